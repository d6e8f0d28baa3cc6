"""Signs of a run onto the roads of a layer."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.export.roads import RoadRow, road_rows
from automap.records import NO_TIME, DrivePath
from pipeline.shared.products import RunProducts

_MARGIN_DEG = 0.01
"""Round the path, some kilometre: roads that it may have gone along begin no further."""


def signs_on_roads(products: RunProducts, file: Path) -> tuple[list[RoadRow], str]:
    """Rows of the signs that stand on roads of ``file``, and a sentence about the others ("" none).

    Raises InputError for a file that cannot be used.
    """
    from automap.io.roads_file import read_roads
    from automap.mapping.road_matching import road_positions

    trajectory, signs = products.trajectory, products.signs or []
    if trajectory is None or not len(trajectory):
        raise InputError("There is no trajectory, so no sign has a place on a road.")
    lat, lon = np.degrees(trajectory.lat_rad), np.degrees(trajectory.lon_rad)
    box = (
        float(np.nanmin(lon)) - _MARGIN_DEG,
        float(np.nanmin(lat)) - _MARGIN_DEG,
        float(np.nanmax(lon)) + _MARGIN_DEG,
        float(np.nanmax(lat)) + _MARGIN_DEG,
    )
    roads = read_roads(file, box)
    path = DrivePath(
        np.asarray(trajectory.t_ns, np.float64) * 1e-9,
        trajectory.lat_rad,
        trajectory.lon_rad,
        trajectory.rpy[:, 2],
        trajectory.sd_pos_ned[:, [1, 0, 2]],
    )
    seen = [(_seconds(s.first_seen_ns), _seconds(s.last_seen_ns)) for s in signs]
    positions, matched = road_positions(path, roads, signs, seen)
    texts = []
    share = float(np.mean(matched.segment < 0))
    if share > 0.0:
        texts.append(f"{100 * share:.0f} % of the path are on none of its roads")
    lost = sum(at is None for at in positions)
    if lost:
        texts.append(f"{lost} of {len(signs)} signs have no place on one")
    told = f"{file}: {' and '.join(texts)}." if texts else ""
    return road_rows(signs, positions, roads), told


def _seconds(stamp: int) -> float:
    return math.nan if stamp == NO_TIME else stamp * 1e-9
