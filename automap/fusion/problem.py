"""One filter problem as arrays, and the calls into the kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects import extra_basis
from automap.fusion import kernels
from automap.fusion.layout import MAX_SCALARS, N_NAV, PHI_ID, V_ID
from automap.fusion.measurements import Nodes, Shift
from automap.fusion.model import FusionOptions, StateModel
from automap.records import FloatArray, ImuData, IntArray

DELAY_STATE = "imu_time_offset_s"
VEL_LATENCY_STATE = "gnss_velocity_latency_s"


@dataclass(frozen=True)
class Problem:
    """Readings and model in the form the kernels take.

    ``t`` [n] seconds from the first sample, ``readings`` [n, 6] raw rates and forces,
    ``extra`` [n, e] extra basis signals, ``force`` [n, 3] the forces low-passed without delay.
    """

    t: FloatArray
    readings: FloatArray
    extra: FloatArray
    force: FloatArray
    model: StateModel
    options: FusionOptions
    gap: FloatArray
    gate: FloatArray


@dataclass(frozen=True)
class Start:
    """Where a run begins: nominal state [10] and its one-sigma [9] (m, m/s, rad, NED)."""

    nominal: FloatArray
    sd: FloatArray


@dataclass(frozen=True)
class ForwardRun:
    """What the forward filter leaves for the smoother and the tables.

    ``nominal`` [k, 10] and ``params`` [k, n - 9] are the states it linearised about, ``mean``
    [k, n] its error estimate relative to them.
    """

    nodes: Nodes
    nominal: FloatArray
    params: FloatArray
    mean: FloatArray
    trans: FloatArray
    cov: FloatArray
    sc_count: IntArray
    sc_h: FloatArray
    sc_k: FloatArray
    sc_nu: FloatArray
    sc_s: FloatArray
    sc_info: IntArray
    nis: FloatArray
    score: float


@dataclass(frozen=True)
class SmoothRun:
    """Smoothed nodes: ``nominal`` [k, 10], ``params`` [k, n - 9], ``cov`` [k, n, n]."""

    nodes: Nodes
    nominal: FloatArray
    params: FloatArray
    cov: FloatArray


def make_problem(
    imu: ImuData,
    model: StateModel,
    options: FusionOptions,
    speed: FloatArray | None = None,
) -> Problem:
    """Problem of a recording; ``speed`` [n] m/s feeds effects that grow with it."""
    from scipy.ndimage import uniform_filter1d
    from scipy.stats import chi2

    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    readings = np.ascontiguousarray(np.concatenate([imu.gyro, imu.accel], axis=1))
    extra = extra_basis(list(model.terms), imu.gyro, imu.accel, imu.temp_c, speed)
    step = float(np.median(np.diff(t)))
    gap = np.array([options.gap_factor * step, options.gap_force_sd, options.gap_rate_sd])
    p = 1.0 - options.gate_probability
    # thresholds for 1, 2, 3 rows, largest inflation, and the inflation that counts as refused
    gate = np.array([chi2.ppf(p, 1), chi2.ppf(p, 2), chi2.ppf(p, 3), 1e6, 9.0])
    width = max(2 * round(0.05 / step) + 1, 1)
    force = uniform_filter1d(imu.accel, width, axis=0, mode="nearest")
    return Problem(t, readings, extra, force, model, options, gap, gate)


def initial_covariance(problem: Problem, start: Start) -> FloatArray:
    """Diagonal prior [n, n] of a start."""
    return np.diag(np.concatenate([start.sd, problem.model.prior_sd]) ** 2)


def run_forward(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    store: bool = True,
    about: SmoothRun | None = None,
) -> ForwardRun:
    """Run the forward filter over the nodes, linearised about ``about`` if given.

    ``shift`` is what the nodes' times already contain of the delays; the states hold the rest.
    """
    model = problem.model
    n, k = model.size, len(nodes.t)
    per_node = np.zeros(k, dtype=np.int64)
    for bit, rows in ((1, 2), (2, 1), (4, 2), (8, 1), (16, 6), (32, 2)):
        per_node += ((nodes.flags & bit) > 0) * rows
    total = int(per_node.sum()) if store else 0
    size = k if store else 0
    xi0 = model.prior_mean.copy()
    for name, value in ((DELAY_STATE, shift.delay_s), (VEL_LATENCY_STATE, shift.vel_latency_s)):
        if name in model.names:
            xi0[model.names.index(name)] -= value
    out = ForwardRun(
        nodes,
        np.zeros((size, 10)),
        np.zeros((size, n - N_NAV)),
        np.zeros((size, n)),
        np.zeros((size, N_NAV, n)),
        np.zeros((size, n, n)),
        np.zeros(size, dtype=np.int64),
        np.zeros((total, n)),
        np.zeros((total, n)),
        np.zeros(total),
        np.zeros(total),
        np.zeros((total, 3), dtype=np.int64),
        np.full((size, MAX_SCALARS), np.nan),
        0.0,
    )
    options = problem.options
    noise = np.array([options.accel_noise**2, options.gyro_noise**2])
    score = kernels.run_forward(
        problem.t,
        problem.readings,
        problem.extra,
        problem.force,
        model.term_table,
        model.offsets,
        nodes.t,
        nodes.flags,
        nodes.values,
        nodes.var,
        nodes.wander_sd,
        start.nominal,
        xi0,
        initial_covariance(problem, start),
        model.tau,
        model.walk,
        noise,
        problem.gap,
        problem.gate,
        options.earth_rotation,
        store,
        np.zeros((0, 10)) if about is None else about.nominal,
        np.zeros((0, n - N_NAV)) if about is None else about.params,
        out.nominal,
        out.params,
        out.mean,
        out.trans,
        out.cov,
        out.sc_count,
        out.sc_h,
        out.sc_k,
        out.sc_nu,
        out.sc_s,
        out.sc_info,
        out.nis,
    )
    object.__setattr__(out, "score", float(score))
    return out


def run_smoother(problem: Problem, forward: ForwardRun) -> SmoothRun:
    """Smooth a stored forward run."""
    k, n = forward.nominal.shape[0], problem.model.size
    dx = np.zeros((k, n))
    cov = np.zeros((k, n, n))
    kernels.run_smoother(
        forward.nodes.t,
        problem.model.tau,
        forward.trans,
        forward.cov,
        forward.sc_count,
        forward.sc_h,
        forward.sc_k,
        forward.sc_nu,
        forward.sc_s,
        dx,
        cov,
    )
    nominal, params = forward.nominal.copy(), forward.params.copy()
    kernels.apply_correction(nominal, params, forward.mean + dx)
    return SmoothRun(forward.nodes, nominal, params, cov)


def filtered_states(forward: ForwardRun) -> tuple[FloatArray, FloatArray]:
    """The forward filter's own states [k, 10] and parameters [k, n - 9] after each update."""
    nominal, params = forward.nominal.copy(), forward.params.copy()
    kernels.apply_correction(nominal, params, forward.mean)
    return nominal, params


def run_dense(
    problem: Problem, nodes: Nodes, nominal: FloatArray, params: FloatArray, blend: bool
) -> tuple[FloatArray, FloatArray]:
    """States [n, 10] and corrected readings [n, 6] at every IMU epoch."""
    out = np.full((len(problem.t), 10), np.nan)
    rates = np.full((len(problem.t), 6), np.nan)
    kernels.run_dense(
        problem.t,
        problem.readings,
        problem.extra,
        problem.model.term_table,
        nodes.t,
        nominal,
        params,
        problem.gap,
        problem.options.earth_rotation,
        blend,
        out,
        rates,
    )
    return out, rates


def navigation_variance(cov: FloatArray) -> FloatArray:
    """Position, velocity variances and attitude covariance [k, 6 + 9] of node covariances."""
    k = len(cov)
    out = np.empty((k, 15))
    for i in range(3):
        out[:, i] = cov[:, i, i]
        out[:, 3 + i] = cov[:, V_ID + i, V_ID + i]
    out[:, 6:] = cov[:, PHI_ID : PHI_ID + 3, PHI_ID : PHI_ID + 3].reshape(k, 9)
    return np.maximum(out, -np.inf)
