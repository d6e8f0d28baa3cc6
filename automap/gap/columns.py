"""Regressors of candidate effects along a smoothed drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.imu import ACCEL, BASIS_EXTRA, BASIS_FORCE, BASIS_ONE, OF_USER, imu_terms
from automap.effects.user_fixes import acts_on_fixes
from automap.fusion.layout import (
    CH_NHC,
    CH_ODOMETER,
    CH_POS,
    CH_VEL,
    LEVER,
    MAX_SCALARS,
    MOUNT,
    N_NAV,
    WHEEL,
)
from automap.fusion.steady_rate import steady_rate
from automap.gap.fit import Fit, Motion, at_times, lagged, motion_of
from automap.gap.kernels import push_columns
from automap.gap.motion_signals import motion_signals
from automap.records import FloatArray, IntArray

REFERENCE_TAU_S = 0.1
"""Delays and lags are told apart by what so long a one does beyond first order."""
ORIGIN = "origin"
EARTH_RATE = 7.292115e-5


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
    """One parameter of a candidate: how it acts, and its prior sd."""

    effect: str
    parameter: str
    prior_sd: float
    inertial: tuple[Inertial, ...] = ()
    direct: Direct | None = None


@dataclass(frozen=True)
class NodeMotion:
    """The motion at the nodes: velocity, acceleration NED, ``dcm`` body to NED, rate, the velocity
    of the point that does not slide in body axes ``u`` [k, 3], ``arm`` [3] m to the antenna."""

    t: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray
    u: FloatArray
    turn: FloatArray
    arm: FloatArray


def node_motion(fit: Fit, motion: Motion) -> NodeMotion:
    """The smoothed motion at the nodes of a fit."""
    from automap.frames import quat_to_matrix

    nominal = fit.last.smooth.nominal
    t = fit.last.nodes.t
    dcm = quat_to_matrix(nominal[:, 6:10])
    vel = nominal[:, 3:6]
    rate = at_times(motion, steady_rate(motion.t, motion.rate), t)
    u = np.einsum("kji,kj->ki", dcm, vel)
    final = fit.last.smooth.params[-1]
    offsets = fit.last.problem.model.offsets
    if offsets[WHEEL] >= 0:
        arm = final[offsets[WHEEL] - N_NAV :][:3]
        u = u + np.cross(rate, arm)
    mount = np.zeros(3)
    if offsets[MOUNT] >= 0:
        mount = final[offsets[MOUNT] - N_NAV :][:3]
    turn = np.eye(3) + np.array(
        [[0.0, -mount[2], mount[1]], [mount[2], 0.0, -mount[0]], [-mount[1], mount[0], 0.0]]
    )
    antenna = np.zeros(3)
    if offsets[LEVER] >= 0:
        antenna = final[offsets[LEVER] - N_NAV :][:3]
    return NodeMotion(t, vel, at_times(motion, motion.acc, t), dcm, rate, u, turn, antenna)


def effect_columns(
    effect: str, fit: Fit, motion: Motion, at: NodeMotion, prior_sds: Mapping[str, float]
) -> list[Column]:
    """The columns of a catalogue effect, none where the drive lacks what it needs."""
    family = CATALOGUE[effect].family
    if family == "imu":
        return _imu_columns(effect, fit, motion, prior_sds)
    if acts_on_fixes(effect):
        from automap.gap.fix_effects import fix_columns

        return fix_columns(effect, fit, motion, at, prior_sds)
    if effect == "earth_rotation":
        return [_earth_column(fit, motion)]
    direct = _direct(effect, motion, at)
    if effect == "imu_clock_skew":
        # with the instant at which the clocks agreed, which nobody says
        length = float(motion.t[-1] - motion.t[0])
        prior_sds = {**prior_sds, ORIGIN: prior_sds["skew"] * length}
        direct[ORIGIN] = _direct("imu_time_offset", motion, at)["s"]
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
    users = any(OF_USER in (t.extra or "") for t in terms)
    signals = motion_signals(fit, motion) if users else None
    extra = extra_basis(terms, motion.rate, motion.force, imu.temp_c, speed, signals=signals)
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


def _earth_column(fit: Fit, motion: Motion) -> Column:
    """What the gyro and the accelerometer would read more were the Earth turning."""
    lat = float(motion.pos[0, 0])
    turn = EARTH_RATE * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    gyro = np.einsum("nij,i->nj", motion.dcm, turn)
    coriolis = 2.0 * np.cross(turn, motion.vel)
    accel = np.einsum("nij,ni->nj", motion.dcm, coriolis)
    acts = tuple(Inertial(0, a, gyro[:, a]) for a in range(3))
    acts += tuple(Inertial(1, a, accel[:, a]) for a in range(3))
    return Column("earth_rotation", "on", 1.0, acts)


def _direct(effect: str, motion: Motion, at: NodeMotion) -> dict[str, FloatArray]:
    """What a unit of each parameter adds to the nodes' channels [k, 15]."""
    k = len(at.t)
    out: dict[str, FloatArray] = {}

    def blank() -> FloatArray:
        return np.zeros((k, MAX_SCALARS))

    pos, vel = slice(CH_POS, CH_POS + 3), slice(CH_VEL, CH_VEL + 3)
    if effect == "gnss_lever_arm":
        for i, name in enumerate("xyz"):
            d = blank()
            d[:, pos] = at.dcm[:, :, i]
            unit = np.zeros(3)
            unit[i] = 1.0
            d[:, vel] = np.einsum("kij,kj->ki", at.dcm, np.cross(at.rate, unit))
            out[name] = d
    elif effect in ("gnss_latency", "imu_time_offset", "imu_clock_skew"):
        d = blank()
        sign = -1.0 if effect == "gnss_latency" else 1.0
        factor = sign * (at.t if effect == "imu_clock_skew" else np.ones(k))[:, None]
        d[:, pos], d[:, vel] = factor * at.vel, factor * at.acc
        out["skew" if effect == "imu_clock_skew" else "s"] = d
    elif effect in ("gnss_velocity_latency", "gnss_velocity_lag"):
        d = blank()
        tau = REFERENCE_TAU_S
        if effect == "gnss_velocity_lag":
            seen = at_times(motion, lagged(motion, tau), at.t)
        else:
            seen = at_times(motion, motion.vel, at.t - tau)
        d[:, vel] = (seen - at_times(motion, motion.vel, at.t)) / tau
        out["tau" if effect == "gnss_velocity_lag" else "s"] = d
    elif effect == "gnss_datum_shift":
        for i, name in enumerate("ned"):
            d = blank()
            d[:, CH_POS + i] = 1.0
            out[name] = d
    elif effect == "imu_mounting":
        u = at.u
        rows = {
            "roll": (np.zeros(k), -u[:, 2], u[:, 1]),
            "pitch": (u[:, 2], np.zeros(k), -u[:, 0]),
            "yaw": (-u[:, 1], u[:, 0], np.zeros(k)),
        }
        for name, (x, y, z) in rows.items():
            d = blank()
            d[:, CH_NHC], d[:, CH_NHC + 1], d[:, CH_ODOMETER] = y, z, x
            axis = "rpy".index(name[0])
            # the antenna is on the vehicle, not on the sensor
            swung = np.cross(at.arm, np.eye(3)[axis])
            d[:, pos] = at.dcm @ swung
            d[:, vel] = np.einsum("kij,kj->ki", at.dcm, np.cross(at.rate, swung))
            out[name] = d
    elif effect == "nhc_lever_arm":
        for i, name in enumerate("xyz"):
            unit = np.zeros(3)
            unit[i] = 1.0
            swing = np.cross(at.rate, unit) @ at.turn.T
            d = blank()
            d[:, CH_NHC], d[:, CH_NHC + 1], d[:, CH_ODOMETER] = (
                swing[:, 1],
                swing[:, 2],
                swing[:, 0],
            )
            out[name] = d
    elif effect == "vehicle_sideslip":
        d = blank()
        lateral = np.einsum("ki,ki->k", at.dcm[:, :, 1], at.acc)
        d[:, CH_NHC] = lateral * at.u[:, 0]
        out["coefficient"] = d
    elif effect == "odometer_scale":
        d = blank()
        d[:, CH_ODOMETER] = at.u[:, 0]
        out["relative"] = d
    return out


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
    push_columns(
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
        last.problem.model.offsets,
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
