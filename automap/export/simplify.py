"""Fewer points for the same path: thinning that keeps position and time."""

from __future__ import annotations

import numpy as np

from automap.records import FloatArray, IntArray


def keep_indices(
    time: FloatArray, values: FloatArray, tolerance: float, limit: int | None = None
) -> IntArray:
    """Rows to keep so that linear interpolation in time stays within ``tolerance``.

    ``time`` [n] increases, ``values`` [n, k] share one unit with ``tolerance``. This is the
    top-down splitting of Douglas and Peucker (1973) with the synchronous distance, to the
    point of the chord at the same time, instead of the perpendicular one, so that speed and
    stops survive; all pieces of a level are split together. With ``limit`` the tolerance is
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


def _split(time: FloatArray, values: FloatArray, tolerance: float) -> IntArray:
    n = len(time)
    rows = np.arange(n)
    kept = np.array([0, n - 1], np.int64)
    while True:
        chord = np.column_stack([np.interp(time, time[kept], v[kept]) for v in values.T])
        distance = np.sqrt(((values - chord) ** 2).sum(axis=1))
        distance[kept] = 0.0
        starts = kept[:-1]
        worst = np.maximum.reduceat(distance, starts)
        piece = np.searchsorted(kept, rows, side="right") - 1
        piece = np.minimum(piece, len(starts) - 1)
        candidates = np.flatnonzero((distance > tolerance) & (distance == worst[piece]))
        if len(candidates) == 0:
            return kept
        # of equal worst points in a piece the first is enough
        _, first = np.unique(piece[candidates], return_index=True)
        kept = np.union1d(kept, candidates[first])
