"""Whether names that were found are what is missing, or only resemble it.

An effect that is in no library is often told by a name that can take on part of it. Once all
names are found, each is taken out again, and a formula of several terms may have its place: where
the formula explains what the name does and much more, and the name nothing beside the formula,
the name only resembles what is missing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from automap.effects.catalogue import bias_walks
from automap.effects.user import UserEffect, add_user_effect
from automap.gap.comparison import (
    held_out_gain,
    take_formulas_noise,
    unconstrained_gain,
)
from automap.gap.composite import composite_for, slow_formulas
from automap.gap.evidence import p_value
from automap.gap.formula import Formula
from automap.gap.formula_effect import (
    consistent_terms,
    dismiss,
    effect_of,
    fit_as_effect,
    fit_its_noise,
    name_of,
)
from automap.gap.formula_trial import (
    BESIDES_SHARE,
    FORMULA_NATS,
    FORMULA_P,
    OVER_NAMES_NATS,
    RAISED,
)
from automap.gap.heldout import HELD_OUT_SLACK, SURE_NATS
from automap.gap.jumps import jumps_of
from automap.gap.scoring import log_likelihood_ratio
from automap.gap.search_state import (
    LOW_WALK,
    MIN_NATS,
    WALKS,
    Log,
    State,
    fit_all,
    joint_of,
)
from automap.gap.trial import sparsity_gains

ROUNDS = 2
SLOW_TRIALS = 5
PART = 0.3
"""Of what is taken for drift a sensor's likeliest slow formula explains so much, or that sensor
does not drift."""
PROMISING = 0.7
"""A first formula, chosen under the name's noise, must have this share of the name's nats."""


def substitute_formulas(state: State, exclude: Collection[str], log: Log) -> None:
    """Put a formula in the place of a name, or of drift, that only resembles what is missing.

    The state then has the formula as what is unexplained, fitted where it can be an effect.
    """
    for trial in sorted(state.trials, key=lambda t: -t.nats):
        if trial.effect not in state.accepted:
            continue
        log(f"checking {trial.effect} against formulas")
        fewer = {e: s for e, s in state.accepted.items() if e != trial.effect}
        without = replace(
            state,
            accepted=fewer,
            fits=fit_all(state, state.model, fewer),
            trials=[t for t in state.trials if t.effect != trial.effect],
            resembles=trial.effect,
        )
        if _try_in_place(state, without, [trial.effect], exclude, log):
            return
    raised = [
        w for w in WALKS if state.model.factors[w] > RAISED * LOW_WALK * state.stated_factors[w]
    ]
    if raised:
        log("checking the drift against formulas")
        low = {w: LOW_WALK * state.stated_factors[w] for w in raised}
        model = replace(state.model, factors={**state.model.factors, **low})
        without = replace(state, model=model, fits=fit_all(state, model, state.accepted))
        _try_in_place(state, without, raised, exclude, log)


def _try_in_place(
    state: State, without: State, names: Sequence[str], exclude: Collection[str], log: Log
) -> bool:
    """Whether a formula explains more than ``names``, which ``without`` does without, each fitted,
    on held-out data too, and leaves nothing to them; it is then in the state.

    One that explains as much stands with the names as what they cannot be told from.
    """
    few = sparsity_gains(state, names)
    named = log_likelihood_ratio(state.fits, without.fits) + few
    found = _fitted(without, named, exclude, log)
    if names[0] in WALKS and named >= FORMULA_NATS:
        kept = None if found is None else effect_of(_formula_of(found))
        slow = _slow_formula(state, without, names, named, exclude, log)
        if kept is not None:
            # the trials may have dismissed the same terms
            add_user_effect(kept)
        found = _better(found, slow) if found is not None and slow is not None else found or slow
    if found is None:
        return False
    formula = _formula_of(found)
    if take_formulas_noise(state, found, log):
        named = log_likelihood_ratio(state.fits, without.fits) + few
    back = {e: state.accepted[e] for e in names if e in state.accepted}
    both = fit_all(found, found.model, found.accepted | back)
    left = log_likelihood_ratio(both, found.fits) if back else 0.0
    log(
        f"{formula.equation}: {formula.nats:.1f} nats; in its place {named:.1f}, "
        f"beside it {left:.1f}"
    )
    alone = left <= max(MIN_NATS, BESIDES_SHARE * named) and formula.p_value <= FORMULA_P
    # both were fitted, and the formula has paid for its choice
    more = min(
        formula.nats - named, log_likelihood_ratio(found.fits, state.fits) - formula.spent - few
    )
    slack = HELD_OUT_SLACK if more > SURE_NATS else 0.0
    enough = formula.nats >= FORMULA_NATS and more >= OVER_NAMES_NATS
    supported = alone and enough and unconstrained_gain(found, state, log) > 0.0
    if supported and held_out_gain(found, state, log) >= -slack:
        state.accepted, state.trials = found.accepted, found.trials
        state.model, state.fits = found.model, found.fits
        state.unexplained, state.resembles = formula, found.resembles
        return True
    dismiss(formula)
    if alone and formula.nats + formula.spent >= max(FORMULA_NATS, named):
        for name in names:
            known = state.confusable.get(name, ())
            state.confusable[name] = (
                known if formula.equation in known else (*known, formula.equation)
            )
    return False


def _fitted(without: State, named: float, exclude: Collection[str], log: Log) -> State | None:
    """The best formula of some rounds, each chosen under the noise that suited the last one."""
    best: State | None = None
    effect: UserEffect | None = None
    fits = without.fits
    seen: set[str] = set()
    for _ in range(ROUNDS):
        formula = composite_for(fits, exclude)
        if formula is None or formula.equation in seen or formula.nats < max(FORMULA_NATS, named):
            break
        seen.add(formula.equation)
        tried = _pruned(without, formula)
        if tried is None:
            break
        fit_its_noise(tried)
        consistent = _consistent(replace(without, model=tried.model), tried)
        if consistent is None:
            break
        tried = _judged(without, consistent)
        text = _formula_of(tried).equation
        log(f"{text}: {formula.nats:.1f} nats screened, {_nats(tried):.1f} fitted")
        best = tried if best is None else _better(best, tried)
        effect = effect_of(_formula_of(best))
        if _nats(best) < PROMISING * named:
            break
        fits = fit_all(without, tried.model, without.accepted)
    if effect is not None:
        # another round may have dismissed the same terms
        add_user_effect(effect)
    return best


def _better(one: State, other: State) -> State:
    """The state of the likelier formula; the effect of the other's is dismissed."""
    best, worse = (one, other) if _nats(one) >= _nats(other) else (other, one)
    if name_of(_formula_of(worse)) != name_of(_formula_of(best)):
        dismiss(_formula_of(worse))
    return best


def _slow_formula(
    state: State,
    without: State,
    walks: Sequence[str],
    named: float,
    exclude: Collection[str],
    log: Log,
) -> State | None:
    """The slow quantity that explains most of the ``named`` nats that were taken for drift: a step
    of an axis where the drift shows one, or what acts on all axes of a sensor. What is slow looks
    alike and is large: only fits tell one from another."""
    best: State | None = None
    sensors = [bias_walks()[walk].sensor for walk in walks]
    # instants belong to one drive
    fit = state.fits[0] if len(state.fits) == 1 else None
    steps = [] if fit is None else [jump for sensor in sensors for jump in jumps_of(fit, sensor)]
    for jumps, triads in slow_formulas(without.fits, exclude, sensors, steps).values():
        tried: list[tuple[float, Formula]] = []
        for formula in [*jumps, *triads[:SLOW_TRIALS]]:
            one = replace(without, unexplained=formula)
            if not fit_as_effect(one):
                continue
            tried.append((log_likelihood_ratio(one.fits, without.fits), formula))
            log(f"{formula.equation}: {tried[-1][0]:.1f} nats fitted")
            dismiss(formula)
            first = triads and formula is triads[0]
            if first and max(nats for nats, _ in tried) < PART * named:
                break
        if not tried:
            continue
        found = _pruned(without, max(tried, key=lambda item: item[0])[1])
        if found is None:
            continue
        fit_its_noise(found)
        judged = _judged(without, found)
        best = judged if best is None else _better(best, judged)
    return best


def _pruned(without: State, formula: Formula) -> State | None:
    """The state with a formula as an effect, of the terms that are worth what they cost by their
    fitted values; None where it cannot be one."""
    while True:
        tried = replace(without, unexplained=formula)
        if not fit_as_effect(tried):
            return None
        kept = _needed(tried, formula)
        if not kept or len(kept) == len(formula.terms):
            return tried
        dismiss(formula)
        formula = formula.of_terms(kept)


def _consistent(without: State, tried: State) -> State | None:
    """The state with those terms of its formula that measurements bear out: what slips or sways
    is the vehicle, no sensor. None where nothing is left."""
    while True:
        formula = _formula_of(tried)
        good = consistent_terms(tried)
        kept = [i for i in _needed(tried, formula) if good[i]]
        if len(kept) == len(formula.terms):
            return tried
        dismiss(formula)
        if not kept:
            return None
        tried = replace(without, unexplained=formula.of_terms(kept))
        fit_as_effect(tried)


def _needed(tried: State, formula: Formula) -> list[int]:
    """Numbers of the terms whose evidence is more than their choice costs."""
    joint = joint_of(tried.model, tried.accepted, tried.fits, [0.0] * len(tried.fits))
    cost = formula.spent / len(formula.terms)
    out = []
    for i, (value, sd) in enumerate(joint.of(name_of(formula)).values()):
        room = formula.terms[i].prior_sd / sd
        if 0.5 * (value / sd) ** 2 - 0.5 * float(np.log1p(room**2)) > cost:
            out.append(i)
    return out


def _judged(without: State, tried: State) -> State:
    """The state with the evidence of its fitted formula."""
    formula = _formula_of(tried)
    nats = log_likelihood_ratio(tried.fits, without.fits) - formula.spent
    p = p_value(nats, formula.maxima)
    found = replace(formula, evidence=replace(formula.evidence, nats=nats), p_value=p)
    return replace(tried, unexplained=found)


def _formula_of(state: State) -> Formula:
    assert state.unexplained is not None
    return state.unexplained


def _nats(state: State) -> float:
    return _formula_of(state).nats
