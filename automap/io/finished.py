"""A finished trajectory from other software: the record, and what its files leave out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.earth import metres_per_radian
from automap.errors import InputError
from automap.frames import wrap_pi
from automap.io.stamps import order_stamps
from automap.records import FloatArray, IntArray, Trajectory

DEFAULT_SD_M = 0.1
DEFAULT_SD_M_S = 0.1
DEFAULT_SD_DEG = 0.1
_LEVEL_SD_DEG = 3.0
"""A vehicle taken as level: slope of the road and springs."""
_SLIP_SD_DEG = 2.0
"""A vehicle taken as heading along its course."""
_SLOWEST_M_S = 1.0
"""Below this the course says nothing about the heading,"""
_SURE = 5.0
"""nor where the speed is less than so many times its own sd."""
_MAX_YAW_SD = np.pi / np.sqrt(3.0)
"""That of a heading nobody knows."""


@dataclass(frozen=True)
class FinishedTrajectory:
    """A trajectory as given; ``time`` says which stamps the file had: "t_ns", "gps_s" or
    "both". The missing kind is ``gps_s`` NaN, or ``t_ns`` made from ``gps_s`` (nanoseconds
    of GPS time)."""

    data: Trajectory
    time: str
    warnings: tuple[str, ...]


def kept_in_time(
    path: Path, t_ns: IntArray, total: int, again: str, warnings: list[str]
) -> IntArray:
    """Which of the usable rows, with stamps [k], to keep so that time increases.

    What is left out of the ``total`` rows is said in ``warnings``. Raises InputError when fewer
    than two are left; ``again`` says what to do then.
    """
    order = order_stamps(t_ns) if len(t_ns) else None
    if order is None or len(order.keep) < 2:
        raise InputError(
            f"{path} has fewer than two rows with a time and a position on Earth; {again} again."
        )
    if len(order.keep) < total:
        warnings.append(
            f"{path}: {total - len(order.keep)} rows without a position, or whose time repeats or "
            "jumps, left out"
        )
    return order.keep


def given_or(values: FloatArray, default: float) -> FloatArray:
    """Standard deviations, the default where one is missing or not positive."""
    with np.errstate(invalid="ignore"):
        return np.where(values > 0, values, default)


def differenced_velocity(
    seconds: FloatArray, lat: FloatArray, lon: FloatArray, height: FloatArray
) -> FloatArray:
    """Velocity NED [n, 3] in m/s from positions [n] (rad, rad, m) at ``seconds`` [n]."""
    north, east = metres_per_radian(lat, height)
    rates = [np.gradient(values, seconds) for values in (lat, np.unwrap(lon), height)]
    return np.column_stack([rates[0] * north, rates[1] * east, -rates[2]])


def course_attitude(
    path: Path, velocity: FloatArray, velocity_sd: FloatArray
) -> tuple[FloatArray, FloatArray, str]:
    """Attitude of a level vehicle that heads along its course, its sd [n, 3] in rad, a warning.

    At standstill the heading is held; if the vehicle then leaves in another direction it turned
    at some instant between, which its sd holds. Raises InputError when it never moves.
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    speed_sd = np.hypot(velocity_sd[:, 0], velocity_sd[:, 1]) / np.sqrt(2.0)
    moving = np.flatnonzero((speed > _SLOWEST_M_S) & (speed > _SURE * speed_sd))
    if not len(moving):
        raise InputError(
            f"{path} has no attitude and never moves faster than {_SLOWEST_M_S:g} m/s, so the "
            "heading is unknown; add roll_deg, pitch_deg, yaw_deg."
        )
    rows = np.arange(len(speed))
    after = np.searchsorted(moving, rows)
    before = moving[np.maximum(np.searchsorted(moving, rows, side="right") - 1, 0)]
    following = moving[np.minimum(after, len(moving) - 1)]
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    # before it first moves the vehicle heads where it will go
    yaw = course[before]
    turned = np.asarray(wrap_pi(course[following] - yaw))
    across = speed_sd[before] / speed[before]
    yaw_sd = np.sqrt(np.radians(_SLIP_SD_DEG) ** 2 + across**2 + turned**2 / 3.0)
    zero = np.zeros(len(rows))
    level_sd = np.full(len(rows), np.radians(_LEVEL_SD_DEG))
    warning = (
        f"{path} has no complete attitude; the vehicle is taken as level, to {_LEVEL_SD_DEG:g} "
        f"deg, and heading along its course, to {_SLIP_SD_DEG:g} deg and what its velocity allows"
    )
    return (
        np.column_stack([zero, zero, yaw]),
        np.column_stack([level_sd, level_sd, np.minimum(yaw_sd, _MAX_YAW_SD)]),
        warning,
    )
