"""Runs of the kernels: forward, backward, and between the nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.fusion import kernels
from automap.fusion.aside import Matrices
from automap.fusion.delay_states import contained
from automap.fusion.kernels import ForwardStore, Legs, NodeArrays, Samples
from automap.fusion.kernels.integrate import GAP_STEP_S
from automap.fusion.layout import MAX_SCALARS, N_NAV, ROWS_OF_FLAG
from automap.fusion.mechanisation import N_EARTH
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem, node_signals
from automap.fusion.stamp_error import reported_rows
from automap.records import FloatArray

AnyFloats = npt.NDArray[np.floating[Any]]

PARAMETER_STEP_S = 1.0
"""How often the uncertainty of parameters is noted."""


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
    cov: AnyFloats | Matrices | None = None
    param_var: AnyFloats | None = None


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
    cov: AnyFloats | Matrices
    param_var: AnyFloats


def run_forward(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    store: bool = True,
    linearised_at: PathStates | None = None,
    legs: Legs | None = None,
) -> ForwardRun:
    """Run the forward filter over the nodes, linearised about ``linearised_at`` if given.

    ``shift`` is what the nodes' times already contain of the delays; the states hold the rest;
    ``legs`` between the states linearised about, where they are known.
    """
    out = empty_store(nodes if store else nodes.first(0), problem.model.size)
    state = first_state(problem, start, shift)
    score = filter_into(out, problem, nodes, state, linearised_at, legs)
    return ForwardRun(nodes, out, score)


@dataclass(frozen=True)
class FilterState:
    """Where a filter stands: nominal state [10], parameters [n - 9], covariance [n, n]."""

    nominal: FloatArray
    params: FloatArray
    cov: FloatArray


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
    legs: Legs | None = None,
) -> float:
    """Filter over the nodes from ``state`` at the first of them; returns the score. The ``legs``
    between them are those about ``linearised_at``."""
    samples = problem.samples_between(nodes.t[0], nodes.t[-1])
    if linearised_at is None:
        legs = empty_legs(problem, samples, nodes.t, 1)
    elif legs is None:
        legs = legs_about(problem, nodes, linearised_at)
    score = kernels.run_forward(
        samples,
        problem.arrays,
        node_arrays(problem, nodes),
        state.nominal,
        state.params,
        state.cov,
        np.zeros((0, 10)) if linearised_at is None else linearised_at.nominal,
        np.zeros((0, problem.model.size - N_NAV))
        if linearised_at is None
        else linearised_at.params,
        legs,
        store,
    )
    return float(score)


def node_arrays(problem: Problem, nodes: Nodes) -> NodeArrays:
    """The nodes as kernels take them."""
    return NodeArrays(
        nodes.t,
        nodes.flags,
        nodes.values,
        nodes.var,
        node_signals(problem, nodes),
        nodes.lasting_keep,
    )


def speed_downwards(problem: Problem, nodes: Nodes, path: PathStates, legs: Legs) -> FloatArray:
    """Speed [k], m/s down in the vehicle's axes, with which a path and the ``legs`` about it have
    the point that does not slide at the nodes where the constraint acts; 0 at the others."""
    samples = problem.samples_between(nodes.t[0], nodes.t[-1])
    out = np.empty(len(nodes.t))
    at = problem.arrays, node_arrays(problem, nodes), path.nominal, path.params
    kernels.speed_downwards(samples, *at, legs, out)
    return out


def legs_about(problem: Problem, nodes: Nodes, path: PathStates) -> Legs:
    """How the filter goes from node to node about a path, whatever the levels of noise."""
    samples = problem.samples_between(nodes.t[0], nodes.t[-1])
    legs = empty_legs(problem, samples, nodes.t, len(nodes.t))
    kernels.walk_path(samples, problem.arrays, nodes.t, path.nominal, path.params, legs)
    return legs


def empty_legs(problem: Problem, samples: Samples, node_t: FloatArray, k: int) -> Legs:
    """Room for ``k`` legs between nodes at ``node_t``, and for their steps of integration."""
    widths = np.diff(samples.t)
    wide = widths[widths > problem.arrays.longest_step]
    # a step ends at a sample, at a node, or within a gap, which may go on beyond the samples
    beyond = max(samples.t[0] - node_t[0], 0.0) + max(node_t[-1] - samples.t[-1], 0.0)
    within = int((wide.sum() + beyond) / GAP_STEP_S) + len(wide) + 2
    steps = len(widths) + len(node_t) + within
    extra = samples.extra.shape[1]
    return Legs(
        trans=np.zeros((k, N_NAV, problem.model.size)),
        off=np.zeros((k, N_NAV)),
        rate=np.zeros((k, 3)),
        now=np.zeros((k, 6)),
        mid=np.zeros((k, 6 + extra)),
        place=np.zeros((k, N_EARTH)),
        at=np.zeros(k, dtype=np.int64),
        steps=np.zeros(k, dtype=np.int64),
        dvn=np.empty((steps, 3)),
        dt=np.empty(steps),
        since=np.empty(steps, dtype=np.int64),
    )


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
        factor=np.ones(total),
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
        forward.nodes.lasting_keep,
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
