"""The search: name one missing effect after another until nothing stands out any more."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import bias_walks
from automap.fusion.levels import ALL_LEVELS
from automap.gap.clock_offset import missing_offset, starting_offset
from automap.gap.drive import OpenDrive
from automap.gap.effect_library import library
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula import Formula
from automap.gap.formula_effect import consistent_terms, dismiss, fit_as_effect, formula_validated
from automap.gap.formula_trial import strongest_formula
from automap.gap.heldout import (
    HELD_OUT_SLACK,
    SURE_NATS,
    fit_held_out,
    fit_held_out_uncertain,
    score_under_better_noise,
    total_score,
)
from automap.gap.model import SKEW, GapModel
from automap.gap.naming import (
    CLOSE_NATS,
    FIX_DELAY,
    OFFSETS,
    VELOCITY_DELAYS,
    by_sign,
    confusable_with_best,
    offset_at_start,
    offset_besides,
    offset_first,
)
from automap.gap.noise import Curvatures, fit_noise, noise_score
from automap.gap.noise_kinds import with_noise_kinds, without_wander
from automap.gap.scoring import Joint, log_likelihood_ratio, whitener_of
from automap.gap.screening import screen
from automap.gap.search_state import (
    MAX_P,
    MIN_NATS,
    Log,
    State,
    Trial,
    estimated,
    fit_all,
    joint_of,
    values_of,
)
from automap.gap.shortlist import shortlist
from automap.gap.trial import (
    INERTIAL_LEVELS,
    against_better_null,
    evidence_bound,
    null_fits,
    sparsity_gain,
    take_better_noise,
    trials_under_stated_noise,
    trials_with_little_drift,
    try_candidate,
    under_common_whitener,
    with_refitted_noise,
)
from automap.gap.whitening import Whitener

MAX_FINDINGS = 8
SWAP_NATS = 1.0
LESS_DRIFT = 0.7


def initial_state(
    drives: Sequence[OpenDrive], held_out: Sequence[OpenDrive], model: GapModel, log: Log
) -> State:
    """Fit the base model, its noise first."""
    stated_factors = dict(model.factors)
    log("fitting the base model")
    fits = [fit_drive(d, model) for d in drives]
    others = tuple(k for k in ALL_LEVELS if k not in INERTIAL_LEVELS)
    log("fitting the noise")
    # the sensors' noise first or the fixes': the likelihood has a top for either
    known: Curvatures = {}
    tops = [
        fit_noise(fits, initial=fit_noise(fits, levels, known=known), known=known)
        for levels in (INERTIAL_LEVELS, others)
    ]
    best = max(tops, key=lambda factors: noise_score(fits, factors))
    found = with_noise_kinds(fits, replace(model, factors=best), log)
    state = State(list(drives), list(held_out), stated_factors, found.model, found.fits)
    state.stages.append((state.model, {}))
    return state


def candidates_of(state: State, exclude: Collection[str]) -> list[str]:
    """Effects that may be missing and were not refused already."""
    has_wheels = any(d.session.odometer is not None for d in state.drives)
    included = state.model.included | set(state.accepted) | set(state.refused) | set(exclude)
    for opened in state.drives:
        if opened.drive.mounting_sd.any():
            included |= {"imu_mounting"}
        if opened.drive.delay.sd > 0.02:
            # a free offset between the clocks is the same thing
            included |= {"gnss_latency"}
    return library(frozenset(included), has_wheels, state.model.options.earth_rotation)


def forward_step(state: State, exclude: Collection[str], log: Log) -> Trial | None:
    """Name the next missing effect, or None. The state moves on when one is named."""
    effects = candidates_of(state, exclude)
    if not effects:
        return None
    offset = missing_offset(state, effects, log)
    if offset is not None and validated(state, offset, log):
        state.confusable[offset.effect] = confusable_with_best(offset, (), effects, None)
        return accept(state, offset, log)
    log("screening the library")
    screening = screen(state.fits, effects)
    trials = trials_under_stated_noise(state, effects, log)
    slow: list[Trial] = []
    if not any(t.nats >= MIN_NATS for t in trials):
        chosen = shortlist(screening, state.accepted)
        trials += [try_candidate(state, c, state.model, screening, log) for c in chosen]
        slow = trials_with_little_drift(state, effects, log)
    trials = by_sign([*trials, *slow], effects)
    trials.sort(key=lambda t: -t.joint.nats)
    trials = with_refitted_noise(state, trials, log)
    nulls = null_fits(state, trials)
    if take_better_noise(state, nulls, log):
        return forward_step(state, exclude, log)
    trials = offset_first(under_common_whitener(against_better_null(state, trials, nulls)))
    for t in trials:
        log(f"{t.effect}: {t.nats:.1f} nats, screened {t.screened:.1f}, p {t.p_value:.1e}")
    formula = strongest_formula(state, trials, exclude, log) if state.formulas else None
    rejection = None if formula is None else _why_rejected(state, formula, log)
    if formula is not None and rejection is not None:
        state.warnings.append(
            f"{formula.equation} would explain {formula.nats:.0f} nats of the "
            f"fitted data, but {rejection}; it is not told"
        )
        formula = None
    if formula is not None:
        state.unexplained = formula
        if trials and trials[0].nats > MIN_NATS:
            state.resembles = trials[0].effect
            state.runner_up = trials[0] if trials[0].p_value <= MAX_P else None
        return None
    if not trials or trials[0].nats < MIN_NATS or trials[0].p_value > MAX_P:
        besides = starting_offset(state, effects, log)
        if besides is not None:
            return accept(state, besides, log)
        _note_confusable_with_drift(state, [*trials, *slow])
        return None
    best = trials[0]
    if not validated(state, best, log):
        state.refused[best.effect] = (
            f"{best.effect} would explain {best.nats:.0f} nats of the fitted data, but the "
            "held-out data do not confirm it; it is not named"
        )
        return forward_step(state, exclude, log)
    state.confusable[best.effect] = confusable_with_best(best, trials[1:], effects, screening)
    if state.equivalent_formula is not None:
        state.confusable[best.effect] += (state.equivalent_formula,)
    return accept(state, best, log)


def _note_confusable_with_drift(state: State, trials: Sequence[Trial]) -> None:
    """Keep the names that a drift of the biases cannot be told from: with them less of it is left,
    and the data are as likely."""
    for walk, bias in bias_walks().items():
        alike = [
            t.effect
            for t in trials
            if CATALOGUE[t.effect].sensor == bias.sensor
            and t.nats > -CLOSE_NATS
            and t.model.factors[walk] < LESS_DRIFT * state.model.factors[walk]
        ]
        known = state.confusable.get(walk, ())
        state.confusable[walk] = (*known, *dict.fromkeys(e for e in alike if e not in known))


def accept(state: State, best: Trial, log: Log) -> Trial:
    """Make a trial's effect one of the state's."""
    state.accepted[best.effect] = best.scale
    state.trials.append(replace(best, stage=len(state.trials) + 1))
    state.model, state.fits = best.model, list(best.fits)
    # what held-out data refused may have been bent by what was still missing
    state.refused.clear()
    if CATALOGUE[best.effect].resembles_velocity_wander:
        plain = without_wander(state.fits, state.model, state.accepted, log)
        if plain is not None:
            state.model, state.fits = plain.model, plain.fits
    state.stages.append((state.model, estimated(state)))
    return best


def validated(state: State, trial: Trial, log: Log) -> bool:
    """Whether the held-out data are more likely with the effect than without."""
    if not state.held_out:
        return True
    log(f"checking {trial.effect} on held-out data")
    before = estimated(state)
    after = values_of(trial.joint, [*state.accepted, trial.effect])
    wider = float(np.sqrt(trial.candidate.evidence.overdispersion))
    sds = {p: wider * sd for p, (_, sd) in trial.joint.of(trial.effect).items()}
    old = state.held_fits = fit_held_out(state.held_out, state.model, before, state.held_fits)
    whitener: Whitener = whitener_of(trial.fits[0])

    def without(model: GapModel) -> list[Fit]:
        return fit_held_out(state.held_out, model, before, old)

    def with_effect(model: GapModel) -> list[Fit]:
        return fit_held_out_uncertain(state.held_out, model, after, trial.effect, sds, old)

    # with the noise that either model was fitted with, or both under whichever suits them better
    models = (state.model, trial.model)
    gain = max(
        total_score(with_effect(trial.model), whitener) - total_score(old, whitener),
        score_under_better_noise(with_effect, models, whitener)
        - score_under_better_noise(without, models, whitener),
    )
    return gain > (-HELD_OUT_SLACK if trial.nats > SURE_NATS else 0.0)


def _why_rejected(state: State, formula: Formula, log: Log) -> str | None:
    """Why a formula is not to be believed: measurements do not show it, or held-out data do not
    become more likely with it, as far as they can tell."""
    log(f"checking {formula.equation} on held-out data")
    tried = replace(state, unexplained=formula)
    if fit_as_effect(tried) and not all(consistent_terms(tried)):
        dismiss(formula)
        return "only the vehicle constraint shows it"
    values = estimated(state)
    old = state.held_fits = fit_held_out(state.held_out, state.model, values, state.held_fits)
    if not formula_validated(old, state.model, values, formula):
        return "the held-out data do not confirm it"
    return None


def _resolve_delay(state: State, log: Log) -> None:
    """Whether velocities come late, through a low-pass or with their whole fix, once all else is
    named: with other effects still missing one resembles the other."""
    free = set(candidates_of(state, state.exclude)) | set(VELOCITY_DELAYS) - state.exclude
    delay = next((e for e in VELOCITY_DELAYS if e in state.accepted), None)
    if delay is None:
        return
    whitener = whitener_of(state.fits[0])
    before = total_score(state.fits, whitener)
    found = []
    for other in (*VELOCITY_DELAYS, FIX_DELAY):
        if other in state.accepted or other not in free:
            continue
        log(f"checking whether {delay} is {other}")
        swapped = {other if e == delay else e: s for e, s in state.accepted.items()}
        fits = fit_all(state, state.model, swapped)
        # whole fixes are late more often
        head_start = CLOSE_NATS if other == FIX_DELAY else -SWAP_NATS
        gain = total_score(fits, whitener) - before + head_start
        log(f"{other}: {gain - head_start:.1f} nats more")
        if gain > 0.0 and min(fits[0].value_of(other).values()) > 0.0:
            found.append((gain, other, swapped, fits))
    if not found:
        return
    _, other, state.accepted, state.fits = max(found, key=lambda item: item[0])
    state.confusable[other] = (delay, *(e for e in state.confusable.pop(delay, ()) if e != other))
    state.trials = [
        replace(t, candidate=replace(t.candidate, effect=other)) if t.effect == delay else t
        for t in state.trials
    ]


def _stands_beside(state: State) -> bool:
    """Whether the clocks have an offset besides their skew."""
    return offset_besides(state.fits) or offset_at_start(state.fits) != 0.0


def backward_elimination(state: State, log: Log) -> Joint:
    """Drop effects that others, accepted later, have made unnecessary; returns the estimate."""
    zeros = [0.0] * len(state.fits)
    _resolve_delay(state, log)
    for effect in list(state.accepted) if len(state.accepted) > 1 else []:
        if effect in OFFSETS and SKEW in state.accepted and _stands_beside(state):
            continue
        log(f"checking whether {effect} is still needed")
        fewer = {e: s for e, s in state.accepted.items() if e != effect}
        fits = fit_all(state, state.model, fewer)
        loss = log_likelihood_ratio(state.fits, fits, state.fits[:1] * len(fits))
        joint = joint_of(state.model, state.accepted, state.fits, zeros)
        scale = state.accepted[effect]
        loss += sparsity_gain(joint, state.model, effect, scale)
        if min(loss, evidence_bound(joint, state.model, effect, scale)) < CLOSE_NATS:
            state.accepted, state.fits = fewer, fits
            state.trials = [t for t in state.trials if t.effect != effect]
    return joint_of(state.model, state.accepted, state.fits, zeros)
