"""How far probabilities are from how often they are right, and how far chance alone would be."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from automap.records import FloatArray

BINS, CHANCES = 10, 200
ALIKE: FloatArray = np.linspace(0.0, 0.95, 20)
"""Correlations tried, of what lies beneath passes of one drawing."""


def calibration_error(probability: FloatArray, right: FloatArray, weight: FloatArray) -> float:
    """Expected calibration error by bins of equal weight."""
    return float(sum(w * abs(p - y) for p, y, w in bins(probability, right, weight)))


def by_chance(
    probability: FloatArray, right: FloatArray, weight: FloatArray, drawing: FloatArray
) -> float:
    """The median calibration error of passes whose probabilities are exactly right, and that are
    right together with others of their drawing as these are."""
    rng = np.random.default_rng(7)
    group = np.unique(drawing, return_inverse=True)[1]

    def together(right: FloatArray) -> float:
        off = right - probability
        return float((np.bincount(group, off) ** 2).sum() - (off**2).sum())

    def drawn(alike: float) -> FloatArray:
        common, own = rng.standard_normal(group.max() + 1)[group], rng.standard_normal(len(group))
        common, own = np.sqrt(alike) * common, np.sqrt(1.0 - alike) * own
        return np.asarray(ndtr(common + own) < probability, np.float64)

    wanted = together(right)
    found = [abs(np.mean([together(drawn(a)) for _ in range(9)]) - wanted) for a in ALIKE]
    alike = float(ALIKE[int(np.argmin(found))])
    errors = [calibration_error(probability, drawn(alike), weight) for _ in range(CHANCES)]
    return float(np.median(errors))


def bins(
    probability: FloatArray, right: FloatArray, weight: FloatArray
) -> list[tuple[float, float, float]]:
    """Mean probability, share right and weight of bins of equal weight."""
    order = np.argsort(probability, kind="stable")
    place = np.cumsum(weight[order]) / weight.sum()
    number = np.minimum((place * BINS - 1e-9).astype(int), BINS - 1)
    found = []
    for k in np.unique(number):
        rows = order[number == k]
        share = weight[rows] / weight[rows].sum()
        mean = float(share @ probability[rows]), float(share @ right[rows])
        found.append((*mean, float(weight[rows].sum() / weight.sum())))
    return found
