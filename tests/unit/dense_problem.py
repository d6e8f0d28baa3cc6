"""One problem with every channel at once, for the filter and for the textbook's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.frames import matrix_to_quat, quat_to_matrix
from automap.fusion.kernel_runs import ForwardRun, SmoothRun, Start
from automap.fusion.layout import (
    CHANNELS,
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    NHC,
    ODOMETER,
    STANDSTILL,
)
from automap.fusion.model import build_state_model
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.output import Innovations, innovations
from automap.fusion.problem import Problem, make_problem
from automap.fusion.sections import filter_and_smooth
from automap.fusion.steady_readings import steady
from tests.unit.dense_filter import DenseFilter, Readings, Seen, State, Trace, smooth
from tests.unit.fusion_drive import BASE_NS, Sensor, record
from tests.unit.fusion_motion import Motion, make_motion
from tests.unit.fusion_problem import make_nodes
from tests.unit.fusion_receiver import Receiver, receive

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
    # the formulas have the constraint at every instant
    nhc_mean_s=0.0,
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
    return replace(make_nodes(t, flags, values, var, wander), lasting_keep=np.hstack([keep, keep]))


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
                nodes.lasting_keep[k, :3],
            )
        )
    return out


def solve_both() -> Both:
    """The problem solved by both."""
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
        Readings(t, linear[:, :3], linear[:, 3:], steady(t, imu.gyro), steady(t, imu.accel)),
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
