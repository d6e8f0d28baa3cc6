"""Noise that depends on what the vehicle does, on temperature or on time.

A level that is fitted for a whole drive is a mean of what shakes a sensor above some speed and
leaves it alone below. So the likelihood's slope along each level is cut where a condition holds:
where a level is one for all of the drive no cut matters (Breusch and Pagan, Econometrica 47 (1979),
1287-1294). What stands out is fitted with a level within the condition and one elsewhere.
A body that sways in bends looks like noise of the sensors in it: so how far the vehicle keeps to
its path may depend on a condition too, and what is said of a sensor must hold without that.
At rest, where all is quieter, levels stay as they are, and have no say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.fusion.adapt import scale_nodes
from automap.fusion.kernel_runs import legs_about, run_forward
from automap.fusion.kernels import Legs
from automap.fusion.level_climb import GAIN
from automap.fusion.level_likelihood import slopes_by_node
from automap.fusion.levels import ALL_LEVELS, VEHICLE_LEVELS, WHITE_LEVELS
from automap.fusion.nodes import Nodes
from automap.fusion.problem import Problem
from automap.gap import limits
from automap.gap.fit import Fit
from automap.gap.limits import REST_S
from automap.gap.motion import motion_of
from automap.gap.nodes import motion_signals
from automap.gap.noise import INERTIAL_LEVELS
from automap.gap.noise_levels import Levels
from automap.records import BoolArray, FloatArray

QUANTITIES = {
    "speed": ("speed", "at a speed", "{:.3g} m/s"),
    "turn": ("abs(rate_z)", "at a turn rate", "{:.2g} rad/s"),
    "acceleration": ("abs(acceleration)", "at a change of speed", "{:.2g} m/s^2"),
    "temperature": ("temperature", "at a temperature", "{:.3g} deg C"),
    "time": ("time", "at a time since the start", "{:.0f} s"),
}
"""What noise and values may go with: formulas, and words for each and its values."""
CALMED = ("rate_z", "acceleration")
TRIED = (*WHITE_LEVELS, *VEHICLE_LEVELS)
EACH, BOTH = ((1, 0), (0, -1), (-1, 0), (0, 1)), ((1, 1), (-1, -1))
"""Ways to move two levels."""
SLOPED = tuple(ALL_LEVELS.index(level) for level in TRIED)


@dataclass(frozen=True)
class Condition:
    """A quantity within a range."""

    quantity: str
    low: float
    high: float

    def __str__(self) -> str:
        _, words, value = QUANTITIES[self.quantity]
        if self.low == -math.inf:
            return f"{words} below {value.format(self.high)}"
        if self.high == math.inf:
            return f"{words} above {value.format(self.low)}"
        low = value.partition("}")[0] + "}"
        return f"{words} of {low.format(self.low)} to {value.format(self.high)}"


@dataclass(frozen=True)
class Ranged:
    """A level that is higher under a condition: ``inside`` and ``outside`` factors on the level
    that is one for all of the drive, ``nats`` by which the drives are likelier with the two, all
    that might have been tried paid for."""

    level: str
    condition: Condition
    inside: float
    outside: float
    nats: float


def conditional_noise(levels: Levels, held_out: Sequence[Fit]) -> Ranged | None:
    """The level of a sensor or receiver that is likeliest to depend on a condition, where a
    thousand to one speaks for it on fitted drives and twenty to one on those held out, of a sensor
    also where nothing is known of how the vehicle moves."""
    fits = levels.fits
    courses = [courses_of(fit) for fit in fits]
    conditions = _conditions(courses)
    price = math.log(len(conditions) * len(TRIED)) + limits.OCCAM_NATS
    best: Ranged | None = None
    for level, condition, most in _shortlist(fits, courses, conditions, price + limits.LEAST_ODDS):
        if best is not None and best.nats >= most:
            break
        one = _fitted(fits, courses, level, condition)
        best = one if best is None or one.nats > best.nats else best
    if best is None or best.nats - price < limits.LEAST_ODDS or best.level in VEHICLE_LEVELS:
        return None
    others = [courses_of(fit) for fit in held_out]
    one = replace(best, inside=1.0, outside=1.0)
    # another day may be noisier as a whole
    gain, least = (_climbed(held_out, others, each, BOTH).nats for each in (best, one))
    if gain - least < limits.CLOSE_NATS:
        return None
    if best.level in INERTIAL_LEVELS:
        free = levels.free.scaled()
        if _fitted(free, courses, best.level, best.condition).nats < limits.CLOSE_NATS:
            return None
    return replace(best, nats=best.nats - price)


Course = tuple[FloatArray, dict[str, FloatArray]]
"""Instants [n] of a drive, s, and the quantities [n] then."""


def courses_of(fit: Fit) -> Course:
    """What noise and values may go with along the drive of a fit."""
    from scipy.ndimage import uniform_filter1d

    motion = motion_of(fit.last)
    signals = motion_signals(fit, motion)
    # what a sensor's own noise adds is no turn
    width = max(round(REST_S / float(np.median(np.diff(motion.t)))), 1)
    calm = {name: uniform_filter1d(getattr(signals, name), width) for name in CALMED}
    signals = replace(signals, **calm)
    return motion.t, {q: parse_formula(of[0])(signals) for q, of in QUANTITIES.items()}


def _inside(course: Course, condition: Condition, t: FloatArray) -> BoolArray:
    values = np.interp(t, course[0], course[1][condition.quantity])
    return np.asarray((values >= condition.low) & (values < condition.high))


def _moves(course: Course, t: FloatArray) -> BoolArray:
    return np.asarray(np.interp(t, course[0], course[1]["speed"]) >= limits.STANDING_SPEED)


def _conditions(courses: Sequence[Course]) -> list[Condition]:
    """All ranges between two of the edges of each quantity."""
    out = []
    for quantity in QUANTITIES:
        every = np.concatenate([of[quantity][_moves((t, of), t)] for t, of in courses])
        if len(every) == 0:
            continue
        inner = np.unique(
            np.quantile(every, np.arange(1, limits.DRIFT_BLOCKS) / limits.DRIFT_BLOCKS)
        )
        if not float(every.min()) < float(inner[-1]):
            # it has but one value
            continue
        # other drives go beyond what these have
        edges = [-math.inf, *inner.tolist(), math.inf]
        pairs = combinations(range(len(edges)), 2)
        ranges = [(edges[i], edges[j]) for i, j in pairs if j - i < len(edges) - 1]
        out += [Condition(quantity, *ends) for ends in ranges]
    return out


def _shortlist(
    fits: Sequence[Fit], courses: Sequence[Course], conditions: Sequence[Condition], least: float
) -> list[tuple[str, Condition, float]]:
    """Of each level and quantity the range that cuts the slope most unevenly, the likeliest of
    those of ``least`` nats by it, with these: a level that is f times higher in n values has
    n (f^2 - 1)^2 / 4 by its slope, and by its likelihood n ((f^2 - 1) / 2 - log f), which is less.
    """
    slope = np.zeros((len(conditions), len(TRIED)))
    info = np.zeros_like(slope)
    whole = np.zeros((2, len(TRIED)))
    for fit, course in zip(fits, courses, strict=True):
        last = fit.last
        each = slopes_by_node(last.problem, last.nodes, fit.start, last.shift, last.smooth)
        moves = _moves(course, last.nodes.t)[:, None]
        s, i = (values[:, SLOPED] * moves for values in each)
        inside = np.array([_inside(course, c, last.nodes.t) for c in conditions], np.float64)
        slope += inside @ s
        info += inside @ i
        whole += s.sum(axis=0), i.sum(axis=0)
    share = info / np.maximum(whole[1], 1e-300)
    over = slope - share * whole[0]
    nats = np.where(over > 0.0, 0.5 * over**2 / np.maximum(info * (1.0 - share), 1e-300), 0.0)
    best: dict[tuple[str, str], tuple[float, Condition]] = {}
    for (c, v), value in np.ndenumerate(nats):
        key = TRIED[v], conditions[c].quantity
        if value > best.get(key, (0.0,))[0]:
            best[key] = float(value), conditions[c]
    likely = sorted(best.items(), key=lambda one: -one[1][0])[: limits.RIVALS]
    return [(level, c, nats) for (level, _), (nats, c) in likely if nats >= least]


def _fitted(
    fits: Sequence[Fit], courses: Sequence[Course], level: str, condition: Condition
) -> Ranged:
    """The two levels that make the drives likeliest, and the nats by which these say more than
    one."""
    one = _climbed(fits, courses, Ranged(level, condition, 1.0, 1.0, 0.0), BOTH)
    best = _climbed(fits, courses, one, EACH)
    return replace(best, nats=best.nats - one.nats)


def _climbed(
    fits: Sequence[Fit], courses: Sequence[Course], at: Ranged, ways: Sequence[tuple[int, int]]
) -> Ranged:
    """Levels moved in ``ways``, steps inside and outside, while the drives, of log-likelihood
    ``nats``, grow likelier."""
    legs = [legs_about(f.last.problem, f.last.nodes, f.last.smooth) for f in fits]
    at = replace(at, nats=_score(fits, courses, legs, at))
    for step in (2.0, 2.0**0.25):
        moved = True
        while moved:
            moved = False
            for inner, outer in ways:
                inside, outside = at.inside * step**inner, at.outside * step**outer
                if not 1.0 / limits.LEVEL_RANGE < outside <= inside < limits.LEVEL_RANGE:
                    continue
                trial = replace(at, inside=inside, outside=outside)
                value = _score(fits, courses, legs, trial)
                if value > at.nats + GAIN:
                    at, moved = replace(trial, nats=value), True
    return at


def _score(
    fits: Sequence[Fit], courses: Sequence[Course], legs: Sequence[Legs], at: Ranged
) -> float:
    """Log-likelihood of drives, nats."""
    total = 0.0
    for fit, course, its in zip(fits, courses, legs, strict=True):
        problem, nodes = _scaled(fit, course, at)
        last = fit.last
        run = run_forward(problem, nodes, fit.start, last.shift, False, last.smooth, its)
        total += run.score if np.isfinite(run.score) else -np.inf
    return total


def _scaled(fit: Fit, course: Course, at: Ranged) -> tuple[Problem, Nodes]:
    problem, nodes = fit.last.problem, fit.last.nodes
    if at.level not in INERTIAL_LEVELS:
        var = nodes.var
        factors = _factors(course, at, nodes.t)
        for factor in (at.inside, at.outside):
            levels = dict.fromkeys(ALL_LEVELS, 1.0) | {at.level: factor}
            here = scale_nodes(nodes, levels).var
            var = np.where((factors == factor)[:, None], here, var)
        return problem, replace(nodes, var=var)
    which = INERTIAL_LEVELS.index(at.level)
    psd = float(problem.arrays.noise[which])
    shocks = problem.samples.shocks.copy()
    shocks[:, which] += (_factors(course, at, problem.t) ** 2 - 1.0) * psd
    return replace(problem, samples=problem.samples._replace(shocks=shocks)), nodes


def _factors(course: Course, at: Ranged, t: FloatArray) -> FloatArray:
    """Factors on the level at instants [n]; at rest it stays as it is."""
    moving = np.where(_inside(course, at.condition, t), at.inside, at.outside)
    return np.where(_moves(course, t), moving, 1.0)
