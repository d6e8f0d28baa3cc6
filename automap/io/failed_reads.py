"""Rows of an IMU whose sensor did not answer: all axes of a triad bear one number.

A bus that nobody drives reads the same bytes for each register, all zeros or all ones, and drivers
that give up write zeros. A sensor's own three axes are equal by chance alone, and then no further
from the readings beside them than others are.
"""

from __future__ import annotations

import numpy as np

from automap.gates import sd_by_median
from automap.records import BoolArray, FloatArray

FAILED = (
    "with one number on all axes of a triad, far off the rows beside them, left out: the sensor "
    "did not answer; look at its bus and wiring"
)
"""What is said of so many rows."""
_FAR_SD = 6.0
"""A row that far from the line between its neighbours is none of the sensor's. Chosen: where three
axes happen to be equal a shock of that size costs one reading."""
_LEAST = 16
"""Fewer readings have no usual distance."""
_SHORT = 5
"""A gyro's zeros that last longer may be a band in which it shows none. Chosen: drivers retry."""


def failed_rows(gyro: FloatArray, accel: FloatArray) -> BoolArray:
    """Which rows [n] are no readings, by the triads' raw readings [n, 3], finite and in order of
    time. An accelerometer that feels gravity has no rest at zero, a gyro may."""
    silent = _failed(gyro)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], silent.astype(np.int8), [0]])))
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        silent[first:stop] = stop - first <= _SHORT
    failed = silent | _failed(accel)
    # what most rows are is how the sensor reads
    return np.asarray(failed & (2 * np.count_nonzero(failed) <= len(failed)))


def _failed(triad: FloatArray) -> BoolArray:
    """Rows [n] with one number on all axes, and far off the rows beside them."""
    failed = np.zeros(len(triad), np.bool_)
    equal = (triad[:, 0] == triad[:, 1]) & (triad[:, 0] == triad[:, 2])
    equal_rows, others = np.flatnonzero(equal), np.flatnonzero(~equal)
    if not len(equal_rows) or len(others) < max(_LEAST, len(equal_rows)):
        return failed
    good = triad[others]
    off = good[1:-1] - 0.5 * (good[:-2] + good[2:])
    for axis in range(3):
        # coarse or repeated readings are mostly no step off
        moved = off[:, axis][off[:, axis] != 0.0]
        if len(moved):
            between = np.interp(equal_rows, others, good[:, axis])
            away = np.abs(triad[equal_rows, axis] - between)
            failed[equal_rows] |= away > _FAR_SD * sd_by_median(moved)
    return failed
