"""Noise levels by the likelihood of the innovations, by factors of two.

A sensor's data sheet says little about its noise in a car: vibration folds down, the mount
flexes. So the filter asks the drive itself. Each level is moved up or down while that makes
the measurements more likely; a level that does not matter stays where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.fusion.layout import CH_POS, CH_VEL
from automap.fusion.measurements import Nodes, Shift
from automap.fusion.model import FusionOptions
from automap.fusion.problem import Problem, Start, run_forward, with_options

MAX_PART_S = 300.0
MIN_GAIN_NATS = 3.0
FACTOR = 2.0
MAX_STEPS = 4
LEVELS = ("accel", "gyro", "position_h", "position_v", "velocity_h", "velocity_v")


def adapt_noise(problem: Problem, nodes: Nodes, start: Start, shift: Shift) -> dict[str, float]:
    """Factors on the noise levels that the first five minutes of a drive ask for.

    Returns a factor for the accelerometer's and gyro's white noise and for the white parts of
    position and velocity, horizontal and vertical; 1.0 where the likelihood does not prefer
    another by three nats.
    """
    stop = int(np.searchsorted(nodes.t, nodes.t[0] + MAX_PART_S))
    part = nodes.first(max(stop, 2))
    factors = dict.fromkeys(LEVELS, 1.0)

    def score(trial: dict[str, float]) -> float:
        scaled = with_options(problem, scaled_options(problem, trial))
        value = run_forward(scaled, scale_nodes(part, trial), start, shift, store=False).score
        return value if np.isfinite(value) else -np.inf

    best = score(factors)
    for _ in range(2):
        before = best
        for level in LEVELS:
            for direction in (FACTOR, 1.0 / FACTOR):
                moved = False
                while abs(np.log(factors[level] * direction)) <= MAX_STEPS * np.log(FACTOR) + 1e-9:
                    trial = factors | {level: factors[level] * direction}
                    value = score(trial)
                    if value < best + MIN_GAIN_NATS:
                        break
                    best, factors, moved = value, trial, True
                if moved:
                    break
        if best - before < MIN_GAIN_NATS:
            break
    return factors


def scaled_options(problem: Problem, factors: dict[str, float]) -> FusionOptions:
    """The options with inertial noise scaled."""
    options = problem.options
    return replace(
        options,
        accel_noise=options.accel_noise * factors["accel"],
        gyro_noise=options.gyro_noise * factors["gyro"],
    )


def scale_nodes(nodes: Nodes, factors: dict[str, float]) -> Nodes:
    """Nodes with the white variances of position and velocity scaled."""
    var = nodes.var.copy()
    var[:, CH_POS : CH_POS + 2] *= factors["position_h"] ** 2
    var[:, CH_POS + 2] *= factors["position_v"] ** 2
    var[:, CH_VEL : CH_VEL + 2] *= factors["velocity_h"] ** 2
    var[:, CH_VEL + 2] *= factors["velocity_v"] ** 2
    return replace(nodes, var=var)
