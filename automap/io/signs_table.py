"""Located signs as a table, between geolocation and export (SI units and radians)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.atomic import atomic_path
from automap.io.tables import check_texts
from automap.records import Sign

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


def write_signs(path: Path, signs: Sequence[Sign]) -> None:
    """Write one row per sign to a Parquet file; the file appears whole or not at all.

    Columns are the fields of ``records.Sign`` (``class`` for the class name), the six
    different elements of the ENU covariance in square metres, and ``detection_rows``, the
    rows of ``observations.parquet`` that belong to the sign.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    text, real, whole = pa.string(), pa.float64(), pa.int64()
    columns: dict[str, Any] = {
        "id": pa.array([s.id for s in signs], text),
        "class": pa.array([s.class_name for s in signs], text),
        "lat_rad": pa.array([s.lat_rad for s in signs], real),
        "lon_rad": pa.array([s.lon_rad for s in signs], real),
        "height_m": pa.array([s.height_m for s in signs], real),
    }
    for name, row, column in COVARIANCE_COLUMNS:
        columns[name] = pa.array([float(s.cov_enu[row, column]) for s in signs], real)
    columns |= {
        "confidence": pa.array([s.confidence for s in signs], real),
        "n_views": pa.array([s.n_views for s in signs], whole),
        "first_seen_ns": pa.array([s.first_seen_ns for s in signs], whole),
        "last_seen_ns": pa.array([s.last_seen_ns for s in signs], whole),
        "height_above_road_m": pa.array([s.height_above_road_m for s in signs], real),
        "sd_above_road_m": pa.array([s.sd_above_road_m for s in signs], real),
        "facing_rad": pa.array([s.facing_rad for s in signs], real),
        "facing_sd_rad": pa.array([s.facing_sd_rad for s in signs], real),
        "size_m": pa.array([s.size_m for s in signs], real),
        "side": pa.array([s.side for s in signs], text),
        "status": pa.array([s.status for s in signs], text),
        "drives": pa.array([list(s.drives) for s in signs], pa.list_(text)),
        "existence": pa.array([s.existence for s in signs], real),
        "class_probability": pa.array([s.class_probability for s in signs], real),
        "group_probability": pa.array([s.group_probability for s in signs], real),
        "geoid_m": pa.array([s.geoid_m for s in signs], real),
        "path_offset_m": pa.array([s.path_offset_m for s in signs], real),
        "contrast": pa.array([s.contrast for s in signs], real),
        "contrast_sd": pa.array([s.contrast_sd for s in signs], real),
        "contrast_note": pa.array([s.contrast_note for s in signs], text),
        "seen_share": pa.array([s.seen_share for s in signs], real),
        "n_looked": pa.array([s.n_looked for s in signs], whole),
        "n_back_views": pa.array([s.n_back_views for s in signs], whole),
        "note": pa.array([s.note for s in signs], text),
        "reviewer": pa.array([s.reviewer for s in signs], text),
        "reviewed": pa.array([s.reviewed for s in signs], text),
        "support": pa.array([s.support for s in signs], text),
        "detection_rows": pa.array(
            [np.asarray(s.detection_rows, np.int64).tolist() for s in signs], pa.list_(whole)
        ),
    }
    with atomic_path(path) as temporary:
        pq.write_table(pa.table(columns), temporary)


def read_signs(path: Path) -> list[Sign]:
    """Signs of a file that ``write_signs`` wrote, in its order.

    Raises InputError when the file cannot be read, lacks a column or has a sign beyond the Earth.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # where memory is short Arrow waits for threads that never began
        with pq.ParquetFile(path) as file:
            table = file.read(use_threads=False)
        check_texts(table)
        signs: list[Sign] = []
        names: dict[str, str] = {}
        for piece in table.to_batches(_ROWS):
            signs += [_sign(row, names) for row in piece.to_pylist()]
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError(
            f"{path}: the table of signs cannot be read ({error}); run the geolocate stage again."
        ) from error
    except KeyError as error:
        raise InputError(
            f"{path}: the table of signs lacks the column {error}; run the geolocate stage again."
        ) from error
    for sign in signs:
        # a place that is not known is none
        if abs(sign.lat_rad) > 0.5 * math.pi or abs(sign.lon_rad) > 2.0 * math.pi:
            raise InputError(
                f"{path}: sign {sign.id} lies nowhere on Earth (latitude {sign.lat_rad:.6g}, "
                f"longitude {sign.lon_rad:.6g} rad); run the geolocate stage again."
            )
    return signs


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
        note=row.get("note") or "",
        reviewer=row.get("reviewer") or "",
        reviewed=row.get("reviewed") or "",
        detection_rows=np.array(row["detection_rows"], np.int64),
    )
