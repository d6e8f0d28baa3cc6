"""The offset that clocks have besides different rates.

A skew is fitted with an offset that nobody is told: at which instant the clocks agreed is seldom
known. Where that offset cannot be the skew's own, it is an effect by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from automap.gap.evidence import p_value
from automap.gap.model import SKEW
from automap.gap.naming import OFFSETS, by_sign, first_offset, offset_at_start, offset_besides
from automap.gap.screening import screen
from automap.gap.search_state import MIN_NATS, Log, State, Trial, fit_all, joint_of
from automap.gap.trial import try_candidate


def missing_offset(state: State, effects: Sequence[str], log: Log) -> Trial | None:
    """The offset between clocks of which so far only the skew is named, though they agree at no
    instant of the drives: a skew brings its own offset along, which nobody is told."""
    offsets = [e for e in effects if e in OFFSETS]
    if SKEW not in state.accepted or not offsets or not offset_besides(state.fits):
        return None
    log("clocks agree nowhere: trying an offset besides their skew")
    fewer = {e: s for e, s in state.accepted.items() if e != SKEW}
    plain = replace(state, accepted=fewer, fits=fit_all(state, state.model, fewer))
    screening = screen(plain.fits, offsets)
    alone = [try_candidate(plain, c, state.model, screening, log) for c in screening.candidates[:1]]
    alone = [t for t in by_sign(alone, offsets) if t.nats >= MIN_NATS]
    if not alone:
        return None
    estimate = state.accepted | {alone[0].effect: alone[0].scale}
    fits = fit_all(state, state.model, estimate)
    joint = joint_of(state.model, estimate, fits, [0.0] * len(fits))
    joint = replace(joint, nats=alone[0].joint.nats)
    return replace(alone[0], joint=joint, fits=tuple(fits), model=state.model)


def starting_offset(state: State, effects: Sequence[str], log: Log) -> Trial | None:
    """The offset that clocks have at the first sample besides their skew, once all else is named:
    an age of velocities that is still missing would look like one."""
    if SKEW not in state.accepted or any(e in state.accepted for e in OFFSETS):
        return None
    first = offset_at_start(state.fits)
    effect = "imu_time_offset" if first > 0.0 else "gnss_latency"
    if first == 0.0 or effect not in effects:
        return None
    log(f"clocks disagree by {first:.3f} s at the first sample: an offset besides their skew")
    screening = screen(state.fits, [effect])
    estimate = state.accepted | {effect: screening.candidates[0].evidence.scale}
    fits = fit_all(state, state.model, estimate)
    nats = sum(0.5 * (value / sd) ** 2 for value, sd in map(first_offset, state.fits))
    found = replace(screening.candidates[0].evidence, nats=nats)
    candidate = replace(screening.candidates[0], evidence=found)
    joint = joint_of(state.model, estimate, fits, [0.0] * len(fits))
    p = p_value(nats, screening.maxima)
    return Trial(
        candidate, replace(joint, nats=nats), tuple(fits), state.model, nats, p, screening.maxima
    )
