"""The noise of sensors where the vehicle stands: what their means over ``REST_S`` change by."""

from __future__ import annotations

import numpy as np

from automap.gap.limits import REST_S
from automap.records import FloatArray


def squared_steps(t: FloatArray, readings: FloatArray, span: tuple[float, float]) -> FloatArray:
    """Squared differences [k, 3] of neighbouring means over ``REST_S`` within a halt."""
    inside = np.flatnonzero((t >= span[0]) & (t < span[1]))
    if len(inside) == 0:
        return np.zeros((0, 3))
    number = ((t[inside] - span[0]) / REST_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(starts, len(inside)))
    means = np.add.reduceat(readings[inside], starts, axis=0) / counts[:, None]
    # the last one may be cut short
    return np.asarray(np.diff(means[:-1], axis=0) ** 2)


def surely(count: int) -> float:
    """Share of a standard deviation of ``count`` values that it exceeds with 95 %."""
    from scipy.stats import chi2

    return float(np.sqrt(count / chi2.ppf(0.95, count)))
