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

GAIN = 0.1
"""The climb ends when a step brings less than so many nats. Lasting errors of seconds and of
minutes are hardly told apart: with 0.3 climbs ended anywhere between a third and all of the one."""
MAX_STEPS = 20
"""Bounds the time of a climb along a ridge."""
LARGEST_STEP = 0.5
"""Of a logarithm: further away a level's slope says little."""
TRIES, SHORTEST, LONGEST = 3, 0.02, 0.5
"""A step that leads down is tried again, so often in all, so much shorter as the parabola through
the slope and what was found says, within these shares."""
LEAST_INFO = 5.0
"""The variance of a process noise's slope is summed as if intervals knew nothing of one another:
too small, and its steps would be too long. What is known beforehand alone is half a unit; with 20
climbs stopped on flat ridges, with 2 they overshot (six recorded drives, three starts each)."""


@dataclass(frozen=True)
class _Place:
    """Where a climb stands: logarithms [p] of the factors, log-likelihood, slopes [p],
    their variances [p]."""

    x: FloatArray
    score: float
    slope: FloatArray
    info: FloatArray


@dataclass(frozen=True)
class Maximum:
    """Where a climb ended: score in nats, factors, the inverse curvature [p, p] along their
    logarithms as far as the steps have told it."""

    score: float
    factors: dict[str, float]
    inverse: FloatArray


def climb(
    likelihood: Callable[[dict[str, float]], LevelLikelihood],
    factors: Mapping[str, float],
    levels: Sequence[str],
    limits: Callable[[str], tuple[float, float]],
    inverse: FloatArray | None = None,
) -> Maximum:
    """Move ``levels`` together uphill as long as it pays.

    ``likelihood`` of factors by level; no factor leaves its level's ``limits``. ``inverse``
    curvature [p, p] of a climb on nearly the same hill: with it few steps are needed.
    """
    rows = [ALL_LEVELS.index(level) for level in levels]
    low, high = (np.log([limits(level)[i] for level in levels]) for i in (0, 1))

    def place(x: FloatArray) -> _Place:
        there = likelihood({**factors, **_by_name(levels, x)})
        return _Place(x, there.score, there.slope[rows], there.info[rows])

    here = place(np.log([factors[level] for level in levels]))
    fresh = inverse is None
    if inverse is None:
        inverse = _by_information(here)
    for _ in range(MAX_STEPS):
        # at a limit a level stays if it wants to go beyond
        free = ~((here.x <= low) & (here.slope < 0.0) | (here.x >= high) & (here.slope > 0.0))
        step = np.where(free, inverse @ np.where(free, here.slope, 0.0), 0.0)
        # each by itself: the long way of one level that is far off must not hold up the others
        step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        gained = 0.0
        # what a parabola promises; not worth a look if too little
        worth = 0.5 * float(step @ here.slope) >= 0.5 * GAIN
        for _ in range(TRIES if worth else 0):
            there = place(np.clip(here.x + step, low, high))
            if there.score > here.score:
                gained = there.score - here.score
                inverse = _updated(inverse, there.x - here.x, here.slope - there.slope)
                here = there
                break
            step = step * _share(float(step @ here.slope), there.score - here.score)
        if gained >= GAIN:
            fresh = False
        elif fresh:
            break
        else:
            # a poor step may be a poor curvature's fault, not the top
            inverse, fresh = _by_information(here), True
    return Maximum(here.score, {**factors, **_by_name(levels, here.x)}, inverse)


def _share(promised: float, gained: float) -> float:
    """Share of a step at which the parabola has its top that rises by ``promised`` a step at its
    beginning and has ``gained``, less than nothing, at its end."""
    if not np.isfinite(gained):
        return SHORTEST
    share = promised / max(2.0 * (promised - gained), 1e-300)
    return float(np.clip(share, SHORTEST, LONGEST))


def _by_information(place: _Place) -> FloatArray:
    """The inverse curvature [p, p] that the slopes' variances promise."""
    return np.diag(1.0 / np.maximum(place.info, LEAST_INFO))


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
