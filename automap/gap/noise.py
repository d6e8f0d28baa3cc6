"""A set of effects fitted to drives as states of the filter, with the noise that suits it.

A wrong variance hides effects, or shows some that are not there; so all levels are fitted
together by maximum likelihood, before anything is named and again with every set.
The search climbs along the likelihood's exact slopes (``fusion.level_climb``).
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from automap.fusion.adapt import scale_nodes, scale_problem
from automap.fusion.kernel_runs import SmoothRun, run_forward
from automap.fusion.level_climb import GAIN, Maximum, climb
from automap.fusion.level_likelihood import LevelLikelihood, Room, level_likelihood, room_for
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.limits import TIME_FACTORS
from automap.fusion.nodes import Nodes
from automap.fusion.passes import Pass
from automap.fusion.problem import Problem
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, GapModel, fit_drive, parameter_names, prior_sd
from automap.gap.joint import Joint, combine
from automap.gap.limits import LEAST_RESTS, LEVEL_RANGE, MAX_NODES, REST_S
from automap.gap.rest import squared_steps, surely
from automap.records import FloatArray

Log = Callable[[str], None]
INERTIAL_LEVELS = ("accel", "gyro")
TAU_STEP = 2.0**0.5
SETTLED_NATS, CLIMBS = 1.0, 3
"""A path that moves the likelihood by less has settled: what tells rivals apart is three nats. So
many climbs at most; bounds the time."""
SHARES = 0.25, 0.5, 0.75
"""Of the way from one set of levels to another where a valley is looked for."""

_LIMITS = {
    **TIME_FACTORS,
    # no vehicle keeps to its path so well, but a simulated one does
    "nhc_y": (0.2, 64.0),
    "nhc_z": (1.0, 64.0),
}
_BY_SLOPE = tuple(level for level in ALL_LEVELS if level not in TIME_FACTORS)


@dataclass(frozen=True)
class Fitted:
    """A set of effects fitted: ``estimate`` effect -> factor on its prior sds, ``fits`` of all
    drives with these as states, under ``model`` with the noise that suits them; ``curvature`` of
    the likelihood along all levels, its inverse, as far as it was climbed."""

    model: GapModel
    estimate: Mapping[str, float]
    fits: tuple[Fit, ...]
    curvature: FloatArray | None = None

    def joint(self) -> Joint:
        """The drives' estimates as one."""
        sds = [
            scale * prior_sd(self.model.options, effect, parameter)
            for effect, scale in self.estimate.items()
            for parameter in parameter_names(effect)
        ]
        return combine(self.fits, [0.0] * len(self.fits), np.array(sds))

    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> estimated value."""
        joint = self.joint()
        return {e: {p: v for p, (v, _) in joint.of(e).items()} for e in self.estimate}


def open_fits(drives: Sequence[OpenDrive], model: GapModel, log: Log) -> Fitted:
    """The base model fitted, its noise first."""
    log("fitting the base model")
    fits = tuple(fit_drive(d, model) for d in drives)
    log("fitting the noise")
    return with_noise(Fitted(model, {}, fits), model.factors)


def with_noise(fitted: Fitted, stated: Mapping[str, float]) -> Fitted:
    """The set with the noise levels that make the drives likeliest.

    The likelihood has a top where the sensors are noisy and one where the receiver is; so it is
    climbed from the levels that the set has, or those of the sensors moved first, and where a
    valley lies before those stated, or those of the receiver moved first, from there too.
    """
    fits = fitted.fits
    others = tuple(k for k in ALL_LEVELS if k not in INERTIAL_LEVELS)
    first, second = dict(fitted.model.factors), dict(stated)
    if not fitted.estimate:
        starts = [fit_noise(fits, levels, initial=stated) for levels in (INERTIAL_LEVELS, others)]
        first, second = starts
    best = _likeliest(fits, ALL_LEVELS, first, fitted.curvature)
    if _valley_before(fits, second, best):
        other = _likeliest(fits, ALL_LEVELS, second, fitted.curvature)
        best = max(best, other, key=lambda top: top.score)
    return _settled(replace(fitted, curvature=best.inverse), best)


def _settled(fitted: Fitted, top: Maximum, levels: Collection[str] = ALL_LEVELS) -> Fitted:
    """The set under the levels at the top of a climb, and about its own path then. A likelihood is
    climbed about a path; where the levels' own path has another, it is climbed once more."""
    for left in reversed(range(CLIMBS)):
        model = replace(fitted.model, factors=top.factors)
        settled = fitted_about(model, fitted.estimate, fitted.fits)
        fitted = replace(settled, curvature=fitted.curvature)
        if not left or abs(noise_score(fitted.fits, top.factors) - top.score) < SETTLED_NATS:
            break
        top = _likeliest(fitted.fits, levels, top.factors, fitted.curvature)
    return fitted


def _valley_before(fits: Sequence[Fit], levels: Mapping[str, float], top: Maximum) -> bool:
    """Whether the likelihood is anywhere on the way from some levels to a top below what it would
    be were it to rise evenly: on one hill, in the levels' logarithms, it rises the less the
    further."""
    rooms = rooms_of(fits)
    begin = noise_score(fits, levels, rooms)
    for share in SHARES:
        between = {k: v ** (1.0 - share) * top.factors[k] ** share for k, v in levels.items()}
        if noise_score(fits, between, rooms) < begin + share * (top.score - begin):
            return True
    return False


def with_levels(fitted: Fitted, levels: Collection[str] = ALL_LEVELS) -> Fitted:
    """The set with some levels of noise moved to where they suit the drives best."""
    top = _likeliest(fitted.fits, levels, fitted.model.factors, fitted.curvature)
    return _settled(fitted, top, levels)


def fitted_about(model: GapModel, estimate: Mapping[str, float], about: Sequence[Fit]) -> Fitted:
    """The set ``estimate`` as states under a model, beginning about other fits of the drives."""
    fits = tuple(fit_drive(f.opened, model, estimate, linearised_at=f) for f in about)
    return Fitted(model, dict(estimate), fits)


def fit_noise(
    fits: Sequence[Fit],
    levels: Collection[str] = ALL_LEVELS,
    initial: Mapping[str, float] | None = None,
    curvature: FloatArray | None = None,
) -> dict[str, float]:
    """Factors on the noise levels that make the drives' innovations most likely.

    ``levels`` are those that may move. The climb begins at ``initial``, else at the fits' own
    factors; it is linearised about the fits' smoothed states. No sensor is taken for quieter on
    the road than it is at rest. ``curvature`` of all levels near there, its inverse.
    """
    return _likeliest(fits, levels, initial or fits[0].model.factors, curvature).factors


def _likeliest(
    fits: Sequence[Fit],
    levels: Collection[str],
    initial: Mapping[str, float],
    inverse: FloatArray | None = None,
) -> Maximum:
    """The top of the climb; ``inverse`` curvature of one on nearly the same hill, along all
    levels."""
    least = rest_factors(fits)

    def limits_of(level: str) -> tuple[float, float]:
        low, high = _limits(level)
        return min(max(low, least.get(level, 0.0)), high), high

    factors = {
        k: float(np.clip(v, *limits_of(k))) if k in levels else v for k, v in initial.items()
    }
    smooth = [level for level in _BY_SLOPE if level in levels]
    if inverse is not None and len(smooth) < len(inverse):
        at = [_BY_SLOPE.index(level) for level in smooth]
        inverse = np.asarray(np.linalg.inv(np.linalg.inv(inverse)[np.ix_(at, at)]))
    rooms = rooms_of(fits)
    for _ in range(2):
        top = climb(
            lambda trial: noise_slopes(fits, trial, rooms), factors, smooth, limits_of, inverse
        )
        inverse = top.inverse
        best, factors = top.score, top.factors
        # sizes and times of what lasts lie along a ridge: times in steps that pay, or none
        for level in (level for level in TIME_FACTORS if level in levels):
            best, factors = _time_constant(level, fits, rooms, best, factors)
        if best - top.score < GAIN:
            break
    return Maximum(best, factors, top.inverse)


def rest_factors(fits: Sequence[Fit]) -> dict[str, float]:
    """Factors on the white levels of the inertial sensors below which no drive can be: the noise
    of their means over ``REST_S`` where the vehicle stands (Allan deviation, IEEE Std 952).

    The smallest over the axes that is likely, since standing vehicles shake; nothing where the
    drives hardly stand.
    """
    found: dict[str, list[float]] = {"accel": [], "gyro": []}
    for fit in fits:
        imu = fit.opened.drive.imu
        t = (imu.t_ns - imu.t_ns[0]) * 1e-9
        for level, readings in (("accel", imu.accel), ("gyro", imu.gyro)):
            squares = [squared_steps(t, readings, span) for span in fit.opened.session.standstill]
            steps = np.concatenate(squares) if squares else np.zeros((0, 3))
            if len(steps) < LEAST_RESTS:
                continue
            density = np.sqrt(0.5 * steps.mean(axis=0) * REST_S)
            stated = getattr(fit.model.options, f"{level}_noise")
            found[level].append(float(density.min() / stated) * surely(len(steps)))
    return {level: min(values) for level, values in found.items() if values}


def rooms_of(fits: Sequence[Fit]) -> list[Room]:
    """What all levels of noise are asked with, claimed once: pages are dear, and the way from node
    to node is long."""
    same = dict.fromkeys(ALL_LEVELS, 1.0)
    return [room_for(*_scaled(f, same, _most_nodes(fits))) for f in fits]


def noise_score(
    fits: Sequence[Fit], factors: Mapping[str, float], rooms: Sequence[Room] = ()
) -> float:
    """Log-likelihood of fitted drives under other factors on the noise levels, nats."""
    relative = _relative(fits, factors)
    total = 0.0
    for fit, (_, legs) in zip(fits, rooms or rooms_of(fits), strict=True):
        problem, nodes, about = _scaled(fit, relative, _most_nodes(fits))
        run = run_forward(problem, nodes, fit.start, fit.last.shift, False, about, legs)
        total += run.score if np.isfinite(run.score) else -np.inf
    return total


def noise_slopes(
    fits: Sequence[Fit], factors: Mapping[str, float], rooms: Sequence[Room] = ()
) -> LevelLikelihood:
    """Log-likelihood of fitted drives under other factors, and its slopes along them."""
    relative = _relative(fits, factors)
    parts = []
    for fit, room in zip(fits, rooms or rooms_of(fits), strict=True):
        problem, nodes, about = _scaled(fit, relative, _most_nodes(fits))
        parts.append(level_likelihood(problem, nodes, fit.start, fit.last.shift, about, room))
    return reduce(operator.add, parts)


def _most_nodes(fits: Sequence[Fit]) -> int:
    """Of each drive."""
    return max(MAX_NODES // len(fits), 500)


def at_top(level: str, factor: float) -> bool:
    """Whether a level of noise rests at the upper end of where it is sought: how far beyond it is,
    nobody has asked."""
    return factor >= (1.0 - 1e-9) * _limits(level)[1]


def _limits(level: str) -> tuple[float, float]:
    return _LIMITS.get(level, (1.0 / LEVEL_RANGE, LEVEL_RANGE))


def _relative(fits: Sequence[Fit], factors: Mapping[str, float]) -> dict[str, float]:
    return {k: factors[k] / fits[0].model.factors[k] for k in ALL_LEVELS}


def _time_constant(
    level: str, fits: Sequence[Fit], rooms: Sequence[Room], best: float, factors: dict[str, float]
) -> tuple[float, dict[str, float]]:
    """Move a time constant up or down while that helps."""
    low, high = _limits(level)
    start = factors[level]
    for way in (TAU_STEP, 1.0 / TAU_STEP):
        while low <= factors[level] * way <= high:
            trial = factors | {level: factors[level] * way}
            value = noise_score(fits, trial, rooms)
            if not value > best + GAIN:
                break
            best, factors = value, trial
        if factors[level] != start:
            break
    return best, factors


def _scaled(fit: Fit, relative: Mapping[str, float], most: int) -> tuple[Problem, Nodes, SmoothRun]:
    last: Pass = fit.last
    nodes = scale_nodes(last.nodes.first(most), relative)
    smooth = last.smooth
    nominal, params = (np.ascontiguousarray(a[:most]) for a in (smooth.nominal, smooth.params))
    first = replace(smooth, nominal=nominal, params=params)
    return scale_problem(last.problem, relative), nodes, first
