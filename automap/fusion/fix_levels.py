"""How large the errors of fixes are, by what their positions and velocities say of each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from automap.fusion.adapt import COARSE
from automap.fusion.fix_axes import smooth_epochs, usable_epochs
from automap.fusion.options import FusionOptions
from automap.records import Fixes

_LASTS = ("wander", "multipath")
"""A path of fixes alone takes for one error what lasts of positions for seconds and minutes."""
_LEAST = 1.0, 1.0, 1.0 / COARSE.limit
"""Least factors on what lasts of positions, on their white part, on velocities."""
_LEVELS = (
    ((0, 1), (_LASTS, ("position_h",), ("velocity_h",))),
    ((2,), (("wander_v",), ("position_v",), ("velocity_v",))),
)
"""Axes and the levels that are moved together for them."""
_WORSE = 4.0
"""Where the other top of the likelihood is begun: the middle of what is tried, in logarithms."""


def fix_levels(fixes: Fixes, options: FusionOptions) -> dict[str, float]:
    """Factors on the sizes of the fixes' errors by level, by the likelihood of what positions and
    velocities say of each other.

    A receiver's own figures are not believed where the two contradict them. Positions are never
    made better than stated: nothing here tells what they err by together.
    """
    at = usable_epochs(fixes, options)
    factors: dict[str, float] = {}
    none = np.zeros((0, 4))
    for axes, levels in _LEVELS:

        def score(trial: Mapping[str, float], axes: tuple[int, ...] = axes) -> float:
            return sum(smooth_epochs(at, axis, options, trial, none) for axis in axes)

        tops = []
        # positions that err by more are one top of the likelihood, velocities that do another
        for begun in (1.0, _WORSE):
            trial = factors | {name: begun for names in levels[:2] for name in names}
            tops.append(_top(levels, trial, score))
        (first, plain), (second, worse) = tops
        factors = worse if second > first + COARSE.gain else plain
    return factors


Score = Callable[[Mapping[str, float]], float]


def _top(
    levels: Sequence[tuple[str, ...]], factors: dict[str, float], score: Score
) -> tuple[float, dict[str, float]]:
    """The likelihood's top that lies uphill of ``factors``, level by level."""
    best, before = score(factors), -np.inf
    while best - before >= COARSE.gain:
        before = best
        for names, least in zip(levels, _LEAST, strict=True):
            best, factors = _climbed(names, least, best, factors, score)
    return best, factors


def _climbed(
    names: tuple[str, ...],
    least: float,
    best: float,
    factors: dict[str, float],
    score: Score,
) -> tuple[float, dict[str, float]]:
    """The levels ``names`` moved together, by steps, while each brings its gain."""
    for step in (COARSE.factor, 1.0 / COARSE.factor):
        while True:
            value = factors.get(names[0], 1.0) * step
            if not least <= value <= COARSE.limit:
                break
            trial = factors | dict.fromkeys(names, value)
            found = score(trial)
            if not found > best + COARSE.gain:
                break
            best, factors = found, trial
    return best, factors
