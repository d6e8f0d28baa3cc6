"""A formula that was found, as an effect like any other, and whether held-out data confirm it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.formula_text import parse_formula
from automap.effects.user import (
    ACTS_ON,
    UserEffect,
    UserTerm,
    add_user_effect,
    set_user_effects,
    user_effect,
    user_effects,
)
from automap.fusion.levels import VEHICLE_LEVELS
from automap.gap.columns import effect_columns, node_motion, sensitivities
from automap.gap.fit import Fit, motion_of
from automap.gap.formula import CONFLICT, Formula
from automap.gap.heldout import fit_held_out, total_score
from automap.gap.model import GapModel
from automap.gap.noise import fit_noise
from automap.gap.scoring import whitener_of
from automap.gap.screening import whitened_innovations
from automap.gap.search_state import Log, State, fit_all, joint_of
from automap.gap.whitening import white_rows

PREFIX = "formula_"
ROOM = 1.5
LOOSE = 100.0
"""Factor on the vehicle constraint's sds that takes all it says away."""
SEEN = 3.0
"""Sigmas by which measurements alone show what they and the constraint disagree on."""
LEAST_SHARE = 0.3
SHOWS_NATS = 3.0
"""Held-out data that would show a formula with less than this have no say."""


def effect_of(formula: Formula) -> UserEffect | None:
    """The formula as an effect, None where it is an effect of the catalogue that was left out."""
    if any(term.channel not in ACTS_ON for term in formula.terms):
        return None
    terms = [
        UserTerm(name, term.channel, parse_formula(term.text), term.prior_sd, formula=term.text)
        for name, term in zip(formula.names, formula.terms, strict=True)
    ]
    return user_effect(name_of(formula), "a formula that the data show", *terms)


def name_of(formula: Formula) -> str:
    """The name of the formula's effect: that of one of the same terms, or a free one."""
    texts = [(term.channel, term.text) for term in formula.terms]
    for known in user_effects():
        # what the user defined stays the user's
        if known.name.startswith(PREFIX) and [(k.on, k.formula) for k in known.formulas] == texts:
            return known.name
    name, number = PREFIX + formula.channel, 1
    while name in CATALOGUE:
        number += 1
        name = f"{PREFIX}{formula.channel}_{number}"
    return name


def adopt(state: State, log: Log) -> bool:
    """Make the formula that was found one of the accepted effects, with the noise that suits it;
    whether it can be one.

    Noise that was fitted without it has swallowed part of it.
    """
    if not fit_as_effect(state):
        return False
    assert state.unexplained is not None
    log(f"fitting the noise with {state.unexplained.equation}")
    fit_its_noise(state)
    return True


def fit_as_effect(state: State) -> bool:
    """Make the formula that was found one of the accepted effects, under the state's noise;
    whether it can be one."""
    formula = state.unexplained
    effect = None if formula is None else effect_of(formula)
    if formula is None or effect is None:
        return False
    add_user_effect(effect)
    room = max(1.0, *(ROOM * abs(term.coefficient) / term.prior_sd for term in formula.terms))
    state.accepted = {**state.accepted, effect.name: room}
    state.fits = fit_all(state, state.model, state.accepted)
    return True


def fit_its_noise(state: State) -> None:
    """Noise levels that suit the state's effects."""
    factors = fit_noise(state.fits, known=state.curvatures)
    state.model = replace(state.model, factors=factors)
    state.fits = fit_all(state, state.model, state.accepted)


def consistent_terms(state: State) -> list[bool]:
    """Of each term of the state's fitted formula whether measurements bear out its value.

    Everything is fitted again without the vehicle constraint, which bends all states. Where the
    value with it and the value without it contradict each other, the latter must be of the same
    sign by itself: what slips or sways is the vehicle, no sensor.
    """
    assert state.unexplained is not None
    loose = unconstrained(state)
    values, free = (_terms(state, one.model, one.fits) for one in (state, loose))
    out = []
    for (value, sd), (alone, alone_sd) in zip(values, free, strict=True):
        # the sd of what one more source of information moves an estimate by
        apart = max(alone_sd**2 - sd**2, (LEAST_SHARE * alone_sd) ** 2) ** 0.5
        agree = abs(alone - value) < CONFLICT * apart
        out.append(bool(agree or alone * np.sign(value) > SEEN * alone_sd))
    return out


def unconstrained(state: State) -> State:
    """The state fitted without the vehicle constraint."""
    factors = {**state.model.factors, **dict.fromkeys(VEHICLE_LEVELS, LOOSE)}
    model = replace(state.model, factors=factors)
    return replace(state, model=model, fits=fit_all(state, model, state.accepted))


def _terms(state: State, model: GapModel, fits: Sequence[Fit]) -> list[tuple[float, float]]:
    """Value and sd of each term of the state's formula."""
    assert state.unexplained is not None
    joint = joint_of(model, state.accepted, fits, [0.0] * len(fits))
    return list(joint.of(name_of(state.unexplained)).values())


def formula_validated(
    before: Sequence[Fit],
    model: GapModel,
    values: Mapping[str, Mapping[str, float]],
    formula: Formula,
) -> bool:
    """Whether held-out data become likelier with the formula, as far as they can tell.

    ``before`` fits of the held-out drives without it, ``values`` those of the named effects. The
    formula's effect becomes one of the users' where they do.
    """
    effect = effect_of(formula)
    if effect is None or not before:
        return True
    add_user_effect(effect)
    found = {effect.name: coefficients(formula)}
    held_out = [fit.opened for fit in before]
    after = fit_held_out(held_out, model, {**values, **found}, before)
    expected = sum(_shows(f, effect.name, coefficients(formula)) for f in after)
    whitener = whitener_of(after[0])
    gain = total_score(after, whitener) - total_score(before, whitener)
    helps = gain > 0.0 or expected < SHOWS_NATS
    if not helps:
        dismiss(formula)
    return helps


def dismiss(formula: Formula) -> None:
    """Take a formula's effect out of the users' effects, that nobody is asked for it as a name."""
    name = name_of(formula)
    set_user_effects([e for e in user_effects() if e.name != name])


def coefficients(formula: Formula) -> dict[str, float]:
    """Parameter of the formula's effect -> coefficient."""
    return dict(zip(formula.names, (t.coefficient for t in formula.terms), strict=True))


def _shows(fit: Fit, effect: str, values: Mapping[str, float]) -> float:
    """Nats that a formula of this size should be worth on a drive."""
    motion = motion_of(fit.last)
    at = node_motion(fit, motion)
    columns = effect_columns(effect, fit, motion, at, dict.fromkeys(values, 1.0))
    each = sensitivities(fit, motion, columns)
    phi = each @ np.array([[values[column.parameter]] for column in columns])
    whitened, t, channel = whitened_innovations(fit)
    rows = white_rows(whitener_of(fit), whitened, phi, t, channel)
    return 0.5 * float((rows.phi**2).sum())
