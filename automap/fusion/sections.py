"""Filter and smoother over long drives, section by section, in bounded memory.

What the smoother needs of a node is some twelve kilobytes. So a first forward run keeps that
only for one section at a time, and of the others the state at their first node; going back,
each section is filtered once more. The result is that of a run in one piece.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from automap.fusion import kernels
from automap.fusion.aside import Columns, Matrices, columns_in
from automap.fusion.filtered import (
    filtered_states,
    filtered_variances,
    full_covariance,
    reported_cov,
)
from automap.fusion.kernel_runs import (
    AnyFloats,
    FilterState,
    ForwardRun,
    PathStates,
    SmoothRun,
    Start,
    empty_store,
    filter_into,
    first_state,
    legs_about,
    no_adjoint,
    run_forward,
    run_smoother,
    speed_downwards,
)
from automap.fusion.kernels import ForwardStore, Legs
from automap.fusion.layout import ON_SPRINGS
from automap.fusion.measurements.constraint import on_springs
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem
from automap.fusion.stamp_error import reported_rows

SECTION_NODES = 4_000
"""Longest stretch whose details are kept at once: a quarter of an hour of fixes five times a
second, and 75 MB."""


def filter_and_smooth(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    linearised_at: PathStates | None = None,
    with_cov: bool = True,
    section_nodes: int = SECTION_NODES,
) -> tuple[ForwardRun, SmoothRun]:
    """Filter forward and smooth back over all nodes (see ``run_forward``, ``run_smoother``)."""
    bounds = _bounds(nodes, section_nodes)
    legs: Legs | None = None
    if linearised_at is not None and problem.options.nhc_mean_s > 0.0:
        nodes, legs = _on_springs(problem, nodes, linearised_at, bounds)
    if len(bounds) == 2:
        forward = run_forward(problem, nodes, start, shift, linearised_at=linearised_at, legs=legs)
        return forward, run_smoother(problem, forward, with_cov=with_cov)
    del legs
    room = _room_for_cov(problem, len(nodes.t)) if with_cov else None
    state = first_state(problem, start, shift)
    states: list[FilterState] = []
    parts: list[ForwardRun] = []
    run: ForwardRun | None = None
    for a, b in pairwise(bounds):
        states.append(state)
        # the details of the section before go first
        run = None
        run = _filter_section(problem, nodes, a, b, state, linearised_at)
        state = _state_after(problem, run)
        part = _light(problem, run, with_cov)
        parts.append(
            part if room is None else replace(part, cov=_moved(room, "filter", a, part.cov))
        )
    adjoint = no_adjoint(problem.model.size)
    smoothed: list[SmoothRun] = []
    for number in range(len(parts) - 1, -1, -1):
        a, b = bounds[number], bounds[number + 1]
        if run is None:
            run = _filter_section(problem, nodes, a, b, states[number], linearised_at)
        smooth = run_smoother(problem, run, adjoint, with_cov)
        cov = np.asarray(smooth.cov[:]).astype(np.float32)
        smooth = replace(smooth, param_var=smooth.param_var.astype(np.float32))
        smoothed.append(replace(smooth, cov=_moved(room, "smoother", a, cov) if room else cov))
        run = None
    smoothed.reverse()
    forward, whole = _join_forward(nodes, parts), _join_smooth(nodes, smoothed)
    if room is None:
        return forward, whole
    filtered, known = (Matrices(room, name, len(nodes.t)) for name in ("filter", "smoother"))
    return replace(forward, cov=filtered), replace(whole, cov=known)


def _on_springs(
    problem: Problem, nodes: Nodes, path: PathStates, bounds: list[int]
) -> tuple[Nodes, Legs]:
    """The nodes with what the body does on its springs along a path, and the legs about it in the
    last section."""
    down = np.zeros(len(nodes.t))
    legs: Legs | None = None
    for a, b in pairwise(bounds):
        legs = None
        part, about = nodes.between(a, b + 1), _of_nodes(path, a, b)
        legs = legs_about(problem, part, about)
        down[a : b + 1] = speed_downwards(problem, part, about, legs)
    assert legs is not None
    values = nodes.values.copy()
    mean_s = problem.options.nhc_mean_s
    values[:, ON_SPRINGS] = on_springs(nodes.t, nodes.flags, nodes.var, down, mean_s)
    return replace(nodes, values=values), legs


def _of_nodes(path: PathStates, a: int, b: int) -> PathStates:
    """The path at the nodes from ``a`` to ``b``."""
    return PathStates(path.nominal[a : b + 1], path.params[a : b + 1])


def _room_for_cov(problem: Problem, n: int) -> Columns | None:
    """Room for the covariances of ``n`` nodes beside the samples of a long drive."""
    if problem.stored is None:
        return None
    samples = problem.stored.place.values()
    begin = max(at + len(problem.t) * (width or 1) for at, width in samples)
    size = len(reported_rows(problem.model)) ** 2
    return columns_in(problem.stored.file, n, {"filter": size, "smoother": size}, begin)


def _moved(room: Columns, name: str, start: int, told: Any, skip: int = 0) -> AnyFloats:
    """Nothing in place of covariances [k, r, r] of the nodes from ``start`` on, which are there but
    for the first ``skip``."""
    cov: AnyFloats = told
    room.write(name, start + skip, cov[skip:].reshape(len(cov) - skip, -1))
    # a view would keep them all
    return cov[:0].copy()


def _bounds(nodes: Nodes, section_nodes: int) -> list[int]:
    """First nodes of the sections, and the last node of all; time passes after each."""
    last = len(nodes.t) - 1
    bounds = [0]
    while last - bounds[-1] > section_nodes:
        cut = bounds[-1] + section_nodes
        while cut < last and nodes.t[cut + 1] <= nodes.t[cut]:
            cut += 1
        bounds.append(cut)
    if bounds[-1] < last or len(bounds) == 1:
        bounds.append(last)
    return bounds


def _filter_section(
    problem: Problem,
    nodes: Nodes,
    a: int,
    b: int,
    state: FilterState,
    linearised_at: PathStates | None,
) -> ForwardRun:
    """Filter from node ``a``, whose own measurements ``state`` already has (but for the first
    of all), to node ``b``."""
    part = nodes.between(a, b + 1)
    if a > 0:
        flags = part.flags.copy()
        flags[0] = 0
        part = replace(part, flags=flags)
    store = empty_store(part, problem.model.size)
    path = None if linearised_at is None else _of_nodes(linearised_at, a, b)
    return ForwardRun(part, store, filter_into(store, problem, part, state, path))


def _state_after(problem: Problem, run: ForwardRun) -> FilterState:
    store = run.store
    nominal, params = store.nominal[-1:].copy(), store.params[-1:].copy()
    kernels.apply_correction(nominal, params, store.mean[-1:])
    cov = full_covariance(store.cov[-1:], problem.model.size)[0]
    return FilterState(nominal[0], params[0], cov)


def _light(problem: Problem, run: ForwardRun, with_cov: bool) -> ForwardRun:
    """The run without what only the smoother needs: states have their corrections, and variances
    seven digits."""
    n = problem.model.size
    nominal, params, _ = filtered_states(problem, run)
    store = run.store._replace(
        nominal=nominal,
        params=params,
        mean=np.zeros((0, n)),
        trans=np.zeros((0, 9, n)),
        cov=np.zeros((0, n * (n + 1) // 2)),
        h=np.zeros((0, n)),
        gain=np.zeros((0, n)),
    )
    variances = filtered_variances(problem, run).astype(np.float32)
    cov = np.asarray(reported_cov(problem, run)[: None if with_cov else 0]).astype(np.float32)
    return ForwardRun(run.nodes, store, run.score, cov, variances)


def _join_forward(nodes: Nodes, parts: list[ForwardRun]) -> ForwardRun:
    """One run of its sections; a section's first node is the last of the one before."""
    node, scalar = 0, 0
    for part in parts:
        # in place: nobody else has them
        part.store.info[:, 0] += node
        part.store.scalars[:] += scalar
        node += len(part.nodes.t) - 1
        scalar += len(part.store.info)
    score = sum(part.score for part in parts)
    columns = [
        part.store._asdict() | {"of_cov": part.cov, "of_params": part.param_var} for part in parts
    ]
    parts.clear()
    of_nodes = ("nominal", "params", "scalars", "nis", "of_cov", "of_params")
    done = {name: _joined(columns, name, shared=True) for name in of_nodes}
    # nothing is left to correct; pages that nobody writes to take no room
    done["mean"] = np.zeros((len(nodes.t), _joined(columns, "mean", shared=False).shape[1]))
    done |= {name: _joined(columns, name, shared=False) for name in columns[0].copy()}
    cov, variance = done.pop("of_cov"), done.pop("of_params")
    return ForwardRun(nodes, ForwardStore(**done), score, cov, variance)


def _join_smooth(nodes: Nodes, parts: list[SmoothRun]) -> SmoothRun:
    names = ("nominal", "params", "cov", "param_var")
    columns = [{name: getattr(part, name) for name in names} for part in parts]
    parts.clear()
    done = {name: _joined(columns, name, shared=True) for name in names}
    return SmoothRun(nodes=nodes, **done)


def _joined(columns: list[dict[str, Any]], name: str, shared: bool) -> np.ndarray:
    """One column of all sections, which are without it then: two of everything would not fit. The
    first row of a section is ``shared`` with the one before."""
    parts = [column.pop(name) for column in columns]
    return np.concatenate([part[min(i, 1) :] if shared else part for i, part in enumerate(parts)])
