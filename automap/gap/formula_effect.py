"""A formula that was found, as an effect like any other, and whether held-out data confirm it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from automap.effects import CATALOGUE
from automap.effects.formula_text import parse_formula
from automap.effects.user import ACTS_ON, UserEffect, UserTerm, add_user_effect, user_effect
from automap.gap.columns import effect_columns, node_motion, sensitivities
from automap.gap.fit import Fit, motion_of
from automap.gap.formula import Formula
from automap.gap.heldout import fit_held_out, total_score
from automap.gap.model import GapModel
from automap.gap.noise import fit_noise
from automap.gap.scoring import whitener_of
from automap.gap.screening import whitened_innovations
from automap.gap.search_state import Say, State, fit_all
from automap.gap.whitening import white_rows

PARAMETER = "k"
ROOM = 1.5
SHOWS_NATS = 3.0
"""Held-out data that would show a formula with less than this have no say."""


def effect_of(formula: Formula) -> UserEffect | None:
    """The formula as an effect, None where it is an effect of the catalogue that was left out."""
    if formula.channel not in ACTS_ON:
        return None
    term = UserTerm(
        PARAMETER,
        formula.channel,
        parse_formula(formula.text),
        formula.prior_sd,
        formula=formula.text,
    )
    return user_effect(_name(formula), "a formula that the data show", term)


def _name(formula: Formula) -> str:
    """A name that no other formula has."""
    name, number = f"formula_{formula.channel}", 1
    while (known := CATALOGUE.get(name)) is not None:
        if isinstance(known, UserEffect) and known.terms[0].formula == formula.text:
            break
        number += 1
        name = f"formula_{formula.channel}_{number}"
    return name


def adopt(state: State, say: Say) -> UserEffect | None:
    """Make the formula that was found one of the accepted effects, with the noise that suits it.

    Noise that was fitted without it has swallowed part of it.
    """
    formula = state.unexplained
    effect = None if formula is None else effect_of(formula)
    if formula is None or effect is None:
        return None
    add_user_effect(effect)
    say(f"fitting the noise with {formula.channel} += k * {formula.text}")
    room = max(1.0, ROOM * abs(formula.coefficient) / formula.prior_sd)
    estimate = {**state.accepted, effect.name: room}
    fits = fit_all(state, state.model, estimate)
    model = replace(state.model, factors=fit_noise(fits, known=state.curvatures))
    state.model, state.accepted = model, estimate
    state.fits = fit_all(replace(state, fits=fits), model, estimate)
    return effect


def confirmed(
    before: Sequence[Fit],
    model: GapModel,
    values: Mapping[str, Mapping[str, float]],
    formula: Formula,
) -> bool:
    """Whether held-out data become likelier with the formula, as far as they can tell.

    ``before`` fits of the held-out drives without it, ``values`` those of the named effects. The
    formula's effect becomes one of the users'.
    """
    effect = effect_of(formula)
    if effect is None or not before:
        return True
    add_user_effect(effect)
    found = {effect.name: {PARAMETER: formula.coefficient}}
    held_out = [fit.opened for fit in before]
    after = fit_held_out(held_out, model, {**values, **found}, before)
    expected = sum(_shows(f, effect.name, formula.coefficient) for f in after)
    whitener = whitener_of(after[0])
    gain = total_score(after, whitener) - total_score(before, whitener)
    return gain > 0.0 or expected < SHOWS_NATS


def _shows(fit: Fit, effect: str, coefficient: float) -> float:
    """Nats that a formula of this size should be worth on a drive."""
    motion = motion_of(fit.last)
    at = node_motion(fit, motion)
    columns = effect_columns(effect, fit, motion, at, {PARAMETER: 1.0})
    phi = sensitivities(fit, motion, columns)
    whitened, t, channel = whitened_innovations(fit)
    rows = white_rows(whitener_of(fit), whitened, phi, t, channel)
    return 0.5 * coefficient**2 * float((rows.phi**2).sum())
