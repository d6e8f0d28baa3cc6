"""Formulas as effects, and effects as formulas.

What a search takes from the dictionary becomes an effect, so that the filter can estimate it; an
effect that the library is to do without is told as a formula.
"""

from __future__ import annotations

from collections.abc import Collection

from automap.effects import CATALOGUE, UserEffect, imu_terms
from automap.effects.formula_text import parse_formula
from automap.effects.imu import BASIS_EXTRA, BASIS_FORCE, BASIS_ONE, ImuTerm
from automap.effects.inertial_signals import formula_of
from automap.effects.user import (
    INERTIAL,
    UserTerm,
    add_user_effect,
    is_users,
    set_user_effects,
    user_effect,
    user_effects,
)
from automap.gap.candidates import PREFIX, Candidate
from automap.gap.columns import effect_columns
from automap.gap.linear import Column
from automap.gap.nodes import NodeMotion
from automap.gap.result import coefficient_names, equation
from automap.records import FloatArray


def left_out_columns(at: NodeMotion, effects: Collection[str]) -> list[Column]:
    """The columns of effects that the library does without, told as formulas."""
    out = []
    for effect in effects:
        if effect in CATALOGUE and CATALOGUE[effect].family in ("imu", "gnss", "vehicle", "clock"):
            sds = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
            out += [_as_formula(c) for c in effect_columns(effect, at, sds)]
    return out


def left_out(effect: str) -> str:
    """The channel of an effect that no formula says and that the library does without."""
    words = {"vehicle": "vehicle", "imu": "readings"}
    return f"{words.get(CATALOGUE[effect].family, 'fixes')} ({effect})"


def left_out_effect(channel: str) -> str | None:
    """The effect of such a channel, None for others."""
    _, bracket, rest = channel.partition(" (")
    return rest.removesuffix(")") if bracket else None


def _as_formula(column: Column) -> Column:
    """A column of an effect that the library does without, told as a formula."""
    if not column.inertial:
        text = column.parameter
        on = left_out(column.effect)
        name = equation([(on, text)])
        return Column(name, text, column.prior_sd, direct=column.direct, term=(on, text))
    part = column.inertial[0]
    channel = INERTIAL[3 * part.sensor + part.axis]
    term: ImuTerm = next(
        t for t in imu_terms([column.effect]) if t.parameter.name == column.parameter
    )
    text = _basis_text(term)
    if not text:
        channel, text = left_out(column.effect), column.parameter
    name = equation([(channel, text)])
    return Column(name, "k", column.prior_sd, column.inertial, term=(channel, text))


def _basis_text(term: ImuTerm) -> str:
    if term.basis == BASIS_ONE:
        return "1"
    if term.basis < BASIS_FORCE:
        return f"rate_{'xyz'[term.basis - 1]}"
    if term.basis < BASIS_EXTRA:
        return f"force_{'xyz'[term.basis - BASIS_FORCE]}"
    if is_users(str(term.extra)):
        effect = CATALOGUE[term.effect]
        assert isinstance(effect, UserEffect)
        return effect.formula(term.parameter.name).formula or term.name
    return formula_of(str(term.extra))


def effect_for(candidate: Candidate, prior_sds: FloatArray) -> str:
    """The name of the effect that stands for a candidate with ``prior_sds`` [p] in the filter.

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
    names = coefficient_names(len(candidate.terms))
    terms = [
        UserTerm(parameter, on, parse_formula(text), float(sd), formula=text)
        for parameter, (on, text), sd in zip(names, candidate.terms, prior_sds, strict=True)
    ]
    add_user_effect(user_effect(name, "a formula that the data show", *terms))
    return name


def forget_formulas(keep: Collection[str]) -> None:
    """Take formulas out of the catalogue that a search has tried, but for those to ``keep``."""
    set_user_effects([e for e in user_effects() if not e.name.startswith(PREFIX) or e.name in keep])
