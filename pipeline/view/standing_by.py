"""What is known of a sign that a reviewer puts beside a path, by a click on the map alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from automap.earth import local_ned
from automap.records import PlacedSign
from automap.review import limits

if TYPE_CHECKING:
    from pipeline.view.drives import MapDrive
    from pipeline.view.viewed_map import ViewedMap

_BESIDE_M = 60.0
"""Further from the path than that its height says nothing of the ground."""
_FACE_M, _FACE_SD_M = 2.2, 0.8
"""Height of a face's middle above the road: plates hang between 1.5 and 3 m, gantries apart."""


def clicked_on_map(shown: ViewedMap, lon_deg: float, lat_deg: float) -> PlacedSign:
    """A sign at a place of the map, good to what a hand does, with height and side by the path."""
    from automap.geolocation.limits import IMU_ABOVE_ROAD_M
    from automap.geolocation.path_relation import make_path, roads_at, side_of_path
    from automap.geolocation.views import map_origin

    variance = limits.HAND_SD_M**2
    bare = PlacedSign(lon_deg, lat_deg, (variance, 0.0, variance, float("nan")))
    drive = _nearest_drive(shown, lon_deg, lat_deg)
    trajectory = None if drive is None else drive.trajectory
    if drive is None or trajectory is None:
        return bare
    origin = map_origin(trajectory)
    at = np.radians([[lat_deg], [lon_deg]])
    position = local_ned(at[0], at[1], np.array([origin[2]]), origin)[0]
    path = make_path(trajectory, origin)
    offset = np.hypot(*(path.position[:, :2] - position[:2]).T)
    k = int(np.argmin(offset))
    if offset[k] > _BESIDE_M:
        return bare
    lateral = float(roads_at(path, position, int(path.t_ns[k]), int(path.t_ns[k]))[0, 3])
    manifest = None if drive.drive is None else drive.drive.manifest.vehicle.imu_above_road_m
    imu_m = IMU_ABOVE_ROAD_M if manifest is None else manifest
    row = min(int(np.searchsorted(trajectory.t_ns, path.t_ns[k])), len(trajectory) - 1)
    height = float(trajectory.height_m[row]) - imu_m + _FACE_M
    sd_u = float(trajectory.sd_pos_ned[row, 2])
    return PlacedSign(
        *(lon_deg, lat_deg),
        (variance, 0.0, variance, sd_u**2 + _FACE_SD_M**2 if np.isfinite(sd_u) else float("nan")),
        height_m=height,
        height_above_road_m=_FACE_M,
        sd_above_road_m=_FACE_SD_M,
        side=side_of_path(lateral, 0.0),
    )


def _nearest_drive(shown: ViewedMap, lon_deg: float, lat_deg: float) -> MapDrive | None:
    """The drive of the nearest sign, of a map of one drive that."""
    if not shown.merged or not len(shown.table):
        return shown.drives[0] if shown.drives else None
    table = shown.table
    far = np.hypot((table.lon_deg - lon_deg) * np.cos(np.radians(lat_deg)), table.lat_deg - lat_deg)
    if not np.isfinite(far).any():
        return None
    seen = table.drives_of(int(np.nanargmin(far)))
    return next((d for d in shown.drives if d.name in seen), None)
