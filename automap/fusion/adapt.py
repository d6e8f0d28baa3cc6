"""Noise levels by the likelihood of the innovations.

A sensor's data sheet says little about its noise in a car: vibration folds down, the mount
flexes. So the filter asks the drive itself. Each level is moved up or down by a factor while
that makes the measurements more likely; a level that does not matter stays where it is.
``adapt_noise`` does so coarsely for the white levels in every run; ``refine_noise`` climbs on along
exact slopes, also in how large the receiver's lasting errors are and how long those of velocities
last; when tuning in random walks and in how long positions err, too. The likelihood is that
of the innovations (F. C. Schweppe, IEEE Transactions on Information Theory 11, 1965).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.kernel_runs import PathStates, Start, run_forward
from automap.fusion.layout import BESIDE_FIXES, CH_NHC, CH_POS, CH_VEL, HAS_VEL_H, N_NAV
from automap.fusion.level_climb import climb
from automap.fusion.level_likelihood import LevelLikelihood, level_likelihood, room_for
from automap.fusion.levels import (
    ALL_LEVELS,
    LEVELS,
    RUN_LEVELS,
    VEHICLE_LEVELS,
    VELOCITY_TAU,
    VELOCITY_WANDER,
    WHITE_LEVELS,
)
from automap.fusion.limits import (
    ABSENT,
    LASTING_ODDS_NATS,
    LEVEL_SPREAD,
    REFINE_S,
    SHAKEN_SPREAD,
    STANDING_PART,
    TIME_FACTORS,
)
from automap.fusion.nodes import Nodes, Shift
from automap.fusion.problem import Problem, with_options


@dataclass(frozen=True)
class Search:
    """How finely to search: levels, step factor, largest total factor, seconds of driving
    that are used, sweeps, and the gain in nats that a step must bring. With ``measured_only``
    what the vehicle is assumed to do (standstill, no slip) has no say: that is kept loose on
    purpose, and its too small innovations would pull the sensors' levels down."""

    levels: Sequence[str]
    factor: float
    limit: float
    part_s: float
    sweeps: int
    gain: float
    measured_only: bool = False

    def bounds(
        self, level: str, least: Mapping[str, float], shaken: Mapping[str, float]
    ) -> tuple[float, float]:
        """Between which factors a level is looked for: not less than sensors are at rest, and of
        an accelerometer up to what its readings differ by from one to the next, to a step.

        A gyro that shakes so takes turns and delays with it (28 deg/s of white noise on a made
        motorcycle: a delay of 0.6 s that was not there), and stays at its end.
        """
        if level in TIME_FACTORS:
            return TIME_FACTORS[level]
        most = self.factor * shaken.get(level, 0.0) if level == "accel" else 0.0
        return max(1.0 / self.limit, least.get(level, 0.0)), max(self.limit, most)


COARSE = Search(WHITE_LEVELS, 2.0, 16.0, 180.0, 2, 3.0, True)
"""Of every run. Chosen: quick, and no step without odds of 20 to 1 (three nats)."""
CURVED = 0.1
"""Of a level's logarithm, to either side: over so much its slope is a straight line."""
_LASTING_WHITE = {"wander": "position_h", "wander_v": "position_v", "multipath": "position_h"}
"""What lasts of positions, and the white level beside it."""
FINE = Search(LEVELS, 2.0**0.5, 64.0, 1800.0, 6, 1.0, True)
"""On request. Chosen: half an hour of driving shows the slow levels too, at many times the cost."""


def adapt_noise(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    initial: Mapping[str, float],
    search: Search = COARSE,
    progress: Callable[[str], None] = lambda text: None,
    least: Mapping[str, float] = MappingProxyType({}),
    shaken: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, float]:
    """Factors on the levels that the first part of a drive asks for, from ``initial`` ones, none
    below ``least``, nor above the search's limit and what readings are ``shaken`` by.

    Returns a factor for every one of ``LEVELS``, unchanged where the likelihood does not care:
    white noise of accelerometer and gyro, white parts of position and velocity, horizontal and
    vertical, random walks of the biases, size and correlation time of the receiver's wander.
    """
    part = nodes.first_moving(search.part_s, STANDING_PART * search.part_s)
    if search.measured_only:
        part = replace(part, flags=part.flags & ~BESIDE_FIXES)
    factors = _raised(initial, least)

    def score(trial: dict[str, float]) -> float:
        scaled = scale_problem(problem, trial)
        value = run_forward(scaled, scale_nodes(part, trial), start, shift, store=False).score
        return value if np.isfinite(value) else -np.inf

    scores: dict[tuple[float, ...], float] = {}

    def cached(trial: dict[str, float]) -> float:
        key = tuple(trial[level] for level in LEVELS)
        if key not in scores:
            scores[key] = score(trial)
        return scores[key]

    best = cached(factors)
    for sweep in range(search.sweeps):
        before = best
        for level in search.levels:
            progress(f"noise levels, sweep {sweep + 1}: {level}")
            bounds = search.bounds(level, least, shaken)
            best, factors = _climb(level, best, factors, cached, search, bounds)
        if best - before < search.gain:
            break
    found = {k: _refined(k, v, factors, cached, search) for k, v in factors.items()}
    return _raised(found, least)


def _raised(factors: Mapping[str, float], least: Mapping[str, float]) -> dict[str, float]:
    return {level: max(value, least.get(level, 0.0)) for level, value in factors.items()}


def refine_noise(
    problem: Problem,
    nodes: Nodes,
    start: Start,
    shift: Shift,
    linearised_at: PathStates,
    initial: Mapping[str, float],
    levels: Sequence[str] = RUN_LEVELS,
    least: Mapping[str, float] = MappingProxyType({}),
    shaken: Mapping[str, float] = MappingProxyType({}),
) -> dict[str, float]:
    """Factors on the levels at the top of the likelihood about a smoothed path ``linearised_at``,
    within the bounds of ``adapt_noise``.

    ``adapt_noise`` looks about the filter's own path, which wants coarse steps and little
    data; here every step has exact slopes, and the whole drive counts, so the levels scatter
    less from drive to drive. ``problem`` and ``nodes`` without factors.
    """
    part = nodes.first_moving(REFINE_S, STANDING_PART * REFINE_S)
    part = replace(part, flags=part.flags & ~BESIDE_FIXES)
    path = PathStates(
        np.ascontiguousarray(linearised_at.nominal[: len(part.t)]),
        np.ascontiguousarray(linearised_at.params[: len(part.t)]),
    )

    # claimed once: pages are dear
    room = room_for(problem, part, path)

    def likelihood(trial: dict[str, float]) -> LevelLikelihood:
        scaled = scale_problem(problem, trial)
        measured = level_likelihood(scaled, scale_nodes(part, trial), start, shift, path, room)
        return measured + _expected(trial, levels, shaken.get("accel", 0.0))

    search = COARSE if tuple(levels) == RUN_LEVELS else FINE

    def bounds(level: str) -> tuple[float, float]:
        return search.bounds(level, least, shaken)

    tops = [
        climb(likelihood, _raised(start, least), tuple(levels), bounds)
        for start in _starts(initial)
    ]
    top = max(tops, key=lambda found: found.score)
    if VELOCITY_WANDER not in levels or not _below_white(part, problem, top.factors):
        return top.factors
    others = tuple(level for level in levels if level not in (VELOCITY_WANDER, VELOCITY_TAU))
    without = {VELOCITY_WANDER: ABSENT, VELOCITY_TAU: 1.0}
    absent = climb(likelihood, top.factors | without, others, bounds)
    some, none = (np.log(found.factors[VELOCITY_WANDER]) / LEVEL_SPREAD for found in (top, absent))
    # of the sizes that were possible only those up to this one are left, of times those near it
    gain = absent.score + 0.5 * none**2 - (top.score + 0.5 * some**2)
    gain -= math.log(0.5 * math.erfc(-some / math.sqrt(2.0)))
    gain -= math.log(_share_left(likelihood, top.factors, VELOCITY_TAU))
    return absent.factors if gain > LASTING_ODDS_NATS else top.factors


def _share_left(
    likelihood: Callable[[dict[str, float]], LevelLikelihood],
    factors: Mapping[str, float],
    level: str,
) -> float:
    """What is left of a level's spread beforehand at the top of the likelihood (Laplace's
    approximation: D. MacKay, Neural Computation 4, 1992)."""
    row = ALL_LEVELS.index(level)
    ends = [
        likelihood({**factors, level: factors[level] * math.exp(side)}).slope[row]
        for side in (-CURVED, CURVED)
    ]
    curvature = (ends[0] - ends[1]) / (2.0 * CURVED)
    return 1.0 / max(math.sqrt(max(curvature, 0.0)) * LEVEL_SPREAD, 1.0)


def _starts(initial: Mapping[str, float]) -> list[Mapping[str, float]]:
    """Where climbs begin: at ``initial`` factors; and, where the white part of positions is as
    small as was looked for, at ones with what lasts of them as small.

    Of a receiver that states 20 m and errs by one a climb is else at first without positions, and
    ends where noise of the accelerometer stands for the lasting error of velocities.
    """
    at_end = initial["position_h"] < (1.0 + 1e-9) / COARSE.limit
    lasting = {level: initial[white] for level, white in _LASTING_WHITE.items()}
    return [initial, {**initial, **lasting}] if at_end else [initial]


def _below_white(nodes: Nodes, problem: Problem, factors: Mapping[str, float]) -> bool:
    """Whether the lasting error of velocities is less than half of what they are white by."""
    has = (nodes.flags & HAS_VEL_H) > 0
    white = np.median(np.sqrt(nodes.var[has, CH_VEL])) if has.any() else 0.0
    lasting = problem.options.velocity_wander_sd * factors[VELOCITY_WANDER]
    return bool(0.0 < lasting < 0.5 * white * factors["velocity_h"])


def _expected(
    factors: Mapping[str, float], levels: Sequence[str], shaken: float
) -> LevelLikelihood:
    """What is known of the ``levels`` beforehand: where a short drive says nothing of one, its
    variance would else run away to nothing; and that of an accelerometer's is hardly less than its
    readings are ``shaken`` by."""
    slope, info = np.zeros(len(ALL_LEVELS)), np.zeros(len(ALL_LEVELS))
    rows = [ALL_LEVELS.index(level) for level in levels]
    off = np.log([factors[level] for level in levels]) / LEVEL_SPREAD
    slope[rows], info[rows] = -off / LEVEL_SPREAD, 1.0 / LEVEL_SPREAD**2
    score = -0.5 * float(off @ off)
    if "accel" in levels and shaken > factors["accel"]:
        below, row = math.log(shaken / factors["accel"]), ALL_LEVELS.index("accel")
        slope[row] += below / SHAKEN_SPREAD**2
        info[row] += 1.0 / SHAKEN_SPREAD**2
        score -= 0.5 * (below / SHAKEN_SPREAD) ** 2
    return LevelLikelihood(score, slope, info)


def _refined(
    level: str,
    value: float,
    factors: dict[str, float],
    score: Callable[[dict[str, float]], float],
    search: Search,
) -> float:
    """The factor at the top of the parabola through the level's score and its neighbours'."""
    if level not in search.levels:
        return value
    here = score(factors)
    down = here - score(factors | {level: value / search.factor})
    up = here - score(factors | {level: value * search.factor})
    # flat, or not a maximum at the end of the range: the level does not matter, or is at its end
    if not min(down, up) > -search.gain or down + up < 2.0 * search.gain:
        return value
    top = float(np.clip(0.5 * (down - up) / (down + up), -0.5, 0.5))
    return float(value * search.factor**top)


def _climb(
    level: str,
    best: float,
    factors: dict[str, float],
    score: Callable[[dict[str, float]], float],
    search: Search,
    bounds: tuple[float, float],
) -> tuple[float, dict[str, float]]:
    """Move one level as far as it pays, up or else down, within ``bounds``."""
    for step in (search.factor, 1.0 / search.factor):
        moved = False
        while bounds[0] <= factors[level] * step <= bounds[1]:
            trial = factors | {level: factors[level] * step}
            value = score(trial)
            if value < best + search.gain:
                break
            best, factors, moved = value, trial, True
        if moved:
            break
    return best, factors


def scale_problem(problem: Problem, factors: Mapping[str, float]) -> Problem:
    """The problem with scaled inertial noise, random walks and wander time."""
    options = replace(
        problem.options,
        accel_noise=problem.options.accel_noise * factors["accel"],
        gyro_noise=problem.options.gyro_noise * factors["gyro"],
    )
    model = problem.model
    walk, tau, prior_sd = model.walk.copy(), model.tau.copy(), model.prior_sd.copy()
    for row, term in zip(model.term_table[:, 3], model.terms, strict=True):
        if level := CATALOGUE[term.effect].walk_setting:
            walk[N_NAV + row] *= factors[level] ** 2
    for effect in model.places:
        markov, rows = CATALOGUE[effect].markov, model.rows(effect)
        if markov is None:
            continue
        if markov.time_level:
            tau[rows] *= factors.get(markov.time_level, 1.0)
        size = np.array([factors.get(level, 1.0) for level in markov.size_levels])
        walk[rows] *= size**2
        prior_sd[rows.start - N_NAV : rows.stop - N_NAV] *= size
    scaled = replace(model, walk=walk, tau=tau, prior_sd=prior_sd)
    return with_options(replace(problem, model=scaled), options)


def scale_nodes(nodes: Nodes, factors: Mapping[str, float]) -> Nodes:
    """Nodes with scaled errors of position, velocity and vehicle constraint."""
    var = nodes.var.copy()
    var[:, CH_POS : CH_POS + 2] *= factors["position_h"] ** 2
    var[:, CH_POS + 2] *= factors["position_v"] ** 2
    var[:, CH_VEL : CH_VEL + 2] *= factors["velocity_h"] ** 2
    var[:, CH_VEL + 2] *= factors["velocity_v"] ** 2
    for row, level in enumerate(VEHICLE_LEVELS):
        var[:, CH_NHC + row] *= factors.get(level, 1.0) ** 2
    return replace(nodes, var=var)
