"""How tall signs of a class are: by the table of classes, then by the other signs of the drive.

A country makes its signs in a few sizes, and most of a class in a drive have the same one. What
the other signs of a class measure, each where bearings from several places tell its distance, is
the best guess for a sign whose own boxes tell little. A class that stands in two sizes shows by
its spread; that a single sign is of another size is allowed for by the heavy tails of the fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.views import Views
from automap.records import FloatArray
from automap.robust import cauchy_weight
from automap.signs.class_shares import commonest
from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary

_HEIGHT_BY_WIDTH = {"red-triangle-up": 0.87, "red-triangle-down": 0.87}
_UNSURE_GROUPS = ("white-square", "black-square", "blue-square", "yellow-square", "other")

_ROUNDS = 5
"""Of mean, spread and weights in turn."""


def usual_sizes(names: Iterable[str]) -> dict[str, SizePrior]:
    """Priors of the heights of the classes that the table knows, among ``names``.

    A face known by colour and shape alone is as tall as most that look like that.
    """
    known = load_classes()
    group_named = {name: group for group, name in load_vocabulary().groups.items()}
    result = {}
    for name in sorted({str(n) for n in names}):
        entry, group = known.get(name), group_named.get(name, "other")
        alike = [e.size_m for e in known.values() if e.group == group and group != "other"]
        if entry is not None:
            sure = entry.group not in _UNSURE_GROUPS
            sd = limits.USUAL_LOG_SD if sure else limits.UNSURE_LOG_SD
            result[name] = SizePrior(entry.size_m * _HEIGHT_BY_WIDTH.get(entry.group, 1.0), sd)
        elif alike:
            height = float(np.median(alike)) * _HEIGHT_BY_WIDTH.get(group, 1.0)
            result[name] = SizePrior(height, limits.UNSURE_LOG_SD)
    return result


def sizes_of_others(
    views: Views, landmarks: Sequence[Landmark], prior: SizePrior
) -> list[SizePrior]:
    """For each landmark the prior of its size by the other landmarks of its class.

    ``landmarks`` were settled with ``prior``; where no other of the class tells anything, it is
    that prior.
    """
    names = [commonest(views.class_name[mark.rows].tolist()) for mark in landmarks]
    result = [prior.of([name]) for name in names]
    for name in set(names):
        members = [k for k, other in enumerate(names) if other == name]
        if len(members) < 2:
            continue
        general = prior.of([name])
        size, variance = np.array([measured_size(landmarks[k], general) for k in members]).T
        for i, k in enumerate(members):
            others = np.isfinite(size)
            others[i] = False
            if others.any():
                result[k] = _predicted(size[others], variance[others], general)
    return result


def measured_size(mark: Landmark, prior: SizePrior, weight: float = 1.0) -> tuple[float, float]:
    """Logarithm of a size by boxes and bearings alone, and its variance, where the fit gave the
    ``prior`` a ``weight``; NaN where those tell next to nothing."""
    after = float(mark.covariance[3, 3] + mark.pass_covariance[3, 3])
    before, expected = prior.log_sd**2, float(np.log(prior.size_m))
    if not (mark.ok and after * weight < (1.0 - limits.LEAST_SIZE_GAIN) * before):
        return np.nan, np.nan
    variance = 1.0 / (1.0 / after - weight / before)
    return (float(mark.parameters[3]) / after - weight * expected / before) * variance, variance


def _predicted(size: FloatArray, variance: FloatArray, prior: SizePrior) -> SizePrior:
    """What sizes [n] with variances [n] let expect of one more of their class."""
    start = float(np.log(prior.size_m))
    mean, spread = float(np.median(size)), limits.CLASS_SPREAD_LOG**2
    sure = 0.0
    for _ in range(_ROUNDS):
        square = (size - mean) ** 2
        weight = 1.0 / (spread + variance)
        weight = weight * cauchy_weight(square * weight)
        sure = prior.log_sd**-2 + float(weight.sum())
        mean = (start * prior.log_sd**-2 + float(weight @ size)) / sure
        beyond = float(np.sum(np.maximum(square - variance, 0.0)))
        spread = (limits.CLASS_SPREAD_FREEDOM * limits.CLASS_SPREAD_LOG**2 + beyond) / (
            limits.CLASS_SPREAD_FREEDOM + len(size)
        )
        spread = max(spread, limits.LEAST_CLASS_SPREAD_LOG**2)
    return SizePrior(float(np.exp(mean)), float(min(np.sqrt(spread + 1.0 / sure), prior.log_sd)))
