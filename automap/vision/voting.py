"""What a sign is by all its views, and how sure that is.

The views of a pass share the face, its dirt and light, the optics and what the classifier confuses:
a hundred of them say hardly more than four. Their evidence is the mean of their log probabilities
(a logarithmic pool: Genest and Zidek, Statistical Science 1, 1986), which counts as so many
independent views as the mean of n equally correlated values does: n / (1 + rho n), at most 1 / rho.
How likely a face is before it is seen (an unknown one, or one of another country) is in the
probabilities of every view, but counts once.
What is left of overconfidence, of faces that are drawn as none that was trained on, is taken out by
a power of the odds (Platt's scaling, with a shift and a share of lapses where no country is known).
All was fitted on passes of signs that the classifier was not trained on (``docs/detector.md``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from automap.records import FloatArray
from automap.signs.classes import country_set, load_classes
from automap.signs.vocabulary import load_vocabulary
from automap.vision import limits
from automap.vision.detector import Alternatives, CalibratedDetector, Detector, FoundSigns


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
    """``correlation`` of the views of a pass; ``class_power`` and ``group_power`` of the odds that
    the class, and the group, are as they come out, ``class_shift`` of the logarithm of the odds of
    the class, and ``group_lapse`` how often the group is wrong in spite of them; ``named`` the
    probability from which a class
    is named; ``unknown`` how likely each view takes an unknown face of a group to be, against one
    class of the country, before it is seen, and ``foreign`` the classes of other countries."""

    correlation: float = limits.VIEW_CORRELATION
    class_power: float = limits.POWERS_UNTOLD[0]
    group_power: float = limits.POWERS_UNTOLD[1]
    class_shift: float = 0.0
    group_lapse: float = 0.0
    named: float = limits.NAMED
    unknown: float = 1.0
    foreign: frozenset[str] = frozenset()


def pooling(country: str | None) -> PoolingRules:
    """How to pool what is told of views in a country (ISO 3166 alpha-2), or where none is known."""
    foreign = frozenset(load_classes()) - country_set(country)
    at_home = len(foreign) > 0
    by_class, by_group = limits.POWERS_AT_HOME if at_home else limits.POWERS_ELSEWHERE
    odds = limits.ODDS_AT_HOME if at_home else limits.ODDS_ELSEWHERE
    # the classes together are ``odds`` times as likely as the groups together
    unknown = len(load_classes()) / len(load_vocabulary().groups) / odds
    return PoolingRules(
        class_power=by_class,
        group_power=by_group,
        class_shift=0.0 if at_home else limits.SHIFT_ELSEWHERE,
        group_lapse=0.0 if at_home else limits.LAPSE_ELSEWHERE,
        unknown=unknown,
        foreign=foreign,
    )


def rules_of(detector: Detector) -> PoolingRules:
    """How to pool what a detector says of views."""
    if not isinstance(detector, CalibratedDetector):
        return PoolingRules()
    return pooling(detector.country)


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
    sure: dict[str, float] = {}
    for group, share in zip(own, shares.tolist(), strict=True):
        sure[group] = sure.get(group, 0.0) + share
    sure = {
        group: tempered(share, rules.group_power, lapse=rules.group_lapse)
        for group, share in sure.items()
    }
    classes = [k for k, name in enumerate(names) if name != own[k]]
    if classes:
        best = max(classes, key=lambda k: shares[k])
        likely = tempered(float(shares[best]), rules.class_power, rules.class_shift)
        if likely >= rules.named:
            group_too = sure[own[best]]
            return Verdict(names[best], min(likely, group_too), group_too)
    group = max(sorted(sure), key=sure.__getitem__)
    return Verdict(group, sure[group], sure[group])


def tempered(share: float, power: float, shift: float = 0.0, lapse: float = 0.0) -> float:
    """A probability whose odds are those of ``share`` to a power, ``shift`` added to their
    logarithm, where nothing lapses."""
    share = min(max(share, limits.SUREST), 1.0 - limits.SUREST)
    odds = math.exp(shift + power * math.log(share / (1.0 - share)))
    return (1.0 - lapse) * odds / (1.0 + odds)


def pooled(views: Sequence[View], rules: PoolingRules) -> tuple[list[str], FloatArray]:
    """Names that the views list, and the share [k] of each in what they say together."""
    known = load_classes()
    names = sorted({name for view in views for name, _ in view.alternatives})
    clear = np.array([min(max(v.height, 1.0) / limits.CLEAR_PX, 1.0) for v in views])
    weight = clear**2
    listed = np.array([[dict(v.alternatives).get(name, 0.0) for name in names] for v in views])
    rest = np.maximum(1.0 - listed.sum(axis=1), limits.FAINTEST) / limits.OTHERS
    # rounded probabilities of exactly zero must not forbid a class
    expected = [limits.FOREIGN if n in rules.foreign else 1.0 if n in known else rules.unknown
                for n in names]  # fmt: skip
    prior = np.log(expected)
    total = weight @ (np.log(np.maximum(listed, rest[:, None])) - prior)
    total = total / (1.0 + rules.correlation * weight.sum()) + prior
    shares = np.exp(total - total.max())
    return names, np.asarray(shares / shares.sum(), np.float64)


def mean_shares(views: Sequence[View]) -> Alternatives:
    """What the views give to each class on average, clear ones more, best first; what is less than
    ``limits.LEAST_SHARE`` is left out."""
    weight = np.array([min(max(v.height, 1.0) / limits.CLEAR_PX, 1.0) ** 2 for v in views])
    shares: dict[str, float] = {}
    for view, part in zip(views, (weight / weight.sum()).tolist(), strict=True):
        for name, share in view.alternatives:
            shares[name] = shares.get(name, 0.0) + part * share
    kept = [(name, share) for name, share in shares.items() if share >= limits.LEAST_SHARE]
    return tuple(sorted(kept, key=lambda one: (-one[1], one[0])))


@lru_cache(maxsize=4096)
def group_of(class_name: str) -> str | None:
    """What an unknown face of the shape and colour of a class is called; None if not known."""
    known = load_classes().get(class_name)
    return None if known is None else load_vocabulary().groups.get(known.group)
