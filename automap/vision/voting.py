"""The class of a sign from all its views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision import limits
from automap.vision.detector import Alternatives, FoundSigns


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
    score = float(np.clip(found.score[index], *limits.SCORE_LIMITS))
    return View(((found.class_name[index], score),), height)


def vote(views: Sequence[View]) -> tuple[str, float]:
    """The class and its probability.

    The product of the views' probabilities, each to the power of how clear it is: a face of 16
    px is a guess, and ten guesses do not outweigh one view from near. What a view does not list
    keeps a small probability. A class that most of the views doubt is no name for a sign: it is
    called after the shape and colour on which they agree.
    """
    names = sorted({name for view in views for name, _ in view.alternatives})
    weight = np.array([min(max(v.height, 1.0) / limits.CLEAR_PX, 1.0) ** 2 for v in views])
    listed = np.array([[dict(v.alternatives).get(name, 0.0) for name in names] for v in views])
    rest = np.maximum(1.0 - listed.sum(axis=1), limits.FAINTEST) / limits.OTHERS
    # rounded probabilities of exactly zero must not forbid a class
    total = weight @ np.log(np.maximum(listed, rest[:, None]))
    total *= min(1.0, limits.INDEPENDENT / weight.sum())
    posterior = np.exp(total - total.max())
    posterior /= posterior.sum()
    best = int(np.argmax(posterior))
    mean = weight @ listed
    mean /= mean.sum()
    if posterior[best] >= limits.NAMED and mean[best] >= limits.DOUBTED:
        return names[best], float(posterior[best])
    groups: dict[str, float] = {}
    for name, part in zip(names, mean.tolist(), strict=True):
        group = group_of(name) or name
        groups[group] = groups.get(group, 0.0) + part
    group = max(sorted(groups), key=lambda g: groups[g])
    return group, groups[group]


@lru_cache(maxsize=4096)
def group_of(class_name: str) -> str | None:
    """What an unknown face of the shape and colour of a class is called; None if not known."""
    known = load_classes().get(class_name)
    return None if known is None else load_vocabulary().groups.get(known.group)
