"""Log-likelihood of a drive and its slopes along the noise levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.kernel_runs import (
    PathStates,
    Start,
    empty_store,
    filter_into,
    first_state,
    legs_about,
)
from automap.fusion.kernels import ForwardStore, Legs
from automap.fusion.kernels.level_slopes import level_slopes
from automap.fusion.layout import CH_NHC, CH_POS, CH_VEL, MAX_SCALARS, N_NAV
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem
from automap.records import FloatArray, IntArray

_CHANNELS = {
    "position_h": (CH_POS, CH_POS + 1),
    "position_v": (CH_POS + 2,),
    "velocity_h": (CH_VEL, CH_VEL + 1),
    "velocity_v": (CH_VEL + 2,),
    "nhc_y": (CH_NHC,),
    "nhc_z": (CH_NHC + 1,),
}

LEFT_OUT = 0.0, 1.0
"""A block that surprised counts for the slopes between wholly and not at all. Where a level hardly
moves its NIS its factor jumps, and the exact slope holds for a hair's breadth of the level only:
climbs along it end early on recorded phones."""


Room = tuple[ForwardStore, Legs]
"""What a run leaves, which the next writes over, and the legs between the nodes, which no level of
noise changes."""


def room_for(problem: Problem, nodes: Nodes, path: PathStates) -> Room:
    """Room for the runs about a path under any levels of noise."""
    return empty_store(nodes, problem.model.size), legs_about(problem, nodes, path)


@dataclass(frozen=True)
class LevelLikelihood:
    """Log-likelihood in nats, and by level in the order of ``ALL_LEVELS`` its slope along the
    factor's logarithm [l] and that slope's variance where the level is right [l]."""

    score: float
    slope: FloatArray
    info: FloatArray

    def __add__(self, other: LevelLikelihood) -> LevelLikelihood:
        return LevelLikelihood(
            self.score + other.score, self.slope + other.slope, self.info + other.info
        )


def level_likelihood(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    linearised_at: PathStates,
    room: Room | None = None,
    left_out: tuple[float, float] = LEFT_OUT,
) -> LevelLikelihood:
    """Likelihood of the nodes' measurements and its slopes, linearised about ``linearised_at``;
    ``room`` of calls about the same states is used again. Slopes are exact where shares
    of surprising blocks that are ``left_out`` may be any."""
    at_once = np.zeros(len(nodes.t), dtype=np.int64)
    score, slope, info = _slopes(
        problem, nodes, start, shift, linearised_at, room, left_out, at_once
    )
    return LevelLikelihood(score, slope[0], info[0])


def slopes_by_node(
    problem: Problem, nodes: Nodes, start: Start, shift: Shift, linearised_at: PathStates
) -> tuple[FloatArray, FloatArray]:
    """The slopes [k, l] of the likelihood, and their variances [k, l], that each node and the
    interval before it have a part in."""
    each = np.arange(len(nodes.t))
    return _slopes(problem, nodes, start, shift, linearised_at, None, LEFT_OUT, each)[1:]


def _slopes(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    linearised_at: PathStates,
    room: Room | None,
    left_out: tuple[float, float],
    part: IntArray,
) -> tuple[float, FloatArray, FloatArray]:
    """Likelihood, and the slopes and variances [g, l] of the ``part`` [k] that nodes are of."""
    slope, info = np.zeros((2, int(part.max()) + 1, len(ALL_LEVELS)))
    store, legs = room or room_for(problem, nodes, linearised_at)
    state = first_state(problem, start, shift)
    score = filter_into(store, problem, nodes, state, linearised_at, legs)
    if not np.isfinite(score):
        return -np.inf, slope, info
    level_slopes(
        nodes.t,
        nodes.var,
        nodes.lasting_keep,
        problem.model.kept,
        problem.model.tau,
        problem.model.walk,
        problem.arrays.noise,
        _level_of_channel(),
        *_levels_of_states(problem),
        store,
        problem.arrays.gate[3],
        np.array(left_out),
        slope,
        info,
        part,
    )
    return score, slope, info


def _level_of_channel() -> IntArray:
    out = np.full(MAX_SCALARS, -1, dtype=np.int64)
    for level, channels in _CHANNELS.items():
        out[list(channels)] = ALL_LEVELS.index(level)
    return out


def _levels_of_states(problem: Problem) -> tuple[IntArray, IntArray]:
    """The level of each state's size, and of how long it lasts; -1 none."""
    model = problem.model
    size, time = (np.full(model.size, -1, dtype=np.int64) for _ in range(2))
    for row, term in zip(model.term_table[:, 3], model.terms, strict=True):
        if level := CATALOGUE[term.effect].walk_setting:
            size[N_NAV + row] = ALL_LEVELS.index(level)
    for effect in model.places:
        if markov := CATALOGUE[effect].markov:
            size[model.rows(effect)] = [ALL_LEVELS.index(level) for level in markov.size_levels]
            if markov.time_level:
                time[model.rows(effect)] = ALL_LEVELS.index(markov.time_level)
    return size, time
