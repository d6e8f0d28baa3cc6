"""Which drives should have seen a sign: in front of a camera, near enough, its face to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from automap.mapping.grid import CELL_M, delta, empty_table, fill_table, neighbours
from automap.mapping.sightings import CameraView, DrivePath, DriveSigns
from automap.records import FloatArray, IntArray

NEAREST_M = 7.0
FARTHEST_M = 30.0
"""Between these distances a sign in the picture is large enough and not yet cut off."""
FACE_LIMIT = 1.05
"""Angle at which a face is still read, rad."""
EDGE_SHARE = 0.9
"""Part of half the field of view within which a sign counts as in the picture."""
LEAST_ROWS = 2
"""Rows of the path, some metres apart, from which a sign must have been in view."""

DEFAULT_CAMERA = CameraView(0.0, 0.5)
LATERAL_EDGES_M = (6.0, 12.0, 20.0)
"""Bounds of the classes of distance across the road, each with a detection rate of its own."""


@dataclass(frozen=True)
class Opportunities:
    """Pairs [p] of a sign and a drive that had it in view: ``sign``, ``drive``, and the class
    ``lateral`` of the distance across the road, ordered by drive, then sign."""

    sign: IntArray
    drive: IntArray
    lateral: IntArray

    def __len__(self) -> int:
        return len(self.sign)


def opportunities(
    drives: Sequence[DriveSigns], lat: FloatArray, lon: FloatArray, facing: FloatArray
) -> Opportunities:
    """Which of the signs [m] each drive had in view, by its path and its cameras.

    Positions in rad; a sign whose ``facing`` is NaN can be seen from all sides. A drive
    without a path or without cameras says nothing.
    """
    table = empty_table(len(lat))
    fill_table(table, lat, lon)
    parts: list[tuple[IntArray, IntArray, IntArray]] = []
    for number, drive in enumerate(drives):
        if drive.path is None or len(drive.path) == 0 or not drive.cameras or not len(lat):
            continue
        seen, lateral = in_view(drive.path, drive.cameras, table, lat, lon, facing)
        parts.append((seen, np.full(len(seen), number, np.int64), lateral))
    if not parts:
        none = np.zeros(0, np.int64)
        return Opportunities(none, none, none)
    sign, drive_number, lateral = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return Opportunities(sign, drive_number, lateral)


def in_view(
    path: DrivePath,
    cameras: Sequence[CameraView],
    table: tuple[IntArray, IntArray, IntArray],
    lat: FloatArray,
    lon: FloatArray,
    facing: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Signs in view from a path, ascending, and their lateral class; ``table`` holds them."""
    from automap.earth import metres_per_radian

    per_lat, per_lon = metres_per_radian(path.lat_rad, 0.0)
    views = np.array([[c.yaw_rad, EDGE_SHARE * c.half_angle_rad] for c in cameras])
    count = np.zeros(len(lat), np.int64)
    across = np.full(len(lat), np.inf)
    touched = np.empty(len(lat), np.int64)
    n = _look(
        path.lat_rad, path.lon_rad, path.yaw_rad, per_lat, per_lon, views, *table,
        lat, lon, facing, count, across, touched,
    )  # fmt: skip
    seen = np.sort(touched[:n])
    seen = seen[count[seen] >= LEAST_ROWS]
    lateral = np.searchsorted(np.array(LATERAL_EDGES_M), across[seen])
    return seen, lateral.astype(np.int64)


@njit(cache=True, error_model="numpy")
def _look(
    car_lat: FloatArray,
    car_lon: FloatArray,
    yaw: FloatArray,
    per_lat: FloatArray,
    per_lon: FloatArray,
    views: FloatArray,
    head: IntArray,
    following: IntArray,
    cells: IntArray,
    lat: FloatArray,
    lon: FloatArray,
    facing: FloatArray,
    count: IntArray,
    across: FloatArray,
    touched: IntArray,
) -> int:
    """Count the rows of a path from which each sign is in view; returns how many signs are.

    ``across`` gets the smallest distance from the car's axis, ``touched`` the signs seen.
    """
    reach = int(np.ceil(FARTHEST_M / CELL_M))
    near = np.empty(4096, np.int64)
    n = 0
    for row in range(len(car_lat)):
        if not (car_lat[row] == car_lat[row] and yaw[row] == yaw[row]):
            continue
        found = neighbours(head, following, cells, car_lat[row], car_lon[row], reach, near)
        for place in range(found):
            k = near[place]
            east, north = delta(
                lat[k], lon[k], car_lat[row], car_lon[row], per_lat[row], per_lon[row]
            )
            distance = np.hypot(east, north)
            if distance < NEAREST_M or distance > FARTHEST_M:
                continue
            azimuth = np.arctan2(east, north)
            # NaN compares false: a face of unknown direction is seen from everywhere
            if abs(_turn(azimuth + np.pi - facing[k])) > FACE_LIMIT:
                continue
            for camera in range(len(views)):
                if abs(_turn(azimuth - yaw[row] - views[camera, 0])) < views[camera, 1]:
                    if count[k] == 0:
                        touched[n] = k
                        n += 1
                    count[k] += 1
                    across[k] = min(across[k], distance * abs(np.sin(azimuth - yaw[row])))
                    break
    return n


@njit(cache=True, error_model="numpy")
def _turn(angle: float) -> float:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
