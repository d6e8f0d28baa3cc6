"""Filter and smoother, with every channel at once, against a textbook filter with full matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from automap.frames import matrix_to_quat, quat_to_matrix
from automap.fusion.layout import (
    CHANNELS,
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    N_NAV,
    NHC,
    ODOMETER,
    STANDSTILL,
)
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.output import Innovations, innovations
from automap.fusion.problem import (
    ForwardRun,
    PathStates,
    Problem,
    SmoothRun,
    Start,
    filtered_states,
    filtered_variances,
    make_problem,
    with_options,
)
from automap.fusion.sections import filter_and_smooth
from automap.fusion.stamp_error import reported_rows
from automap.fusion.steady_rate import steady_rate
from tests.unit.dense_filter import DenseFilter, Readings, Seen, State, Trace, smooth
from tests.unit.fusion_drive import (
    BASE_NS,
    Motion,
    Receiver,
    Sensor,
    make_motion,
    receive,
    record,
)
from tests.unit.fusion_problem import make_nodes

EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "gyro_scale",
    "gnss_lever_arm",
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_correlated_noise",
    "imu_mounting",
    "nhc_lever_arm",
    "odometer_scale",
    "odometer_time_offset",
    "vehicle_sideslip",
    "vehicle_pitch",
    "gnss_latency",
    "gnss_velocity_lag",
    "gnss_course_latency",
    "gnss_velocity_scale",
    "gnss_multipath",
    "imu_clock_skew",
    "gnss_datum_shift",
)
OPTIONS = FusionOptions(
    effects=EFFECTS,
    # small, so that the filter's first order and the exact formulas are the same
    prior_sd={
        "accel_bias": {"*": 0.03},
        "gyro_bias": {"*": 0.004},
        "gyro_scale": {"*": 0.002},
        "gnss_lever_arm": {"*": 0.3},
        "imu_time_offset": {"*": 0.005},
        "gnss_velocity_latency": {"*": 0.01},
        "imu_mounting": {"*": 0.004},
        "nhc_lever_arm": {"*": 0.3},
        "odometer_scale": {"*": 0.01},
        "odometer_time_offset": {"*": 0.005},
        "gnss_latency": {"*": 0.01},
        "gnss_velocity_lag": {"*": 0.01},
        "gnss_course_latency": {"*": 0.01},
        "gnss_velocity_scale": {"*": 0.005},
        "imu_clock_skew": {"*": 1e-3},
        "gnss_datum_shift": {"*": 0.5},
    },
    accel_noise=0.02,
    gyro_noise=2e-3,
    accel_bias_walk=3e-3,
    gyro_bias_walk=3e-4,
    wander_tau_s=6.0,
    wander_share=0.7,
    multipath_tau_s=2.5,
    multipath_share=0.5,
    velocity_wander_sd=0.15,
    velocity_wander_tau_s=1.5,
    calm_rates=True,
    gate_probability=1e-30,
)
MEANS = {
    "gnss_lever_arm_x": 0.6,
    "gnss_lever_arm_y": -0.5,
    "gnss_lever_arm_z": -1.0,
    "imu_mounting_roll": 0.012,
    "imu_mounting_pitch": -0.02,
    "imu_mounting_yaw": 0.016,
    "nhc_lever_arm_x": -1.2,
    "nhc_lever_arm_y": 0.3,
    "nhc_lever_arm_z": 0.6,
    "imu_time_offset_s": 0.012,
    "gnss_velocity_latency_s": 0.02,
    "gnss_latency_s": -0.008,
    "gnss_velocity_lag_tau": 0.015,
    "gnss_course_latency_s": 0.015,
    "gnss_velocity_scale_relative": 0.004,
    "imu_clock_skew_skew": 1e-3,
    "gnss_datum_shift_n": 0.4,
    "gnss_datum_shift_e": -0.3,
    "gnss_datum_shift_d": 0.2,
    "odometer_scale_relative": 0.02,
    "odometer_time_offset_s": 0.01,
    "vehicle_sideslip_coefficient": 0.002,
    "vehicle_pitch_coefficient": 0.002,
    "gyro_scale_z": 0.004,
}
"""What is believed beforehand; not what the drive's sensors have, so that there is to learn."""
SENSOR = Sensor(
    2e-3, 0.0, (0.003, -0.002, 0.004), (0.02, -0.01, 0.03), (0.001, -0.002, 0.001), (0.0,) * 3,
    0.0, 0.0, 0.0,
)  # fmt: skip
RATE_HZ = 50.0
NODE_S = 0.27
SECONDS = 9.0
FLAGS = {
    "position_n": HAS_POS_H,
    "position_e": HAS_POS_H,
    "position_d": HAS_POS_V,
    "velocity_n": HAS_VEL_H,
    "velocity_e": HAS_VEL_H,
    "velocity_d": HAS_VEL_V,
    "nhc_y": NHC,
    "nhc_z": NHC,
    "odometer": ODOMETER,
} | {f"{kind}_{a}": STANDSTILL for kind, axes in (("zupt", "ned"), ("zaru", "xyz")) for a in axes}
SIZE = {
    "position_n": 0.2, "position_e": 0.3, "position_d": 0.5, "velocity_n": 0.05,
    "velocity_e": 0.08, "velocity_d": 0.12, "nhc_y": 0.06, "nhc_z": 0.11, "zupt_n": 0.02,
    "zupt_e": 0.03, "zupt_d": 0.045, "zaru_x": 0.004, "zaru_y": 0.006, "zaru_z": 0.009,
    "odometer": 0.07,
}  # fmt: skip
FILTER_SIGMAS, CHANNEL_SIGMAS = 0.03, 0.015
"""What second orders may come to, and the turn of the Earth that the transition leaves out."""


@dataclass(frozen=True)
class Both:
    """One problem solved by the product and by the textbook."""

    problem: Problem
    start: Start
    forward: ForwardRun
    smoothed: SmoothRun
    table: Innovations
    trace: Trace
    states: list[State]
    covs: list[np.ndarray]


def _motion() -> Motion:
    return make_motion(
        [(0.0, 0.0), (2.5, 0.0), (6.0, 9.0)],
        [(4.0, 4.0, 60.0)],
        SECONDS + 1.0,
        origin_deg=(58.3, 12.1, 90.0),
    )


def _nodes(motion: Motion) -> Nodes:
    """Every channel, each node with variances of its own; some nodes lack a part."""
    rng = np.random.default_rng(5)
    t = 0.113 + NODE_S * np.arange(int(SECONDS / NODE_S))
    lever = (0.4, -0.3, -0.8)
    fixes = receive(motion, Receiver(rate=1.0 / NODE_S, lever=lever), 6, begin=float(t[0]))
    k = len(t)
    moving = np.linalg.norm(motion.at(t).vel, axis=1) > 1.0
    flags = np.full(k, HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V)
    flags[3::5] &= ~(HAS_POS_V | HAS_VEL_V)
    flags[4::7] &= ~(HAS_POS_H | HAS_VEL_H)
    flags[5::6] &= ~(HAS_POS_H | HAS_POS_V)
    flags |= np.where(moving, NHC | ODOMETER, STANDSTILL)
    flags[0] = 0
    flags[11] = 0
    speed = 1.005 * np.linalg.norm(motion.at(t).vel, axis=1)
    values = np.column_stack(
        [fixes.lat_rad[:k], fixes.lon_rad[:k], fixes.height_m[:k], fixes.vel_ned[:k], speed]
    )
    size = np.array([SIZE[c] for c in CHANNELS])
    var = np.square(size * rng.uniform(0.7, 1.4, (k, len(CHANNELS))))
    wander = np.tile([1.0, 1.3, 2.2], (k, 1))
    wander[k // 2 :] *= [1.5, 1.2, 0.8]
    keep = np.ones((k, 3))
    keep[k // 2] = 1 / 1.5, 1 / 1.2, 0.8
    return replace(make_nodes(t, flags, values, var, wander), wander_keep=keep)


@pytest.fixture(scope="module")
def both() -> Both:
    motion = _motion()
    imu = record(motion, SENSOR, 3, rate=RATE_HZ)
    model = build_state_model(OPTIONS, MEANS)
    problem = make_problem(imu, model, OPTIONS)
    nodes = _nodes(motion)
    sd = np.array([2.0, 1.5, 3.0, 0.3, 0.2, 0.25, 0.01, 0.012, 0.02])
    start = Start(_nearly_true(motion, float(nodes.t[0])), sd)
    forward, smoothed = filter_and_smooth(problem, nodes, start, Shift(), with_cov=True)
    table = innovations(forward, 0, np.zeros(0, np.int64))

    t = (imu.t_ns - BASE_NS) * 1e-9
    readings = np.concatenate([imu.gyro, imu.accel], axis=1)
    # linear between samples such that a step integrates like the cubic through them
    linear = readings.copy()
    linear[1:-1] -= np.diff(readings, 2, axis=0) / 12.0
    dense = DenseFilter(
        Readings(t, linear[:, :3], linear[:, 3:], steady_rate(t, imu.gyro)),
        model.names,
        tau={f"gnss_correlated_noise_{a}": 6.0 for a in "ned"}
        | {f"gnss_multipath_{a}": 2.5 for a in "ned"}
        | {f"gnss_velocity_wander_{a}": 1.5 for a in "ned"},
        walk={f"accel_bias_{a}": 3e-3**2 for a in "xyz"}
        | {f"gyro_bias_{a}": 3e-4**2 for a in "xyz"}
        | {f"gnss_correlated_noise_{a}": 0.7**2 for a in "ned"}
        | {f"gnss_multipath_{a}": 0.5**2 for a in "ned"}
        | {f"gnss_velocity_wander_{a}": 0.15**2 for a in "ned"},
        noise=(0.02**2, 2e-3**2),
    )
    first = State(
        start.nominal[None, :3],
        start.nominal[None, 3:6],
        quat_to_matrix(start.nominal[None, 6:10]),
        model.prior_mean[None].copy(),
    )
    cov = np.diag(np.concatenate([sd, model.prior_sd]) ** 2)
    trace = dense.run(first, cov, _seen(nodes, table))
    return Both(problem, start, forward, smoothed, table, trace, *smooth(trace))


def _nearly_true(motion: Motion, t: float) -> np.ndarray:
    """A nominal state [10] a little off the truth at ``t``."""
    true = motion.at(np.array([t]))
    place = np.array([true.lat[0] + 1e-7, true.lon[0] - 2e-7, true.height[0] + 0.5])
    turn = State(place[None], true.vel, true.c_n_b, np.zeros((1, 0))).moved(
        np.array([[0.0, 0.0, 0.0, 0.1, -0.1, 0.05, 0.004, -0.003, 0.006]])
    )
    return np.concatenate([place, turn.vel[0], matrix_to_quat(turn.c)[0]])


def _seen(nodes: Nodes, table: Innovations) -> list[Seen]:
    """The nodes in the textbook's form, channels in the order of the product's table."""
    stamp = np.rint(nodes.t * 1e9).astype(np.int64)
    out = []
    for k in range(len(nodes.t)):
        channels = [str(c) for c in table.channel[table.t_ns == stamp[k]]]
        assert sorted(channels) == sorted(c for c in CHANNELS if nodes.flags[k] & FLAGS[c])
        out.append(
            Seen(
                float(nodes.t[k]),
                channels,
                dict(zip(CHANNELS, nodes.var[k].tolist(), strict=True)),
                nodes.values[k, :3],
                nodes.values[k, 3:6],
                float(nodes.values[k, 6]),
                nodes.stated_sd[k],
                nodes.wander_keep[k],
            )
        )
    return out


def _miss(nominal: np.ndarray, params: np.ndarray, states: list[State]) -> np.ndarray:
    """Differences [k, n] of the product's states from the textbook's."""
    rows = [
        State(
            nominal[k : k + 1, :3],
            nominal[k : k + 1, 3:6],
            quat_to_matrix(nominal[k : k + 1, 6:10]),
            params[k : k + 1],
        ).minus(states[k])[0]
        for k in range(len(states))
    ]
    return np.stack(rows)


def _sds(covs: list[np.ndarray]) -> np.ndarray:
    return np.sqrt(np.stack([np.diag(c) for c in covs]))


def test_innovations_and_their_spread_by_channel(both: Both) -> None:
    nu = np.concatenate(both.trace.innovation)
    sd = np.sqrt(np.concatenate(both.trace.innovation_var))
    assert both.table.accepted.all()
    for channel in CHANNELS:
        rows = both.table.channel == channel
        assert rows.sum() > 5, channel
        assert both.table.sd[rows] == pytest.approx(sd[rows], rel=CHANNEL_SIGMAS), channel
        assert np.abs((both.table.innovation - nu)[rows] / sd[rows]).max() < CHANNEL_SIGMAS, channel
    # the residuals are measurements' and no rounding
    assert 0.5 < np.sqrt(np.mean((nu / sd) ** 2)) < 2.0


def test_filtered_states_and_covariances(both: Both) -> None:
    nominal, params, cov = filtered_states(both.problem, both.forward)
    _compare(both, nominal, params, cov, both.trace.state, both.trace.cov)
    sd = _sds(both.trace.cov)[:, N_NAV:]
    variances = filtered_variances(both.problem, both.forward)
    assert np.sqrt(variances) == pytest.approx(sd, rel=FILTER_SIGMAS)


def test_smoothed_states_and_covariances(both: Both) -> None:
    s = both.smoothed
    _compare(both, s.nominal, s.params, s.cov, both.states, both.covs)
    noted = np.isfinite(s.param_var).all(axis=1)
    assert noted.sum() > 5
    sd = _sds(both.covs)[noted][:, N_NAV:]
    assert np.sqrt(s.param_var[noted]) == pytest.approx(sd, rel=FILTER_SIGMAS)


def _compare(
    both: Both,
    nominal: np.ndarray,
    params: np.ndarray,
    cov: np.ndarray,
    states: list[State],
    covs: list[np.ndarray],
) -> None:
    miss, sd = _miss(nominal, params, states), _sds(covs)
    off = np.abs(miss / sd).max(axis=0)
    names = (
        *(f"{kind}_{a}" for kind in ("p", "v", "phi") for a in "ned"),
        *both.problem.model.names,
    )
    assert off.max() < FILTER_SIGMAS, names[int(off.argmax())]
    rows = reported_rows(both.problem.model)
    size = sd[:, rows][:, :, None] * sd[:, rows][:, None, :]
    dense = np.stack(covs)[:, rows][:, :, rows]
    assert np.abs((cov - dense) / size).max() < FILTER_SIGMAS


def test_likelihood_of_all_measurements(both: Both) -> None:
    assert both.forward.score == pytest.approx(both.trace.score, abs=0.05)


def test_the_estimate_does_not_hang_on_the_path_linearised_about(both: Both) -> None:
    """Where the path is a third of a sigma off, another way at every node, the filter's mean makes
    up for it: in eight draws, for a single one says as much of its own numbers."""
    rng = np.random.default_rng(9)
    sd = _sds(both.covs)

    def smoothed_about(size: float) -> np.ndarray:
        moved = [
            state.moved(size * s[None] * rng.uniform(-1.0, 1.0, (1, len(s))))
            for state, s in zip(both.states, sd, strict=True)
        ]
        rows = [np.concatenate([m.place[0], m.vel[0], matrix_to_quat(m.c)[0]]) for m in moved]
        about = PathStates(np.stack(rows), np.stack([m.par[0] for m in moved]))
        nodes = both.forward.nodes
        _, smoothed = filter_and_smooth(both.problem, nodes, both.start, Shift(), about)
        return _miss(smoothed.nominal, smoothed.params, both.states) / sd

    plain = smoothed_about(0.0)
    off = np.stack([smoothed_about(0.3) - plain for _ in range(8)])
    assert np.sqrt(np.mean(off**2, axis=0)).max() < 0.03
    # where the filter linearised about its own first guesses it was off by as much as this
    assert np.abs(plain).max() < 0.3


@pytest.mark.parametrize(
    "rows",
    [
        ("position_n", "position_e", "position_d"),
        ("position_n", "position_e"),
        ("velocity_n", "velocity_e", "velocity_d"),
        ("odometer",),
    ],
)
def test_a_surprising_block_is_trusted_less_until_it_is_none(
    both: Both, rows: tuple[str, ...]
) -> None:
    """The same as stating its variances larger by the factor that brings its NIS to the gate."""
    whole = both.forward.nodes
    wanted = sum({FLAGS[c] for c in rows})
    mask = wanted | (HAS_POS_V if "position_n" in rows else 0)
    k = 12 + int(np.flatnonzero((whole.flags[12:] & mask) == wanted)[0])
    whole = whole.first(k + 3)
    values, var = whole.values.copy(), whole.var
    values[k, 1] += 5e-5 * ("position_e" in rows)
    values[k, 3:5] += np.array([12.0, -7.0]) * ("velocity_n" in rows)
    values[k, 6] += 20.0 * ("odometer" in rows)
    wild = replace(whole, values=values)
    open_gate = with_options(both.problem, replace(OPTIONS, gate_probability=0.0))

    def run(problem: Problem, nodes: Nodes) -> tuple[Innovations, SmoothRun, float]:
        forward, smoothed = filter_and_smooth(problem, nodes, both.start, Shift())
        return innovations(forward, 0, np.zeros(0, np.int64)), smoothed, forward.score

    def at(table: Innovations) -> np.ndarray:
        return (table.t_ns == round(whole.t[k] * 1e9)) & np.isin(table.channel, rows)

    table, smoothed, score = run(both.problem, wild)
    plain, _, _ = run(open_gate, wild)
    here = at(table)
    nis = float(np.sum((plain.innovation[here] / plain.sd[here]) ** 2))
    gate = chi2.isf(OPTIONS.gate_probability, len(rows))
    assert nis > 3.0 * gate
    assert table.nis[here] == pytest.approx(nis, rel=1e-6)
    assert not table.accepted[here].any()
    assert table.accepted[~here].all()
    first = CHANNELS.index(rows[0])
    factor = 1.0 + (table.sd[here][0] ** 2 - plain.sd[here][0] ** 2) / var[k, first]
    wider = var.copy()
    wider[k, [CHANNELS.index(c) for c in rows]] *= factor
    again, same, likelihood = run(open_gate, replace(wild, var=wider))
    left = float(np.sum((again.innovation[here] / again.sd[here]) ** 2))
    assert gate / 10.0 < left <= gate
    assert table.sd == pytest.approx(again.sd, rel=1e-6)
    assert table.innovation == pytest.approx(again.innovation, rel=1e-4, abs=1e-7)
    assert score == pytest.approx(likelihood, abs=1e-3)
    sd = _sds(both.covs)[: k + 3]
    assert np.abs((smoothed.params - same.params) / sd[:, N_NAV:]).max() < 1e-5
    assert np.abs((smoothed.nominal - same.nominal)[:, 3:6] / sd[:, 3:6]).max() < 1e-5
