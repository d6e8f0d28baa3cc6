"""Formulas outside the library against the best name, each fitted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from automap.gap.evidence import p_value
from automap.gap.fit import fit_drive
from automap.gap.formula import Formula, screen_formulas, without_formula
from automap.gap.model import GapModel
from automap.gap.scoring import robust_score, whitener_of
from automap.gap.search_state import (
    LOW_WALK,
    MIN_NATS,
    SLOW_EFFECTS,
    WALKS,
    Say,
    State,
    Trial,
    fit_all,
)

FORMULA_TRIALS = 4
FORMULA_NATS = 25.0
FORMULA_P = 1e-4
FORMULA_SHARE = 0.1
"""A formula must beat all names by so many nats, or this share of their evidence: among a
thousand formulas one resembles whatever rough roads leave behind."""
RAISED = 1.5


def strongest_formula(
    state: State, trials: Sequence[Trial], exclude: Collection[str], say: Say
) -> Formula | None:
    """A formula that beats every name of the library, each fitted."""
    say("screening formulas")
    named = max(trials[0].joint.nats, 0.0) if trials else 0.0
    enough = named + max(FORMULA_NATS, FORMULA_SHARE * named)
    contexts = [(state.model, state.fits)]
    if trials and trials[0].effect in SLOW_EFFECTS and trials[0].nats >= MIN_NATS:
        # under the noise that the best name was judged with: drift hides slow formulas too
        model = trials[0].model
        contexts.append((model, fit_all(state, model, state.accepted)))
    elif any(state.model.factors[w] > RAISED * state.asked[w] for w in WALKS):
        low = {w: LOW_WALK * state.asked[w] for w in WALKS}
        model = replace(state.model, factors={**state.model.factors, **low})
        contexts.append((model, fit_all(state, model, state.accepted)))
    best: Formula | None = None
    for model, fits in contexts:
        for formula in screen_formulas(fits, exclude)[:FORMULA_TRIALS]:
            # a fit never has more than the screening
            if formula.nats < enough or formula.p_value > FORMULA_P:
                continue
            tried = _fit_formula(state, model, formula)
            say(
                f"{formula.channel} += k * {formula.text}: {tried.nats:.1f} nats fitted, "
                f"{formula.nats:.1f} screened, names {named:.1f}"
            )
            if best is None or tried.nats > best.nats:
                best = tried
    if best is None or best.nats < enough:
        return None
    if best.p_value > FORMULA_P:
        return None
    return best


def _fit_formula(state: State, model: GapModel, formula: Formula) -> Formula:
    """The evidence of a formula by fits with its part taken out, along the coefficient."""
    whiteners = [whitener_of(f) for f in state.fits]
    before = [robust_score(f, w) for f, w in zip(state.fits, whiteners, strict=True)]

    def gain(k: float) -> float:
        total = 0.0
        for opened, fit, column, old, whitener in zip(
            state.drives, state.fits, formula.columns, before, whiteners, strict=False
        ):
            changed = without_formula(opened, fit, column, k)
            new = fit_drive(changed, model, state.accepted, near=fit)
            total += robust_score(new, whitener) - old
        return total

    sizes = np.array([0.5, 1.0, 1.5]) * formula.coefficient
    gains = [gain(float(k)) for k in sizes]
    best, most = float(sizes[int(np.argmax(gains))]), max(gains)
    # the top of the parabola through nothing and the three
    curve = np.polyfit(np.concatenate([[0.0], sizes]), [0.0, *gains], 2)
    if curve[0] < 0.0:
        top = -curve[1] / (2.0 * curve[0])
        if 0.3 * abs(formula.coefficient) < abs(top) < 2.0 * abs(formula.coefficient):
            best, most = float(top), max(most, float(np.polyval(curve, top)))
    occam = 0.5 * np.log1p((formula.prior_sd / max(formula.sd, 1e-300)) ** 2)
    nats = (most - occam) / np.sqrt(formula.evidence.excess) if most > 0.0 else most
    # linear in its coefficient: what the fits show beyond the screening is not the formula's
    nats = min(nats, formula.nats)
    found = replace(formula.evidence, nats=float(nats))
    p = p_value(float(nats), formula.maxima)
    return replace(formula, evidence=found, coefficient=best, p_value=p)
