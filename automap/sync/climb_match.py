"""A receiver's vertical velocity against the rate of its heights."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.records import BoolArray, FloatArray
from automap.robust import cauchy_loss, cauchy_weight
from automap.sync import limits
from automap.sync.path_match import Estimate
from automap.sync.receiver_path import ReceiverPath, plausible_sd, windows

FOOT_M = 0.3048
"""The international foot, by definition."""


@dataclass(frozen=True)
class Vertical:
    """``scale`` is how many times the rate of the heights is told as vertical velocity, None where
    the drive is too level to say; ``turned``: up is told as down, with ``turned_nats`` for it;
    ``stuck``: it is one number throughout, to the last digit, while the horizontal velocity
    changes: no receiver measures that, it fills a column. ``feet``: heights are told in feet
    where metres belong (3.28), or the other way round (0.305), else one; ``height_m`` the largest
    that is told, m."""

    scale: Estimate | None
    turned: bool
    turned_nats: float
    stuck: bool
    feet: float = 1.0
    height_m: float = 0.0


def match_climbs(path: ReceiverPath, use: BoolArray, worse: float) -> Vertical | None:
    """Compare heights and vertical velocities of the rows ``use`` [n]; None where one of the two
    is missing. ``worse`` as in ``parting.excess``."""
    use = use & np.isfinite(path.height) & np.isfinite(path.climb)
    over = windows(path, use, limits.CLIMB_WINDOW_S, use, apart=True)
    if len(over) < limits.LEAST_WINDOWS:
        return None
    t, climb = path.t[use], path.climb[use]
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (climb[1:] + climb[:-1]) * np.diff(t))])
    told = over.change(np.interp(path.t, t, sums))
    seen = over.change(path.height)
    way = np.abs(over.change(path.place))
    upwards = replace(path, velocity=path.climb.astype(complex))
    sd = worse * limits.VERTICAL_FACTOR * plausible_sd(upwards, over)
    scale = _scale(seen, told, sd)

    def nats(factor: float) -> float:
        one, other = (_apart(seen - s * told, way, sd) for s in (1.0, factor))
        return 0.5 * (one - other)

    turned = nats(-1.0)
    unit = max((1.0 / FOOT_M, FOOT_M), key=nats)
    return Vertical(
        scale=scale,
        turned=bool(turned > limits.CERTAIN_LEAD_NATS),
        turned_nats=turned,
        stuck=bool(np.ptp(climb) == 0.0 and np.any(np.diff(path.velocity[use]) != 0.0)),
        feet=unit if nats(unit) > limits.CERTAIN_LEAD_NATS else 1.0,
        height_m=float(np.abs(path.height[use]).max()),
    )


def _apart(rest: FloatArray, way: FloatArray, sd: FloatArray) -> float:
    """The loss of ``rest`` [m] m but for what goes with the ``way`` [m] m: a unit that leans in the
    vehicle and mixes its own inertial velocity in seems to climb or fall all the way."""
    leaning, _ = _times(rest, way, sd, 0.0)
    return float(cauchy_loss(((rest - leaning * way) / sd) ** 2).sum())


def _scale(seen: FloatArray, told: FloatArray, sd: FloatArray) -> Estimate | None:
    """How many times ``seen`` [m] is ``told`` [m]."""
    rate, power = _times(seen, told, sd)
    if abs(rate) * np.sqrt(power) * limits.KNOWN_SHARE < 1.0:
        return None
    return Estimate(1.0 / rate, 1.0 / (rate**2 * np.sqrt(power)))


def _times(y: FloatArray, x: FloatArray, sd: FloatArray, rate: float = 1.0) -> tuple[float, float]:
    """How many times ``y`` [m] is ``x`` [m], by reweighted least squares from ``rate`` on,
    and the inverse of its variance; zeros where ``x`` is nowhere."""
    power = 0.0
    for _ in range(limits.MATCH_ROUNDS):
        weight = cauchy_weight((y - rate * x) / sd) / sd**2
        power = float(weight @ x**2)
        if power <= 0.0:
            return 0.0, 0.0
        rate = float(weight @ (y * x)) / power
    return rate, power
