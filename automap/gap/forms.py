"""The form of a formula that fits best: its periods, instants and widths, and the formulas near.

A dictionary has of each family of formulas one. Which of the family fits best is found from there,
step by step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.signals import Signals
from automap.gap import limits
from automap.gap.evidence import apart, evidence, nats_of_parts
from automap.gap.linear import Conditional, Given, Part, conditional
from automap.gap.neighbours import AMOUNT, Terms, amounts, as_turn, neighbours
from automap.gap.nodes import NodeMotion
from automap.gap.result import equation
from automap.gap.sensitivity import ColumnsOf, linearised

STEPS = 3
"""So many steps a formula may be away from the one that was found; bounds the time."""
MOVES = 4
"""So often amounts are moved, one at a time, before other forms are tried: two that go together, as
how long something is remembered and where it bends, settle by turns. Bounds the time."""
ONE_SIGMA = 0.5
"""Nats by which an amount may be off where it is likeliest: it is known no better."""
FORMS, COMPARED = 3, 6
"""So many of the likeliest at a step are asked of the filter, and so many have their amounts moved
before; bounds the time."""


@dataclass(frozen=True)
class About:
    """What formulas are asked about: fits with what is ``known`` held at its values ``along`` whose
    motion to ask, the effects ``rest`` that stand beside them, and the columns ``of`` formulas with
    these."""

    along: Sequence[NodeMotion]
    known: Mapping[str, Mapping[str, float]]
    rest: Collection[str]
    of: Callable[[Sequence[Terms]], ColumnsOf]


def nearby(
    about: About, signals: Signals, terms: Terms, rivals: Sequence[str] = ()
) -> tuple[list[tuple[Terms, int]], list[Terms]]:
    """Formulas near one of a single term, or near the likeliest of its ``rivals`` on its channel,
    and out of how many each is the likeliest: those that are reached step by step, and at each step
    the likeliest. Another form pays for all that are tried, an amount that moves does not: those
    near it say much the same. What a gyro reads of changes may be a unit that turns. With them
    those whose neighbours were tried."""
    ((on, text),) = terms
    found: dict[str, int] = {}
    around = [text]
    count = 1

    def single_term(text: str) -> Terms:
        return ((on, text),)

    def single(texts: Sequence[str], price: float | None = 0.0, *alike: float) -> list[str]:
        return [t for ((_, t),) in ranked(about, [single_term(t) for t in texts], price, *alike)]

    # what was found first may only follow what another says in a form that is not yet its own
    others = single(rivals, None)[: FORMS - 1] if rivals else []
    for _ in range(STEPS):
        for _ in range(MOVES):
            nearest = single([text, *amounts(text)], 0.0, ONE_SIGMA)[0]
            if nearest == text:
                break
            text = nearest
        around += [text, *others]
        # of two that say nearly the same the other may be on the way
        near = [form for t in (text, *others) for form in neighbours(t, signals)]
        forms = [t for t in dict.fromkeys((*others, *near)) if t != text]
        # none is compared before its amounts are those that suit it best
        likeliest = _of_each_family([text, *single([text, *forms])])[1:]
        moved = [t for form in likeliest[:COMPARED] for t in (form, *amounts(form))]
        order = single([text, *moved], math.log(len(forms)))
        every = _of_each_family(order)
        found[text] = count
        count += len(forms)
        for other in every[:FORMS]:
            found.setdefault(other, count)
        # where none is likelier what is may lie behind one that is nearly so
        if every[0] == text and count > 1 + len(forms):
            break
        text, *others = every[:FORMS]
    told = [(single_term(t), choices) for t, choices in found.items() if t != terms[0][1]]
    turns = {as_turn(on, t): 2 * choices for t, choices in found.items()}
    told += [(turn, choices) for turn, choices in turns.items() if turn]
    return told, [single_term(t) for t in around]


def _of_each_family(texts: Sequence[str]) -> list[str]:
    """The first of each family of formulas, which differ by their amounts alone."""
    out: dict[str, str] = {}
    for text in texts:
        out.setdefault(AMOUNT.sub("", text), text)
    return list(out.values())


def ranked(
    about: About,
    tried: Sequence[Terms],
    price: float | None = None,
    alike: float = limits.CLOSE_NATS,
) -> list[Terms]:
    """Formulas, the likeliest first. Where there is a ``price``, less all that are ``alike`` to the
    first that is ``tried``, or to a likelier one, but for so many nats; and where that is more than
    nothing that one is first, but where another is likelier by so much, both beside the same
    scatter, and told apart."""
    linear = linearised(about.along, about.of(tried), about.known)
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
    likeliest = np.argsort(-nats_of_parts(known, every), kind="stable")
    its = {tuple(linear.layout[i].term for i in every[k]): every[k] for k in likeliest}
    first, out = tried[0], list(its) or [tried[0]]
    if price is None or first not in its:
        return out
    order = [its[t] for t in (first, *(t for t in out if t != first))]
    different = _different(known, order, alike)
    out = [t for t in out if its[t] in different]
    if price > 0.0 and out[0] != first:
        mine, other = evidence(known, its[first]), evidence(known, its[out[0]])
        ratio = min(mine.overdispersion, other.overdispersion)
        gain = other.corrected(ratio) - mine.corrected(ratio)
        if gain <= price or apart(known, its[out[0]], its[first]) <= limits.APART:
            out = [first, *(t for t in out if t != first)]
    return out


def _different(known: Conditional, parts: Sequence[Part], nats: float) -> set[Part]:
    """Of single columns those that these data can tell from all before them: what explains most
    would lose so many ``nats`` with the one in the place of the other."""
    columns = [i for (i,) in parts]
    info = known.info(tuple(columns))
    # of columns that show nothing the product of sizes would be nothing
    unit = np.maximum(np.diag(info), 1e-300) ** -0.5
    most = 0.5 * float(np.max((known.score[columns] * unit) ** 2))
    alike = most * (1.0 - (info * np.outer(unit, unit)) ** 2) < nats
    kept: list[int] = []
    for k in range(len(columns)):
        if not alike[k, kept].any():
            kept.append(k)
    return {parts[k] for k in kept}
