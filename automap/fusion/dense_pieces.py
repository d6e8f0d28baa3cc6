"""States at every sample of a long drive, one stretch after another, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.aside import ROWS
from automap.fusion.delay_states import contained
from automap.fusion.kernel_runs import PathStates, SmoothRun, run_dense
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem
from automap.fusion.resample import states_at
from automap.records import BoolArray, FloatArray

PIECE_ROWS = ROWS
"""Samples of a stretch, 20 MB of states."""
MARGIN_S = 1.0
"""Round a stretch; the rates of change at a node are taken over a few hundredths of a second."""


@dataclass(frozen=True)
class Piece:
    """The samples ``rows`` of a stretch, the ``nodes`` that they lie between, and what a margin
    round them has: states ``dense`` [m, 10] at the samples ``around``; those not ``good`` [m],
    before the first and after the last node, have the nearest. ``rates`` [m, 6] are the corrected
    readings, where they are asked for."""

    rows: slice
    nodes: slice
    around: slice
    dense: FloatArray
    good: BoolArray
    rates: FloatArray


def dense_pieces(
    problem: Problem,
    nodes: Nodes,
    states: PathStates,
    blend: bool,
    margin_s: float,
    with_rates: bool = False,
) -> Iterator[Piece]:
    """The stretches of a drive, each with what lies within ``margin_s`` of its samples and nodes.

    The states are those of ``run_dense`` over the whole drive: integration begins anew at every
    node.
    """
    t, at = problem.t, nodes.t
    for lo in range(0, len(t), PIECE_ROWS):
        hi = min(lo + PIECE_ROWS, len(t))
        own = _span(at, t[lo] - margin_s, t[hi - 1] + margin_s)
        wide = _span(at, at[own.start] - margin_s, at[own.stop - 1] + margin_s)
        # one sample before the first node and two after the last, as between any two nodes
        first = max(min(lo, int(np.searchsorted(t, at[wide.start], "right")) - 2), 0)
        stop = max(hi, int(np.searchsorted(t, at[wide.stop - 1], "left")) + 3)
        around = slice(first, min(stop, len(t)))
        part = replace(problem, samples=problem.samples_at(around), stored=None)
        between = nodes.between(wide.start, wide.stop)
        at_nodes = states.nominal[wide], states.params[wide]
        dense, rates = run_dense(part, between, *at_nodes, blend, with_rates)
        good = np.asarray(np.isfinite(dense).all(axis=1))
        yield Piece(slice(lo, hi), own, around, _hold_ends(dense, good), good, rates)


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
    nominal = np.empty((len(nodes.t), smooth.nominal.shape[1]))
    begin = 0
    for piece in dense_pieces(problem, smooth.nodes, smooth, True, MARGIN_S):
        last = piece.rows.stop == len(problem.t)
        end = len(nodes.t) if last else int(np.searchsorted(nodes.t, problem.t[piece.rows.stop]))
        t, good = problem.t[piece.around], piece.good
        nominal[begin:end] = states_at(t[good], piece.dense[good], nodes.t[begin:end])
        begin = end
    return PathStates(nominal, params)


def _span(at: FloatArray, begin: float, end: float) -> slice:
    """The nodes from the last before ``begin`` to the first after ``end``."""
    first = int(np.searchsorted(at, begin, "left")) - 1
    return slice(max(first, 0), min(int(np.searchsorted(at, end, "right")) + 1, len(at)))


def _hold_ends(dense: FloatArray, good: BoolArray) -> FloatArray:
    """Fill rows that rounding left outside the nodes with the nearest good row."""
    if good.all() or not good.any():
        return dense
    index = np.flatnonzero(good)
    nearest = index[np.clip(np.searchsorted(index, np.arange(len(dense))), 0, len(index) - 1)]
    return np.where(good[:, None], dense, dense[nearest])
