"""The search: name one missing effect after another until nothing stands out any more."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.fusion.levels import ALL_LEVELS
from automap.gap.drive import OpenDrive
from automap.gap.evidence import p_value
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula import Formula, screen_formulas, without_formula
from automap.gap.heldout import fit_held_out, total_score
from automap.gap.library import SAME_STATE, library
from automap.gap.model import GapModel, parameter_names, prior_sd
from automap.gap.noise import fit_noise, noise_score
from automap.gap.scoring import Joint, combine, robust_score, whitener_of
from automap.gap.screening import Candidate, Screening, screen
from automap.gap.whitening import Whitener
from automap.records import FloatArray

MIN_NATS = 7.0
MAX_P = 1e-3
"""An effect needs this much evidence, and this little chance, to be named."""
CLOSE_NATS = 3.0
CLOSE_SHARE = 0.03
"""Rivals within so many nats, or this share of the evidence, are said to be confusable."""
ALIKE = (
    ("gnss_latency", "imu_time_offset", "gnss_velocity_latency", "gnss_velocity_lag"),
    ("gnss_lever_arm", "nhc_lever_arm", "vehicle_sideslip"),
    ("accel_misalignment", "imu_mounting"),
)
"""Families that a noisy screening mixes up: when one leads, all are fitted."""
OVERLAP = 0.8
PRIOR_ROOM = 5.0
"""So much of a parameter's information is another effect's, then they are confusable."""
MAX_RESTARTS = 3
BETTER_NATS = 10.0
SHORTLIST = 5
SLOW_SHORTLIST = 2
FINALISTS = 2
FINALIST_SHARE = 0.5
SHORTLIST_SHARE = 0.3
MAX_FINDINGS = 8
FORMULA_TRIALS = 4
FORMULA_NATS = 25.0
FORMULA_P = 1e-4
FORMULA_SHARE = 0.1
"""A formula must beat all names by so many nats, or this share of their evidence: among a
thousand formulas one resembles whatever rough roads leave behind."""
HELD_OUT_SLACK = 3.0
SURE_NATS = 20.0
INERTIAL_LEVELS = ("accel", "gyro")
GROSS = 2.5
WALKS = ("accel_bias_walk", "gyro_bias_walk")
LOW_WALK = 0.1
RAISED = 1.5
SLOW_EFFECTS = (
    "accel_temperature",
    "gyro_temperature",
    "speed_vibration",
    "accel_quadratic",
    "gyro_g_sensitivity",
    "accel_scale_asymmetry",
    "gyro_scale_asymmetry",
    "accel_misalignment",
    "accel_scale",
)
"""Effects that a random walk of the bias can stand in for."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """A candidate that was fitted: joint estimate of all estimated effects, evidence in nats,
    p-value, the model it was fitted under, the null's largest evidences."""

    candidate: Candidate
    joint: Joint
    fits: tuple[Fit, ...]
    model: GapModel
    nats: float
    p_value: float
    maxima: FloatArray

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.candidate.effect

    @property
    def scale(self) -> float:
        """Factor on its prior sd."""
        return self.candidate.evidence.scale

    @property
    def screened(self) -> float:
        """Evidence of the screening in nats."""
        return self.candidate.evidence.nats


@dataclass
class State:
    """Where a search stands: fits of the drives under ``model`` with the accepted effects, the
    noise factors ``asked`` for."""

    drives: list[OpenDrive]
    held_out: list[OpenDrive]
    asked: Mapping[str, float]
    model: GapModel
    fits: list[Fit]
    accepted: dict[str, float] = field(default_factory=dict)
    trials: list[Trial] = field(default_factory=list)
    rivals: dict[str, tuple[str, ...]] = field(default_factory=dict)
    refused: set[str] = field(default_factory=set)
    exclude: frozenset[str] = frozenset()
    restarts: int = 0
    warnings: list[str] = field(default_factory=list)
    unexplained: Formula | None = None
    resembles: str | None = None


def begin(
    drives: Sequence[OpenDrive], held_out: Sequence[OpenDrive], model: GapModel, say: Say
) -> State:
    """Fit the base model, its noise first."""
    asked = dict(model.factors)
    say("fitting the base model")
    fits = [fit_drive(d, model) for d in drives]
    others = tuple(k for k in ALL_LEVELS if k not in INERTIAL_LEVELS)
    say("fitting the noise")
    # the sensors' noise first or the fixes': the likelihood has a top for either
    found = [
        fit_noise(fits, initial=fit_noise(fits, levels)) for levels in (INERTIAL_LEVELS, others)
    ]
    found.sort(key=lambda factors: -noise_score(fits, factors))
    best = found[0]
    for last in (False, True):
        model = replace(model, factors=best)
        fits = [fit_drive(d, model, start=f.start) for d, f in zip(drives, fits, strict=True)]
        best = best if last else fit_noise(fits)
    return State(list(drives), list(held_out), asked, model, fits)


def candidates_of(state: State, exclude: Collection[str]) -> list[str]:
    """Effects that may be missing and were not refused already."""
    has_wheels = any(d.session.odometer is not None for d in state.drives)
    settled = state.model.settled | set(state.accepted) | state.refused | set(exclude)
    for opened in state.drives:
        if opened.drive.mounting_sd.any():
            settled |= {"imu_mounting"}
        if opened.drive.delay.sd > 0.02:
            # a free offset between the clocks is the same thing
            settled |= {"gnss_latency"}
    return library(frozenset(settled), has_wheels, state.model.options.earth_rotation)


def step(state: State, exclude: Collection[str], say: Say) -> Trial | None:
    """Name the next missing effect, or None. The state moves on when one is named."""
    effects = candidates_of(state, exclude)
    if not effects:
        return None
    say("screening the library")
    screening = screen(state.fits, effects)
    trials = _gross_trials(state, effects, say)
    if not trials:
        trials = [_try(state, c, state.model, screening, say) for c in _shortlist(screening)]
        trials += _slow_trials(state, effects, say)
    trials = _by_sign(trials, effects)
    trials.sort(key=lambda t: -t.joint.nats)
    trials = _with_own_noise(state, trials, say)
    if _found_better_noise(state, trials, say):
        return step(state, exclude, say)
    for t in trials:
        say(f"{t.effect}: {t.nats:.1f} nats, screened {t.screened:.1f}, p {t.p_value:.1e}")
    formula = _strongest_formula(state, trials, exclude, say)
    if formula is not None:
        state.unexplained = formula
        if trials and trials[0].nats > MIN_NATS:
            state.resembles = trials[0].effect
        return None
    if not trials or trials[0].nats < MIN_NATS or trials[0].p_value > MAX_P:
        return None
    best = trials[0]
    if not _helps(state, best, say):
        state.refused.add(best.effect)
        state.warnings.append(
            f"{best.effect} would explain {best.nats:.0f} nats of the fitted data, but the "
            "held-out data do not confirm it; it is not named"
        )
        return step(state, exclude, say)
    close = max(CLOSE_NATS, CLOSE_SHARE * best.joint.nats)
    rivals = [t.effect for t in trials[1:] if best.joint.nats - t.joint.nats < close]
    for pair in SAME_STATE:
        if best.effect in pair:
            rivals += [e for e in pair if e != best.effect and e in effects]
    rivals += _overlapping(screening, best)
    state.rivals[best.effect] = tuple(dict.fromkeys(rivals))
    state.accepted[best.effect] = best.scale
    state.trials.append(best)
    state.model, state.fits = best.model, list(best.fits)
    return best


def fit_all(state: State, model: GapModel, estimate: Mapping[str, float]) -> list[Fit]:
    """All drives under a model with effects as states."""
    return [
        fit_drive(d, model, estimate, start=f.start)
        for d, f in zip(state.drives, state.fits, strict=True)
    ]


def prior_of(model: GapModel, estimate: Mapping[str, float]) -> FloatArray:
    """Prior sds [p] of the estimated effects' parameters in order."""
    return np.array(
        [
            scale * prior_sd(model.options, effect, parameter)
            for effect, scale in estimate.items()
            for parameter in parameter_names(effect)
        ]
    )


def joint_of(
    model: GapModel, estimate: Mapping[str, float], fits: Sequence[Fit], gains: Sequence[float]
) -> Joint:
    """The drives' estimates as one."""
    return combine(fits, gains, prior_of(model, estimate))


def _overlapping(screening: Screening, trial: Trial) -> list[str]:
    """Effects whose sensitivities span nearly all of what a found parameter shows."""
    info = screening.scores.info
    own = next((c for c in screening.candidates if c.effect == trial.effect), None)
    if own is None:
        return []
    found = trial.joint.of(trial.effect)
    rows = [
        row
        for parameter, row in zip(own.parameters, own.columns, strict=True)
        if parameter in found and abs(found[parameter][0]) > 4.0 * found[parameter][1]
    ]
    out = []
    for other in screening.candidates:
        if other.effect == trial.effect:
            continue
        at = other.columns
        inner = info[np.ix_(at, at)] + np.diag((PRIOR_ROOM * other.prior_sd) ** -2.0)
        for row in rows:
            cross = info[row, at]
            share = float(cross @ np.linalg.solve(inner, cross)) / max(
                float(info[row, row]), 1e-300
            )
            if share > OVERLAP:
                out.append(other.effect)
                break
    return out


def _strongest_formula(
    state: State, trials: Sequence[Trial], exclude: Collection[str], say: Say
) -> Formula | None:
    """A formula that beats every name of the library, each fitted."""
    say("screening formulas")
    named = max(trials[0].joint.nats, 0.0) if trials else 0.0
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
            if formula.nats < FORMULA_NATS or formula.p_value > FORMULA_P:
                continue
            tried = _fit_formula(state, model, formula)
            say(
                f"{formula.channel} += k * {formula.text}: {tried.nats:.1f} nats fitted, "
                f"{formula.nats:.1f} screened, names {named:.1f}"
            )
            if best is None or tried.nats > best.nats:
                best = tried
    if best is None or best.nats < named + max(FORMULA_NATS, FORMULA_SHARE * named):
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
            new = fit_drive(changed, model, state.accepted, start=fit.start)
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


def _shortlist(screening: Screening, most: int = SHORTLIST) -> list[Candidate]:
    """The candidates worth a fit of their own, and those that look like the strongest; of two
    that differ in sign alone, one."""
    candidates = screening.candidates
    if not candidates or candidates[0].evidence.nats < 0.5 * MIN_NATS:
        return []
    least = max(0.25 * MIN_NATS, SHORTLIST_SHARE * candidates[0].evidence.nats)
    out = [c for c in candidates if c.evidence.nats >= least][:most]
    alike = {e for family in ALIKE for e in family if candidates[0].effect in family}
    out += [c for c in candidates if c.effect in alike and c not in out]
    twins = [c for c in out if c.effect in SAME_STATE[0]]
    return [c for c in out if c not in twins[1:]]


def _try(
    state: State, candidate: Candidate, model: GapModel, screening: Screening, say: Say
) -> Trial:
    """Fit one candidate as a state next to what was accepted, under the model's noise."""
    say(f"trying {candidate.effect}")
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
    gains = []
    for before, after in zip(state.fits, fits, strict=True):
        whitener = whitener_of(after)
        gains.append(robust_score(after, whitener) - robust_score(before, whitener))
    joint = joint_of(model, estimate, fits, gains)
    nats = joint.nats
    if nats > 0.0:
        # the screening knows how much the score scatters, the fit what is not linear
        nats /= np.sqrt(candidate.evidence.excess)
    return Trial(candidate, joint, tuple(fits), model, float(nats), p_value(nats, maxima), maxima)


def _found_better_noise(state: State, trials: Sequence[Trial], say: Say) -> bool:
    """Whether a trial's noise suits the model better without its effect too; then it is taken.

    A search over noise levels ends on one top of several; what a trial gains by another top is
    no evidence for its effect.
    """
    now = sum(f.score for f in state.fits)
    for trial in trials:
        same = dict(trial.model.factors) == dict(state.model.factors)
        if same or trial.joint.nats < MIN_NATS or state.restarts >= MAX_RESTARTS:
            continue
        model = replace(state.model, factors=trial.model.factors)
        fits = fit_all(state, model, state.accepted)
        if sum(f.score for f in fits) > now + BETTER_NATS:
            say("starting again from better noise")
            state.model = replace(model, factors=fit_noise(fits))
            state.fits = fit_all(state, state.model, state.accepted)
            state.restarts += 1
            return True
    return False


def _with_own_noise(state: State, trials: Sequence[Trial], say: Say) -> list[Trial]:
    """The strongest trials again, each with the noise that suits it, best first.

    Noise that was fitted without an effect has swallowed part of it, and not of every effect
    the same share.
    """
    out = []
    for i, trial in enumerate(trials):
        strong = trial.nats >= MIN_NATS and trial.nats > FINALIST_SHARE * trials[0].nats
        if i >= FINALISTS or not strong:
            out.append(trial)
            continue
        say(f"fitting the noise with {trial.effect}")
        model = replace(trial.model, factors=fit_noise(trial.fits))
        estimate = state.accepted | {trial.effect: trial.scale}
        fits = [
            fit_drive(d, model, estimate, start=f.start)
            for d, f in zip(state.drives, trial.fits, strict=True)
        ]
        again = _judge(state, trial.candidate, model, fits, trial.maxima)
        out.append(again if again.joint.nats > trial.joint.nats else trial)
    return sorted(out, key=lambda t: -t.joint.nats)


def _slow_trials(state: State, effects: Sequence[str], say: Say) -> list[Trial]:
    """Candidates that make a fitted random walk unnecessary.

    A slow effect that is missing has already been taken for drift of the biases when the noise
    was fitted. So the screening is repeated with little drift, and what stands out there is
    fitted so and compared with the model that drifts.
    """
    raised = [w for w in WALKS if state.model.factors[w] > 1.5 * LOW_WALK]
    slow = [e for e in effects if e in SLOW_EFFECTS]
    if not raised or not slow:
        return []
    say("screening with little drift")
    low = replace(state.model, factors={**state.model.factors, **dict.fromkeys(raised, LOW_WALK)})
    screening = screen(fit_all(state, low, state.accepted), slow)
    out = []
    for candidate in _shortlist(screening, SLOW_SHORTLIST):
        # with too little drift everything scatters; the model compared with has all it wants
        candidate = replace(candidate, evidence=replace(candidate.evidence, excess=1.0))
        say(f"trying {candidate.effect} in place of drift")
        estimate = state.accepted | {candidate.effect: candidate.evidence.scale}
        fits = fit_all(state, low, estimate)
        model = replace(low, factors=fit_noise(fits, raised))
        out.append(
            _judge(state, candidate, model, fit_all(state, model, estimate), screening.maxima)
        )
    return out


def _gross_trials(state: State, effects: Sequence[str], say: Say) -> list[Trial]:
    """Candidates under the noise that the model was asked with.

    Something gross that is missing has driven the noise of the inertial sensors up until the
    path follows the fixes, whatever is wrong with them, and no candidate shows any more.
    """
    asked = state.asked
    if all(state.model.factors[k] < GROSS * asked[k] for k in INERTIAL_LEVELS):
        return []
    say("screening under the noise as stated")
    plain = replace(state.model, factors=asked)
    fits = fit_all(state, plain, state.accepted)
    screening = screen(fits, effects)
    stand_in = replace(state, model=plain, fits=fits)
    trials = [_try(stand_in, c, plain, screening, say) for c in _shortlist(screening, 3)]
    trials.sort(key=lambda t: -t.joint.nats)
    out = []
    for trial in trials[:4]:
        say(f"fitting the noise with {trial.effect}")
        model = replace(plain, factors=fit_noise(trial.fits))
        estimate = state.accepted | {trial.effect: trial.scale}
        again = fit_all(replace(state, fits=list(trial.fits)), model, estimate)
        out.append(_judge(state, trial.candidate, model, again, screening.maxima))
    return out


def _by_sign(trials: Sequence[Trial], effects: Sequence[str]) -> list[Trial]:
    """Give effects that differ in sign alone the name that makes physical sense.

    Fixes come late and stamps are late; neither is early. A low-pass has a positive constant.
    """
    out: dict[str, Trial] = {}
    for trial in trials:
        effect = trial.effect
        value = next(iter(trial.joint.of(effect).values()), (0.0, 0.0))[0]
        if effect in ("gnss_latency", "imu_time_offset") and value < 0.0:
            other = "imu_time_offset" if effect == "gnss_latency" else "gnss_latency"
            if other in effects:
                trial = _renamed(trial, other)
        if effect == "gnss_velocity_lag" and value <= 0.0:
            continue
        known = out.get(trial.effect)
        if known is None or trial.nats > known.nats:
            out[trial.effect] = trial
    return list(out.values())


def _renamed(trial: Trial, effect: str) -> Trial:
    """The same trial told as the effect of opposite sign."""

    def swap(names: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
        return tuple((effect, p) if e == trial.effect else (e, p) for e, p in names)

    def sign(names: Sequence[tuple[str, str]]) -> FloatArray:
        return np.array([-1.0 if e == trial.effect else 1.0 for e, _ in names])

    joint = trial.joint
    s = sign(joint.names)
    joint = Joint(swap(joint.names), joint.values * s, joint.cov * np.outer(s, s), joint.nats)
    fits = []
    for fit in trial.fits:
        s = sign(fit.names)
        fits.append(
            replace(fit, names=swap(fit.names), values=fit.values * s, cov=fit.cov * np.outer(s, s))
        )
    candidate = replace(trial.candidate, effect=effect)
    return replace(trial, candidate=candidate, joint=joint, fits=tuple(fits))


def _helps(state: State, trial: Trial, say: Say) -> bool:
    """Whether the held-out data are more likely with the effect than without."""
    if not state.held_out:
        return True
    say(f"checking {trial.effect} on held-out data")
    before = values_of(state.trials[-1].joint, state.accepted) if state.trials else {}
    after = values_of(trial.joint, [*state.accepted, trial.effect])
    new = fit_held_out(state.held_out, trial.model, after)
    old = fit_held_out(state.held_out, state.model, before)
    whitener: Whitener = whitener_of(trial.fits[0])
    gain = total_score(new, whitener) - total_score(old, whitener)
    return gain > (-HELD_OUT_SLACK if trial.nats > SURE_NATS else 0.0)


def values_of(joint: Joint, effects: Collection[str]) -> dict[str, dict[str, float]]:
    """Effect -> parameter -> value out of a joint estimate."""
    return {e: {p: v for p, (v, _) in joint.of(e).items()} for e in effects}


def eliminate(state: State, say: Say) -> Joint:
    """Drop effects that others, accepted later, have made unnecessary; returns the estimate."""
    zeros = [0.0] * len(state.fits)
    for effect in list(state.accepted) if len(state.accepted) > 1 else []:
        say(f"checking whether {effect} is still needed")
        fewer = {e: s for e, s in state.accepted.items() if e != effect}
        fits = fit_all(state, state.model, fewer)
        whitener = whitener_of(state.fits[0])
        loss = sum(
            robust_score(a, whitener) - robust_score(b, whitener)
            for a, b in zip(state.fits, fits, strict=True)
        )
        if loss < CLOSE_NATS:
            state.accepted, state.fits = fewer, fits
            state.trials = [t for t in state.trials if t.effect != effect]
    return joint_of(state.model, state.accepted, state.fits, zeros)
