"""Noise levels found finely on half of a drive, and judged on the other half."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from automap.fusion.adapt import (
    COARSE,
    FINE,
    adapt_noise,
    refine_noise,
    scale_nodes,
    scale_problem,
)
from automap.fusion.kernel_runs import PathStates, Start, run_forward
from automap.fusion.layout import BESIDE_FIXES
from automap.fusion.levels import LEVELS, RECEIVER_LEVELS
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem


@dataclass(frozen=True)
class Tuned:
    """Factors by level, what they gain on the half of the drive that they were not found on, nats,
    and whether they are the ones found there or those that the search began with."""

    factors: dict[str, float]
    gain: float
    better: bool


def tune_noise(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    linearised_at: PathStates,
    initial: Mapping[str, float],
    progress: Callable[[str], None] = lambda text: None,
    least: Mapping[str, float] = MappingProxyType({}),
    shaken: Mapping[str, float] = MappingProxyType({}),
) -> Tuned:
    """Find all levels, within the bounds of ``adapt_noise``, on the first half of ``nodes``; they
    stay ``initial`` where those explain the second half as well. ``problem`` and ``nodes`` are
    without factors."""
    half = nodes.first(max(len(nodes.t) // 2, 2))
    path = PathStates(linearised_at.nominal[: len(half.t)], linearised_at.params[: len(half.t)])
    found = adapt_noise(problem, half, start, shift, initial, FINE, progress, least, shaken)
    found = refine_noise(problem, half, start, shift, path, found, LEVELS, least, shaken)

    def unseen_half(factors: Mapping[str, float]) -> float:
        whole, first = (
            run_forward(
                scale_problem(problem, factors),
                scale_nodes(replace(part, flags=part.flags & ~BESIDE_FIXES), factors),
                start,
                shift,
                store=False,
                linearised_at=about,
            ).score
            for part, about in ((nodes, linearised_at), (half, path))
        )
        return whole - first

    gain = unseen_half(found) - unseen_half(initial)
    if not gain > COARSE.gain:
        return Tuned(dict(initial), gain, False)
    return Tuned(found, gain, True)


def shown_at_least(factors: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    """The larger factor of both for errors of the receiver that last: the less a drive seems to
    show of them, the less it is believed."""
    return {
        k: max(v, other[k]) if k in RECEIVER_LEVELS and k in other else v
        for k, v in factors.items()
    }
