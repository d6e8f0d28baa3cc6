"""Counts of 16 bits that ran over, or that were written without their sign.

A microcontroller's program that puts two's complement into an unsigned number writes -1 as 65535. A
sensor driven beyond its range reads the other end of it. Either way neighbouring readings differ by
nearly all that 16 bits hold, and by little where these 65536 are taken off.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from automap.records import FloatArray, IntArray

BITS_16 = 65536
_NEARLY = 0.875
"""Of 65536, what neighbours differ by at least. Chosen: an eighth is 60 deg/s or 0.5 g from one
reading to the next at the ranges that sensors power up with."""
_LEAST = 3
"""Jumps that tell counts without a sign. Chosen: a garbled line brings one or two."""

UNSIGNED = (
    "its counts are written without their sign, 65535 for -1, and are read as numbers of 16 bits "
    "with one; write them as int16_t"
)


def _jumps(x: FloatArray) -> IntArray:
    """Rows of readings [n] after which the next is nearly 65536 off."""
    return np.flatnonzero(np.abs(np.diff(x)) > _NEARLY * BITS_16)


def _are_counts(x: FloatArray, low: int, high: int) -> bool:
    """Whether the finite ones of readings [n] are whole numbers from ``low`` to ``high``."""
    x = x[np.isfinite(x)]
    return bool(len(x)) and bool(((x >= low) & (x <= high) & (x == np.rint(x))).all())


def without_sign(triads: Iterable[FloatArray]) -> bool:
    """Whether the axes [n] of an inertial log are counts that lost their sign."""
    axes = list(triads)
    return (
        all(_are_counts(x, 0, BITS_16 - 1) for x in axes)
        and sum(len(_jumps(x)) for x in axes) >= _LEAST
    )


def with_sign(x: FloatArray) -> FloatArray:
    """Counts [n] of 16 bits as the sensor meant them."""
    return np.where(x >= BITS_16 // 2, x - BITS_16, x)


def first_wrap(x: FloatArray) -> int | None:
    """The row of readings [n] after which counts of 16 bits ran over, if they did.

    A sensor that is cut off at both ends jumps as far, but from one extreme to the other.
    """
    if not _are_counts(x, -BITS_16 // 2, BITS_16 // 2 - 1):
        return None
    ends = (x == np.nanmin(x)) | (x == np.nanmax(x))
    rows = [row for row in _jumps(x).tolist() if not (ends[row] and ends[row + 1])]
    return rows[0] if rows else None
