"""Which name a fitted candidate is given, and what else it could be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import pairs_of_sign
from automap.fusion.delay_states import DELAY_STATE, LATENCY_STATE, SKEW_STATE
from automap.gap.fit import Fit
from automap.gap.model import SKEW
from automap.gap.scoring import Joint
from automap.gap.screening import Screening
from automap.gap.search_state import MIN_NATS, Trial
from automap.records import FloatArray

CLOSE_NATS = 3.0
CLOSE_SHARE = 0.03
"""Rivals within so many nats, or this share of the evidence, are said to be confusable."""
OVERLAP = 0.8
PRIOR_ROOM = 5.0
"""So much of a parameter's information is another effect's, then they are confusable."""
(OFFSETS,) = pairs_of_sign(-1.0)
"""An offset between the clocks: fixes are late, or the stamps of the IMU are."""
(VELOCITY_DELAYS,) = pairs_of_sign(1.0)
"""What delays velocities alone."""
FIX_DELAY, VELOCITY_DELAY = "gnss_latency", "gnss_velocity_latency"
SKEW_SIGMAS = 4.0
START_SIGMAS = 5.0
APART_SHARE = 0.2
APART_S = 5e-3
"""Clocks that nowhere in a drive come nearer than this share of what their skew adds up to, and
this much, are offset besides."""


def by_sign(trials: Sequence[Trial], effects: Sequence[str]) -> list[Trial]:
    """Give effects that differ in sign alone the name that makes physical sense.

    Fixes come late and stamps are late; neither is early, nor is a velocity. A low-pass has a
    positive constant, a tyre gives way outwards, and clocks whose rates do not differ have no skew.
    """
    out: dict[str, Trial] = {}
    for trial in trials:
        effect = trial.effect
        value, sd = next(iter(trial.joint.of(effect).values()), (0.0, 0.0))
        if effect in OFFSETS and value < 0.0:
            other = OFFSETS[1 - OFFSETS.index(effect)]
            if other in effects:
                trial = _renamed(trial, other)
        if CATALOGUE[effect].never_negative and _clearest(trial.joint, effect) <= 0.0:
            continue
        if effect == VELOCITY_DELAY and value + _latency(trial.joint) < 0.0:
            # no velocity is told before its time: where it is ahead of the fixes, those are late
            continue
        if effect == SKEW and abs(value) < SKEW_SIGMAS * sd:
            # what helps is the offset that a skew brings along
            continue
        known = out.get(trial.effect)
        if known is None or trial.nats > known.nats:
            out[trial.effect] = trial
    return list(out.values())


def _clearest(joint: Joint, effect: str) -> float:
    """The parameter of an effect that the drive shows best, of several that are axes."""
    found = joint.of(effect).values()
    return max(found, key=lambda p: abs(p[0]) / p[1] if p[1] > 0.0 else 0.0, default=(0.0, 0.0))[0]


def _latency(joint: Joint) -> float:
    """How late whole fixes are by a joint estimate, s; nothing where that is not estimated."""
    return next((value for value, _ in joint.of(FIX_DELAY).values()), 0.0)


def offset_first(trials: list[Trial]) -> list[Trial]:
    """Put an offset between the clocks before what it may be instead: a skew that would need one
    besides, and an age of velocities alone that explains no more; whole fixes are late more
    often."""
    if not trials:
        return trials
    best = trials[0]
    offsets = [t for t in trials if t.effect in OFFSETS and t.nats >= MIN_NATS]
    if best.effect == SKEW:
        sooner = offset_besides(best.fits)
    else:
        close = [t for t in offsets if best.joint.nats - t.joint.nats < CLOSE_NATS]
        sooner = best.effect in VELOCITY_DELAYS and bool(close)
    return offsets + [t for t in trials if t not in offsets] if sooner else trials


def offset_besides(fits: Sequence[Fit]) -> bool:
    """Whether clocks of different rates agree at no instant of some drive."""
    for fit in fits:
        first, _ = first_offset(fit)
        grown = fit.last.totals().get(SKEW_STATE, 0.0) * float(fit.last.problem.t[-1])
        least = min(abs(first), abs(first + grown)) if first * (first + grown) > 0.0 else 0.0
        if least > APART_SHARE * abs(grown) + APART_S:
            return True
    return False


def first_offset(fit: Fit) -> tuple[float, float]:
    """How much later than the truth the stamp of a drive's first sample is, s, and its sd."""
    last = fit.last
    totals = last.totals()
    value = totals.get(DELAY_STATE, 0.0) - totals.get(LATENCY_STATE, 0.0)
    names = last.problem.model.names
    rows = [names.index(n) for n in (DELAY_STATE, LATENCY_STATE) if n in names]
    variance = float(last.smooth.param_var[-1, rows].sum())
    return value - fit.opened.drive.delay.mean, variance**0.5


def offset_at_start(fits: Sequence[Fit]) -> float:
    """How much later than the truth first samples are beside a skew, s; 0 where one stated to be
    right agrees with it, as it does by the definition of a skew (``stamp_error_s``)."""
    known = [first_offset(fit) for fit in fits if fit.opened.drive.delay.sd == 0.0]
    if not known or any(abs(v) < max(APART_S, START_SIGMAS * sd) for v, sd in known):
        return 0.0
    weights = np.array([sd**-2.0 for _, sd in known])
    return float(np.average([v for v, _ in known], weights=weights))


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


def confusable_with_best(
    best: Trial,
    others: Sequence[Trial],
    effects: Sequence[str],
    screening: Screening | None,
) -> tuple[str, ...]:
    """Effects that explain the data nearly as well as ``best``: what was fitted with nearly as
    much evidence, twins to first order, and those whose sensitivities overlap."""
    close = max(CLOSE_NATS, CLOSE_SHARE * best.joint.nats)
    confusable = [t.effect for t in others if best.joint.nats - t.joint.nats < close]
    for pair in (OFFSETS, VELOCITY_DELAYS):
        if best.effect in pair:
            confusable += [e for e in pair if e != best.effect and e in effects]
    if screening is not None:
        confusable += _overlapping(screening, best)
    return tuple(dict.fromkeys(confusable))
