"""What a sign is by all its views, and how sure that is.

The views of a pass share the face, its dirt and light, the optics and what the classifier confuses:
a hundred of them say hardly more than five. Their evidence is pooled as the mean of log
probabilities (Genest and Zidek, Statistical Science 1, 1986) that counts as so many independent
views as the mean of n equally correlated values does, n / (1 + (n - 1) rho), which ends at 1 / rho.
How large rho is, and how often a whole pass is confused whatever its views say, was fitted on
tracks and faces that the classifier was not trained on (``docs/detector.md``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from automap.records import FloatArray
from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision import limits
from automap.vision.detector import Alternatives, FoundSigns


@dataclass(frozen=True)
class View:
    """What one view says: class probabilities, best first, and the height of the box in px."""

    alternatives: Alternatives
    height: float


@dataclass(frozen=True)
class Verdict:
    """What a sign is called, a class or an unknown face of a group, and the ``probability`` that
    this is right; ``group_probability`` that its shape and colour are."""

    name: str
    probability: float
    group_probability: float


@dataclass(frozen=True)
class PoolingRules:
    """``clear_px`` height from which a view counts whole, a smaller one by its ``power``;
    ``single`` how many views one needs to count as one, ``correlation`` of the views of a pass;
    ``faintest`` probability of all that a view does not list, which are ``others``;
    ``confused`` how often a pass is taken for another class, ``confused_group`` for another group,
    whatever its views say; ``named`` the probability from which a class is named."""

    clear_px: float = limits.CLEAR_PX
    power: float = limits.CLEAR_POWER
    single: float = limits.ONE_VIEW
    correlation: float = limits.VIEW_CORRELATION
    faintest: float = limits.FAINTEST
    others: float = limits.OTHERS
    confused: float = limits.CONFUSED
    confused_group: float = limits.CONFUSED_GROUP
    named: float = limits.NAMED


def view_of(found: FoundSigns, index: int) -> View:
    """The view that box ``index`` is; a bare name counts as much as its score."""
    box = found.box[index]
    height = float(box[3] - box[1])
    if found.alternatives is not None and found.alternatives[index]:
        return View(found.alternatives[index], height)
    score = float(np.clip(found.score[index], *limits.SCORE_LIMITS))
    return View(((found.class_name[index], score),), height)


def vote(views: Sequence[View], rules: PoolingRules | None = None) -> Verdict:
    """What a sign is by its views (at least one).

    The most probable class, where that is probable enough; else an unknown face of the most
    probable group, to which its classes count, since what is not read is still of a shape and a
    colour.
    """
    rules = rules or PoolingRules()
    names, shares = pooled(views, rules)
    own = [group_of(name) or name for name in names]
    groups: dict[str, float] = {}
    for group, share in zip(own, shares.tolist(), strict=True):
        groups[group] = groups.get(group, 0.0) + share
    sure = {group: share * (1.0 - rules.confused_group) for group, share in groups.items()}
    best = max(
        (k for k in range(len(names)) if names[k] != own[k]),
        key=lambda k: (shares[k], names[k]),
        default=-1,
    )
    if best >= 0 and (share := float(shares[best]) * (1.0 - rules.confused)) >= rules.named:
        return Verdict(names[best], min(share, sure[own[best]]), sure[own[best]])
    group = max(sorted(sure), key=sure.__getitem__)
    return Verdict(group, sure[group], sure[group])


def pooled(views: Sequence[View], rules: PoolingRules) -> tuple[list[str], FloatArray]:
    """Names that the views list, and the share [k] of each in what they say together."""
    names = sorted({name for view in views for name, _ in view.alternatives})
    clear = np.array([min(max(v.height, 1.0) / rules.clear_px, 1.0) for v in views])
    weight = clear**rules.power
    listed = np.array([[dict(v.alternatives).get(name, 0.0) for name in names] for v in views])
    rest = np.maximum(1.0 - listed.sum(axis=1), rules.faintest) / rules.others
    # rounded probabilities of exactly zero must not forbid a class
    mean = weight @ np.log(np.maximum(listed, rest[:, None])) / weight.sum()
    mean *= weight.sum() / (rules.single + rules.correlation * weight.sum())
    shares = np.exp(mean - mean.max())
    return names, np.asarray(shares / shares.sum(), np.float64)


@lru_cache(maxsize=4096)
def group_of(class_name: str) -> str | None:
    """What an unknown face of the shape and colour of a class is called; None if not known."""
    known = load_classes().get(class_name)
    return None if known is None else load_vocabulary().groups.get(known.group)
