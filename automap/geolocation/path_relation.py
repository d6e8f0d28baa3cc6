"""Where a sign stands relative to the vehicle's path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.effects.limits import MOVING_SPEED
from automap.geolocation import limits
from automap.geolocation.trajectory_adjustment import AdjustedTrajectory, Adjustment
from automap.records import FloatArray, IntArray, Trajectory

_STEP_S = 0.05
"""Of the thinned path: a metre at 20 m/s."""


@dataclass(frozen=True)
class Path:
    """The trajectory thinned to some 20 rows a second, in the local frame (NED).

    ``t_ns`` [n], ``position`` [n, 3] m, ``course`` [n] rad (of the velocity, at standstill of
    the vehicle's axis).
    """

    t_ns: IntArray
    position: FloatArray
    course: FloatArray


def make_path(
    trajectory: Trajectory,
    origin: tuple[float, float, float],
    adjustment: Adjustment | None = None,
) -> Path:
    """The path of the IMU origin, put right by an ``adjustment``."""
    step = 1
    if len(trajectory) > 2:
        interval = float(np.median(np.diff(trajectory.t_ns))) * 1e-9
        step = max(1, int(_STEP_S / max(interval, 1e-9)))
    parts = []
    thinned = AdjustedTrajectory(trajectory.at(slice(None, None, step)), adjustment, origin)
    for thin in thinned.pieces():
        height = np.where(np.isfinite(thin.height_m), thin.height_m, origin[2])
        moving = np.hypot(thin.vel_ned[:, 0], thin.vel_ned[:, 1]) > MOVING_SPEED
        course = np.arctan2(thin.vel_ned[:, 1], thin.vel_ned[:, 0])
        place = local_ned(thin.lat_rad, thin.lon_rad, height, origin)
        parts.append((thin.t_ns, place, np.where(moving, course, thin.rpy[:, 2])))
    return Path(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def roads_at(path: Path, position: FloatArray, first_ns: int, last_ns: int) -> FloatArray:
    """Course of the path, rad, the direction to its right [2] (north, east), and how far to the
    right of its tangent and above it a ``position`` [3] is, m: [2, 5], where it passes and where it
    was last seen.

    It passes at the point nearest in plan, among those passed while the sign was in view or shortly
    after: other passes of the same street do not count.
    """
    last = min(int(np.searchsorted(path.t_ns, last_ns)), len(path.t_ns) - 1)
    at = np.array([_nearest(path, position, first_ns, last_ns), last])
    course, offset = path.course[at], position - path.position[at]
    right = np.column_stack([-np.sin(course), np.cos(course)])
    lateral = np.sum(right * offset[:, :2], axis=1)
    return np.column_stack([course, right, lateral, -offset[:, 2]])


def _nearest(path: Path, position: FloatArray, first_ns: int, last_ns: int) -> int:
    start = int(np.searchsorted(path.t_ns, first_ns))
    stop = int(np.searchsorted(path.t_ns, last_ns + int(limits.AFTER_S * 1e9), side="right"))
    start = max(0, min(start, len(path.t_ns) - 1))
    offset = position[:2] - path.position[start : max(stop, start + 1), :2]
    return start + int(np.argmin(np.hypot(offset[:, 0], offset[:, 1])))


def side_of_path(lateral_m: float, height_above_road_m: float) -> str:
    """ "left", "right" or "overhead" as seen along the direction of travel."""
    if (
        height_above_road_m > limits.OVERHEAD_HEIGHT_M
        and abs(lateral_m) < limits.OVERHEAD_LATERAL_M
    ):
        return "overhead"
    return "right" if lateral_m >= 0.0 else "left"
