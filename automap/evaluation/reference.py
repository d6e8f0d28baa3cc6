"""Whether a reference's velocities are those of its own positions, and its headings theirs."""

from __future__ import annotations

import numpy as np

from automap.evaluation.trajectory_errors import TrajectoryErrors, position_difference_ned, rms
from automap.fusion.limits import DRIVING_SPEED
from automap.records import NO_TIME, FloatArray, Trajectory

WINDOW_S = 60.0
"""Velocities are summed over so much: positions good to a decimetre tell their mean to 2 mm/s."""
MOST_STEP_S = 1.0
"""Between rows further apart a sum of velocities is no way: braking by 3 m/s^2 is 0.4 m in it."""
LEAST_ROWS = 100
"""A minute in which fewer steps are known says nothing of its mean."""
MOST_SLIP_DEG = 20.0
"""No vehicle on wheels goes so far off its nose for half of its driving. Chosen: tyres let go at
some ten degrees, and a quarter or half a turn, or a radian for a degree, is beyond it."""


def velocity_apart(truth: Trajectory) -> FloatArray:
    """By how much velocities NED [n, 3] m/s of a reference differ from the change of its positions
    in the ``WINDOW_S`` round about; NaN where that is not known.

    The two are one motion. Where they differ the velocities were taken in other axes or other
    metres than the positions (a plane that touches the Earth elsewhere), or positions drift.
    """
    apart = np.full((len(truth), 3), np.nan)
    timed = len(truth) > 0 and truth.t_ns[0] != NO_TIME
    t = np.asarray((truth.t_ns - truth.t_ns[0]) * 1e-9 if timed else truth.gps_s, np.float64)
    if len(t) < LEAST_ROWS:
        return apart
    lat, lon, height = truth.lat_rad, truth.lon_rad, truth.height_m
    way = position_difference_ned(lat[1:], lon[1:], height[1:], lat[:-1], lon[:-1], height[:-1])
    step = np.diff(t)
    off = 0.5 * (truth.vel_ned[1:] + truth.vel_ned[:-1]) * step[:, None] - way
    near = (step > 0.0) & (step <= MOST_STEP_S)
    first = np.searchsorted(t[1:], t - 0.5 * WINDOW_S)
    last = np.searchsorted(t[1:], t + 0.5 * WINDOW_S)
    for axis in range(3):
        known = near & np.isfinite(off[:, axis])
        metres = np.concatenate([[0.0], np.cumsum(np.where(known, off[:, axis], 0.0))])
        seconds = np.concatenate([[0.0], np.cumsum(np.where(known, step, 0.0))])
        many = np.concatenate([[0], np.cumsum(known)])
        told = many[last] - many[first] >= LEAST_ROWS
        apart[told, axis] = (
            ((metres[last] - metres[first])[told]) / ((seconds[last] - seconds[first])[told])
        )
    return apart


def nose_off(truth: Trajectory) -> float | None:
    """Median angle, deg, between the headings of a reference and the courses of its own velocities;
    None where too few of both are told."""
    north, east = truth.vel_ned[:, 0], truth.vel_ned[:, 1]
    off = np.arctan2(east, north) - truth.rpy[:, 2]
    off = off[np.isfinite(off) & (np.hypot(north, east) > DRIVING_SPEED)]
    if len(off) < LEAST_ROWS:
        return None
    return float(np.degrees(np.median(np.abs(np.angle(np.exp(1j * off))))))


def contradiction(truth: Trajectory, errors: TrajectoryErrors) -> str | None:
    """A sentence where a reference contradicts itself by more than what it is to judge is said to
    err by; ``errors`` those of the path against it."""
    apart = velocity_apart(truth)
    compared = np.isfinite(errors.error[:, 3:6])
    told = []
    for axis, name in enumerate(("vn", "ve", "vd")):
        rows = compared[:, axis] & np.isfinite(apart[:, axis])
        own, stated = rms(apart[rows, axis]), rms(errors.sd[rows, 3 + axis])
        if own is not None and stated is not None and own > stated:
            told.append(f"{name} by {own:.3f} m/s")
    sentences = []
    if told:
        sentences.append(
            "the truth's velocities differ over a minute from the change of its positions, "
            f"{' and '.join(told)}, which is more than the path states: figures of velocity, and "
            "of heading where that is the course, are the truth's; make its velocities of its "
            "positions, unless it is these that drift"
        )
    nose = nose_off(truth)
    if nose is not None and nose > MOST_SLIP_DEG:
        sentences.append(
            f"half of the time the truth's vehicle goes {nose:.0f} deg or more off its nose, as no "
            "vehicle does: its attitude is to be in degrees, the yaw clockwise from north, and "
            "figures of attitude are none until then"
        )
    return "; ".join(sentences) or None
