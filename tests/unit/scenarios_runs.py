"""Short drives fused as a whole and judged, with all that a drive may have or lack."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np

from automap.records import Fixes, FixType, ImuData
from tests.unit.figure_calls import after
from tests.unit.scenarios import scenario


@contextmanager
def small_stretches(rows: int) -> Iterator[None]:
    """Have long drives begin at so many rows."""
    from automap.fusion import aside, dense_pieces, engine

    before = aside.ROWS
    aside.ROWS = engine.ROWS = dense_pieces.PIECE_ROWS = rows
    try:
        yield
    finally:
        aside.ROWS = engine.ROWS = dense_pieces.PIECE_ROWS = before


def _summary(result: Any) -> dict[str, Any]:
    wheels = None if result.wheels is None else [result.wheels.scale, result.wheels.late]
    own = {k: v for k, v in vars(result).items() if k not in ("wheels", "t_ns")}
    shown = {"trajectory": result.trajectory, "filtered": result.filtered, "wheels": wheels}
    for name in ("parameters", "filtered_parameters"):
        history = getattr(result, name)
        # which instants are noted hangs on rounding; the last is
        shown[name] = [list(history.names), history.values[-1], history.sd[-1]]
    return own | shown


def _judged(result: Any, imu: ImuData, fixes: Fixes, options: Any, **changes: Any) -> Any:
    from automap.fusion.aside import put_aside
    from automap.fusion.judged import judged
    from automap.fusion.result import Prior
    from automap.fusion.verdict import weigh
    from automap.sync.velocity_consistency import velocity_consistency
    from tests.unit.fusion_drive import CLOCK

    given: dict[str, Any] = {
        "result": result,
        "fused": put_aside(result.path_run(), result.t_ns, BytesIO()),
        "fixes": fixes,
        "clock": CLOCK,
        "options": options,
        "delay": Prior(0.02, 0.05),
        "delay_is_clock": False,
        "receiver": velocity_consistency(fixes),
    }
    found = weigh(judged(**(given | changes)), lambda: imu, lambda readings: readings)
    return {
        "verdict": found.verdict,
        "reasons": [str(reason.as_dict()) for reason in found.verdict.reasons],
        "path": found.trajectory,
        "sd": found.horizontal_sd,
        "rows": found.rows,
        "alone": found.alone,
    }


def _drive(seconds: float, seed: int, **receiver: Any) -> tuple[Any, ImuData, Fixes]:
    from tests.unit.fusion_drive import Sensor, record
    from tests.unit.fusion_motion import city_drive
    from tests.unit.fusion_receiver import Receiver, receive

    motion = city_drive(seconds, seed)
    imu = record(motion, Sensor(), 2, rate=20.0, delay_s=0.04)
    return motion, imu, receive(motion, Receiver(rate=3.0, **receiver), 3, begin=0.7)


@scenario
def runs_unknown_axes() -> Any:
    """Axes, arm and wheels that nobody knows, in stretches and with a file."""
    from automap.fusion.engine import fuse_imu_gnss
    from automap.fusion.options import FusionOptions
    from automap.fusion.result import Prior
    from automap.records import WheelSpeed
    from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, record

    motion, _, fixes = _drive(60.0, 4, lever=(0.5, -0.4, -1.1), vel_latency=0.1)
    turn = np.array([[0.0, 0.8, 0.6], [-1.0, 0.0, 0.0], [0.0, -0.6, 0.8]])
    imu = record(motion, Sensor(), 2, rate=20.0, delay_s=0.04, c_v_s=turn)
    t = np.arange(1.0, 59.0, 0.3)
    true = motion.at(t - 0.2)
    speed = np.einsum("ni,ni->n", true.c_n_b[:, :, 0], true.vel) * 1.02
    wheels = WheelSpeed(BASE_NS + np.rint(t * 1e9).astype(np.int64), np.round(speed, 2))
    told: list[str] = []
    with small_stretches(500):
        result = fuse_imu_gnss(
            imu,
            fixes,
            CLOCK,
            FusionOptions(passes=3),
            Prior(0.02, 0.05),
            delay_is_clock=True,
            odometer=wheels,
            progress=lambda f, text: told.append(f"{f} {text}"),
            scratch=BytesIO(),
        )
        return {"result": _summary(result), "told": told}


def _carriers() -> tuple[Any, ImuData, Fixes, Any, np.ndarray]:
    """Good fixes with a stated arm, fused: result, readings, fixes, options, arm."""
    from automap.fusion.engine import fuse_imu_gnss
    from automap.fusion.options import FusionOptions
    from automap.fusion.result import Prior
    from tests.unit.fusion_drive import CLOCK

    _, imu, fixes = _drive(
        75.0, 6, wander=(0.05, 0.05, 0.1), white=(0.02, 0.02, 0.03), latency=0.05
    )
    fixes = replace(fixes, fix_type=np.full(len(fixes), FixType.FIXED))
    arm = np.array([0.3, -0.2, -1.0])
    options = FusionOptions(passes=4, iterations=2, fixed={"gnss_velocity_lag": {"tau": 0.02}})
    result = fuse_imu_gnss(imu, fixes, CLOCK, options, Prior(0.0, 0.01), arm, 0.1, 0.02)
    return result, imu, fixes, options, arm


@scenario
def runs_carriers() -> Any:
    """Good fixes with a stated arm, judged, and with a gyro that turns the other way."""
    result, imu, fixes, options, arm = _carriers()
    bent = ImuData(imu.t_ns, imu.gyro * [1.0, 1.0, -1.0], imu.accel)
    return {
        "result": _summary(result),
        "sound": _judged(result, imu, fixes, options, lever_arm=arm),
        "bent": _judged(result, bent, fixes, options, delay_is_clock=True),
    }


@scenario
def runs_contradicted() -> Any:
    """Receivers that step, are elsewhere or state too much; fixes alone."""
    from automap.fusion.verdict_alone import weigh_alone
    from automap.sync.velocity_consistency import velocity_consistency
    from tests.unit.fusion_drive import CLOCK

    result, imu, fixes, options, arm = _carriers()
    jump = replace(
        fixes, vel_ned=fixes.vel_ned + [3.0, -2.0, 0.0] * (np.arange(len(fixes)) > 120)[:, None]
    )
    far = replace(fixes, lat_rad=fixes.lat_rad + 5e-6 * (np.arange(len(fixes)) > 100))
    three = replace(fixes, fix_type=np.full(len(fixes), FixType.THREE_D))
    found: dict[str, Any] = {}
    for name, log, each, changes in (
        ("jump", imu, jump, {"lever_arm": arm + 9.0}),
        ("far", imu, far, {"lever_arm": None}),
        ("stated", imu, three, {"lever_arm": arm}),
    ):
        found[name] = _judged(result, log, each, options, **changes)
    for name, each in (("alone", fixes), ("far alone", far)):
        one = weigh_alone(each, CLOCK, options, velocity_consistency(each))
        found[name] = [one.verdict, one.trajectory, one.horizontal_sd, one.rows]
    return found


@scenario
def runs_damaged() -> Any:
    """Gaps, wild and frozen readings, wild fixes, no velocities; tuned levels."""
    from automap.fusion.engine import fuse_imu_gnss
    from automap.fusion.measurements.position import age_sd_of
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions
    from automap.fusion.preparation import _median_sd
    from automap.fusion.result import Prior
    from automap.records import ClockModel
    from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, record
    from tests.unit.fusion_receiver import GPS0

    motion, _, fixes = _drive(45.0, 8, says_all=False)
    imu = record(motion, Sensor(), 2, rate=20.0, lost=[(20.0, 0.9)])
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    gyro[300, 1], accel[500:516], gyro[500:516] = 30.0, accel[500], gyro[500]
    hurt = replace(imu, gyro=gyro, accel=accel)
    wild = replace(fixes, lat_rad=fixes.lat_rad + 2e-5 * (np.arange(len(fixes)) % 40 == 33))
    silent = replace(wild, vel_ned=np.full_like(wild.vel_ned, np.nan))
    options = FusionOptions(passes=2, iterations=1, shocks=True, adapt=False)
    found = {
        name: _summary(fuse_imu_gnss(hurt, each, CLOCK, options, Prior(0.0, 0.02)))
        for name, each in (("wild", wild), ("silent", silent))
    }
    loose = ClockModel(BASE_NS, GPS0, 0.0, 0.3, 1e-9, "identity")
    kinds = fixes.fix_type.copy()
    for share in (0, 60, 80):
        kinds[:share] = FixType.FLOAT
        told = replace(fixes, fix_type=kinds.copy())
        found[f"age {share}"] = [
            age_sd_of(told, clock, replace(options, fixed=fixed))
            for clock in (CLOCK, loose)
            for fixed in ({}, {"gnss_latency": {"s": 0.1}})
        ]
    found["level"] = _median_sd(model_fixes(fixes, fixes.gps_s, options))
    return found


@scenario
def kernels_measurements() -> Any:
    """Every measurement of a node, whole and in part, and the filter over a few of them."""
    from automap.effects.term_sums import Terms, new_room
    from automap.fusion.arrays import ModelArrays, NodeArrays
    from automap.fusion.layout import (
        HAS_POS_H,
        HAS_POS_V,
        HAS_VEL_H,
        HAS_VEL_V,
        NHC,
        ODOMETER,
        STANDSTILL,
        UNSIGNED,
    )
    from automap.fusion.measurements.constraint import constraint
    from automap.fusion.measurements.observe import observe
    from automap.fusion.measurements.position import position
    from automap.fusion.measurements.rest import zero_rate, zero_velocity
    from automap.fusion.measurements.state import AtNode
    from automap.fusion.measurements.velocity import velocity
    from automap.fusion.measurements.wheel_speed import wheel_speed

    rng = np.random.default_rng(2)
    codes = np.array([[k, kind, k % 3, k % 5] for k, kind in enumerate((0, 1, 2, 4, 5, 6, 7))])
    on = [Terms(codes, rng.uniform(0.5, 1.5, 7)) for _ in range(3)]
    terms = np.array([[0, 0, 0, 0], [0, 2, 3, 1], [1, 1, 0, 2], [0, 1, 7, 3]])
    n = 9 + 7
    model = ModelArrays(
        terms, *on, np.ones(n), np.ones(n), np.full(n, -1), np.ones(2), np.ones(3), np.ones(5), True
    )
    whole = HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V | NHC | ODOMETER | STANDSTILL
    flags = np.array(
        [
            whole,
            whole | UNSIGNED,
            HAS_POS_H | HAS_VEL_H,
            HAS_POS_V | HAS_VEL_V,
            0,
            ODOMETER | UNSIGNED,
            ODOMETER | UNSIGNED,
        ]
    )
    fix = np.column_stack(
        [
            0.7 + 1e-6 * rng.normal(size=7),
            [3.1, -3.1, 0.2, 0.3, 0.4, 3.14, -3.14],
            rng.normal(90.0, 9.0, 7),
            rng.normal(0.0, 9.0, (7, 3)),
            [4.0, 0.3, 9.0, 6.0, 1.0, 2.0, 0.9],
            np.linspace(-0.3, 0.3, 7),
        ]
    )
    nodes = NodeArrays(
        np.arange(7.0), flags, fix, np.ones((7, 15)), np.ones((7, 1)), np.ones((7, 3))
    )
    q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    found: dict[str, Any] = {}
    for k in range(7):
        for sign in (1.0, -1.0):
            at = AtNode(
                np.array([0.7, 3.12 * sign, 2e5]),
                sign * rng.normal(0.0, 9.0, 3),
                rng.normal(size=3),
                q,
                rng.normal(size=3),
                rng.normal(size=3),
                rng.normal(size=8),
                rng.normal(size=9),
                0.3 * rng.normal(size=7),
                np.array([1.0, 2.0, 0.5, -0.5, 1.5]),
                new_room(),
            )
            h, z = rng.normal(size=(3, n)), rng.normal(size=3)
            for name, kernel in (
                ("position", position),
                ("velocity", velocity),
                ("constraint", constraint),
                ("wheels", wheel_speed),
                ("rest", zero_velocity),
                ("rate", zero_rate),
            ):
                found[f"{name} {k} {sign}"] = after(kernel, nodes, k, at, model, h, z)
            if k < 2:
                found[f"all {k} {sign}"] = [
                    after(observe, number, nodes, k, at, model, h, z) for number in range(6)
                ]
    return found


@scenario
def fusion_passes() -> Any:
    """Sections, delays from pass to pass, when they have settled, tuned levels."""
    from automap.fusion import passes, tuning
    from automap.fusion.kernel_runs import PathStates
    from automap.fusion.levels import LEVELS
    from automap.fusion.model import build_state_model
    from automap.fusion.nodes import Shift, build_nodes
    from automap.fusion.options import FusionOptions
    from automap.fusion.problem import LateChange, make_problem, stored, with_late_change
    from automap.fusion.sections import _bounds, filter_and_smooth
    from tests.unit.fusion_problem import make_nodes, true_start
    from tests.unit.scenarios_fusion import small_problem

    delays = (
        "imu_time_offset",
        "gnss_velocity_latency",
        "gnss_latency",
        "imu_clock_skew",
        "gnss_velocity_lag",
        "odometer_time_offset",
        "gyro_bias",
        "imu_mounting",
    )
    problem, fixes, motion = small_problem(2, effects=delays)
    speed = np.hypot(fixes.values[:, 3], fixes.values[:, 4])
    nodes = build_nodes(
        *(fixes, Shift(), (0.1, 9.0), [(0.1, 1.0)], fixes.t, speed, 0.1 * speed, None),
        *(problem.options, True),
    )
    start = true_start(motion)
    forward, smooth = filter_and_smooth(problem, nodes, start, Shift())
    found: dict[str, Any] = {"whole": [forward, replace(smooth, cov=np.asarray(smooth.cov))]}
    about = PathStates(smooth.nominal, smooth.params)
    for name, own, with_cov, path in (
        ("parts", problem, True, None),
        ("bare", problem, False, about),
        ("stored", stored(problem, BytesIO()), True, about),
    ):
        parts = filter_and_smooth(own, nodes, start, Shift(), path, with_cov, 7)
        cov = [np.asarray(run.cov[0 : len(nodes.t)]) for run in parts]
        found[name] = [replace(run, cov=c) for run, c in zip(parts, cov, strict=True)]
    at_once = make_nodes(np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 5.0, 5.0]))
    found["bounds"] = [_bounds(at_once, n) for n in (1, 2, 3, 4, 8, 9)]
    shift = Shift(0.1, 0.3, -0.2, 2e-3, 0.05, 0.4)
    model, names = problem.model, problem.model.names
    params = smooth.params.copy()
    for k, size in enumerate((0.0, 0.01, -0.3, 2.0, -5.0)):
        params[-1] = size * (1.0 + 0.1 * np.arange(len(names)))
        each = replace(smooth, params=params.copy())
        after_it = [passes.next_shift(model, each, shift, retime) for retime in (True, False)]
        small = passes.next_shift(
            model, each, replace(shift, vel_latency_s=0.005, vel_lag_s=0.004), True
        )
        found[f"shift {k}"] = [
            *after_it,
            small,
            passes.Pass(problem, nodes, forward, each, shift, {}).totals(),
        ]
    variances = np.full_like(smooth.param_var, np.nan)
    variances[3] = 1e-8
    sure, unsure = replace(smooth, param_var=variances), replace(smooth, param_var=1e6 * variances)
    moved = {
        "delay_s": (4e-4, 6e-4),
        "vel_latency_s": (4e-4, -6e-4),
        "latency_s": (4e-4, 6e-4),
        "skew": (9e-7, 9.9e-6, 1.1e-5),
        "vel_lag_s": (4e-4, 6e-4),
        "wheels_s": (4e-4, 6e-4),
    }
    found["settled"] = [
        passes.converged(model, run, shift, replace(shift, **{n: getattr(shift, n) + off}))
        for run in (sure, unsure)
        for n, offs in moved.items()
        for off in offs
    ]
    imu = record_of(motion)
    session = passes.Session(
        imu, fixes, problem.options, [], {"imu_time_offset_s": 0.07}, {}, (0.0, 9.0), begin_s=40.0
    )
    found["session"] = [
        passes.rate_of_turn(problem.t, imu.gyro),
        passes.rate_of_turn(3e-5 * problem.t, imu.gyro),
        passes.session_signals(session),
        passes.first_shift(session, model),
        passes.problem_of(session).turning,
        passes.basis_of(replace(session, standstill=[(0.0, 12.0)])).least,
    ]
    still = np.zeros((len(problem.t), 3))
    change = np.column_stack([np.sin(problem.t), np.cos(problem.t), 0.1 * problem.t])
    changes = LateChange(change, still, still)
    late = with_late_change(problem, changes)
    users = FusionOptions(effects=("accel_warm_up", "imu_filter_delay", "gnss_speed_offset"))
    felt = replace(
        session,
        options=users,
        late_change=changes,
        made_noise=np.where(problem.t < 1.0, 0.4, 0.0)[:, None] * np.array([1.0, 0.01]),
    )
    whole = passes.problem_of(felt)
    found["problems"] = [
        late.arrays.on_velocity,
        late.model.signals,
        late.users,
        whole.samples,
        whole.users,
    ]
    free = make_problem(imu, build_state_model(users), users)
    found["plain"] = [
        free.samples,
        [free.samples_between(a, b).t for a, b in ((-1.0, 3.0), (5.0, 99.0))],
    ]
    ones = dict.fromkeys(LEVELS, 1.0)
    half = PathStates(smooth.nominal[:9], smooth.params[:9])
    tuned = tuning.tune_noise(problem, nodes.first(9), start, Shift(), half, {**ones, "gyro": 2.0})
    found["tuned"] = [
        tuned,
        tuning.shown_at_least({**ones, "wander": 0.5}, {"wander": 0.8, "accel": 4.0}),
    ]
    return found


def record_of(motion: Any) -> ImuData:
    """Readings of a motion by a usual sensor, twenty a second, warming up."""
    from tests.unit.fusion_drive import Sensor, record

    imu = record(motion, Sensor(), 2, rate=20.0)
    return replace(imu, temp_c=20.0 + 0.01 * np.arange(len(imu)))


@scenario
def kernels_forward() -> Any:
    """The filter over a few nodes as Python, with signals beside the readings themselves."""
    from automap.fusion import kernels
    from automap.fusion.kernel_runs import empty_legs, empty_store, node_arrays
    from automap.fusion.nodes import Shift, build_nodes
    from tests.unit.figure_calls import plain
    from tests.unit.fusion_problem import true_start
    from tests.unit.scenarios_fusion import small_problem

    effects = ("gyro_scale_asymmetry", "accel_quadratic", "gyro_bias", "gnss_lever_arm")
    problem, fixes, motion = small_problem(3, effects=effects, gate_probability=0.3)
    speed = np.hypot(fixes.values[:, 3], fixes.values[:, 4]) + 5.0
    nodes = build_nodes(
        *(fixes, Shift(), (0.73, 2.4), [(0.7, 1.3)], fixes.t, speed, 0.1 * speed, None),
        *(problem.options, True),
    )
    start, n = true_start(motion), problem.model.size
    spread = np.diag(np.concatenate([start.sd, problem.model.prior_sd]) ** 2)
    given = node_arrays(problem, nodes)
    about = np.tile(start.nominal, (len(nodes.t), 1)), np.zeros((len(nodes.t), n - 9))
    found: dict[str, Any] = {}
    for name, (path, params), room in (
        ("free", (np.zeros((0, 10)), np.zeros((0, n - 9))), nodes),
        ("about", about, nodes),
        ("score", about, nodes.first(0)),
    ):
        store, legs = (
            empty_store(room, n),
            empty_legs(problem, problem.samples, nodes.t, len(nodes.t)),
        )
        if len(path):
            plain(kernels.walk_path)(problem.samples, problem.arrays, nodes.t, path, params, legs)
        score = plain(kernels.run_forward)(
            *(problem.samples, problem.arrays, given, start.nominal, problem.model.prior_mean),
            *(spread, path, params, legs, store),
        )
        found[name] = {"score": score, "store": store._asdict()}
    return found
