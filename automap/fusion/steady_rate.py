"""Turn rates without the noise of single readings.

What a lever arm adds to a velocity is the turn rate times the arm. With the noise of a single
reading in the rate, a short arm fits better than the true one, which adds that noise to every
prediction (errors in variables; Fuller, 1987): low-cost gyros had antennas a metre off.
"""

from __future__ import annotations

import numpy as np

from automap.fusion.limits import STEADY_GAP_STEPS, STEADY_WINDOW_S
from automap.records import FloatArray


def steady_rate(t: FloatArray, rate: FloatArray) -> FloatArray:
    """Rates [n, 3] at times [n] s smoothed without delay (Savitzky and Golay, 1964); as they are
    next to gaps and where sampling is too slow for it."""
    from scipy.signal import savgol_filter

    if len(t) < 2:
        return rate.copy()
    step = np.diff(t)
    usual = float(np.median(step))
    half = round(0.5 * STEADY_WINDOW_S / usual) if usual > 0.0 else 0
    if half < 2 or len(t) < 2 * half + 1:
        return rate.copy()
    out = np.asarray(savgol_filter(rate, 2 * half + 1, 2, axis=0, mode="nearest"), np.float64)
    gaps = np.flatnonzero(step > STEADY_GAP_STEPS * usual)
    near = np.zeros(len(t) + 1, np.int64)
    np.add.at(near, np.maximum(gaps + 1 - half, 0), 1)
    np.add.at(near, np.minimum(gaps + 1 + half, len(t)), -1)
    near[0] += 1
    near[half] -= 1
    near[len(t) - half] += 1
    raw = np.cumsum(near)[: len(t)] > 0
    out[raw] = rate[raw]
    return out
