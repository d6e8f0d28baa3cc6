"""Candidates fitted as states of the filter, under the noise that is fair to them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.gap.evidence import p_value
from automap.gap.fit import Fit, fit_drive
from automap.gap.model import GapModel
from automap.gap.noise import fit_noise
from automap.gap.scoring import Joint, log_likelihood_ratio, mean_ratio
from automap.gap.screening import Candidate, Screening, screen
from automap.gap.search_state import (
    LOW_WALK,
    MIN_NATS,
    WALKS,
    Log,
    State,
    Trial,
    fit_all,
    joint_of,
    prior_of,
)
from automap.gap.shortlist import shortlist
from automap.gap.sparse import estimate_nats, sparse_gain
from automap.records import FloatArray

MAX_RESTARTS = 3
BETTER_NATS = 10.0
LITTLE_DRIFT_SHORTLIST = 3
STATED_NOISE_SHORTLIST = 3
FINALISTS = 2
FINALIST_SHARE = 0.5
INERTIAL_LEVELS = ("accel", "gyro")
RAISED_NOISE = 2.5
EXPLAINED_SHARE = 0.1
"""Of what raised noise has brought, an effect must bring so much under the noise as stated."""


def try_candidate(
    state: State, candidate: Candidate, model: GapModel, screening: Screening, log: Log
) -> Trial:
    """Fit one candidate as a state next to what was accepted, under the model's noise."""
    log(f"trying {candidate.effect}")
    estimate = state.accepted | {candidate.effect: candidate.evidence.scale}
    fits = fit_all(state, model, estimate)
    return _judge(state, candidate, model, fits, screening.maxima)


def _judge(
    state: State,
    candidate: Candidate,
    model: GapModel,
    fits: Sequence[Fit],
    maxima: FloatArray,
) -> Trial:
    """The evidence of a fitted candidate against the state's own fits."""
    estimate = state.accepted | {candidate.effect: candidate.evidence.scale}
    gains = [log_likelihood_ratio([a], [b]) for a, b in zip(fits, state.fits, strict=True)]
    joint = joint_of(model, estimate, fits, gains)
    effect, scale = candidate.effect, candidate.evidence.scale
    nats = joint.nats + sparsity_gain(joint, model, effect, scale)
    joint = replace(joint, nats=min(nats, evidence_bound(joint, model, effect, scale)))
    nats = _corrected(joint.nats, candidate)
    return Trial(candidate, joint, tuple(fits), model, nats, p_value(nats, maxima), maxima)


def _corrected(nats: float, candidate: Candidate) -> float:
    """Evidence of a fit less what the score scatters too much: the screening knows that, the fit
    what is not linear."""
    return float(nats / np.sqrt(candidate.evidence.overdispersion)) if nats > 0.0 else nats


def sparsity_gain(joint: Joint, model: GapModel, effect: str, scale: float) -> float:
    """Nats that an estimated effect gains where few of its parameters act: fits have all free."""
    rows = [i for i, (name, _) in enumerate(joint.names) if name == effect]
    if not rows:
        return 0.0
    prior_sd = prior_of(model, {effect: scale})
    return sparse_gain(joint.values[rows], joint.cov[np.ix_(rows, rows)], prior_sd)


def sparsity_gains(state: State, effects: Collection[str]) -> float:
    """The same of all accepted effects among these, by the state's fits."""
    joint = joint_of(state.model, state.accepted, state.fits, [0.0] * len(state.fits))
    return sum(
        sparsity_gain(joint, state.model, e, scale)
        for e, scale in state.accepted.items()
        if e in effects
    )


def evidence_bound(joint: Joint, model: GapModel, effect: str, scale: float) -> float:
    """Nats that an effect's estimate is worth by itself, and the most that it can be worth. A
    filter that trusts surprising measurements less may gain more by a state that is unsure,
    whatever its value turns out to be."""
    rows = [i for i, (name, _) in enumerate(joint.names) if name == effect]
    if not rows:
        return np.inf
    values, cov = joint.values[rows], joint.cov[np.ix_(rows, rows)]
    prior_sd = prior_of(model, {effect: scale})
    return estimate_nats(values, cov, prior_sd) + sparse_gain(values, cov, prior_sd)


def _with_nats(trial: Trial, nats: float) -> Trial:
    """The trial with another evidence of its fit."""
    nats = min(nats, evidence_bound(trial.joint, trial.model, trial.effect, trial.scale))
    own = _corrected(nats, trial.candidate)
    joint = replace(trial.joint, nats=nats)
    return replace(trial, joint=joint, nats=own, p_value=p_value(own, trial.maxima))


def _sparsity_gain_of(trial: Trial) -> float:
    return sparsity_gain(trial.joint, trial.model, trial.effect, trial.scale)


def null_fits(state: State, trials: Sequence[Trial]) -> list[list[Fit] | None]:
    """The state's own effects alone under the noise of each serious trial, None where that noise
    is the state's own.

    A search over noise levels ends on one top of several; what a trial gains by another top is
    no evidence for its effect.
    """
    out: list[list[Fit] | None] = []
    for trial in trials:
        same = dict(trial.model.factors) == dict(state.model.factors)
        if same or trial.nats < MIN_NATS:
            out.append(None)
            continue
        model = replace(state.model, factors=trial.model.factors)
        out.append(fit_all(state, model, state.accepted))
    return out


def take_better_noise(state: State, nulls: Sequence[list[Fit] | None], log: Log) -> bool:
    """Whether a trial's noise suits the model better without its effect too; then it is taken."""
    if state.restarts >= MAX_RESTARTS:
        return False
    now = sum(f.score for f in state.fits)
    for fits in nulls:
        if fits is not None and sum(f.score for f in fits) > now + BETTER_NATS:
            log("starting again from better noise")
            state.model = replace(fits[0].model, factors=fit_noise(fits, known=state.curvatures))
            state.fits = fit_all(state, state.model, state.accepted)
            state.restarts += 1
            return True
    return False


def against_better_null(
    state: State, trials: Sequence[Trial], nulls: Sequence[list[Fit] | None]
) -> list[Trial]:
    """The trials, best first, each judged against the better of two models without its effect:
    the state's and the one with the trial's noise."""
    out = []
    for trial, fits in zip(trials, nulls, strict=True):
        if fits is not None:
            gained = log_likelihood_ratio(fits, state.fits, trial.fits)
            if gained > 0.0:
                trial = _with_nats(trial, trial.joint.nats - gained)
        out.append(trial)
    return sorted(out, key=lambda t: -t.joint.nats)


def with_refitted_noise(state: State, trials: Sequence[Trial], log: Log) -> list[Trial]:
    """The strongest trials again, each with the noise that suits it, best first.

    Noise that was fitted without an effect has swallowed part of it, and not of every effect
    the same share.
    """
    out = []
    for i, trial in enumerate(trials):
        strong = trial.nats >= MIN_NATS and trial.nats > FINALIST_SHARE * trials[0].nats
        if i >= FINALISTS or not strong or trial.noise_refitted:
            out.append(trial)
            continue
        log(f"fitting the noise with {trial.effect}")
        model = replace(trial.model, factors=fit_noise(trial.fits, known=state.curvatures))
        estimate = state.accepted | {trial.effect: trial.scale}
        fits = [
            fit_drive(d, model, estimate, linearised_at=f)
            for d, f in zip(state.drives, trial.fits, strict=True)
        ]
        # by the filter's own likelihood: whiteners of different noise cannot be compared
        better = sum(f.score for f in fits) > sum(f.score for f in trial.fits)
        again = _judge(state, trial.candidate, model, fits, trial.maxima)
        out.append(again if better else trial)
    return sorted(out, key=lambda t: -t.joint.nats)


def under_common_whitener(trials: Sequence[Trial]) -> list[Trial]:
    """The strongest trials compared under the same spread and autoregression, best first.

    Each was judged under those of its own innovations, and a whitener that suits one better hides
    a difference of many nats between two. The difference is the mean of what the whiteners of both
    say.
    """
    if not trials or trials[0].nats < MIN_NATS:
        return list(trials)
    best = trials[0]
    out = [best]
    for trial in trials[1:]:
        if trial.nats < max(MIN_NATS, FINALIST_SHARE * best.nats):
            out.append(trial)
            continue
        ahead = _sparsity_gain_of(trial) - _sparsity_gain_of(best)
        ahead += mean_ratio(trial.fits, best.fits)
        out.append(_with_nats(trial, best.joint.nats + ahead))
    return sorted(out, key=lambda t: -t.joint.nats)


def trials_with_little_drift(state: State, effects: Sequence[str], log: Log) -> list[Trial]:
    """Candidates that make a fitted random walk unnecessary.

    A slow effect that is missing has already been taken for drift of the biases when the noise
    was fitted. So the screening is repeated with little drift, and what stands out there is
    fitted so and compared with the model that drifts.
    """
    raised = [w for w in WALKS if state.model.factors[w] > 1.5 * LOW_WALK]
    slow = [e for e in effects if CATALOGUE[e].resembles_drift]
    if not raised or not slow:
        return []
    log("screening with little drift")
    low = replace(state.model, factors={**state.model.factors, **dict.fromkeys(raised, LOW_WALK)})
    screening = screen(fit_all(state, low, state.accepted), slow)
    out = []
    for candidate in shortlist(screening, most=LITTLE_DRIFT_SHORTLIST):
        # with too little drift everything scatters; the model compared with has all it wants
        candidate = replace(candidate, evidence=replace(candidate.evidence, overdispersion=1.0))
        log(f"trying {candidate.effect} in place of drift")
        estimate = state.accepted | {candidate.effect: candidate.evidence.scale}
        fits = fit_all(state, low, estimate)
        model = replace(low, factors=fit_noise(fits, raised, known=state.curvatures))
        out.append(
            _judge(state, candidate, model, fit_all(state, model, estimate), screening.maxima)
        )
    return out


def trials_under_stated_noise(state: State, effects: Sequence[str], log: Log) -> list[Trial]:
    """Candidates under the noise that the model was asked with.

    Something gross that is missing has driven the noise of the inertial sensors up until the
    path follows the fixes, whatever is wrong with them, and no candidate shows any more.
    """
    stated_factors = state.stated_factors
    if all(state.model.factors[k] < RAISED_NOISE * stated_factors[k] for k in INERTIAL_LEVELS):
        return []
    log("screening under the noise as stated")
    plain = replace(state.model, factors=stated_factors)
    fits = fit_all(state, plain, state.accepted)
    screening = screen(fits, effects)
    stand_in = replace(state, model=plain, fits=fits)
    chosen = shortlist(screening, state.accepted, STATED_NOISE_SHORTLIST)
    trials = [try_candidate(stand_in, c, plain, screening, log) for c in chosen]
    trials.sort(key=lambda t: -t.joint.nats)
    without = sum(f.score for f in fits)
    deficit = sum(f.score for f in state.fits) - without
    out = []
    for trial in trials[: STATED_NOISE_SHORTLIST + 1]:
        # what makes up for little of it cannot be what has driven the noise up
        if sum(f.score for f in trial.fits) - without < EXPLAINED_SHARE * deficit:
            continue
        log(f"fitting the noise with {trial.effect}")
        model = replace(plain, factors=fit_noise(trial.fits, known=state.curvatures))
        estimate = state.accepted | {trial.effect: trial.scale}
        again = fit_all(replace(state, fits=list(trial.fits)), model, estimate)
        judged = _judge(state, trial.candidate, model, again, screening.maxima)
        out.append(replace(judged, noise_refitted=True))
    return out
