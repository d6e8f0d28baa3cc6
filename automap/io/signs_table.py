"""Located signs as a table, between geolocation and export (SI units and radians)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.atomic import atomic_path
from automap.io.tables import check_texts, write_row_groups
from automap.records import Sign
from automap.records.sign_lists import Names, SignList, joined_names, values_of

COVARIANCE_COLUMNS = (
    ("cov_ee_m2", 0, 0),
    ("cov_en_m2", 0, 1),
    ("cov_eu_m2", 0, 2),
    ("cov_nn_m2", 1, 1),
    ("cov_nu_m2", 1, 2),
    ("cov_uu_m2", 2, 2),
)
"""Column name, row and column of the ENU covariance."""
_ROWS = 4096
"""Of a table that are records at once: as such they are ten times as large."""


ROW_GROUP = 65_536
"""Signs written at once, and a row group of their file."""
_DETECTIONS = "detection_rows"
_TEXT, _REAL, _WHOLE = "string", "double", "int64"
_COLUMNS = (
    ("id", "id", _TEXT), ("class", "class_name", _TEXT), ("lat_rad", "lat_rad", _REAL),
    ("lon_rad", "lon_rad", _REAL), ("height_m", "height_m", _REAL), ("", "cov_enu", ""),
    ("confidence", "confidence", _REAL), ("n_views", "n_views", _WHOLE),
    ("first_seen_ns", "first_seen_ns", _WHOLE), ("last_seen_ns", "last_seen_ns", _WHOLE),
    ("height_above_road_m", "height_above_road_m", _REAL),
    ("sd_above_road_m", "sd_above_road_m", _REAL), ("facing_rad", "facing_rad", _REAL),
    ("facing_sd_rad", "facing_sd_rad", _REAL), ("size_m", "size_m", _REAL),
    ("side", "side", _TEXT), ("status", "status", _TEXT), ("drives", "drives", "texts"),
    ("existence", "existence", _REAL), ("class_probability", "class_probability", _REAL),
    ("group_probability", "group_probability", _REAL), ("geoid_m", "geoid_m", _REAL),
    ("path_offset_m", "path_offset_m", _REAL), ("contrast", "contrast", _REAL),
    ("contrast_sd", "contrast_sd", _REAL), ("contrast_note", "contrast_note", _TEXT),
    ("seen_share", "seen_share", _REAL), ("n_looked", "n_looked", _WHOLE),
    ("n_back_views", "n_back_views", _WHOLE), ("by_size_e_m", "by_size_e_m", _REAL),
    ("by_size_n_m", "by_size_n_m", _REAL), ("by_size_u_m", "by_size_u_m", _REAL),
    ("note", "note", _TEXT),
    ("reviewer", "reviewer", _TEXT), ("reviewed", "reviewed", _TEXT),
    ("support", "support", _TEXT), (_DETECTIONS, _DETECTIONS, "wholes"),
)  # fmt: skip
"""Columns of the file, the fields of ``records.Sign`` that they hold, and their kinds."""


def write_signs(path: Path, signs: Sequence[Sign]) -> None:
    """Write one row per sign to a Parquet file; the file appears whole or not at all.

    Columns are the fields of ``records.Sign`` (``class`` for the class name), the six
    different elements of the ENU covariance in square metres, and ``detection_rows``, the
    rows of ``observations.parquet`` that belong to the sign.
    """
    parts = (signs[k : k + ROW_GROUP] for k in range(0, max(len(signs), 1), ROW_GROUP))
    with atomic_path(path) as temporary:
        write_row_groups(temporary, map(_table, parts), ROW_GROUP)


def _table(signs: Sequence[Sign]) -> Any:
    import pyarrow as pa

    kinds: dict[str, Any] = {_TEXT: pa.string(), _REAL: pa.float64(), _WHOLE: pa.int64()}
    kinds |= {"texts": pa.list_(kinds[_TEXT]), "wholes": pa.list_(kinds[_WHOLE])}
    columns: dict[str, Any] = {}
    for name, field, kind in _COLUMNS:
        found = _values(signs, field)
        if kind:
            listed = found if isinstance(found, list | np.ndarray) else list(found)
            columns[name] = pa.array(listed, kinds[kind])
            continue
        covariance = np.asarray(found, np.float64).reshape(-1, 3, 3)
        columns |= {each: pa.array(covariance[:, i, j]) for each, i, j in COVARIANCE_COLUMNS}
    return pa.table(columns)


def _values(signs: Sequence[Sign], field: str) -> Any:
    found = values_of(signs, field)
    return [np.asarray(own, np.int64).tolist() for own in found] if field == _DETECTIONS else found


def sign_values(table: Any, field: str) -> Any:
    """The column [n] of a field of ``records.Sign`` in a table, or a piece of one, that
    ``write_signs`` wrote: an array of numbers or a list."""
    name, kind = next((name, kind) for name, own, kind in _COLUMNS if own == field)
    if field == "cov_enu":
        covariance = np.empty((len(table), 3, 3))
        for name, i, j in COVARIANCE_COLUMNS:
            covariance[:, i, j] = covariance[:, j, i] = table[name].to_numpy()
        return covariance
    if kind in (_REAL, _WHOLE):
        return table[name].to_numpy()
    column = table[name]
    column = column.combine_chunks() if hasattr(column, "combine_chunks") else column
    # very many signs have their texts in common
    if kind == _TEXT:
        return _texts(column)
    edges = column.offsets.to_pylist()
    items = _texts(column.values) if kind == "texts" else column.values.to_pylist()
    return [tuple(items[lo:hi]) for lo, hi in pairwise(edges)]


def _texts(column: Any) -> list[str]:
    coded = column.dictionary_encode()
    known = np.array([*coded.dictionary.to_pylist(), None], object)[:-1]
    return list(known[coded.indices.to_numpy(zero_copy_only=False)].tolist())


def sign_pieces(path: Path, rows: int, fields: Sequence[str] = ()) -> Iterator[Any]:
    """Pieces of up to so many rows of a file that this version wrote, with the columns of some
    ``fields``, or with all."""
    import pyarrow.parquet as pq

    names = [name for name, field, _ in _COLUMNS if name and (not fields or field in fields)]
    if not fields or "cov_enu" in fields:
        names += [name for name, _, _ in COVARIANCE_COLUMNS]
    with pq.ParquetFile(path) as file:
        yield from file.iter_batches(rows, columns=names, use_threads=False)


class SignRows:
    """Rows of a file that this version wrote, a row group of which is in memory at a time."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, (0, 0)
        self._group: Any = None

    def between(self, lo: int, hi: int) -> Any:
        """The table of rows ``lo`` to ``hi``, one at least."""
        import pyarrow as pa

        parts = []
        while lo < hi:
            if not self._at[0] <= lo < self._at[1]:
                self._load(lo // ROW_GROUP)
            first, stop = self._at
            parts.append(self._group.slice(lo - first, min(hi, stop) - lo))
            lo = min(hi, stop)
        return pa.concat_tables(parts)

    def _load(self, number: int) -> None:
        import pyarrow.parquet as pq

        self._group = None
        with pq.ParquetFile(self._path) as file:
            self._group = file.read_row_group(number, use_threads=False)
        self._at = number * ROW_GROUP, number * ROW_GROUP + len(self._group)


def first_signs(path: Path, count: int) -> list[Sign]:
    """The first signs of a file that this version wrote."""
    found: list[Sign] = []
    names: dict[str, str] = {}
    for piece in sign_pieces(path, max(count, 1)):
        found += [_sign(row, names) for row in piece.slice(0, count - len(found)).to_pylist()]
        if len(found) >= count:
            break
    return found


def read_signs(path: Path) -> list[Sign]:
    """Signs of a file that ``write_signs`` wrote, in its order.

    Raises InputError when the file cannot be read, lacks a column or has a sign beyond the Earth.
    """
    import pyarrow.parquet as pq

    signs: list[Sign] = []
    names: dict[str, str] = {}
    # where memory is short Arrow waits for threads that never began
    with _told(path), pq.ParquetFile(path) as file:
        table = file.read(use_threads=False)
        check_texts(table)
        for piece in table.to_batches(_ROWS):
            signs += [_sign(row, names) for row in piece.to_pylist()]
    _check_places(path, signs)
    return signs


def read_sign_list(path: Path) -> SignList:
    """The same of very many signs, without the rows of their detections."""
    found: dict[str, list[Any]] = {}
    with _told(path):
        if next(sign_pieces(path, 1), None) is None:
            return SignList({f.name: [] for f in fields(Sign)}, np.zeros((0, 3, 3)))
        for piece in sign_pieces(path, ROW_GROUP):
            check_texts(piece)
            for name, field, _ in _COLUMNS:
                # runs of earlier versions lack some, which a record has by default
                if field not in (_DETECTIONS, "drives") and name in {"", *piece.schema.names}:
                    found.setdefault(field, []).append(sign_values(piece, field))
            found.setdefault("drives", []).append(_names(piece["drives"]))
        covariance = np.concatenate(found.pop("cov_enu"))
        columns: dict[str, Any] = {"drives": joined_names(found.pop("drives"))}
        for field, parts in found.items():
            many = isinstance(parts[0], list)
            columns[field] = (
                [text or "" for part in parts for text in part] if many else np.concatenate(parts)
            )
        signs = SignList(columns, covariance)
        if lacking := signs.lacking():
            raise KeyError(lacking)
        strange = (np.abs(columns["lat_rad"]) > 0.5 * math.pi) | (
            np.abs(columns["lon_rad"]) > 2.0 * math.pi
        )
    _check_places(path, [signs[k] for k in np.flatnonzero(strange).tolist()])
    return signs


def _names(column: Any) -> Names:
    coded = column.values.dictionary_encode()
    code = np.asarray(coded.indices, np.int64)
    return Names(coded.dictionary.to_pylist(), code, np.asarray(column.offsets, np.int64))


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """What is wrong with a table of signs as InputError."""
    import pyarrow as pa

    try:
        yield
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: the table of signs cannot be read ({error}); run the geolocate stage again."
        ) from error
    except KeyError as error:
        raise InputError(
            f"{path}: the table of signs lacks the column {error}; run the geolocate stage again."
        ) from error


def _check_places(path: Path, signs: Sequence[Sign]) -> None:
    for sign in signs:
        # a place that is not known is none
        if abs(sign.lat_rad) > 0.5 * math.pi or abs(sign.lon_rad) > 2.0 * math.pi:
            raise InputError(
                f"{path}: sign {sign.id} lies nowhere on Earth (latitude {sign.lat_rad:.6g}, "
                f"longitude {sign.lon_rad:.6g} rad); run the geolocate stage again."
            )


def _sign(row: dict[str, Any], names: dict[str, str]) -> Sign:
    """A sign of a row; ``names`` of drives and classes, which very many signs have in common."""
    covariance = np.empty((3, 3))
    for name, i, j in COVARIANCE_COLUMNS:
        covariance[i, j] = covariance[j, i] = row[name]
    return Sign(
        id=row["id"],
        class_name=names.setdefault(row["class"], row["class"]),
        lat_rad=row["lat_rad"],
        lon_rad=row["lon_rad"],
        height_m=row["height_m"],
        cov_enu=covariance,
        confidence=row["confidence"],
        n_views=row["n_views"],
        first_seen_ns=row["first_seen_ns"],
        last_seen_ns=row["last_seen_ns"],
        height_above_road_m=row["height_above_road_m"],
        sd_above_road_m=row.get("sd_above_road_m", float("nan")),
        facing_rad=row["facing_rad"],
        facing_sd_rad=row.get("facing_sd_rad", float("nan")),
        size_m=row["size_m"],
        side=row["side"],
        status=row["status"],
        drives=tuple([names.setdefault(drive, drive) for drive in row["drives"]]),
        support=row.get("support") or "",
        existence=row.get("existence", float("nan")),
        class_probability=row.get("class_probability", float("nan")),
        group_probability=row.get("group_probability", float("nan")),
        geoid_m=row.get("geoid_m", float("nan")),
        path_offset_m=row.get("path_offset_m", float("nan")),
        contrast=row.get("contrast", float("nan")),
        contrast_sd=row.get("contrast_sd", float("nan")),
        contrast_note=row.get("contrast_note") or "",
        seen_share=row.get("seen_share", float("nan")),
        n_looked=row.get("n_looked") or 0,
        n_back_views=row.get("n_back_views") or 0,
        by_size_e_m=row.get("by_size_e_m", float("nan")),
        by_size_n_m=row.get("by_size_n_m", float("nan")),
        by_size_u_m=row.get("by_size_u_m", float("nan")),
        note=row.get("note") or "",
        reviewer=row.get("reviewer") or "",
        reviewed=row.get("reviewed") or "",
        detection_rows=np.array(row["detection_rows"], np.int64),
    )
