"""Uphill along the exact slopes of a likelihood, in the logarithms of noise levels.

BFGS steps (Nocedal and Wright, Numerical Optimization, 2006, chapter 6) that begin with the
slopes' own variances for curvature.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.fusion.level_likelihood import LevelLikelihood
from automap.fusion.levels import ALL_LEVELS
from automap.records import FloatArray

GAIN = 0.3
"""The climb ends when a step brings less than so many nats."""
MAX_STEPS = 14
LARGEST_STEP = 1.0
"""No level changes by more than a factor of e in a step."""
HALVINGS = 3
LEAST_INFO = 2.0


@dataclass(frozen=True)
class _Place:
    """Where a climb stands: logarithms [p] of the factors, log-likelihood, slopes [p],
    their variances [p]."""

    x: FloatArray
    score: float
    slope: FloatArray
    info: FloatArray


def climb(
    likelihood: Callable[[dict[str, float]], LevelLikelihood],
    factors: Mapping[str, float],
    levels: Sequence[str],
    limits: Callable[[str], tuple[float, float]],
) -> tuple[float, dict[str, float]]:
    """Move ``levels`` together uphill as long as it pays; score in nats and factors there.

    ``likelihood`` of factors by level; no factor leaves its level's ``limits``.
    """
    rows = [ALL_LEVELS.index(level) for level in levels]
    low, high = (np.log([limits(level)[i] for level in levels]) for i in (0, 1))

    def place(x: FloatArray) -> _Place:
        there = likelihood({**factors, **_by_name(levels, x)})
        return _Place(x, there.score, there.slope[rows], there.info[rows])

    here = place(np.log([factors[level] for level in levels]))
    inverse = np.diag(1.0 / np.maximum(here.info, LEAST_INFO))
    for _ in range(MAX_STEPS):
        # at a limit a level stays if it wants to go beyond
        free = ~((here.x <= low) & (here.slope < 0.0) | (here.x >= high) & (here.slope > 0.0))
        step = np.where(free, inverse @ np.where(free, here.slope, 0.0), 0.0)
        step *= min(1.0, LARGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        there = None
        for _ in range(HALVINGS + 1):
            there = place(np.clip(here.x + step, low, high))
            if there.score > here.score:
                break
            step *= 0.35
        if there is None or not there.score > here.score:
            break
        inverse = _updated(inverse, there.x - here.x, here.slope - there.slope)
        gained, here = there.score - here.score, there
        if gained < GAIN:
            break
    return here.score, {**factors, **_by_name(levels, here.x)}


def _by_name(levels: Sequence[str], x: FloatArray) -> dict[str, float]:
    return {k: float(np.exp(v)) for k, v in zip(levels, x, strict=True)}


def _updated(inverse: FloatArray, moved: FloatArray, fell: FloatArray) -> FloatArray:
    """The BFGS update of the inverse curvature [p, p] by a step and the fall of the slope."""
    curve = float(moved @ fell)
    if curve <= 1e-9 * float(np.linalg.norm(moved) * np.linalg.norm(fell) + 1e-300):
        return inverse
    rho = 1.0 / curve
    left = np.eye(len(moved)) - rho * np.outer(moved, fell)
    return np.asarray(left @ inverse @ left.T + rho * np.outer(moved, moved))
