"""The class of a sign from all its views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.vision.detector import Alternatives, FoundSigns

_CLEAR_PX = 32.0
"""From this height a face shows all that a classifier can read."""
_FAINTEST = 0.02
_OTHERS = 50.0
_INDEPENDENT = 4.0
"""Views of one sign share light, dirt and angle: together they count as so many at most."""


@dataclass(frozen=True)
class View:
    """What one view says: class probabilities, best first, and the height of the box in px."""

    alternatives: Alternatives
    height: float


def view_of(found: FoundSigns, index: int) -> View:
    """The view that box ``index`` is; a bare name counts as much as its score."""
    box = found.box[index]
    height = float(box[3] - box[1])
    if found.alternatives is not None and found.alternatives[index]:
        return View(found.alternatives[index], height)
    score = float(np.clip(found.score[index], 0.05, 0.95))
    return View(((found.class_name[index], score),), height)


def vote(views: Sequence[View]) -> tuple[str, float]:
    """The most probable class and its probability.

    The product of the views' probabilities, each to the power of how clear it is: a face of 16
    px is a guess, and ten guesses do not outweigh one view from near. What a view does not list
    keeps a small probability.
    """
    names = sorted({name for view in views for name, _ in view.alternatives})
    total = np.zeros(len(names))
    weights = 0.0
    for view in views:
        listed = dict(view.alternatives)
        rest = max(1.0 - sum(listed.values()), _FAINTEST) / _OTHERS
        weight = min(max(view.height, 1.0) / _CLEAR_PX, 1.0) ** 2
        # rounded probabilities of exactly zero must not forbid a class
        p = np.array([max(listed.get(name, rest), rest) for name in names])
        total += weight * np.log(p)
        weights += weight
    if weights > _INDEPENDENT:
        total *= _INDEPENDENT / weights
    posterior = np.exp(total - total.max())
    posterior /= posterior.sum()
    best = int(np.argmax(posterior))
    return names[best], float(posterior[best])
