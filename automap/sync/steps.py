"""Steps of a clock: a level that changes once and stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.records import FloatArray
from automap.sync import limits
from automap.sync.envelope import bin_quantiles


@dataclass(frozen=True)
class ClockStep:
    """A jump of the delays by ``size`` s at host time ``x`` s."""

    x: float
    size: float


def find_step(x: FloatArray, y: FloatArray) -> ClockStep | None:
    """The one step in delays ``y`` [n] over time ``x`` [n], None when a line explains them.

    Low quantiles in bins of time are fitted by two levels of one common slope; a step is
    reported when that is far better than one level, and when the step is well above both
    the scatter of the levels and 20 ms.
    """
    bin_x, bin_y = bin_quantiles(x, y, limits.LOWEST_SHARE)
    count = len(bin_x)
    if count < 2 * limits.SIDE_BINS:
        return None
    slopes = _candidate_slopes(bin_x, bin_y)
    z = bin_y[None, :] - slopes[:, None] * bin_x[None, :]  # [slopes, bins]
    single = float(_cost(z).min())
    least, best_split, best_slope = np.inf, 0, 0
    for split in range(limits.SIDE_BINS, count - limits.SIDE_BINS + 1):
        cost = _cost(z[:, :split]) + _cost(z[:, split:])
        index = int(np.argmin(cost))
        if cost[index] < least:
            least, best_split, best_slope = float(cost[index]), split, index
    before, after = z[best_slope, :best_split], z[best_slope, best_split:]
    size = float(np.median(after) - np.median(before))
    scatter = least / count
    smallest = max(limits.LEAST_STEP_S, limits.STEP_SCATTERS * scatter)
    if least > limits.STEP_GAIN * single or abs(size) < smallest:
        return None
    level = y - slopes[best_slope] * x
    return ClockStep(x=_boundary(x, level, bin_x, best_split, before, after), size=size)


def _candidate_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Slopes of a clock worth trying: quantiles of all pairs' slopes, and none."""
    i, j = np.triu_indices(len(x), 1)
    slopes = (y[j] - y[i]) / (x[j] - x[i])
    return np.concatenate([[0.0], np.quantile(slopes, np.linspace(0.02, 0.98, 97))])


def _cost(z: FloatArray) -> FloatArray:
    """Sum of absolute deviations from the median of each row [k, n] -> [k]."""
    return np.asarray(np.abs(z - np.median(z, axis=1, keepdims=True)).sum(axis=1))


def _boundary(
    x: FloatArray,
    level: FloatArray,
    bin_x: FloatArray,
    split: int,
    before: FloatArray,
    after: FloatArray,
) -> float:
    """Where between two bins the level changes: the split with the least misfit."""
    low, high = float(bin_x[max(split - 2, 0)]), float(bin_x[min(split + 1, len(bin_x) - 1)])
    inside = np.flatnonzero((x >= low) & (x <= high))
    inside = inside[np.argsort(x[inside], kind="stable")]
    if len(inside) < 2:
        return float(0.5 * (bin_x[split - 1] + bin_x[split]))
    from_first = np.abs(level[inside] - np.median(before))
    from_second = np.abs(level[inside] - np.median(after))
    misfit = np.concatenate([[0.0], np.cumsum(from_first)]) + np.concatenate(
        [np.cumsum(from_second[::-1])[::-1], [0.0]]
    )
    cut = int(np.argmin(misfit))
    xs = x[inside]
    if cut == 0:
        return float(xs[0])
    if cut == len(xs):
        return float(xs[-1]) + 1e-9
    return float(0.5 * (xs[cut - 1] + xs[cut]))
