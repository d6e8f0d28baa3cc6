"""The form of a formula that fits best: its periods, instants and widths, and the formulas near."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.signals import Signals
from automap.gap import limits
from automap.gap.evidence import apart, evidence, nats_of_parts
from automap.gap.fit import Fit
from automap.gap.linear import ColumnsOf, Given, conditional, linearised
from automap.gap.neighbours import amounts, neighbours
from automap.gap.result import equation

Terms = tuple[tuple[str, str], ...]
STEPS = 3
"""So many steps a formula may be away from the one that was found; bounds the time."""


@dataclass(frozen=True)
class About:
    """What formulas are asked about: ``fits`` with what is ``known`` held at its values, the
    effects ``rest`` that stand beside them, and the columns ``of`` formulas with these."""

    fits: Sequence[Fit]
    known: Mapping[str, Mapping[str, float]]
    rest: Collection[str]
    of: Callable[[Sequence[Terms]], ColumnsOf]


def nearby(about: About, signals: Signals, terms: Terms) -> tuple[Terms, int]:
    """The likeliest of the formulas near one of a single term, step by step, and out of how many.
    Another form pays for all that are tried, an amount that moves does not: those near it say much
    the same."""
    ((on, text),) = terms
    count = 1

    def best(others: Sequence[str], price: float) -> str:
        every: list[Terms] = [((on, t),) for t in (text, *others)]
        return likeliest(about, every, price)[0][1] if others else text

    for _ in range(STEPS):
        text = best(amounts(text), 0.0)
        forms = neighbours(text, signals)
        other = best(forms, math.log(len(forms)))
        if other == text:
            break
        text, count = other, count + len(forms)
    return ((on, text),), count


def likeliest(about: About, tried: Sequence[Terms], price: float = 0.0) -> Terms:
    """The formula that explains most: the first that is ``tried``, but where another is likelier.
    Where there is a ``price`` that one must be likelier by so many nats, both beside the same
    scatter, and told apart."""
    linear = linearised(about.fits, about.of(tried), about.known)
    asked = {equation(terms) for terms in tried}
    parts: dict[str, list[int]] = {}
    given = Given()
    for i, column in enumerate(linear.layout):
        if column.effect in about.rest:
            given = given.joined((i,), linear, 1.0)
        elif column.effect in asked:
            parts.setdefault(column.effect, []).append(i)
    known = conditional(linear, given)
    every = [tuple(part) for part in parts.values()]
    if not every:
        return tried[0]
    nats = nats_of_parts(known, every)
    best = int(np.argmax(nats))
    its = {tuple(linear.layout[i].term for i in part): part for part in every}
    first = its.get(tried[0], every[best])
    if price > 0.0 and first != every[best]:
        mine, other = evidence(known, first), evidence(known, every[best])
        ratio = min(mine.overdispersion, other.overdispersion)
        gain = other.corrected(ratio) - mine.corrected(ratio)
        if gain <= price or apart(known, every[best], first) <= limits.APART:
            return tried[0]
    return tuple(linear.layout[i].term for i in every[best])
