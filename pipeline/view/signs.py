"""The signs of a map as columns, read so that a hundred thousand of them are there at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from automap.errors import InputError
from automap.io import names
from automap.io.tables import floats, read_table
from automap.records import NO_TIME, FloatArray, IntArray, Sign

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class SignTable:
    """Signs [n] of a map before any review. Longitude and latitude in degrees (NaN unknown).

    ``class_index`` and ``status_index`` [n] point into ``classes`` and ``statuses``; the drives
    of sign i are ``drive_members[drive_starts[i]:drive_starts[i + 1]]``, numbers in ``drives``.
    ``rows_starts`` and ``rows_members`` list the rows of ``observations.parquet`` likewise
    (empty where the file does not say). Other lengths in metres, angles in degrees.
    """

    ids: list[str]
    classes: list[str]
    class_index: IntArray
    statuses: list[str]
    status_index: IntArray
    drives: list[str]
    drive_starts: IntArray
    drive_members: IntArray
    rows_starts: IntArray
    rows_members: IntArray
    sides: list[str | None]
    lon_deg: FloatArray
    lat_deg: FloatArray
    height_m: FloatArray
    cov_ee_m2: FloatArray
    cov_en_m2: FloatArray
    cov_nn_m2: FloatArray
    sd_u_m: FloatArray
    confidence: FloatArray
    existence: FloatArray
    facing_deg: FloatArray
    facing_sd_deg: FloatArray
    sd_above_road_m: FloatArray
    size_m: FloatArray
    height_above_road_m: FloatArray
    path_offset_m: FloatArray
    contrast: FloatArray
    contrast_sd: FloatArray
    seen_share: FloatArray
    n_views: IntArray
    n_looked: IntArray
    first_seen_ns: IntArray
    last_seen_ns: IntArray

    def __len__(self) -> int:
        return len(self.ids)

    def class_of(self, row: int) -> str:
        """The name of a sign's class."""
        return self.classes[int(self.class_index[row])]

    def drives_of(self, row: int) -> list[str]:
        """The names of the drives that saw a sign."""
        members = self.drive_members[self.drive_starts[row] : self.drive_starts[row + 1]]
        return [self.drives[k] for k in members.tolist()]

    def observations_of(self, row: int) -> IntArray:
        """Rows of ``observations.parquet`` that belong to a sign."""
        return self.rows_members[self.rows_starts[row] : self.rows_starts[row + 1]]


def read_sign_table(out: Path) -> SignTable | None:
    """The signs of an output folder, None where it has none.

    From the table that geolocation or merging left (in which signs that a review rejected
    still stand), else from the map's own files. Raises InputError for a damaged file.
    """
    for name in (names.SIGNS_RAW, names.SIGNS_TABLE):
        path = out / name
        if path.is_file():
            try:
                with np.errstate(over="ignore", invalid="raise"):
                    return _from_table(read_table(path, ("id", "class")))
            except (KeyError, ValueError, TypeError, FloatingPointError) as error:
                raise InputError(
                    f"{path}: the table of signs cannot be used ({error}); make the map again."
                ) from error
    path = out / names.SIGNS_GEOJSON
    if not path.is_file():
        return None
    from automap.export.geojson import read_signs_geojson

    return table_of(read_signs_geojson(path))


def _from_table(table: pa.Table) -> SignTable:
    n = table.num_rows
    have = set(table.column_names)

    def real(name: str, factor: float = 1.0) -> FloatArray:
        return floats(table, name) * factor if name in have else np.full(n, np.nan)

    def whole(name: str, missing: int) -> IntArray:
        if name not in have:
            return np.full(n, missing, np.int64)
        return np.asarray(table.column(name).fill_null(missing).to_numpy(), np.int64)

    def first_of(*candidates: str) -> str:
        return next((name for name in candidates if name in have), candidates[0])

    degrees = 180.0 / np.pi
    if "lon_rad" in have:
        lon, lat, height = real("lon_rad", degrees), real("lat_rad", degrees), real("height_m")
    else:
        lon, lat, height = _points(table)
    with np.errstate(invalid="ignore"):
        sd_u = real("sd_u_m") if "sd_u_m" in have else np.sqrt(real("cov_uu_m2"))
    facing, facing_sd = (
        real(f"{name}_deg") if f"{name}_deg" in have else real(f"{name}_rad", degrees)
        for name in ("facing", "facing_sd")
    )
    drive_starts, drive_values = _lists(table, "drives")
    drives, drive_members = _indexed(drive_values)
    rows_starts, rows_values = _lists(table, "detection_rows")
    classes, class_index = _indexed(_texts(table, "class"))
    statuses, status_index = _indexed(_texts(table, "status") if "status" in have else ["ok"] * n)
    return SignTable(
        ids=_texts(table, "id"),
        classes=classes,
        class_index=class_index,
        statuses=statuses,
        status_index=status_index,
        drives=drives,
        drive_starts=drive_starts,
        drive_members=drive_members,
        rows_starts=rows_starts,
        rows_members=np.asarray(rows_values, np.int64),
        sides=table.column("side").to_pylist() if "side" in have else [None] * n,
        lon_deg=np.mod(lon + 180.0, 360.0) - 180.0,
        lat_deg=np.where(np.abs(lat) <= 90.0, lat, np.nan),
        height_m=height,
        cov_ee_m2=real("cov_ee_m2"),
        cov_en_m2=real("cov_en_m2"),
        cov_nn_m2=real("cov_nn_m2"),
        sd_u_m=sd_u,
        confidence=real("confidence"),
        existence=real("existence"),
        facing_deg=np.mod(facing, 360.0),
        facing_sd_deg=facing_sd,
        sd_above_road_m=real("sd_above_road_m"),
        size_m=real("size_m"),
        height_above_road_m=real("height_above_road_m"),
        path_offset_m=real("path_offset_m"),
        contrast=real("contrast"),
        contrast_sd=real("contrast_sd"),
        seen_share=real("seen_share"),
        n_views=whole("n_views", 0),
        n_looked=whole("n_looked", 0),
        first_seen_ns=whole(first_of("first_seen_ns", "first_seen_t_ns"), NO_TIME),
        last_seen_ns=whole(first_of("last_seen_ns", "last_seen_t_ns"), NO_TIME),
    )


def _texts(table: pa.Table, name: str) -> list[str]:
    return ["" if value is None else str(value) for value in table.column(name).to_pylist()]


def _indexed(values: Sequence[Any]) -> tuple[list[str], IntArray]:
    """The different values in sorted order and where each value [n] stands among them."""
    known = sorted({str(value) for value in values})
    number = {value: k for k, value in enumerate(known)}
    return known, np.array([number[str(value)] for value in values], np.int64)


def _lists(table: pa.Table, name: str) -> tuple[IntArray, list[Any]]:
    """A column of lists as starts [n + 1] and all members in one list; texts stand for one."""
    import pyarrow as pa

    n = table.num_rows
    if name not in table.column_names:
        return np.zeros(n + 1, np.int64), []
    column = table.column(name)
    if not pa.types.is_list(column.type) and not pa.types.is_large_list(column.type):
        texts = column.to_pylist()
        parts = [str(text).split(", ") if text else [] for text in texts]
        return _starts([len(part) for part in parts]), [item for part in parts for item in part]
    import pyarrow.compute as pc

    lengths = pc.fill_null(pc.list_value_length(column), 0).to_numpy()
    return _starts(lengths), pc.list_flatten(column).to_pylist()


def _starts(lengths: npt.ArrayLike) -> IntArray:
    return np.concatenate([[0], np.cumsum(np.asarray(lengths, np.int64))]).astype(np.int64)


def _points(table: pa.Table) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Longitude, latitude and height [n] of a GeoParquet column of points."""
    import shapely

    points = shapely.from_wkb(table.column("geometry").to_pylist())
    height = shapely.get_z(points)
    return shapely.get_x(points), shapely.get_y(points), np.asarray(height, np.float64)


def table_of(signs: Sequence[Sign]) -> SignTable:
    """Signs as such a table."""
    import pyarrow as pa

    real = pa.float64()
    covariance = np.array([s.cov_enu for s in signs], np.float64).reshape(-1, 3, 3)
    columns: dict[str, Any] = {
        "id": pa.array([s.id for s in signs], pa.string()),
        "class": pa.array([s.class_name for s in signs], pa.string()),
        "status": pa.array([s.status for s in signs], pa.string()),
        "side": pa.array([s.side for s in signs], pa.string()),
        "drives": pa.array([list(s.drives) for s in signs], pa.list_(pa.string())),
        "cov_ee_m2": pa.array(covariance[:, 0, 0], real),
        "cov_en_m2": pa.array(covariance[:, 0, 1], real),
        "cov_nn_m2": pa.array(covariance[:, 1, 1], real),
        "cov_uu_m2": pa.array(covariance[:, 2, 2], real),
        "n_views": pa.array([s.n_views for s in signs], pa.int64()),
        "n_looked": pa.array([s.n_looked for s in signs], pa.int64()),
        "first_seen_ns": pa.array([s.first_seen_ns for s in signs], pa.int64()),
        "last_seen_ns": pa.array([s.last_seen_ns for s in signs], pa.int64()),
    }
    for name in (
        "lon_rad",
        "lat_rad",
        "height_m",
        "confidence",
        "existence",
        "facing_rad",
        "facing_sd_rad",
        "sd_above_road_m",
        "size_m",
        "height_above_road_m",
        "path_offset_m",
        "contrast",
        "contrast_sd",
        "seen_share",
    ):
        columns[name] = pa.array([getattr(s, name) for s in signs], real)
    return _from_table(pa.table(columns))
