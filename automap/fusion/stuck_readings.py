"""Axes of an IMU that stand still: at one value, or at the end of their range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.fusion import limits
from automap.records import BoolArray, FloatArray, ImuData, IntArray


@dataclass(frozen=True)
class StuckAxis:
    """An axis, as the column that has it (gx .. az), the ``value`` (rad/s or m/s^2) that it keeps,
    without a sign where it is the end of its range, and the ``spans`` in which it does, s from the
    first reading."""

    column: str
    value: float
    spans: tuple[tuple[float, float], ...]

    @property
    def seconds(self) -> float:
        """Length of all spans."""
        return sum(b - a for a, b in self.spans)


def frozen_axes(imu: ImuData, counted: BoolArray) -> list[StuckAxis]:
    """Axes whose readings stay the same for ``FROZEN_AXIS_S`` of those that are ``counted`` [n]."""
    t, values = _seconds(imu), _columns(imu)
    found = []
    for name, column in values.items():
        first, last = _runs((np.diff(column) == 0.0) & counted[1:])
        long = t[last] - t[first] >= limits.FROZEN_AXIS_S
        if long.any():
            found.append(
                StuckAxis(name, float(column[first[long][0]]), _spans(t, first, last, long))
            )
    return found


def clipped_axes(imu: ImuData) -> list[StuckAxis]:
    """Axes whose largest readings are all the same, and follow each other: their range ends
    there."""
    # a slow sensor in a quick log says all of it again
    columns, fresh = _columns(imu), np.ones(len(imu), np.bool_)
    fresh[1:] = False
    for column in columns.values():
        fresh[1:] |= np.diff(column) != 0.0
    t = _seconds(imu)[fresh]
    found = []
    for name, column in columns.items():
        size = np.abs(column[fresh])
        most = float(size.max())
        # noise goes on at any value but the last of the range
        first, last = _runs((size[1:] == most) & (size[:-1] == most))
        long = last - first >= max(limits.CLIPPED_STEPS, _chance_steps(size, most))
        # an axis that never changes has no range
        if long.any() and np.ptp(column) > 0.0:
            found.append(StuckAxis(name, most, _spans(t, first, last, long)))
    return found


def _chance_steps(size: FloatArray, most: float) -> float:
    """So many steps in a row without a change are chance no more, by how often readings of ``size``
    [n] stay at other large sizes: coarse ones do, and ones that are held."""
    large = (size[1:] > 0.5 * most) & (size[1:] < most)
    stays = float(np.mean(size[1:][large] == size[:-1][large])) if large.any() else 0.0
    if stays == 0.0:
        return 0.0
    return float(np.log(limits.CLIPPED_PROBABILITY) / np.log(stays)) if stays < 1.0 else np.inf


def _seconds(imu: ImuData) -> FloatArray:
    return np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)


def _columns(imu: ImuData) -> dict[str, FloatArray]:
    triads = (("g", imu.gyro), ("a", imu.accel))
    return {f"{t}{'xyz'[k]}": values[:, k] for t, values in triads for k in range(3)}


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last sample of each run, of which every sample but the first is ``same``
    [n - 1] as the one before it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return edges[::2], edges[1::2]


def _spans(
    t: FloatArray, first: IntArray, last: IntArray, long: BoolArray
) -> tuple[tuple[float, float], ...]:
    return tuple(zip(t[first[long]].tolist(), t[last[long]].tolist(), strict=True))
