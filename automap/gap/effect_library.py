"""What the screening tries: the catalogue's effects."""

from __future__ import annotations

from collections.abc import Sequence

from automap.effects import CATALOGUE
from automap.effects.catalogue import alike_to_first_order
from automap.gap.columns import Column, NodeMotion, effect_columns
from automap.gap.fit import Fit, Motion
from automap.gap.model import prior_sd

FAMILIES = ("imu", "vehicle", "clock", "gnss", "earth")


def library(included: frozenset[str], has_wheels: bool, earth_on: bool) -> list[str]:
    """Names of the effects that could be missing from a model."""
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


def library_columns(
    effects: Sequence[str], fit: Fit, motion: Motion, at: NodeMotion
) -> list[Column]:
    """Columns of all effects along one drive; an effect that the drive cannot show has none."""
    columns: list[Column] = []
    options = fit.model.options
    for effect in effects:
        sds = {p.name: prior_sd(options, effect, p.name) for p in CATALOGUE[effect].parameters}
        columns += effect_columns(effect, fit, motion, at, sds or {"on": 1.0})
    return columns
