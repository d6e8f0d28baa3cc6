"""The passes of a fusion run, from readings and fixes to a smoothed trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from automap.errors import InputError
from automap.frames import (
    matrix_to_quat,
    matrix_to_rpy,
    quat_to_matrix,
    rotation_vector_to_matrix,
)
from automap.fusion.adapt import LEVELS, adapt_noise, scale_nodes, scaled_options
from automap.fusion.alignment import Alignment, align
from automap.fusion.measurements import FixModel, Nodes, Shift, build_nodes, model_fixes
from automap.fusion.model import FusionOptions, StateModel, build_state_model
from automap.fusion.mounting import Mounting, estimate_mounting
from automap.fusion.output import (
    Innovations,
    ParameterHistory,
    innovations,
    node_trajectory,
    parameter_history,
)
from automap.fusion.problem import (
    DELAY_STATE as DELAY,
)
from automap.fusion.problem import (
    VEL_LATENCY_STATE,
    ForwardRun,
    Problem,
    SmoothRun,
    Start,
    filtered_states,
    make_problem,
    run_dense,
    run_forward,
    run_smoother,
)
from automap.fusion.standstill import find_standstill, rest_gyro_bias
from automap.records import ClockModel, Fixes, FloatArray, ImuData, Trajectory

DELAY_CONVERGED_S = 0.002
MAX_VEL_LATENCY_S = 1.0
_NO_NHC = ("imu_mounting", "nhc_lever_arm")


@dataclass(frozen=True)
class Prior:
    """A number known beforehand with one sigma."""

    mean: float
    sd: float


@dataclass(frozen=True)
class FusionResult:
    """A fused drive.

    ``trajectory`` smoothed and ``filtered`` forward only, at every IMU epoch; ``parameters``
    the estimated sensor errors over time, smoothed; ``innovations`` of the last forward pass;
    ``delay`` of the IMU stamps against the fixes (imu_time_offset > 0: stamps later than the
    truth) with sd; ``mounting`` sensor to vehicle; ``standstill`` intervals in s from the
    first sample; ``align_margin`` in nats; ``noise_factors`` what the
    drive made of the noise levels.
    """

    trajectory: Trajectory
    filtered: Trajectory
    parameters: ParameterHistory
    innovations: Innovations
    delay: Prior
    mounting: Mounting
    standstill: list[tuple[float, float]]
    align_margin: float
    n_nodes: int
    n_fixes_used: int
    noise_factors: dict[str, float]
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Session:
    """What stays the same over the passes of one run."""

    imu: ImuData
    fixes: FixModel
    options: FusionOptions
    standstill: list[tuple[float, float]]
    means: dict[str, float]
    sds: dict[str, float]
    span: tuple[float, float]


@dataclass(frozen=True)
class _Pass:
    problem: Problem
    nodes: Nodes
    forward: ForwardRun
    smooth: SmoothRun
    shift: Shift
    factors: dict[str, float]


def fuse_imu_gnss(
    imu: ImuData,
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    delay: Prior,
    lever_arm: FloatArray | None = None,
    lever_arm_sd: float = 0.05,
    delay_is_clock: bool = False,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> FusionResult:
    """Fuse inertial readings and fixes of one drive.

    ``imu`` in vehicle axes or, with ``axes_known`` False, in the sensor's own: then the
    mounting is estimated. ``delay`` is the prior of how much later than the fixes' clock the
    IMU stamps run: imu_time_offset minus any unknown output delay of the receiver. With
    ``delay_is_clock`` that delay is an error of the clock model and corrects ``gps_s``;
    otherwise the stamps are instants of a right clock at which late samples were noted, and
    each row of the output is the vehicle's state at its stamp's instant. ``lever_arm`` [3] IMU to antenna in body axes, None if unknown (it
    is then estimated).

    Raises:
        InputError: fewer than two usable fixes within the IMU's span, or hardly any samples.
    """
    if len(imu) < 10:
        raise InputError(f"the IMU recording has only {len(imu)} usable samples; record longer")
    base_ns = int(imu.t_ns[0])
    fix_t = (clock.t_ns(fixes.gps_s) - base_ns) * 1e-9
    model = model_fixes(fixes, np.asarray(fix_t), options)
    t_imu = (imu.t_ns - base_ns) * 1e-9
    span = (0.0, float(t_imu[-1]))
    inside = (model.t > span[0] - 1.0) & (model.t < span[1] + 1.0) & ((model.flags & 1) > 0)
    if int(inside.sum()) < 2:
        raise InputError(
            f"only {int(inside.sum())} usable fixes fall within the IMU recording "
            f"({span[1]:.0f} s); check the clocks with 'automap check'"
        )
    speed_t, speed, speed_sd = _fix_speed(model)
    standstill = find_standstill(t_imu - delay.mean, imu.gyro, imu.accel, speed_t, speed, speed_sd)
    standstill = [(a + delay.mean, b + delay.mean) for a, b in standstill]
    rest_bias = rest_gyro_bias(t_imu, imu.gyro, standstill)
    means = {DELAY: delay.mean}
    sds = {DELAY: delay.sd}
    effects = tuple(options.effects)
    if "gnss_lever_arm" not in effects:
        effects = (*effects, "gnss_lever_arm")
    if lever_arm is not None:
        for axis, value in zip("xyz", lever_arm, strict=True):
            means[f"gnss_lever_arm_{axis}"] = float(value)
            sds[f"gnss_lever_arm_{axis}"] = lever_arm_sd
    if rest_bias is not None:
        for axis, value in zip("xyz", rest_bias, strict=True):
            means[f"gyro_bias_{axis}"] = float(value)
            sds[f"gyro_bias_{axis}"] = 2e-3
    options = replace(options, effects=effects)
    session = _Session(imu, model, options, standstill, means, sds, span)
    warnings: list[str] = []

    mounting = Mounting(np.eye(3), np.zeros(3), np.zeros(3))
    start: Start | None = None
    margin = np.inf
    if not imu.axes_known:
        free = replace(options, effects=tuple(e for e in effects if e not in _NO_NHC))
        loose = replace(session, options=free)
        progress(0.05, "fusing in sensor axes to find the mounting")
        last, found = _passes(loose, None, constrained=False)
        margin = found.margin
        mounting = _mounting_of(last)
        session, start = _turn(session, last, mounting)
    progress(0.3, "fusing")
    last, found = _passes(session, start, constrained=True)
    margin = min(margin, found.margin)
    if margin < 5.0:
        warnings.append(
            "the heading at the start is weakly determined "
            f"(likelihood margin {margin:.1f} nats): the drive has little change of speed or "
            "direction, so headings and sideways positions of signs may be off"
        )
    progress(0.8, "writing the trajectory at IMU rate")
    return _assemble(
        session, last, clock, mounting, margin, warnings, imu.axes_known, delay_is_clock
    )


def _fix_speed(model: FixModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, horizontal speeds and their sd of the fixes that have velocity."""
    has = (model.flags & 4) > 0
    speed = np.hypot(model.values[has, 3], model.values[has, 4])
    return model.t[has], speed, np.sqrt(model.white_var[has, 3] + model.white_var[has, 4])


def _passes(session: _Session, start: Start | None, constrained: bool) -> tuple[_Pass, Alignment]:
    """Align if there is no start, filter and smooth until the delays have settled, adapt the
    noise levels once in between, and iterate about the result."""
    options = session.options
    model = build_state_model(options, session.means, session.sds)
    speed_t, speed, _ = _fix_speed(session.fixes)
    shift = Shift(session.means[DELAY] if DELAY in model.names else 0.0)
    problem = make_problem(session.imu, model, options)
    margin = np.inf
    factors = dict.fromkeys(LEVELS, 1.0)
    last: _Pass | None = None
    for number in range(max(options.passes, 2)):
        nodes = build_nodes(
            session.fixes,
            shift,
            session.span,
            session.standstill,
            speed_t,
            speed,
            options,
            constrained,
        )
        if start is None:
            bias = np.array([session.means.get(f"gyro_bias_{a}", 0.0) for a in "xyz"])
            found = align(problem, session.fixes, nodes, bias, shift)
            start, margin = found.start, found.margin
        elif number == 1 and options.adapt:
            factors = adapt_noise(problem, nodes, start, shift)
            problem = replace(problem, options=scaled_options(problem, factors))
        nodes = scale_nodes(nodes, factors)
        forward = run_forward(problem, nodes, start, shift)
        smooth = run_smoother(problem, forward)
        last = _Pass(problem, nodes, forward, smooth, shift, factors)
        # begin again at the smoothed start, as unsure as before: only the linearisation gains
        start = Start(smooth.nominal[0].copy(), start.sd)
        speed_t = nodes.t
        speed = np.hypot(smooth.nominal[:, 3], smooth.nominal[:, 4])
        following = _next_shift(model, smooth, shift)
        if number > 0 and _close(following, shift):
            break
        shift = following
    assert last is not None
    assert start is not None
    for _ in range(options.iterations):
        forward = run_forward(problem, last.nodes, start, last.shift, about=last.smooth)
        last = replace(last, forward=forward, smooth=run_smoother(problem, forward))
    return last, Alignment(start, margin)


def _next_shift(model: StateModel, smooth: SmoothRun, shift: Shift) -> Shift:
    """The delays found so far, for the nodes' times of the next pass."""
    found = dict(zip(model.names, smooth.params[-1], strict=True))
    latency = shift.vel_latency_s + float(found.get(VEL_LATENCY_STATE, 0.0))
    return Shift(
        shift.delay_s + float(found.get(DELAY, 0.0)),
        float(np.clip(latency, -MAX_VEL_LATENCY_S, MAX_VEL_LATENCY_S)),
    )


def _close(a: Shift, b: Shift) -> bool:
    return (
        abs(a.delay_s - b.delay_s) < DELAY_CONVERGED_S
        and abs(a.vel_latency_s - b.vel_latency_s) < 2 * DELAY_CONVERGED_S
    )


def _mounting_of(last: _Pass) -> Mounting:
    """Mounting from a run in sensor axes."""
    problem = last.problem
    dense, rates = run_dense(
        problem, last.nodes, last.smooth.nominal, last.smooth.params, blend=True
    )
    ok = np.isfinite(dense).all(axis=1)
    t = problem.t[ok]
    step = max(int(0.1 / max(float(np.median(np.diff(t))), 1e-4)), 1)
    dense, rates, t = dense[ok][::step], rates[ok][::step], t[::step]
    speed = np.linalg.norm(dense[:, 3:6], axis=1)
    along = np.gradient(speed, t)
    return estimate_mounting(t, dense[:, 3:6], quat_to_matrix(dense[:, 6:10]), rates[:, :3], along)


def _turn(session: _Session, last: _Pass, mounting: Mounting) -> tuple[_Session, Start]:
    """Turn readings, priors and the start from sensor into vehicle axes."""
    c = mounting.matrix
    imu = replace(
        session.imu, gyro=session.imu.gyro @ c.T, accel=session.imu.accel @ c.T, axes_known=True
    )
    means = dict(session.means)
    for stem in ("gyro_bias_", "gnss_lever_arm_"):
        if stem + "x" in means:
            turned = c @ np.array([means[stem + a] for a in "xyz"])
            means.update({stem + a: float(v) for a, v in zip("xyz", turned, strict=True)})
    nominal = last.smooth.nominal[0].copy()
    nominal[6:10] = matrix_to_quat(quat_to_matrix(nominal[6:10]) @ c.T)
    sd = np.concatenate([np.full(3, 10.0), np.full(3, 2.0), [0.12, 0.12, 0.3]])
    return replace(session, imu=imu, means=means), Start(nominal, sd)


def _assemble(
    session: _Session,
    last: _Pass,
    clock: ClockModel,
    mounting: Mounting,
    margin: float,
    warnings: list[str],
    axes_known: bool,
    delay_is_clock: bool,
) -> FusionResult:
    model = last.problem.model
    final = last.smooth.params[-1]
    spread = np.sqrt(np.maximum(np.einsum("ii->i", last.smooth.cov[-1]), 0.0))
    delay = Prior(0.0, 0.0)
    if DELAY in model.names:
        i = model.names.index(DELAY)
        delay = Prior(float(final[i]) + last.shift.delay_s, float(spread[9 + i]))
    residual = np.zeros(3)
    residual_sd = np.zeros(3)
    if "imu_mounting_roll" in model.names:
        i = model.names.index("imu_mounting_roll")
        residual = final[i : i + 3]
        residual_sd = spread[9 + i : 12 + i]
    turn = rotation_vector_to_matrix(residual)
    total = turn @ mounting.matrix
    sd = residual_sd.copy()
    if not axes_known:
        sd[0] = max(float(np.hypot(mounting.sd[0], 0.0)), float(residual_sd[0]))
        sd[1:] = np.maximum(residual_sd[1:], 0.002)
    mounted = Mounting(total, matrix_to_rpy(total), sd)
    smoothed = node_trajectory(
        last.problem,
        last.nodes,
        last.smooth.nominal,
        last.smooth.params,
        last.smooth.cov,
        session.imu.t_ns,
        clock,
        delay.mean,
        delay_is_clock,
        turn,
        residual_sd,
        blend=True,
    )
    filtered = node_trajectory(
        last.problem,
        last.nodes,
        *filtered_states(last.forward),
        last.forward.cov,
        session.imu.t_ns,
        clock,
        delay.mean,
        delay_is_clock,
        turn,
        residual_sd,
        blend=False,
    )
    params = parameter_history(last.problem, last.smooth, int(session.imu.t_ns[0]), last.shift)
    return FusionResult(
        smoothed,
        filtered,
        params,
        innovations(last.forward, int(session.imu.t_ns[0])),
        delay,
        mounted,
        session.standstill,
        margin,
        len(last.nodes.t),
        int((last.nodes.fix_row >= 0).sum()),
        last.factors,
        warnings,
    )
