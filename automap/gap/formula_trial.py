"""Formulas outside the library against the best name, each fitted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.levels import ALL_LEVELS
from automap.gap.dictionary import left_out_effect, shape_of
from automap.gap.drive import OpenDrive
from automap.gap.evidence import p_value
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula import Formula, refined, screen_formulas, without_formula
from automap.gap.model import GapModel
from automap.gap.naming import CLOSE_NATS
from automap.gap.noise import fit_noise
from automap.gap.scoring import log_likelihood_ratio
from automap.gap.search_state import (
    LOW_WALK,
    MIN_NATS,
    WALKS,
    Log,
    State,
    Trial,
    fit_all,
)

FORMULA_TRIALS = 4
FORMULA_NATS = 25.0
FORMULA_P = 1e-4
OVER_NAMES_NATS = 15.0
FORMULA_SHARE = 0.05
"""A formula needs so many nats, since among hundreds of formulas one resembles whatever rough
roads leave behind. Over names it needs the logarithm of their number, 6, that of how much oftener
an effect of the library is what is missing, 3, and twice the scatter of fitted evidence, 6; or this
share of the names' evidence, which is linearised."""
RAISED = 1.5
BESIDES_SHARE = 0.3
"""A name that keeps this share of its evidence beside a formula is not what the formula is."""


def strongest_formula(
    state: State, trials: Sequence[Trial], exclude: Collection[str], log: Log
) -> Formula | None:
    """A formula that beats every name of the library, each fitted.

    One that does as well as the best name, but no better, is left in the state.
    """
    log("screening formulas")
    named = max(trials[0].joint.nats, 0.0) if trials else 0.0
    enough = max(FORMULA_NATS, named + max(OVER_NAMES_NATS, FORMULA_SHARE * named))
    contexts = [(state.model, state.fits)]
    best_name = trials[0] if trials and trials[0].nats >= MIN_NATS else None
    if best_name is not None and CATALOGUE[best_name.effect].resembles_drift:
        # under the noise that the best name was judged with: drift hides slow formulas too
        model = best_name.model
        contexts.append((model, fit_all(state, model, state.accepted)))
    elif any(state.model.factors[w] > RAISED * state.stated_factors[w] for w in WALKS):
        low = {w: LOW_WALK * state.stated_factors[w] for w in WALKS}
        model = replace(state.model, factors={**state.model.factors, **low})
        contexts.append((model, fit_all(state, model, state.accepted)))
    best: _Tried | None = None
    for model, fits in contexts:
        own = model is state.model
        for formula in _different(screen_formulas(fits, exclude, correct_overdispersion=own)):
            # a fit never has more than the screening
            if formula.nats < enough or formula.p_value > FORMULA_P:
                continue
            formula = refined(fits, formula, correct_overdispersion=own)
            tried = _fit_formula(state, model, fits, formula)
            log(
                f"{formula.equation}: {tried.formula.nats:.1f} nats fitted, "
                f"{formula.nats:.1f} screened, names {named:.1f}"
            )
            if best is None or tried.formula.nats > best.formula.nats:
                best = tried
    if best is not None and best.formula.nats < enough + OVER_NAMES_NATS:
        best = _with_refitted_noise(state, best, log)
    state.equivalent_formula = None
    if best is None or best.formula.nats < enough or best.formula.p_value > FORMULA_P:
        if best is not None and best.formula.nats > named - CLOSE_NATS:
            state.equivalent_formula = best.formula.equation
        return None
    if trials and trials[0].nats >= MIN_NATS:
        left = _left_for(state, best, trials[0])
        log(f"{trials[0].effect}: {left:.1f} nats beside the formula")
        if left > max(MIN_NATS, BESIDES_SHARE * trials[0].nats):
            # both are there: the name first, and what it leaves to the formula after it
            return None
    return best.formula


def _left_for(state: State, tried: _Tried, trial: Trial) -> float:
    """Nats that a name still explains once the formula's part is out of the drives."""
    estimate = state.accepted | {trial.effect: trial.scale}
    model = tried.fits[0].model
    after = [
        fit_drive(opened, model, estimate, linearised_at=before)
        for opened, before in zip(tried.drives, tried.fits, strict=True)
    ]
    return log_likelihood_ratio(after, tried.fits, tried.fits)


def _different(formulas: Sequence[Formula]) -> list[Formula]:
    """The strongest formulas, one of those that differ in their time alone."""
    out: list[Formula] = []
    seen: set[tuple[str, str]] = set()
    for formula in formulas:
        shape = (formula.channel, shape_of(formula.text))
        if shape not in seen:
            out.append(formula)
        seen.add(shape)
        if len(out) == FORMULA_TRIALS:
            break
    return out


@dataclass(frozen=True)
class _Tried:
    """A formula that was fitted: with its evidence and coefficient, fits to the drives without
    its part, the evidence that the screening of ``context`` allows."""

    formula: Formula
    drives: tuple[OpenDrive, ...]
    fits: tuple[Fit, ...]
    allowed: float


def _fit_formula(state: State, model: GapModel, context: Sequence[Fit], formula: Formula) -> _Tried:
    """The evidence of a formula by fits with its part taken out, along the coefficient.

    ``context`` the fits without it under ``model``. Where that drifts less than the state's, it
    is given the drift that is still wanted with the formula.
    """
    known: dict[float, _Tried] = {}
    effect = left_out_effect(formula.channel)

    def gain(k: float) -> float:
        drives, with_it = list(state.drives), model
        if effect is not None:
            with_it = replace(model, values={**model.values, effect: {formula.text: k}})
        else:
            drives = [
                without_formula(opened, fit, column, k)
                for opened, fit, column in zip(drives, context, formula.columns, strict=False)
            ]
        fits = [
            fit_drive(opened, with_it, state.accepted, linearised_at=fit)
            for opened, fit in zip(drives, context, strict=False)
        ]
        known[k] = _Tried(formula, tuple(drives), tuple(fits), formula.nats)
        return _gain(state, fits)

    sizes = np.array([0.5, 1.0, 1.5]) * formula.coefficient
    gains = [_gain(state, context), *(gain(float(k)) for k in sizes)]
    tops = np.array([0.0, *sizes])
    best, most = float(tops[int(np.argmax(gains))]), max(gains)
    # the top of the parabola through nothing and the three
    curve = np.polyfit(tops, gains, 2)
    if curve[0] < 0.0:
        top = -curve[1] / (2.0 * curve[0])
        if 0.3 * abs(formula.coefficient) < abs(top) < 2.0 * abs(formula.coefficient):
            best, most = float(top), max(most, float(np.polyval(curve, top)))
    nearest = float(sizes[int(np.argmin(np.abs(sizes - best)))])
    tried = replace(known[nearest], formula=replace(formula, coefficient=best))
    if model is not state.model:
        tried, again = _with_noise(state, tried, WALKS)
        most = max(most, again)
    return _judged(tried, most)


def _gain(state: State, fits: Sequence[Fit]) -> float:
    """Log-likelihood of fits over that of the state's own, whitened as these, nats."""
    return log_likelihood_ratio(fits, state.fits, state.fits)


def _with_noise(state: State, tried: _Tried, levels: Collection[str]) -> tuple[_Tried, float]:
    """The formula again with noise levels that suit it, and what it gains so over the better of
    two models without it: the state's and that with the same noise."""
    factors = fit_noise(tried.fits, levels, known=state.curvatures)
    model = replace(tried.fits[0].model, factors=factors)
    fits = [
        fit_drive(opened, model, state.accepted, linearised_at=fit)
        for opened, fit in zip(tried.drives, tried.fits, strict=True)
    ]
    plain = replace(model, values=state.model.values)
    without = _gain(state, fit_all(state, plain, state.accepted))
    return replace(tried, fits=tuple(fits)), _gain(state, fits) - max(without, 0.0)


def _with_refitted_noise(state: State, tried: _Tried, log: Log) -> _Tried:
    """The better of a fitted formula and the same with the noise that suits it, as the strongest
    names have theirs."""
    log(f"fitting the noise with {tried.formula.equation}")
    again, gained = _with_noise(state, tried, ALL_LEVELS)
    again = _judged(again, gained)
    return again if again.formula.nats > tried.formula.nats else tried


def _judged(tried: _Tried, gained: float) -> _Tried:
    """The formula with the evidence that ``gained`` nats of likelihood are."""
    formula = tried.formula
    occam = 0.5 * np.log1p((formula.prior_sd / max(formula.sd, 1e-300)) ** 2)
    nats = (gained - occam) / np.sqrt(formula.evidence.overdispersion) if gained > 0.0 else gained
    # linear in its coefficient: what the fits show beyond the screening is not the formula's
    nats = min(float(nats), tried.allowed)
    found = replace(formula.evidence, nats=nats)
    p = p_value(nats, formula.maxima)
    return replace(tried, formula=replace(formula, evidence=found, p_value=p))
