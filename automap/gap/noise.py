"""The noise block of a model by maximum likelihood, before anything is named.

A wrong variance hides effects, or shows some that are not there; so all levels are fitted
together to the innovations of a smoothed drive, and again after every effect that is named.
The search climbs along the likelihood's exact slopes (``noise_gradient``) by BFGS steps
(Nocedal and Wright, Numerical Optimization, 2006, chapter 6) in the logarithms of the levels.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.layout import CH_NHC, CH_POS, CH_VEL, MAX_SCALARS, N_NAV, WANDER
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.measurements import Nodes
from automap.fusion.passes import Pass
from automap.fusion.problem import Problem, SmoothRun, run_forward
from automap.gap.fit import Fit
from automap.gap.noise_gradient import level_slopes
from automap.records import FloatArray, IntArray

LIMIT = 256.0
GAIN = 0.3
"""The climb ends when a step, or a whole sweep, brings less than so many nats."""
MAX_STEPS = 14
LARGEST_STEP = 1.0
"""No level changes by more than a factor of e in a step."""
HALVINGS = 3
LEAST_INFO = 2.0
TAU_STEPS = (2.0, 2.0**0.5)
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
_CHANNELS = {
    "position_h": (CH_POS, CH_POS + 1),
    "position_v": (CH_POS + 2,),
    "velocity_h": (CH_VEL, CH_VEL + 1),
    "velocity_v": (CH_VEL + 2,),
    "nhc_y": (CH_NHC,),
    "nhc_z": (CH_NHC + 1,),
}
_BY_SLOPE = tuple(level for level in ALL_LEVELS if level != "wander_tau")


def fit_noise(
    fits: Sequence[Fit],
    levels: Collection[str] = ALL_LEVELS,
    initial: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Factors on the noise levels that make the drives' innovations most likely.

    ``levels`` are those that may move. The climb begins at ``initial``, else at the fits' own
    factors; it is linearised about the fits' smoothed states.
    """
    factors = dict(initial or fits[0].model.factors)
    factors = {k: float(np.clip(v, *_limits(k))) if k in levels else v for k, v in factors.items()}
    smooth = [level for level in _BY_SLOPE if level in levels]
    best = -np.inf
    for _ in range(2):
        before = best
        best, factors = _climb(fits, factors, smooth)
        if "wander_tau" not in levels:
            break
        best, factors = _time_constant(fits, best, factors)
        if best - before < GAIN:
            break
    return factors


def noise_score(fits: Sequence[Fit], factors: Mapping[str, float]) -> float:
    """Log-likelihood of fitted drives under other factors on the noise levels, nats."""
    most = max(MAX_NODES // len(fits), 500)
    return sum(_score(f, _relative(fits, factors), most) for f in fits)


def noise_slopes(
    fits: Sequence[Fit], factors: Mapping[str, float]
) -> tuple[float, FloatArray, FloatArray]:
    """Log-likelihood in nats, and by level in the order of ``ALL_LEVELS`` its slope along the
    factor's logarithm [l] and that slope's variance where the level is right [l].

    The slope along ``wander_tau`` is left at zero.
    """
    most = max(MAX_NODES // len(fits), 500)
    relative = _relative(fits, factors)
    slope, info = np.zeros(len(ALL_LEVELS)), np.zeros(len(ALL_LEVELS))
    total = 0.0
    for fit in fits:
        problem, nodes, about = _scaled(fit, relative, most)
        run = run_forward(problem, nodes, fit.start, fit.last.shift, about=about)
        if not np.isfinite(run.score):
            return -np.inf, slope, info
        total += run.score
        level_slopes(
            nodes.t,
            nodes.var,
            nodes.wander_keep,
            int(problem.model.offsets[WANDER]),
            problem.model.tau,
            problem.model.walk,
            problem.arrays.noise,
            _level_of_channel(),
            _level_of_state(problem),
            run.store,
            _surprise(problem),
            slope,
            info,
        )
    return total, slope, info


def _limits(level: str) -> tuple[float, float]:
    return _LIMITS.get(level, (1.0 / LIMIT, LIMIT))


def _relative(fits: Sequence[Fit], factors: Mapping[str, float]) -> dict[str, float]:
    return {k: factors[k] / fits[0].model.factors[k] for k in ALL_LEVELS}


def _level_of_channel() -> IntArray:
    out = np.full(MAX_SCALARS, -1, dtype=np.int64)
    for level, channels in _CHANNELS.items():
        out[list(channels)] = ALL_LEVELS.index(level)
    return out


def _level_of_state(problem: Problem) -> IntArray:
    model = problem.model
    out = np.full(model.size, -1, dtype=np.int64)
    for sensor in ("accel", "gyro"):
        for axis in "xyz":
            if f"{sensor}_bias_{axis}" in model.names:
                row = model.index(f"{sensor}_bias_{axis}")
                out[row] = ALL_LEVELS.index(f"{sensor}_bias_walk")
    offset = int(model.offsets[WANDER])
    if offset >= N_NAV:
        out[offset : offset + 3] = ALL_LEVELS.index("wander")
    return out


def _surprise(problem: Problem) -> FloatArray:
    """NIS of a channel's block beyond which it was trusted less."""
    gate = problem.arrays.gate
    out = np.full(MAX_SCALARS, gate[2])
    out[CH_NHC : CH_NHC + 2] = gate[1]
    return out


@dataclass(frozen=True)
class _Place:
    """Where a climb stands: logarithms [p] of the factors, log-likelihood, slopes [p],
    their variances [p]."""

    x: FloatArray
    score: float
    slope: FloatArray
    info: FloatArray


def _climb(
    fits: Sequence[Fit], factors: dict[str, float], levels: Sequence[str]
) -> tuple[float, dict[str, float]]:
    """Move ``levels`` together uphill as long as it pays."""
    rows = [ALL_LEVELS.index(level) for level in levels]
    low, high = (np.log([_limits(level)[i] for level in levels]) for i in (0, 1))

    def place(x: FloatArray) -> _Place:
        trial = factors | {k: float(np.exp(v)) for k, v in zip(levels, x, strict=True)}
        score, slope, info = noise_slopes(fits, trial)
        return _Place(x, score, slope[rows], info[rows])

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
    return here.score, factors | {k: float(np.exp(v)) for k, v in zip(levels, here.x, strict=True)}


def _updated(inverse: FloatArray, moved: FloatArray, fell: FloatArray) -> FloatArray:
    """The BFGS update of the inverse curvature [p, p] by a step and the fall of the slope."""
    curve = float(moved @ fell)
    if curve <= 1e-9 * float(np.linalg.norm(moved) * np.linalg.norm(fell) + 1e-300):
        return inverse
    rho = 1.0 / curve
    left = np.eye(len(moved)) - rho * np.outer(moved, fell)
    return np.asarray(left @ inverse @ left.T + rho * np.outer(moved, moved))


def _time_constant(
    fits: Sequence[Fit], best: float, factors: dict[str, float]
) -> tuple[float, dict[str, float]]:
    """Move the wander's time constant up or down by ever finer steps while that helps."""
    low, high = _limits("wander_tau")
    for step in TAU_STEPS:
        for way in (step, 1.0 / step):
            moved = False
            while low <= factors["wander_tau"] * way <= high:
                trial = factors | {"wander_tau": factors["wander_tau"] * way}
                value = noise_score(fits, trial)
                if not value > best + GAIN:
                    break
                best, factors, moved = value, trial, True
            if moved:
                break
    return best, factors


def _scaled(fit: Fit, relative: Mapping[str, float], most: int) -> tuple[Problem, Nodes, SmoothRun]:
    last: Pass = fit.last
    nodes = scale_nodes(last.nodes.first(most), relative)
    return scale_problem(last.problem, relative), nodes, _first(last.smooth, most)


def _score(fit: Fit, relative: Mapping[str, float], most: int) -> float:
    problem, nodes, about = _scaled(fit, relative, most)
    run = run_forward(problem, nodes, fit.start, fit.last.shift, store=False, about=about)
    return run.score if np.isfinite(run.score) else -np.inf


def _first(smooth: SmoothRun, most: int) -> SmoothRun:
    return replace(
        smooth,
        nominal=np.ascontiguousarray(smooth.nominal[:most]),
        params=np.ascontiguousarray(smooth.params[:most]),
    )
