"""What is random in a receiver's epochs: errors, held positions, kinds of solutions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects.gnss import (
    frozen,
    gauss_markov,
    noise_factor,
    outliers,
    short_error,
    slow_error,
    steps,
    velocity_wander,
    wander,
)
from automap.effects.measured import Values
from automap.records import BoolArray, FixType, FloatArray, IntArray
from automap.simulation.scenario import Gnss, Solution

FIX_TYPES = {
    "none": FixType.NONE,
    "3d": FixType.THREE_D,
    "dgnss": FixType.DGNSS,
    "float": FixType.FLOAT,
    "fixed": FixType.FIXED,
}


@dataclass(frozen=True)
class ReceiverErrors:
    """Errors of epochs NED [n, 3], m and m/s, and what the receiver says of them.

    ``position_of`` and ``velocity_of`` [n] are the epochs whose values each repeats, without a
    fix or frozen; ``fix_type`` [n]; ``sd_position``, ``sd_velocity`` [n, 3] as stated.
    """

    position: FloatArray
    velocity: FloatArray
    position_of: IntArray
    velocity_of: IntArray
    fix_type: IntArray
    sd_position: FloatArray
    sd_velocity: FloatArray


def draw_errors(
    t_s: FloatArray, step_s: float, setup: Gnss, values: Values, rng: np.random.Generator
) -> ReceiverErrors:
    """Errors of the epochs ``t_s`` [n], ``step_s`` apart.

    What a plain receiver has is drawn from ``rng``, every other effect from a stream of its own:
    one more leaves the others as they were.
    """
    n, streams = len(t_s), rng.spawn(7)
    solutions = list(setup.solutions.values()) or [_only(setup)]
    chosen = _sequence(n, step_s, setup, streams[2])
    position, sd = np.zeros((n, 3)), np.zeros((n, 3))
    for number, solution in enumerate(solutions):
        at = chosen == number
        sigma, tau = wander(np.asarray(solution.sigma_correlated_m), solution.correlation_s, values)
        white = np.asarray(solution.sigma_white_m)
        error = gauss_markov(n, sigma, step_s / tau, rng) + rng.standard_normal((n, 3)) * white
        position[at] = error[at]
        stated = solution.stated_sd_m
        sd[at] = np.hypot(sigma, white) if stated is None else stated
    factor = noise_factor(values)
    position = factor * position + outliers(n, values, streams[0])
    position += slow_error(n, step_s, values, streams[3]) + steps(t_s, values, streams[4])
    position += short_error(n, step_s, values, streams[6])
    velocity = rng.standard_normal((n, 3)) * setup.sigma_velocity * factor
    lasting, lasts_s = velocity_wander(values)
    if lasting > 0.0:
        velocity += gauss_markov(n, np.full(3, lasting), step_s / lasts_s, streams[1])
    kinds = np.array([FIX_TYPES[s.fix] for s in solutions], np.int64)[chosen]
    lost = kinds == FixType.NONE
    for begin, length in setup.dropouts:
        lost |= (t_s >= begin) & (t_s < begin + length)
    held = last_good(~lost)
    worse = 1.0 + 5.0 * (np.arange(n) - held)[:, None] * step_s
    return ReceiverErrors(
        position=position,
        velocity=velocity,
        position_of=last_good(~(lost | frozen(t_s, values, streams[5]))),
        velocity_of=held,
        fix_type=np.where(lost & (np.arange(n) > 0), FixType.NONE, kinds).astype(np.int64),
        sd_position=sd[held] * worse,
        sd_velocity=np.asarray(setup.stated_sd_velocity or setup.sigma_velocity) * worse,
    )


def _only(setup: Gnss) -> Solution:
    """The one solution of a receiver without others."""
    return Solution(
        sigma_correlated_m=setup.sigma_correlated_m,
        correlation_s=setup.correlation_s,
        sigma_white_m=setup.sigma_white_m,
        stated_sd_m=setup.stated_sd_m,
    )


def _sequence(n: int, step_s: float, setup: Gnss, rng: np.random.Generator) -> IntArray:
    """Which solution each epoch [n] has, the first at the begin."""
    out = np.zeros(n, np.int64)
    order = list(setup.solutions)
    now, done = 0, 0
    while order and done < n:
        solution = setup.solutions[order[now]]
        last = rng.exponential(solution.mean_s) / step_s if solution.then else n
        end = min(n, done + max(1, round(last)))
        out[done:end] = now
        done = end
        if solution.then:
            weights = np.array([solution.then.get(name, 0.0) for name in order])
            now = int(rng.choice(len(order), p=weights / weights.sum()))
    return out


def last_good(good: BoolArray) -> IntArray:
    """The last good epoch up to each [n]; the first counts as good."""
    return np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))
