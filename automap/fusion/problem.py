"""One filter problem as arrays, and the calls into the kernels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automap.effects import Signals, extra_basis
from automap.effects.terms import POSITION_ACCURACY
from automap.effects.user import is_users, user_signal
from automap.fusion import kernels
from automap.fusion.kernels import ForwardStore, ModelArrays, NodeArrays, Samples
from automap.fusion.layout import MAX_SCALARS, N_NAV, ROWS_OF_FLAG
from automap.fusion.limits import FORCE_WINDOW_S, MAX_INFLATION, REFUSED_INFLATION
from automap.fusion.model import StateModel
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.resample import states_at
from automap.fusion.shocks import shock_noise
from automap.fusion.stamp_error import reported_rows
from automap.fusion.steady_rate import steady_rate
from automap.fusion.unusable_readings import bridge_noise
from automap.gates import gate
from automap.records import FloatArray, ImuData

PARAMETER_STEP_S = 1.0
"""How often the uncertainty of parameters is noted."""
DELAY_STATE = "imu_time_offset_s"
VEL_LATENCY_STATE = "gnss_velocity_latency_s"
LATENCY_STATE = "gnss_latency_s"
SKEW_STATE = "imu_clock_skew_skew"
VEL_LAG_STATE = "gnss_velocity_lag_tau"
WHEELS_STATE = "odometer_time_offset_s"


def contained(shift: Shift) -> tuple[tuple[str, float], ...]:
    """States of which the nodes' times contain a part, and that part."""
    return (
        (DELAY_STATE, shift.delay_s),
        (VEL_LATENCY_STATE, shift.vel_latency_s),
        (LATENCY_STATE, shift.latency_s),
        (SKEW_STATE, shift.skew),
        (VEL_LAG_STATE, shift.vel_lag_s),
        (WHEELS_STATE, shift.wheels_s),
    )


@dataclass(frozen=True)
class Problem:
    """Readings and model in the form the kernels take; ``arrays`` are the model's, ``users`` the
    users' signals [n] at the samples that its terms on fixes and vehicle are multiplied with."""

    samples: Samples
    model: StateModel
    options: FusionOptions
    arrays: ModelArrays
    users: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def t(self) -> FloatArray:
        """Sample times [n] in s from the first."""
        return self.samples.t


@dataclass(frozen=True)
class Start:
    """Where a run begins: nominal state [10] and its one-sigma [9] (m, m/s, rad, NED)."""

    nominal: FloatArray
    sd: FloatArray


@dataclass(frozen=True)
class ForwardRun:
    """What the forward filter leaves for the smoother and the tables.

    ``cov`` [k, r, r] of the reported rows and ``param_var`` [k, n - 9] where the run went in
    sections: then ``store`` has no covariances, transitions, rows and gains.
    """

    nodes: Nodes
    store: ForwardStore
    score: float
    cov: FloatArray | None = None
    param_var: FloatArray | None = None


@dataclass(frozen=True)
class PathStates:
    """States along the path to linearise about: ``nominal`` [k, 10], ``params`` [k, n - 9]."""

    nominal: FloatArray
    params: FloatArray


@dataclass(frozen=True)
class SmoothRun(PathStates):
    """Smoothed nodes.

    ``cov`` [k, r, r] the covariance of the ``reported_rows``;
    ``param_var`` [k, n - 9] with NaN at most nodes.
    """

    nodes: Nodes
    cov: FloatArray
    param_var: FloatArray


def make_problem(
    imu: ImuData,
    model: StateModel,
    options: FusionOptions,
    speed: FloatArray | None = None,
    signals: Signals | None = None,
    bridged_s: FloatArray | None = None,
) -> Problem:
    """Problem of a recording; ``speed`` [n] m/s feeds effects that grow with it, ``signals`` [n]
    those of users; ``bridged_s`` [n] s is the length of the replaced stretch at a sample."""
    from scipy.ndimage import uniform_filter1d

    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    step = float(np.median(np.diff(t)))
    readings = np.concatenate([imu.gyro, imu.accel], axis=1)
    raw = _for_linear_steps(readings, t, step)
    terms = list(model.terms)
    extra = extra_basis(terms, imu.gyro, imu.accel, imu.temp_c, speed, signals=signals)
    width = max(2 * round(0.5 * FORCE_WINDOW_S / step) + 1, 1)
    force = uniform_filter1d(imu.accel, width, axis=0, mode="nearest")
    shocks = shock_noise(readings, step) if options.shocks else np.zeros((len(t), 2))
    if bridged_s is not None:
        shocks = shocks + bridge_noise(bridged_s, options.gap_force_sd, options.gap_rate_sd)
    calm = steady_rate(t, imu.gyro) - raw[:, :3] if options.calm_rates else np.zeros((len(t), 3))
    samples = Samples(
        t, raw, np.ascontiguousarray(extra), np.ascontiguousarray(force), calm, shocks
    )
    users = {}
    if signals is not None:
        users = {n: user_signal(n, signals) for n in model.signals if is_users(n)}
    return Problem(samples, model, options, _model_arrays(model, options, step), users)


def with_options(problem: Problem, options: FusionOptions | None = None) -> Problem:
    """The problem with other noise figures (same effects)."""
    options = options or problem.options
    step = float(np.median(np.diff(problem.t)))
    return replace(problem, options=options, arrays=_model_arrays(problem.model, options, step))


def _for_linear_steps(readings: FloatArray, t: FloatArray, step: float) -> FloatArray:
    """Readings whose linear interpolation integrates like the cubic through the samples.

    Minus a twelfth of the second difference: then the trapezoid over a step equals the
    integral of the cubic interpolant. Next to gaps the samples stay as they are.
    """
    out = readings.copy()
    spacing = np.diff(t)
    regular = (spacing[1:] < 1.5 * step) & (spacing[:-1] < 1.5 * step)
    second = readings[2:] - 2.0 * readings[1:-1] + readings[:-2]
    out[1:-1] -= np.where(regular[:, None], second / 12.0, 0.0)
    return out


def _model_arrays(model: StateModel, options: FusionOptions, step: float) -> ModelArrays:
    thresholds = [gate(options.gate_probability, rows) for rows in (1, 2, 3)]
    return ModelArrays(
        terms=model.term_table,
        on_position=model.measured.position,
        on_velocity=model.measured.velocity,
        on_vehicle=model.measured.vehicle,
        tau=model.tau,
        walk=model.walk,
        kept=model.kept,
        noise=np.array([options.accel_noise**2, options.gyro_noise**2]),
        gap=np.array([options.gap_factor * step, options.gap_force_sd, options.gap_rate_sd]),
        gate=np.array([*thresholds, MAX_INFLATION, REFUSED_INFLATION]),
        earth_on=bool(options.earth_rotation),
    )


def run_forward(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    store: bool = True,
    linearised_at: PathStates | None = None,
) -> ForwardRun:
    """Run the forward filter over the nodes, linearised about ``linearised_at`` if given.

    ``shift`` is what the nodes' times already contain of the delays; the states hold the rest.
    """
    out = empty_store(nodes if store else nodes.first(0), problem.model.size)
    score = filter_into(out, problem, nodes, first_state(problem, start, shift), linearised_at)
    return ForwardRun(nodes, out, score)


@dataclass(frozen=True)
class FilterState:
    """Where a filter stands: nominal state [10], parameters [n - 9], covariance [n, n]."""

    nominal: FloatArray
    params: FloatArray
    cov: FloatArray


def node_signals(problem: Problem, nodes: Nodes) -> FloatArray:
    """The signals [k, e] at the nodes that the model's terms on measurements are multiplied with:
    the size of the fixes' wandering error, or a user's."""
    out = np.empty((len(nodes.t), len(problem.model.signals)))
    for column, name in enumerate(problem.model.signals):
        if name in problem.users:
            out[:, column] = np.interp(nodes.t, problem.t, problem.users[name])
        else:
            out[:, column] = nodes.stated_sd[:, POSITION_ACCURACY.index(name)]
    return out


def first_state(problem: Problem, start: Start, shift: Shift) -> FilterState:
    """The state before anything was measured."""
    model = problem.model
    params = model.prior_mean.copy()
    for name, value in contained(shift):
        if name in model.names:
            params[model.names.index(name)] -= value
    cov = np.diag(np.concatenate([start.sd, model.prior_sd]) ** 2)
    return FilterState(start.nominal, params, cov)


def filter_into(
    store: ForwardStore,
    problem: Problem,
    nodes: Nodes,
    state: FilterState,
    linearised_at: PathStates | None,
) -> float:
    """Filter over the nodes from ``state`` at the first of them; returns the score."""
    score = kernels.run_forward(
        problem.samples,
        problem.arrays,
        NodeArrays(
            nodes.t,
            nodes.flags,
            nodes.values,
            nodes.var,
            node_signals(problem, nodes),
            nodes.wander_keep,
        ),
        state.nominal,
        state.params,
        state.cov,
        np.zeros((0, 10)) if linearised_at is None else linearised_at.nominal,
        np.zeros((0, problem.model.size - N_NAV))
        if linearised_at is None
        else linearised_at.params,
        store,
    )
    return float(score)


def linearisation_states(
    problem: Problem, smooth: SmoothRun, nodes: Nodes, before: Shift, now: Shift
) -> PathStates:
    """Smoothed states at the instants of other ``nodes``, whose times contain ``now``."""
    params = np.stack(
        [np.interp(nodes.t, smooth.nodes.t, column) for column in smooth.params.T], axis=1
    )
    for (name, old), (_, new) in zip(contained(before), contained(now), strict=True):
        if name in problem.model.names:
            params[:, problem.model.names.index(name)] += old - new
    if np.array_equal(nodes.t, smooth.nodes.t):
        return PathStates(smooth.nominal, params)
    dense, _ = run_dense(problem, smooth.nodes, smooth.nominal, smooth.params, blend=True)
    good = np.isfinite(dense).all(axis=1)
    return PathStates(states_at(problem.t[good], dense[good], nodes.t), params)


def empty_store(nodes: Nodes, n: int) -> ForwardStore:
    """Room for what a run over the nodes leaves, with ``n`` states."""
    k = len(nodes.t)
    per_node = np.zeros(k, dtype=np.int64)
    for bit, rows in ROWS_OF_FLAG:
        per_node += ((nodes.flags & bit) > 0) * rows
    total = int(per_node.sum())
    return ForwardStore(
        nominal=np.zeros((k, 10)),
        params=np.zeros((k, n - N_NAV)),
        mean=np.zeros((k, n)),
        trans=np.zeros((k, N_NAV, n)),
        cov=np.zeros((k, n * (n + 1) // 2)),
        scalars=np.zeros(k, dtype=np.int64),
        h=np.zeros((total, n)),
        gain=np.zeros((total, n)),
        nu=np.zeros(total),
        var=np.zeros(total),
        info=np.zeros((total, 3), dtype=np.int64),
        nis=np.full((k, MAX_SCALARS), np.nan),
    )


@dataclass(frozen=True)
class Adjoint:
    """What all later measurements say: [n] and [n, n], changed in place."""

    lam: FloatArray
    big: FloatArray


def no_adjoint(n: int) -> Adjoint:
    """The adjoint at the end of a drive."""
    return Adjoint(np.zeros(n), np.zeros((n, n)))


def run_smoother(
    problem: Problem,
    forward: ForwardRun,
    adjoint: Adjoint | None = None,
    with_cov: bool = True,
) -> SmoothRun:
    """Smooth a stored forward run, back from ``adjoint`` (default: the end of the drive).

    Without ``with_cov`` the covariances per node are left out.
    """
    store = forward.store
    rows = reported_rows(problem.model)
    k, n = store.mean.shape
    adjoint = adjoint or no_adjoint(n)
    dx = np.empty((k, n))
    cov = np.empty((k if with_cov else 0, len(rows), len(rows)))
    variances = np.empty((k, n - N_NAV))
    kernels.run_smoother(
        forward.nodes.t,
        forward.nodes.wander_keep,
        problem.model.kept,
        problem.model.tau,
        store,
        rows,
        PARAMETER_STEP_S,
        adjoint.lam,
        adjoint.big,
        dx,
        cov,
        variances,
    )
    dx += store.mean
    nominal, params = store.nominal.copy(), store.params.copy()
    kernels.apply_correction(nominal, params, dx)
    return SmoothRun(nominal, params, forward.nodes, cov, variances)


def full_covariance(packed: FloatArray, n: int) -> FloatArray:
    """Symmetric matrices [k, n, n] of packed upper triangles [k, n (n + 1) / 2]."""
    out = np.empty((len(packed), n, n))
    rows, columns = np.triu_indices(n)
    out[:, rows, columns] = packed
    out[:, columns, rows] = packed
    return out


def filtered_states(
    problem: Problem, forward: ForwardRun
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The forward filter's own states [k, 10], parameters [k, n - 9] and covariance [k, r, r]
    of the reported rows after each update."""
    nominal, params = forward.store.nominal.copy(), forward.store.params.copy()
    kernels.apply_correction(nominal, params, forward.store.mean)
    return nominal, params, reported_cov(problem, forward)


def filtered_variances(problem: Problem, forward: ForwardRun) -> FloatArray:
    """The filter's variances [k, n - 9] of the parameters after each update."""
    if forward.param_var is not None:
        return forward.param_var
    n = problem.model.size
    i = np.arange(N_NAV, n)
    return np.asarray(forward.store.cov[:, i * n - i * (i - 1) // 2])


def reported_cov(problem: Problem, forward: ForwardRun) -> FloatArray:
    """The filter's covariance [k, r, r] of the reported rows after each update."""
    if forward.cov is not None:
        return forward.cov
    rows = reported_rows(problem.model)
    n = problem.model.size
    low = np.minimum(rows[:, None], rows[None, :])
    high = np.maximum(rows[:, None], rows[None, :])
    # place of an element in the packed upper triangle
    return np.asarray(forward.store.cov[:, low * n - low * (low - 1) // 2 + high - low])


def run_dense(
    problem: Problem,
    nodes: Nodes,
    nominal: FloatArray,
    params: FloatArray,
    blend: bool,
    with_rates: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """States [n, 10] at every IMU epoch and, ``with_rates``, corrected readings [n, 6]."""
    out = np.full((len(problem.t), 10), np.nan)
    rates = np.full((len(problem.t) if with_rates else 0, 6), np.nan)
    kernels.run_dense(problem.samples, problem.arrays, nodes.t, nominal, params, blend, out, rates)
    return out, rates
