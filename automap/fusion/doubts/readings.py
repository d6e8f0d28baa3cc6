"""Readings of an IMU that no drive makes: frozen, clipped, or wild for a moment."""

from __future__ import annotations

import numpy as np

from automap.fusion import limits
from automap.fusion.doubts.reason import Reason, Span
from automap.records import BoolArray, FloatArray, ImuData, IntArray


def reading_doubts(imu: ImuData, speed: FloatArray) -> list[Reason]:
    """What is wrong with single readings; ``speed`` [n] m/s of the vehicle at each of them."""
    if len(imu) < limits.LEAST_JUDGED:
        return []
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    moving = speed > limits.DRIVING_SPEED
    return [*_frozen(t, imu, moving), *_clipped(t, imu), *_wild(t, imu)]


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last sample of each run, of which every sample but the first is ``same``
    [n - 1] as the one before it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return edges[::2], edges[1::2]


def _frozen(t: FloatArray, imu: ImuData, moving: BoolArray) -> list[Reason]:
    """Stretches of driving in which all readings, or those of one axis, stay the same."""
    values = np.column_stack([imu.gyro, imu.accel])
    same = (np.diff(values, axis=0) == 0.0) & moving[1:, None]
    for what, repeats, least in (
        ("the IMU's readings", same.all(axis=1)[:, None], limits.FROZEN_S),
        ("readings of one axis of the IMU", same, limits.FROZEN_AXIS_S),
    ):
        spans: list[Span] = []
        for column in repeats.T:
            first, last = _runs(column)
            long = t[last] - t[first] >= least
            spans += zip(t[first[long]].tolist(), t[last[long]].tolist(), strict=True)
        if spans:
            seconds = sum(b - a for a, b in spans)
            return [
                Reason(
                    "imu_frozen",
                    f"{what} stay the same for {seconds:.1f} s of driving: the sensor or its "
                    "logging hung; look for a loose plug or a full buffer",
                    tuple(sorted(set(spans))),
                    inertial=True,
                )
            ]
    return []


def _clipped(t: FloatArray, imu: ImuData) -> list[Reason]:
    """A channel whose largest readings are all the same, and follow each other: its range ends
    there."""
    # a slow sensor in a quick log says all of it again
    both = np.column_stack([imu.gyro, imu.accel])
    fresh = np.concatenate([[True], (np.diff(both, axis=0) != 0.0).any(axis=1)])
    t, both = t[fresh], both[fresh]
    for what, unit, values in (
        ("gyro", "rad/s", both[:, :3]),
        ("accelerometer", "m/s^2", both[:, 3:]),
    ):
        for axis in range(3):
            size = np.abs(values[:, axis])
            # noise goes on at any value but the last of the range
            at_end = size >= size.max()
            first, last = _runs(at_end[1:] & at_end[:-1])
            long = last - first >= limits.CLIPPED_STEPS
            if not long.any() or size.max() == 0.0:
                continue
            spans = tuple(zip(t[first[long]].tolist(), t[last[long]].tolist(), strict=True))
            seconds = sum(b - a for a, b in spans)
            return [
                Reason(
                    "imu_clipped",
                    f"the {what}'s axis {'xyz'[axis]} stays at {size.max():.3g} {unit}, the end of "
                    f"its range, for {seconds:.1f} s: choose a larger range",
                    spans,
                    inertial=True,
                )
            ]
    return []


def _wild(t: FloatArray, imu: ImuData) -> list[Reason]:
    """Few readings beyond all that moves a vehicle."""
    for what, unit, values, most in (
        ("gyro", "rad/s", imu.gyro, limits.MOST_RATE),
        ("accelerometer", "m/s^2", imu.accel, limits.MOST_FORCE),
    ):
        size = np.abs(values).max(axis=1)
        rows = np.flatnonzero(size > most)
        if 0 < len(rows) <= limits.WILD_SHARE * len(t):
            near = limits.STRETCHES_S[0]
            first = rows[np.concatenate([[True], np.diff(t[rows]) > near])]
            return [
                Reason(
                    "imu_wild",
                    f"{len(rows)} reading{'s' if len(rows) > 1 else ''} of the IMU's {what}, up to "
                    f"{size.max():.3g} {unit}, {'are' if len(rows) > 1 else 'is'} no motion of a "
                    "vehicle: take them out, and look for a loose plug",
                    tuple((float(t[row]) - near, float(t[row]) + near) for row in first),
                    inertial=True,
                )
            ]
    return []
