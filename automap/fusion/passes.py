"""The passes of a run: align, filter, smooth, settle the delays, adapt, iterate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automap.effects import Signals
from automap.effects.inertial_signals import asks_for_the_drive
from automap.effects.signals import CalmReadings, signals_of_readings, travel_of_fixes
from automap.effects.terms import TRAVEL
from automap.errors import StageError
from automap.fusion import limits
from automap.fusion.adapt import COARSE, adapt_noise, refine_noise, scale_nodes, scale_problem
from automap.fusion.alignment import Alignment, align
from automap.fusion.delay_states import (
    COURSE_STATE,
    DELAY_STATE,
    LATENCY_STATE,
    SKEW_STATE,
    VEL_LAG_STATE,
    VEL_LATENCY_STATE,
    WHEELS_STATE,
    contained,
)
from automap.fusion.dense_pieces import linearisation_states
from automap.fusion.kernel_runs import ForwardRun, SmoothRun, Start
from automap.fusion.kernels import Samples
from automap.fusion.layout import HAS_VEL_H
from automap.fusion.levels import LEVELS, RUN_LEVELS
from automap.fusion.measurements.wheel_speed import Odometer
from automap.fusion.model import StateModel, build_state_model
from automap.fusion.nodes import FixModel, Nodes, Shift, build_nodes, fix_speed
from automap.fusion.options import FusionOptions
from automap.fusion.problem import LateChange, Problem, make_problem, with_late_change
from automap.fusion.rest_noise import least_levels, shaken_levels
from automap.fusion.sections import SECTION_NODES, filter_and_smooth
from automap.fusion.tuning import Tuned, tune_noise
from automap.fusion.wheel_limits import MAX_WHEELS_S, TURN_WINDOW_S
from automap.records import FloatArray, ImuData


@dataclass(frozen=True)
class Session:
    """What stays the same over the passes of one run.

    ``means`` and ``sds`` are priors by parameter name, ``standstill`` intervals and ``span`` in
    s from the first sample, which was taken ``begin_s`` into the drive; ``made_noise`` [n, 2]
    the PSD of what force and rate err by where they were made up; ``late_change`` how late
    velocities change; ``readings`` as the filter takes them, and ``calm`` ones, where many models
    are asked of them; ``section_nodes`` the longest stretch of whose filter all is kept;
    ``path`` times [k] and velocities [k, 3] NED of the vehicle that the quantities of the drive are
    told by in place of fixes, which may be late.
    """

    imu: ImuData
    fixes: FixModel
    options: FusionOptions
    standstill: list[tuple[float, float]]
    means: dict[str, float]
    sds: dict[str, float]
    span: tuple[float, float]
    odometer: Odometer | None = None
    begin_s: float = 0.0
    made_noise: FloatArray | None = None
    late_change: LateChange | None = None
    readings: Samples | None = None
    calm: CalmReadings | None = None
    section_nodes: int = SECTION_NODES
    path: tuple[FloatArray, FloatArray] | None = None


@dataclass(frozen=True)
class Pass:
    """One pass: the filter's run over the nodes and its smoothed form.

    ``shift`` the delays that the nodes' times contain, ``factors`` on the noise levels,
    ``untuned`` those before they were ``tuned``.
    """

    problem: Problem
    nodes: Nodes
    forward: ForwardRun
    smooth: SmoothRun
    shift: Shift
    factors: dict[str, float]
    tuned: Tuned | None = None
    untuned: Mapping[str, float] = field(default_factory=dict)

    def totals(self) -> dict[str, float]:
        """Final values of all parameters by name, what the times contain included."""
        names = self.problem.model.names
        out = dict(zip(names, self.smooth.params[-1].tolist(), strict=True))
        return out | {n: out[n] + part for n, part in contained(self.shift) if n in out}


def rate_of_turn(t: FloatArray, gyro: FloatArray) -> FloatArray:
    """Size [n] of the rate of turn, rad/s, of rates [n, 3] at ``t`` [n] s, whatever their bias."""
    step = max(float(np.median(np.diff(t))), 1e-4)
    rate = np.linalg.norm(gyro - np.median(gyro, axis=0), axis=1)
    width = min(max(round(TURN_WINDOW_S / step), 1), len(rate))
    return np.convolve(rate, np.full(width, 1.0 / width), mode="same")


def session_signals(session: Session) -> Signals:
    """The quantities of a drive at its IMU samples, as readings and fixes show them."""
    imu = session.imu
    t, vel_t, vel = _velocities(session)
    if session.path is not None:
        vel_t, vel = session.path[0] + session.begin_s, session.path[1]
    readings = t, imu.gyro, imu.accel, imu.temp_c
    return signals_of_readings(*readings, vel_t, vel, session.calm)


def _velocities(session: Session) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [n] of the IMU samples in s since the drive began, times [m] and velocities [m, 3] of
    fixes."""
    imu, fixes = session.imu, session.fixes
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9) + session.begin_s
    has = (fixes.flags & HAS_VEL_H) > 0
    return t, fixes.t[has] + session.begin_s, fixes.values[has, 3:6]


def problem_of(session: Session) -> Problem:
    """What the filter needs of a session but its nodes, noise levels as the options state them."""
    model = build_state_model(session.options, session.means, session.sds)
    speed_t, speed, _ = fix_speed(session.fixes)
    if session.path is not None:
        speed_t, speed = session.path[0], np.hypot(*session.path[1][:, :2].T)
    along = None
    if len(speed_t):
        t_imu = np.asarray((session.imu.t_ns - session.imu.t_ns[0]) * 1e-9)
        along = np.interp(t_imu, speed_t, speed)
    named = [*(t.extra or "" for t in model.terms), *model.signals]
    of_drive = {name for name in named if asks_for_the_drive(name)}
    signals = session_signals(session) if of_drive - set(TRAVEL) else None
    problem = make_problem(
        *(session.imu, model, session.options, along, signals, session.made_noise, session.readings)
    )
    problem = replace(problem, turning=rate_of_turn(problem.t, session.imu.gyro))
    if of_drive.intersection(TRAVEL) and (signals is None or session.path is not None):
        # alone it is quickly told; what velocities err by along it they err by as they are told
        travel = zip(TRAVEL, travel_of_fixes(*_velocities(session)), strict=True)
        problem = replace(problem, users={**problem.users, **dict(travel)})
    if session.late_change is None:
        return problem
    return with_late_change(problem, session.late_change)


def nodes_of(
    session: Session,
    problem: Problem,
    shift: Shift,
    speed_t: FloatArray,
    speed: FloatArray,
    constrained: bool,
) -> Nodes:
    """The nodes of a pass at times that contain ``shift``, along speeds [m] at ``speed_t`` [m]."""
    return build_nodes(
        session.fixes,
        shift,
        session.span,
        session.standstill,
        speed_t,
        speed,
        speed * np.interp(speed_t, problem.t, problem.turning),
        session.odometer,
        session.options,
        constrained,
    )


@dataclass(frozen=True)
class Basis:
    """What passes take of a session's readings: the ``problem`` with noise levels as the options
    state them, the ``least`` factors on these levels that readings at rest allow, and those that
    readings have ``shaken``, which are no less possible."""

    problem: Problem
    least: dict[str, float]
    shaken: dict[str, float]


def basis_of(session: Session) -> Basis:
    """The basis of a session's passes."""
    base = problem_of(session)
    least = least_levels(session.imu, base.t, session.standstill, session.options)
    return Basis(base, least, shaken_levels(session.imu, session.options))


def without_readings(session: Session) -> Session:
    """The session without what a basis was made of."""
    unknown = np.broadcast_to(np.nan, session.imu.gyro.shape)
    imu = replace(session.imu, gyro=unknown, accel=unknown, temp_c=None)
    return replace(session, imu=imu, made_noise=None, late_change=None)


def run_passes(
    session: Session,
    start: Start | None,
    constrained: bool,
    progress: Callable[[str], None] = lambda text: None,
    found: Shift | None = None,
    basis: Basis | None = None,
) -> tuple[Pass, Alignment]:
    """Align if there is no start, filter and smooth until the delays have settled; from those
    ``found`` by other passes if they are given. The readings are those of the ``basis``, or of
    the session where there is none.

    The first pass looks at the head of the drive; then the noise levels are adapted. The second
    linearises about the filter's own estimate, all others about the smoothed path of the one
    before, at times that contain the delays found there.
    """
    options = session.options
    basis = basis or basis_of(session)
    base, model, within = basis.problem, basis.problem.model, (basis.least, basis.shaken)
    speed_t, speed, _ = fix_speed(session.fixes)
    shift = found or first_shift(session, model)
    margin = np.inf
    factors = dict.fromkeys(LEVELS, 1.0) | dict(options.factors)
    problem = scale_problem(base, factors)
    last: Pass | None = None
    tuned: Tuned | None = None
    untuned: dict[str, float] = {}
    relinearised = 0
    for number in range(max(options.passes, 2 + options.iterations)):
        nodes = nodes_of(session, problem, shift, speed_t, speed, constrained)
        if start is None:
            bias = np.array([session.means.get(f"gyro_bias_{a}", 0.0) for a in "xyz"])
            aligned = align(problem, session.fixes, nodes, bias, shift)
            start, margin = aligned.start, aligned.margin
        elif number == 1 and (options.adapt or options.tune):
            factors = adapt_noise(base, nodes, start, shift, factors, COARSE, progress, *within)
            problem = scale_problem(base, factors)
        plain, nodes = nodes, scale_nodes(nodes, factors)
        linearised_at = None
        if number == 0:
            # enough to settle start, delays and noise; the whole drive comes after
            nodes = nodes.first(int(np.searchsorted(nodes.t, nodes.t[0] + limits.HEAD_S)) + 1)
        elif number > 1 and options.iterations > 0:
            assert last is not None
            before, smoothed = last.shift, last.smooth
            last = None
            linearised_at = linearisation_states(problem, smoothed, nodes, before, shift)
            del smoothed
            if relinearised == 0 and (options.adapt or options.tune):
                factors = refine_noise(
                    *(base, plain, start, shift, linearised_at, factors, RUN_LEVELS, *within)
                )
                if options.tune and constrained:
                    tuned = tune_noise(
                        *(base, plain, start, shift, linearised_at, factors, progress, *within)
                    )
                    untuned, factors = factors, tuned.factors
                problem, nodes = scale_problem(base, factors), scale_nodes(plain, factors)
            relinearised += 1
        last, plain = None, nodes
        # only a relinearised pass can be the last
        final = number > 1 or options.iterations == 0
        forward, smooth = filter_and_smooth(
            *(problem, nodes, start, shift, linearised_at, final, session.section_nodes)
        )
        del linearised_at
        last = Pass(problem, nodes, forward, smooth, shift, factors, tuned, untuned)
        del forward
        # begin again at the smoothed start, as unsure as before: only the linearisation gains
        start = Start(smooth.nominal[0].copy(), start.sd)
        if number > 0:
            speed_t = nodes.t
            speed = np.hypot(smooth.nominal[:, 3], smooth.nominal[:, 4])
        following = next_shift(model, smooth, shift, options.retime)
        still = number > 0 and converged(model, smooth, following, shift)
        if still and relinearised >= options.iterations:
            break
        shift = following
    assert last is not None
    assert start is not None
    return last, Alignment(start, margin)


def first_shift(session: Session, model: StateModel) -> Shift:
    """What is known of the delays before the first pass."""
    shift = Shift(session.means[DELAY_STATE] if DELAY_STATE in model.names else 0.0)
    if session.odometer is None or WHEELS_STATE not in model.names:
        return shift
    return replace(shift, wheels_s=session.odometer.late_s)


def next_shift(model: StateModel, smooth: SmoothRun, shift: Shift, retime: bool) -> Shift:
    """The delays found so far, for the nodes' times of the next pass; without ``retime`` only
    that between the clocks.

    A small age of the velocities stays a state: to first order that is enough, and velocities
    share the nodes of their positions.
    """
    left = dict(zip(model.names, smooth.params[-1], strict=True))
    found = {name: value + float(left.get(name, 0.0)) for name, value in contained(shift)}
    wheels_s = float(np.clip(found[WHEELS_STATE], -MAX_WHEELS_S, MAX_WHEELS_S))
    if not retime:
        return Shift(found[DELAY_STATE], wheels_s=wheels_s)
    if abs(found[VEL_LATENCY_STATE] + found[VEL_LAG_STATE]) < limits.MIN_SPLIT_S:
        found[VEL_LATENCY_STATE] = found[VEL_LAG_STATE] = 0.0
    if abs(found[COURSE_STATE]) < limits.MIN_SPLIT_S:
        found[COURSE_STATE] = 0.0
    return Shift(
        delay_s=found[DELAY_STATE],
        vel_latency_s=float(
            np.clip(found[VEL_LATENCY_STATE], -limits.MAX_DELAY_S, limits.MAX_DELAY_S)
        ),
        latency_s=float(np.clip(found[LATENCY_STATE], -limits.MAX_DELAY_S, limits.MAX_DELAY_S)),
        skew=float(np.clip(found[SKEW_STATE], -limits.MAX_SKEW, limits.MAX_SKEW)),
        vel_lag_s=float(np.clip(found[VEL_LAG_STATE], 0.0, limits.MAX_DELAY_S)),
        course_s=float(np.clip(found[COURSE_STATE], -limits.MAX_DELAY_S, limits.MAX_DELAY_S)),
        wheels_s=wheels_s,
    )


def converged(model: StateModel, smooth: SmoothRun, a: Shift, b: Shift) -> bool:
    """Whether the delays moved by no more than what does not matter."""
    finite = np.flatnonzero(np.isfinite(smooth.param_var).all(axis=1))
    if len(finite) == 0:
        raise StageError(
            "the estimate of the path did not stay finite; check lever arms, units and settings"
        )
    noted = finite[-1]
    sd = np.sqrt(np.maximum(smooth.param_var[noted], 0.0))
    for (name, now), (_, was) in zip(contained(a), contained(b), strict=True):
        if name in model.names:
            least = limits.SKEW_CONVERGED if name == SKEW_STATE else limits.DELAY_CONVERGED_S
            limit = max(least, limits.CONVERGED_SIGMAS * float(sd[model.names.index(name)]))
            if abs(now - was) > limit:
                return False
    return True
