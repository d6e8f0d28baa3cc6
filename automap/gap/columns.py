"""How a named effect or a formula acts along a drive: its columns.

What a unit of each parameter adds to the readings of an axis, or to what is measured at the nodes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.earth import RATE
from automap.effects import CATALOGUE
from automap.effects.formula_text import parse_formula
from automap.effects.imu import BASIS_EXTRA, BASIS_FORCE, BASIS_ONE, imu_terms
from automap.effects.measured import MEASURED, measured_terms
from automap.effects.measured_kernels import rows_along
from automap.effects.terms import ELAPSED, POSITION, VEHICLE, VELOCITY, Kind, Term
from automap.effects.terms import INERTIAL as SENSORS
from automap.effects.user import (
    INSTALLED,
    OF_ANTENNA,
    OF_MOUNT,
    is_users,
    towards,
    turned,
    user_signal,
)
from automap.fusion.layout import CH_NHC, CH_ODOMETER, CH_POS, CH_VEL, MAX_SCALARS, N_NAV
from automap.fusion.problem import LateChange, node_signals
from automap.gap import limits
from automap.gap.fit import ORIGIN, prior_sd
from automap.gap.limits import REFERENCE_TAU_S
from automap.gap.linear import Column, Direct, Inertial
from automap.gap.motion import Motion, at_times, lagged, swung
from automap.gap.nodes import NodeMotion
from automap.gap.result import coefficient_names, equation
from automap.records import FloatArray

UNIT_OF = {
    **{channel: ("imu_mounting", channel.removeprefix("imu_")) for channel in OF_MOUNT},
    **{channel: ("gnss_lever_arm", channel[-1]) for channel in OF_ANTENNA},
}
"""Effect and parameter that act as a channel of the installation does while it is the same."""


def named_columns(effects: Sequence[str], at: NodeMotion) -> list[Column]:
    """Columns of named effects along one drive; an effect that the drive cannot show has none."""
    columns: list[Column] = []
    options = at.fit.model.options
    for effect in effects:
        sds = {p.name: prior_sd(options, effect, p.name) for p in CATALOGUE[effect].parameters}
        columns += effect_columns(effect, at, sds or {"on": 1.0})
    return columns


def effect_columns(effect: str, at: NodeMotion, prior_sds: Mapping[str, float]) -> list[Column]:
    """The columns of a catalogue effect, none where the drive lacks what it needs."""
    known = CATALOGUE[effect]
    if known.acts_on(*SENSORS):
        return _imu_columns(effect, at, prior_sds)
    if known.family == "earth":
        return [_earth_column(effect, at.motion)]
    if not known.acts_on(*MEASURED):
        return []
    direct = _direct(effect, at)
    if known.unknown_epoch:
        # with what was off already when the drive began, which nobody says
        length = float(at.motion.t[-1] - at.motion.t[0])
        prior_sds = {**prior_sds, ORIGIN: next(iter(prior_sds.values())) * length}
        direct[ORIGIN] = next(iter(_direct(known.unknown_epoch, at).values()))
    return [
        Column(effect, parameter, prior_sds[parameter], direct=Direct(values))
        for parameter, values in direct.items()
    ]


def _imu_columns(effect: str, at: NodeMotion, prior_sds: Mapping[str, float]) -> list[Column]:
    from automap.effects import extra_basis

    motion, imu = at.motion, at.fit.opened.drive.imu
    terms = imu_terms([effect])
    speed = np.linalg.norm(motion.vel, axis=1)
    extra = extra_basis(
        *(terms, motion.rate, motion.force, imu.temp_c, speed),
        signals=at.along,
        as_read=(imu.gyro, imu.accel),
    )
    acts: dict[str, list[Inertial]] = {}
    for term in terms:
        if term.basis == BASIS_ONE:
            signal = np.ones(len(motion.t))
        elif term.basis < BASIS_FORCE:
            signal = motion.rate[:, term.basis - 1]
        elif term.basis < BASIS_EXTRA:
            signal = motion.force[:, term.basis - BASIS_FORCE]
        else:
            signal = extra[:, term.basis - BASIS_EXTRA]
        if not signal.any():
            continue
        acting = Inertial(term.sensor, term.axis, signal)
        acts.setdefault(term.parameter.name, []).append(acting)
    return [Column(effect, p, prior_sds[p], tuple(its)) for p, its in acts.items()]


def _earth_column(effect: str, motion: Motion) -> Column:
    """What the gyro and the accelerometer would read more were the Earth turning."""
    lat = float(motion.pos[0, 0])
    turn = RATE * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    gyro = np.einsum("nij,i->nj", motion.dcm, turn)
    coriolis = 2.0 * np.cross(turn, motion.vel)
    accel = np.einsum("nij,ni->nj", motion.dcm, coriolis)
    acts = tuple(Inertial(0, a, gyro[:, a]) for a in range(3))
    acts += tuple(Inertial(1, a, accel[:, a]) for a in range(3))
    return Column(effect, "on", 1.0, acts)


_CHANNELS = {
    POSITION: (CH_POS, CH_POS + 1, CH_POS + 2),
    VELOCITY: (CH_VEL, CH_VEL + 1, CH_VEL + 2),
    VEHICLE: (CH_ODOMETER, CH_NHC, CH_NHC + 1),
}


def _direct(effect: str, at: NodeMotion) -> dict[str, FloatArray]:
    """What a unit of each parameter adds to the nodes' channels [k, 15], beside the parameters
    that the fit has already."""
    fit, motion = at.fit, at.motion
    model, states = fit.last.problem.model, CATALOGUE[effect].states
    places = {e: first - N_NAV for e, first in model.places.items()}
    params = fit.last.smooth.params[-1]
    first = places.setdefault(effect, len(params))
    if first == len(params):
        params = np.concatenate([params, np.zeros(len(states))])
    terms, names = measured_terms(places)
    of_model = node_signals(fit.last.problem, fit.last.nodes).T
    known = dict(zip(model.signals, of_model, strict=True))
    columns = [
        at.there(user_signal(name, at.along)) if is_users(name) else known[name] for name in names
    ]
    rows = np.zeros((len(at.t), len(MEASURED), 3, len(params)))
    rows_along(
        at.vel,
        np.ascontiguousarray(at.dcm),
        at.rate,
        at.acc,
        at.t,
        np.stack(columns, axis=1) if columns else np.zeros((len(at.t), 0)),
        params,
        terms,
        rows,
    )
    out = {}
    for i, state in enumerate(states):
        by_channel = np.zeros((len(at.t), MAX_SCALARS))
        for number, measured in enumerate(MEASURED):
            by_channel[:, _CHANNELS[measured]] = rows[:, number, :, first + i]
        out[state] = by_channel
    change, its = at.late, _CHANNELS[VELOCITY]
    for term in CATALOGUE[effect].terms:
        if term.on != VELOCITY:
            continue
        if change is not None and (by := _then(term, effect, at, change)) is not None:
            # as the filter does: what is late changes by what happened then
            more = (-1.0 if term.kind == Kind.LAG else term.weight) * at_times(motion, by, at.t)
            if term.signal == ELAPSED:
                more *= at.t[:, None]
            out[term.parameter][:, its] += more
        if term.kind == Kind.LAG:
            out[term.parameter][:, its] += _beyond_latency(at)
    return out


def _then(term: Term, effect: str, at: NodeMotion, change: LateChange) -> FloatArray | None:
    """By how much a term changes late velocities [n, 3] otherwise than those at their tag."""
    if term.kind in (Kind.TIME, Kind.LAG):
        return change.whole
    if term.kind == Kind.COURSE:
        return change.course
    if term.kind != Kind.POINT:
        return None
    if not CATALOGUE[effect].acts_on(POSITION):
        return change.behind
    return swung(at.motion, term.axis, at.fit.delays, at.then)


def _beyond_latency(at: NodeMotion) -> FloatArray:
    """What a low-pass of ``REFERENCE_TAU_S`` makes of velocities [k, 3] beyond what a delay of as
    much does, at the instants that these are of, per second of it: to first order the two are one.
    """
    motion, delays, tau = at.motion, at.fit.delays, REFERENCE_TAU_S
    told = delays.told(at.t)
    slow = at_times(motion, lagged(motion, motion.vel, tau), told)
    return (slow - at_times(motion, motion.vel, told - tau)) / tau


def size_of(channel: str) -> float:
    """Prior sd of the size of a formula on a channel, in its unit: its rms, of how the unit sits
    and keeps time its largest value."""
    sizes = limits.FORMULA_SIZES
    return sizes.get(channel, sizes.get(channel.partition("_")[0], 0.0))


def usual_sds(channels: Collection[str], signal: FloatArray) -> dict[str, float]:
    """Prior sds of what a ``signal`` [n] is multiplied with on each of some channels."""
    spread = {
        installed: float(np.max(np.abs(signal)) if installed else np.std(signal))
        for installed in {channel in INSTALLED for channel in channels}
    }
    return {c: size_of(c) / max(spread[c in INSTALLED], 1e-12) for c in channels}


def formula_column(
    term: tuple[str, str], at: NodeMotion, name: str = "", parameter: str = "k"
) -> Column:
    """A term of a formula, channel and text, as a column along one drive; ``name`` of the formula,
    where that has more terms."""
    return signal_column(term, parse_formula(term[1])(at.along), at, name, parameter)


def term_columns(
    at: NodeMotion, terms: Sequence[tuple[str, str]], choices: float = 1.0
) -> list[Column]:
    """The columns of one formula along one drive, the likeliest of so many ``choices``."""
    columns = [
        formula_column(term, at, equation(terms), name)
        for name, term in zip(coefficient_names(len(terms)), terms, strict=True)
    ]
    return [replace(c, choices=choices) for c in columns]


def signal_column(
    term: tuple[str, str],
    signal: FloatArray,
    at: NodeMotion,
    name: str = "",
    parameter: str = "k",
    sd: float | None = None,
) -> Column:
    """A ``signal`` [n] on the channel of a term as a column along one drive; ``name`` of the
    formula, where that has more terms; ``sd`` where its usual one is known."""
    channel = term[0]
    sd = usual_sds((channel,), signal)[channel] if sd is None else sd
    name = name or equation([term])
    acting = towards(channel)
    if acting[0].on in SENSORS:
        acts = tuple(
            Inertial(SENSORS.index(p.on), p.axis, signal, at.late_readings.get(p.turned))
            for p in acting
        )
        return Column(name, parameter, sd, acts, term=term)
    amount = at.there(signal)
    if channel in UNIT_OF:
        known, own = UNIT_OF[channel]
        if known not in at.units:
            at.units[known] = _direct(known, at)
        direct = Direct(at.units[known][own] * amount[:, None])
        return Column(name, parameter, sd, direct=direct, term=term)
    by_channel = np.zeros((len(amount), MAX_SCALARS))
    for part in acting:
        place = _CHANNELS[part.on][part.axis]
        by_channel[:, place] = part.weight * turned(amount, part.turned, at.signals)
    return Column(name, parameter, sd, direct=Direct(by_channel), term=term)
