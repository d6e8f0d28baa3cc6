"""The noise block of a model by maximum likelihood, before anything is named.

A wrong variance hides effects, or shows some that are not there; so all levels are fitted
together to the innovations of a smoothed drive, and again after every effect that is named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.passes import Pass
from automap.fusion.problem import SmoothRun, run_forward
from automap.gap.fit import Fit

STEPS = (2.0, 2.0**0.5, 2.0**0.25)
LIMIT = 256.0
GAIN = 0.5
MAX_SWEEPS = 4
MAX_NODES = 4000
"""Noise is fitted on so many nodes at most, spread over the drives."""

_LIMITS = {
    "wander_tau": (0.02, 16.0),
    "accel_bias_walk": (0.01, 64.0),
    "gyro_bias_walk": (0.01, 64.0),
    # no vehicle keeps to its path so well, but a simulated one does
    "nhc_y": (0.2, 64.0),
    "nhc_z": (1.0, 64.0),
}


def fit_noise(
    fits: Sequence[Fit],
    levels: Sequence[str] = ALL_LEVELS,
    steps: Sequence[float] = STEPS,
    progress: Callable[[str], None] = lambda text: None,
) -> dict[str, float]:
    """Factors on the noise levels that make the drives' innovations most likely.

    Each level is moved up or down while that helps, by ever finer steps; the fits' own factors
    are where that begins, their smoothed states where it is linearised.
    """
    factors = dict(fits[0].model.factors)
    most = max(MAX_NODES // len(fits), 500)

    known: dict[tuple[float, ...], float] = {}

    def score(trial: Mapping[str, float]) -> float:
        key = tuple(round(float(np.log(trial[k])), 6) for k in ALL_LEVELS)
        if key not in known:
            relative = {k: trial[k] / fits[0].model.factors[k] for k in ALL_LEVELS}
            known[key] = sum(_score(f, relative, most) for f in fits)
        return known[key]

    best = score(factors)
    for step in steps:
        for _ in range(MAX_SWEEPS):
            before = best
            for level in levels:
                progress(level)
                best, factors = _climb(level, step, best, factors, score)
            if best - before < 2.0 * GAIN:
                break
    return factors


def noise_score(fits: Sequence[Fit], factors: Mapping[str, float]) -> float:
    """Log-likelihood of fitted drives under other factors on the noise levels, nats."""
    relative = {k: factors[k] / fits[0].model.factors[k] for k in ALL_LEVELS}
    most = max(MAX_NODES // len(fits), 500)
    return sum(_score(f, relative, most) for f in fits)


def _climb(
    level: str,
    step: float,
    best: float,
    factors: dict[str, float],
    score: Callable[[Mapping[str, float]], float],
) -> tuple[float, dict[str, float]]:
    low, high = _LIMITS.get(level, (1.0 / LIMIT, LIMIT))
    for way in (step, 1.0 / step):
        moved = False
        while low <= factors[level] * way <= high:
            trial = factors | {level: factors[level] * way}
            value = score(trial)
            if not value > best + GAIN:
                break
            best, factors, moved = value, trial, True
        if moved:
            break
    return best, factors


def _score(fit: Fit, relative: Mapping[str, float], most: int) -> float:
    last: Pass = fit.last
    nodes = last.nodes.first(most)
    about = _first(last.smooth, most)
    problem = scale_problem(last.problem, relative)
    run = run_forward(
        problem, scale_nodes(nodes, relative), fit.start, last.shift, store=False, about=about
    )
    return run.score if np.isfinite(run.score) else -np.inf


def _first(smooth: SmoothRun, most: int) -> SmoothRun:
    return replace(
        smooth,
        nominal=np.ascontiguousarray(smooth.nominal[:most]),
        params=np.ascontiguousarray(smooth.params[:most]),
    )
