"""What may be missing from a model: named effects and formulas, candidates of one kind.

A candidate has columns (how the innovations would show a unit of each of its parameters), prior
sds, and the logarithm of its prior probability. Which of them are missing is one comparison of
models: the evidence of a set of candidates together with its prior probability.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from automap.effects import CATALOGUE
from automap.effects.catalogue import alike_to_first_order, pairs_of_sign
from automap.gap import limits
from automap.gap.fit import ORIGIN
from automap.gap.linear import Column

FIX_AGE, VELOCITY_AGE = "gnss_latency", "gnss_velocity_latency"
PREFIX = "formula_"
"""Names of effects that were made of a formula begin with it."""
COURSE = re.compile(
    r"\(?(step\((cos\(2 \* pi \* \()?time - |max\(time - |exp\(-time / |"
    r"(sin|cos)\(2 \* pi \* time / )"
)
GAIN = re.compile(r"(rate|force)_[xyz] \* ")
FAMILIES = ("imu", "vehicle", "clock", "gnss", "earth")


@dataclass(frozen=True)
class Candidate:
    """One thing that may be missing.

    ``parts`` are groups of columns of a layout: any of a named effect's parameters may act by
    itself (one axis is bent, not all nine elements of a matrix), a formula's terms act together.
    ``log_prior`` of the candidate, ``log_choice`` of each part. ``terms`` are channel and text of
    a formula's terms, none for a named effect. ``positive``: nature knows no other sign, ``unless``
    beside another. ``isotropic``: nature knows it much the same on all axes.
    ``choices``: of so many like it it is the likeliest. ``beside``: columns that are free wherever
    it is judged, since what they say is no evidence for it.
    """

    name: str
    parts: tuple[tuple[int, ...], ...]
    log_prior: float
    log_choice: float = 0.0
    terms: tuple[tuple[str, str], ...] = ()
    positive: bool = False
    unless: str = ""
    isotropic: bool = False
    choices: float = 1.0
    beside: tuple[int, ...] = ()


def library(included: frozenset[str], has_wheels: bool, earth_on: bool) -> list[str]:
    """Names of the effects that could be missing from a model that has the effects ``included``."""
    taken = set(included)
    for pair in alike_to_first_order():
        if taken & set(pair):
            # once one is in the model, the other says nothing new to first order
            taken |= set(pair)
    out = []
    for name, effect in CATALOGUE.items():
        known = name in taken or effect.nuisance or (effect.family == "earth" and earth_on)
        if effect.family in FAMILIES and not known and (has_wheels or not effect.needs_wheels):
            out.append(name)
    return out


def candidates_of(layout: Sequence[Column], effects: Collection[str]) -> list[Candidate]:
    """The candidates whose columns are in a layout, those of named ``effects`` first."""
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(layout):
        groups.setdefault(column.effect, []).append(i)
    named = [e for e in groups if e in effects]
    formulas = [e for e in groups if e not in effects]
    signs = {e for pair in pairs_of_sign(-1.0) if set(pair) <= set(named) for e in pair}
    # one missing effect in so many is none of the library's
    outside = math.log(limits.OUTSIDE_LIBRARY)
    inside = math.log1p(-limits.OUTSIDE_LIBRARY)
    out = []
    for effect in named:
        # of a drift the rate: nobody knows when there was nothing, and a constant is another name's
        beside = tuple(i for i in groups[effect] if layout[i].parameter == ORIGIN)
        parts = [(i,) for i in groups[effect] if i not in beside]
        out.append(
            Candidate(
                effect,
                tuple(parts),
                inside - math.log(len(named)),
                -math.log(len(parts)),
                positive=CATALOGUE[effect].never_negative or effect in {*signs, VELOCITY_AGE},
                # beside late fixes a velocity may be the less late of the two
                unless=FIX_AGE if effect == VELOCITY_AGE else "",
                isotropic=CATALOGUE[effect].isotropic,
                beside=beside,
            )
        )
    texts = {n: tuple(layout[i].term for i in groups[n]) for n in formulas}
    choices = {n: layout[groups[n][0]].choices for n in formulas}
    # courses of time that are the likeliest of many share the prior of all of these
    courses = {n for n in formulas if choices[n] > 1.0 and follows_time(texts[n])}
    plain, many = len(formulas) - len(courses), sum(choices[n] for n in courses)
    kinds = (plain > 0) + (many > 0)
    for name in formulas:
        # what is near another formula shares the prior of what is tried in the place of that
        like = many if name in courses else plain * choices[name]
        its = (outside - math.log(kinds * like), 0.0, texts[name])
        out.append(Candidate(name, (tuple(groups[name]),), *its, choices=choices[name]))
    return out


def is_course(terms: Sequence[tuple[str, str]]) -> bool:
    """Whether a formula is a course of time with an instant, a time constant or a period."""
    return bool(terms) and all(COURSE.match(text) for _, text in terms)


def follows_time(terms: Sequence[tuple[str, str]]) -> bool:
    """Whether a formula is a course of time, of a bias or of a gain."""
    return is_course([(on, GAIN.sub("", text, count=1)) for on, text in terms])


def twins_of(names: Sequence[str]) -> frozenset[str]:
    """Effects that act as chosen ones do to first order."""
    out = set()
    for one, other in alike_to_first_order():
        if one in names:
            out.add(other)
        if other in names:
            out.add(one)
    return frozenset(out)
