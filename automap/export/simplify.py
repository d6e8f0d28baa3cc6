"""Fewer points for the same path: thinning that keeps position and time."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray, IntArray


def keep_indices(
    time: FloatArray, values: FloatArray, tolerance: float, limit: int | None = None
) -> IntArray:
    """Rows to keep so that linear interpolation in time stays within ``tolerance``.

    ``time`` [n] increases, ``values`` [n, k] share one unit with ``tolerance``. This is the
    top-down splitting of Douglas and Peucker (1973) with the synchronous distance, to the
    point of the chord at the same time, instead of the perpendicular one, so that speed and
    stops survive. With ``limit`` the tolerance is
    doubled until at most so many rows remain (never fewer than the two ends).
    """
    n = len(time)
    if n <= 2:
        return np.arange(n, dtype=np.int64)
    while True:
        kept = _split(time, values, tolerance)
        if limit is None or len(kept) <= max(limit, 2):
            return kept
        tolerance = max(2.0 * tolerance, 1e-9)


@kernel
def _split(time: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    n, width = values.shape
    kept = np.zeros(n, np.bool_)
    kept[0] = kept[n - 1] = True
    pieces = [(0, n - 1)]
    while len(pieces) > 0:
        start, end = pieces.pop()
        worst, at = tolerance, -1
        span = time[end] - time[start]
        for row in range(start + 1, end):
            square = 0.0
            for k in range(width):
                slope = (values[end, k] - values[start, k]) / span
                off = values[row, k] - (slope * (time[row] - time[start]) + values[start, k])
                square += off * off
            distance = math.sqrt(square)
            if distance != distance:
                # what is not known is no reason to split
                at = -1
                break
            # of equal worst points in a piece the first is enough
            if distance > worst:
                worst, at = distance, row
        if at >= 0:
            kept[at] = True
            pieces.append((start, at))
            pieces.append((at, end))
    return np.flatnonzero(kept)
