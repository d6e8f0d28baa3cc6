"""What may be missing from a model: named effects and formulas, candidates of one kind.

A candidate has columns (how the innovations would show a unit of each of its parameters), prior
sds, and the logarithm of its prior probability. Which of them are missing is one comparison of
models: the evidence of a set of candidates together with its prior probability.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from automap.effects import CATALOGUE
from automap.effects.catalogue import alike_to_first_order, pairs_of_sign
from automap.gap import limits
from automap.gap.columns import Column, NodeMotion, effect_columns
from automap.gap.fit import Fit
from automap.gap.model import SKEW, prior_sd
from automap.gap.motion import Motion

FIX_AGE, VELOCITY_AGE = "gnss_latency", "gnss_velocity_latency"
FAMILIES = ("imu", "vehicle", "clock", "gnss", "earth")


@dataclass(frozen=True)
class Candidate:
    """One thing that may be missing.

    ``parts`` are groups of columns of a layout: any of a named effect's parameters may act by
    itself (one axis is bent, not all nine elements of a matrix), a formula's terms act together.
    ``log_prior`` of the candidate, ``log_choice`` of each part. ``terms`` are channel and text of
    a formula's terms, none for a named effect. ``positive``: nature knows no other sign, ``unless``
    beside another. ``isotropic``: nature knows it much the same on all axes.
    ``choices``: of so many like it it is the likeliest.
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


def named_columns(effects: Sequence[str], fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
    """Columns of named effects along one drive; an effect that the drive cannot show has none."""
    columns: list[Column] = []
    options = fit.model.options
    for effect in effects:
        sds = {p.name: prior_sd(options, effect, p.name) for p in CATALOGUE[effect].parameters}
        columns += effect_columns(effect, fit, motion, at, sds or {"on": 1.0})
    return columns


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
        rows = groups[effect]
        parts = [tuple(rows)] if effect == SKEW else [(i,) for i in rows]
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
            )
        )
    # those that are the likeliest of many share the prior of all of these
    plain = sum(layout[groups[n][0]].choices == 1.0 for n in formulas)
    many = sum(c for n in formulas if (c := layout[groups[n][0]].choices) > 1.0)
    kinds = (plain > 0) + (many > 0)
    for name in formulas:
        rows = groups[name]
        terms = tuple(layout[i].term for i in rows)
        choices = layout[rows[0]].choices
        prior = outside - math.log(kinds * (plain if choices == 1.0 else many))
        out.append(Candidate(name, (tuple(rows),), prior, terms=terms, choices=choices))
    return out
