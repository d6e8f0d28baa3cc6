"""What a fusion gives back, and how it is made of the last pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.terms import POSITION, Kind
from automap.effects.user import is_users
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.fusion import limits
from automap.fusion.aside import whole_trajectory
from automap.fusion.delay_states import DELAY_STATE, SKEW_STATE
from automap.fusion.filtered import filtered_states
from automap.fusion.measurements.constraint import sd_on_springs
from automap.fusion.measurements.position import unseen_changes, unseen_errors
from automap.fusion.mounting import Mounting
from automap.fusion.nodes import Nodes
from automap.fusion.output import (
    Innovations,
    NodeStates,
    ParameterHistory,
    filter_history,
    innovations,
    node_trajectory,
    parameter_history,
)
from automap.fusion.passes import Pass, Session
from automap.fusion.problem import Problem
from automap.fusion.tuning import shown_at_least
from automap.fusion.wheels import Wheels
from automap.fusion.worse_stretches import WorseStretches
from automap.records import ClockModel, FloatArray, IntArray, Trajectory

ARM_UP = "gnss_lever_arm_z"
PITCH = "imu_mounting_pitch"


@dataclass(frozen=True)
class Prior:
    """A number known beforehand with one sigma."""

    mean: float
    sd: float


@dataclass(frozen=True)
class WheelResult:
    """What became of wheel speed: ``found`` before the passes; ``scale`` how many of its metres are
    one, ``late`` how much later than the truth it is stamped, s, None where it was not used."""

    found: Wheels
    scale: Prior | None = None
    late: Prior | None = None


@dataclass(frozen=True)
class FusionResult:
    """A fused drive.

    ``trajectory`` smoothed and ``filtered`` forward only, at the IMU's epochs ``t_ns``, and stretch
    by stretch, made anew at each call, by ``path_run`` and ``filter_run``; ``parameters``
    the estimated sensor errors over time, smoothed, ``filtered_parameters`` as the forward
    filter saw them; ``innovations`` of the last forward pass;
    ``delay`` of the IMU stamps against the fixes (imu_time_offset > 0: stamps later than the
    truth) with sd; ``mounting`` sensor to vehicle; ``standstill`` intervals in s from the
    first sample; ``align_margin`` in nats; ``noise_factors`` what the
    drive made of the noise levels; ``wheels`` None where the drive has no wheel speed; ``age_sd``
    s by which the path at a stamp may be of another instant, as the age of the fixes is not known;
    ``worse`` where positions err by more than elsewhere.
    """

    t_ns: IntArray
    path_run: Callable[[], Iterator[Trajectory]]
    filter_run: Callable[[], Iterator[Trajectory]]
    parameters: ParameterHistory
    filtered_parameters: ParameterHistory
    innovations: Innovations
    delay: Prior
    mounting: Mounting
    standstill: list[tuple[float, float]]
    align_margin: float
    n_nodes: int
    n_fixes_used: int
    noise_factors: dict[str, float]
    wheels: WheelResult | None = None
    warnings: list[str] = field(default_factory=list)
    age_sd: float = 0.0
    worse: WorseStretches | None = None

    @cached_property
    def trajectory(self) -> Trajectory:
        """The smoothed trajectory."""
        return whole_trajectory(self.path_run())

    @property
    def filtered(self) -> Trajectory:
        """The forward filter's trajectory, made anew at each call."""
        return whole_trajectory(self.filter_run())


@dataclass(frozen=True)
class Outcome:
    """What the tables need of the last pass; the filter's store is large and goes."""

    problem: Problem
    nodes: Nodes
    smoothed: NodeStates
    filtered: NodeStates
    parameters: ParameterHistory
    filtered_parameters: ParameterHistory
    innovations: Innovations
    factors: dict[str, float]
    shown: dict[str, float]


def collect(last: Pass, base_ns: int, outliers: IntArray) -> Outcome:
    """The tables' part of a pass; ``base_ns`` the first stamp, ``outliers`` wild fixes."""
    smooth = last.smooth
    return Outcome(
        last.problem,
        last.nodes,
        NodeStates(smooth.nominal, smooth.params, smooth.cov),
        NodeStates(*filtered_states(last.problem, last.forward)),
        parameter_history(last.problem, smooth, base_ns, last.shift),
        filter_history(last.problem, last.forward, base_ns, last.shift),
        innovations(last.forward, base_ns, outliers),
        last.factors,
        shown_at_least(last.factors, last.untuned),
    )


def moved_imu(problem: Problem, final: Mapping[str, float]) -> FloatArray:
    """By how much users' effects turn the mounting, [n, 3] rad, at the samples; ``final`` the
    estimated parameters by name. One row of nothing where none does."""
    moved = np.zeros((1, 3))
    for effect in problem.model.places:
        for term in CATALOGUE[effect].terms:
            if term.on == POSITION and term.kind == Kind.TURN and is_users(term.signal):
                amount = final[f"{effect}_{term.parameter}"] * problem.users[term.signal]
                moved = moved + amount[:, None] * np.eye(3)[term.axis]
    return moved


def _slope_sd(outcome: Outcome, drift: FloatArray) -> float:
    """Sigma, rad, of a path's mean slope where heights drift by ``drift`` [n] m at the nodes, one
    sigma, that nothing shows: by that slope, but for what was known before, a mounting is told."""
    model, t, velocity = outcome.problem.model, outcome.nodes.t, outcome.smoothed.nominal[:, 3:5]
    if PITCH not in model.names or len(t) < 2:
        return 0.0
    way = float(np.trapezoid(np.hypot(*velocity.T), t))
    known = float(model.prior_sd[model.names.index(PITCH)])
    return min(math.atan2(float(np.median(drift)), way), known)


def _beside(history: ParameterHistory, up_sd: float) -> ParameterHistory:
    """Parameters with the height of the antenna as unsure as it was before, ``up_sd`` m."""
    return replace(history, sd=np.hypot(history.sd, up_sd * (np.array(history.names) == ARM_UP)))


def assemble(
    session: Session,
    outcome: Outcome,
    clock: ClockModel,
    mounting: Mounting,
    margin: float,
    warnings: list[str],
    axes_known: bool,
    delay_is_clock: bool,
    arm_sd: FloatArray,
    age_sd: float,
    worse: WorseStretches | None = None,
) -> FusionResult:
    """The result of a drive's last pass; ``arm_sd`` [3] m what of the antenna's arm was not told,
    ``age_sd`` s what dates all fixes wrong, ``worse`` where positions err by more than elsewhere,
    the rest as in ``fuse_imu_gnss``."""
    history = outcome.parameters
    final = dict(zip(history.names, history.values[-1], strict=True))
    spread = dict(zip(history.names, history.sd[-1], strict=True))
    delay = Prior(float(final.get(DELAY_STATE, 0.0)), float(spread.get(DELAY_STATE, 0.0)))
    angles = [f"imu_mounting_{a}" for a in ("roll", "pitch", "yaw")]
    mounted = np.array([final.get(name, 0.0) for name in angles])
    turn = rpy_to_matrix(mounted)
    moved = moved_imu(outcome.problem, final)
    sd = np.array([spread.get(name, 0.0) for name in angles])
    if not axes_known:
        sd[1:] = np.maximum(sd[1:], limits.KNOWN_FORWARD_SD)
    total = turn @ mounting.matrix

    nodes, options = outcome.nodes, session.options
    unseen = np.zeros((len(nodes.t), 6))
    unseen[:, :3] = unseen_errors(nodes.stated_sd, options, outcome.shown)
    drift = unseen_changes(nodes.stated_sd, float(np.ptp(nodes.t)), options, outcome.shown)
    accel_noise = options.accel_noise * outcome.factors.get("accel", 1.0)
    unseen[:, 5] = sd_on_springs(nodes.flags, accel_noise, options.nhc_mean_s)

    make = partial(
        node_trajectory, outcome.problem, nodes,
        t_ns=session.imu.t_ns, clock=clock, delay=delay.mean + final.get(SKEW_STATE, 0.0)
        * outcome.problem.t, delay_is_clock=delay_is_clock,
        turn=rpy_to_matrix(mounted + moved) if moved.any() else turn, unseen_sd=unseen,
        arm_sd=arm_sd, slip_sd=np.radians(options.nhc_lasting_deg),
        slope_sd=_slope_sd(outcome, drift[:, 2]), age_sd=age_sd,
    )  # fmt: skip
    return FusionResult(
        session.imu.t_ns,
        partial(make, states=outcome.smoothed, blend=True),
        partial(make, states=outcome.filtered, blend=False),
        _beside(history, arm_sd[2]),
        _beside(outcome.filtered_parameters, arm_sd[2]),
        outcome.innovations,
        delay,
        Mounting(total, matrix_to_rpy(total), sd),
        session.standstill,
        margin,
        len(outcome.nodes.t),
        len(np.unique(outcome.nodes.fix_row[outcome.nodes.fix_row >= 0])),
        outcome.factors,
        warnings=warnings,
        age_sd=age_sd,
        worse=worse,
    )
