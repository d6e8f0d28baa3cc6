"""What a store's map has of every sighting, and of where cameras looked, written cell by cell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from automap.earth import metres_per_radian
from automap.io.map_tables import write_coverage
from automap.mapping.cells import quadkey
from automap.records import DrivePath, FloatArray, IntArray
from pipeline.merge.cell_map import StoreMap
from pipeline.merge.cell_steps import members
from pipeline.merge.cell_store import Drives, occupied
from pipeline.merge.coverage import cover


def write_sightings(
    path: Path, cells: Path, found: StoreMap, drives: Drives, ids: Sequence[str]
) -> IntArray:
    """Write the sightings cell by cell; of each drive [d, 2] how many there are, and how many are
    of signs in the map."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    counts = np.zeros((len(drives), 2), np.int64)
    in_map = np.array([bool(name) for name in ids], np.bool_)
    keys, names = pa.array(drives.key), pa.array(drives.name)
    sign_ids = pa.array([name or None for name in ids], pa.string())
    writer = None
    try:
        for cell in members(cells, found.homes):
            counts[:, 0] += np.bincount(cell.drive, minlength=len(drives))
            counts[:, 1] += np.bincount(cell.drive[in_map[cell.sign]], minlength=len(drives))
            north, east = metres_per_radian(cell.place[:, 0], np.nan_to_num(cell.place[:, 2]))
            turn = (cell.place[:, 1] - found.lon[cell.sign] + np.pi) % (2 * np.pi) - np.pi
            residual = np.column_stack([
                turn * east, (cell.place[:, 0] - found.lat[cell.sign]) * north,
                cell.place[:, 2] - found.height[cell.sign],
            ]) - cell.offset  # fmt: skip
            who, own = keys.take(pa.array(cell.drive)), pa.array(cell.id, pa.string())
            table = pa.table(
                {
                    "key": pc.binary_join_element_wise(who, own, "|"),
                    "drive": names.take(pa.array(cell.drive)),
                    "drive_key": who,
                    "drive_row": cell.row,
                    "drive_sign": own,
                    "class": pa.array(cell.class_name, pa.string()),
                    "sign_id": sign_ids.take(pa.array(cell.sign)),
                    "lat_deg": np.degrees(cell.place[:, 0]),
                    "lon_deg": np.degrees(cell.place[:, 1]),
                    "height_m": cell.place[:, 2],
                    "existence": found.existence[cell.sign],
                }
                | {f"offset_{axis}_m": cell.offset[:, k] for k, axis in enumerate("enu")}
                | {f"residual_{axis}_m": residual[:, k] for k, axis in enumerate("enu")}
            )
            if writer is None:
                writer = pq.ParquetWriter(path, table.schema, compression="zstd")
            writer.write_table(table)
    finally:
        if writer is not None:
            writer.close()
    return counts


def write_looked(path: Path, cells: Path, drives: Drives) -> dict[str, float]:
    """Write where the cameras looked; when each cell was passed last, in GPS seconds."""
    parts, last = [], {}
    for cell in occupied(cells).tolist():
        looked, passed = cover(cells, drives, cell)
        parts.append(looked)
        if np.isfinite(passed):
            last[quadkey(cell)] = passed

    def column(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    rows = np.zeros(sum(map(len, parts)))
    turn = np.zeros((len(rows), 3))
    write_coverage(
        path, DrivePath(rows, column("lat_rad"), column("lon_rad"), column("yaw_rad"), turn)
    )
    return last
