"""Regressors of candidate effects along a smoothed drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.earth import RATE
from automap.effects import CATALOGUE
from automap.effects.imu import ACCEL, BASIS_EXTRA, BASIS_FORCE, BASIS_ONE, imu_terms
from automap.effects.inertial_signals import asks_for_the_drive
from automap.effects.measured import MEASURED, measured_terms
from automap.effects.measured_kernels import rows_along
from automap.effects.terms import POSITION, VEHICLE, VELOCITY, Kind
from automap.effects.user import is_users, user_signal
from automap.frames import quat_to_matrix
from automap.fusion.layout import CH_NHC, CH_ODOMETER, CH_POS, CH_VEL, MAX_SCALARS, N_NAV
from automap.fusion.problem import node_signals
from automap.fusion.steady_rate import steady_rate
from automap.gap.fit import Fit, Motion, at_times, lagged, motion_of
from automap.gap.kernels import propagate_columns
from automap.gap.motion_signals import motion_signals
from automap.records import FloatArray, IntArray

REFERENCE_TAU_S = 0.1
"""Delays and lags are told apart by what so long a one does beyond first order."""
ORIGIN = "origin"


@dataclass(frozen=True)
class Inertial:
    """Adds ``signal`` [n] times the parameter to an axis of a sensor (0 gyro, 1 accelerometer)."""

    sensor: int
    axis: int
    signal: FloatArray


@dataclass(frozen=True)
class Direct:
    """Adds ``by_channel`` [k, 15] times the parameter to the nodes' measurements."""

    by_channel: FloatArray


@dataclass(frozen=True)
class Column:
    """One parameter of a candidate: how it acts, and its prior sd; channel and text of a formula's
    ``term``, and out of how many ``choices`` it was the likeliest."""

    effect: str
    parameter: str
    prior_sd: float
    inertial: tuple[Inertial, ...] = ()
    direct: Direct | None = None
    term: tuple[str, str] = ("", "")
    choices: float = 1.0


@dataclass(frozen=True)
class NodeMotion:
    """The motion at the nodes: velocity, acceleration NED, ``dcm`` body to NED, rate in body axes
    without the noise of single readings."""

    t: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray


def node_motion(fit: Fit, motion: Motion) -> NodeMotion:
    """The smoothed motion at the nodes of a fit."""
    nominal = fit.last.smooth.nominal
    t = fit.last.nodes.t
    rate = at_times(motion, steady_rate(motion.t, motion.rate), t)
    acc = at_times(motion, motion.acc, t)
    return NodeMotion(t, nominal[:, 3:6].copy(), acc, quat_to_matrix(nominal[:, 6:10]), rate)


def effect_columns(
    effect: str, fit: Fit, motion: Motion, at: NodeMotion, prior_sds: Mapping[str, float]
) -> list[Column]:
    """The columns of a catalogue effect, none where the drive lacks what it needs."""
    known = CATALOGUE[effect]
    if known.family == "imu":
        return _imu_columns(effect, fit, motion, prior_sds)
    if known.family == "earth":
        return [_earth_column(effect, fit, motion)]
    if not known.acts_on(*MEASURED):
        return []
    direct = _direct(effect, fit, motion, at)
    if known.unknown_epoch:
        # with the instant at which nothing was off, which nobody says
        length = float(motion.t[-1] - motion.t[0])
        prior_sds = {**prior_sds, ORIGIN: next(iter(prior_sds.values())) * length}
        direct[ORIGIN] = next(iter(_direct(known.unknown_epoch, fit, motion, at).values()))
    return [
        Column(effect, parameter, prior_sds[parameter], direct=Direct(values))
        for parameter, values in direct.items()
    ]


def _imu_columns(
    effect: str, fit: Fit, motion: Motion, prior_sds: Mapping[str, float]
) -> list[Column]:
    from automap.effects import extra_basis

    imu = fit.opened.drive.imu
    terms = imu_terms([effect])
    speed = np.linalg.norm(motion.vel, axis=1)
    of_drive = any(asks_for_the_drive(t.extra or "") for t in terms)
    signals = motion_signals(fit, motion) if of_drive else None
    extra = extra_basis(
        *(terms, motion.rate, motion.force, imu.temp_c, speed),
        signals=signals,
        as_read=(imu.gyro, imu.accel),
    )
    out = []
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
        sensor = 1 if term.sensor == ACCEL else 0
        acts = (Inertial(sensor, term.axis, signal),)
        sd = prior_sds[term.parameter.name]
        out.append(Column(effect, term.parameter.name, sd, acts))
    return out


def _earth_column(effect: str, fit: Fit, motion: Motion) -> Column:
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


def _direct(effect: str, fit: Fit, motion: Motion, at: NodeMotion) -> dict[str, FloatArray]:
    """What a unit of each parameter adds to the nodes' channels [k, 15], beside the parameters
    that the fit has already."""
    model, states = fit.last.problem.model, CATALOGUE[effect].states
    places = {e: first - N_NAV for e, first in model.places.items()}
    params = fit.last.smooth.params[-1]
    first = places.setdefault(effect, len(params))
    if first == len(params):
        params = np.concatenate([params, np.zeros(len(states))])
    terms, names = measured_terms(places)
    of_model = node_signals(fit.last.problem, fit.last.nodes).T
    known = dict(zip(model.signals, of_model, strict=True))
    signals = motion_signals(fit, motion).at(at.t + fit.opened.drive.begin_s)
    columns = [user_signal(name, signals) if is_users(name) else known[name] for name in names]
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
    for term in CATALOGUE[effect].terms:
        of_velocity = term.on == VELOCITY and not CATALOGUE[effect].acts_on(POSITION)
        if term.kind in (Kind.TIME, Kind.LAG) and of_velocity:
            out[term.parameter][:, _CHANNELS[VELOCITY]] = _beyond_first_order(
                term.kind, term.weight, motion, at.t
            )
    return out


def _beyond_first_order(kind: Kind, weight: float, motion: Motion, t: FloatArray) -> FloatArray:
    """What a delay or a lag of ``REFERENCE_TAU_S`` makes of velocities [k, 3], per second of it."""
    tau = REFERENCE_TAU_S
    if kind == Kind.LAG:
        seen = at_times(motion, lagged(motion, motion.vel, tau), t)
    else:
        seen = at_times(motion, motion.vel, t + weight * tau)
    return (seen - at_times(motion, motion.vel, t)) / tau


def sensitivities(fit: Fit, motion: Motion, columns: Sequence[Column]) -> FloatArray:
    """Whitened sensitivity [s, c] of the fit's scalars to the columns' parameters."""
    inertial = [i for i, c in enumerate(columns) if c.direct is None]
    direct = [i for i, c in enumerate(columns) if c.direct is not None]
    order = inertial + direct
    signals: list[FloatArray] = []
    index: dict[int, int] = {}
    terms: list[tuple[int, int, int, int]] = []
    for place, i in enumerate(order):
        for part in columns[i].inertial:
            key = id(part.signal)
            if key not in index:
                index[key] = len(signals)
                signals.append(part.signal)
            terms.append((place, part.sensor, part.axis, index[key]))
    last = fit.last
    store = last.forward.store
    total = len(store.nu)
    node, channel = store.info[:, 0], store.info[:, 1]
    acting = np.zeros((total, len(direct)))
    for place, i in enumerate(direct):
        acts = columns[i].direct
        assert acts is not None
        acting[:, place] = acts.by_channel[node, channel]
    n = len(motion.t)
    table: IntArray = np.array(terms, dtype=np.int64).reshape(-1, 4)
    out = np.zeros((total, len(order)))
    propagate_columns(
        motion.t,
        motion.force,
        np.ascontiguousarray(motion.dcm),
        np.ascontiguousarray(np.stack(signals, axis=1)) if signals else np.zeros((n, 1)),
        table,
        np.ones(len(terms)),
        last.nodes.t,
        store.trans,
        last.problem.model.tau,
        last.nodes.wander_keep,
        last.problem.model.kept,
        store.scalars,
        store.h,
        store.gain,
        store.var,
        acting,
        out,
    )
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return np.asarray(out[:, back])


__all__ = [
    "Column",
    "Direct",
    "Inertial",
    "NodeMotion",
    "effect_columns",
    "motion_of",
    "node_motion",
    "sensitivities",
]
