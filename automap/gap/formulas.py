"""Formulas as effects, so that the filter can estimate what a search has found."""

from __future__ import annotations

from collections.abc import Collection

from automap.effects import CATALOGUE
from automap.effects.formula_text import parse_formula
from automap.effects.user import (
    UserEffect,
    UserTerm,
    add_user_effect,
    set_user_effects,
    user_effect,
    user_effects,
)
from automap.gap.candidates import Candidate
from automap.gap.dictionary import PREFIX, coefficient_names, left_out_effect
from automap.gap.linear import Linear


def effect_for(candidate: Candidate, linear: Linear) -> str:
    """The name of the effect that stands for a candidate in the filter.

    A named effect stands for itself, and so does one of the catalogue that the library was to do
    without; a formula becomes an effect, once for the same terms.
    """
    if not candidate.terms:
        return candidate.name
    hidden = left_out_effect(candidate.terms[0][0])
    if hidden is not None:
        return hidden
    for known in user_effects():
        # what the user defined stays the user's
        same = [(t.on, t.formula) for t in known.formulas] == list(candidate.terms)
        if known.name.startswith(PREFIX) and same:
            return known.name
    channel = candidate.terms[0][0]
    name, number = PREFIX + channel, 1
    while name in CATALOGUE:
        number += 1
        name = f"{PREFIX}{channel}_{number}"
    sds = linear.prior_sd[list(candidate.parts[0])]
    names = coefficient_names(len(candidate.terms))
    terms = [
        UserTerm(parameter, on, parse_formula(text), float(sd), formula=text)
        for parameter, (on, text), sd in zip(names, candidate.terms, sds, strict=True)
    ]
    add_user_effect(user_effect(name, "a formula that the data show", *terms))
    return name


def forget_formulas(keep: Collection[str]) -> None:
    """Take formulas out of the catalogue that a search has tried, but for those to ``keep``."""
    kept: list[UserEffect] = [
        e for e in user_effects() if not e.name.startswith(PREFIX) or e.name in keep
    ]
    set_user_effects(kept)
