"""Wheel speed against another speed of the same drive: step, delay, scale, what contradicts.

Nothing is taken for granted but that most of both is right: the delay is where speeds fit best,
robustly, and the scale what is left there. The filter estimates both anew; here they say where to
begin, what the wheels' noise is, and whether the numbers are a speed of this drive at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.fusion import wheel_limits
from automap.fusion.limits import (
    LEAST_JUDGED,
    MOVING_SPEED,
    OUTLIER_PROBABILITY,
    ROAD_ACCELERATION_PSD,
)
from automap.gates import sd_by_median, sigmas
from automap.records import BoolArray, FloatArray, IntArray
from automap.robust import huber_weight

UNITS = {
    "km/h": 3.6,
    "miles per hour": 2.2369363,
    "knots": 1.9438445,
    "feet per second": 3.2808399,
    "cm/s": 100.0,
    "mm/s": 1000.0,
    "hundredths of km/h": 360.0,
}
"""How many of a unit are one metre a second."""
OTHER = "other"
"""No unit that is known."""
ROUNDS = 8
"""Of reweighting; weights change by less than a percent after."""


@dataclass(frozen=True)
class Reference:
    """The speed to compare with: ``t`` [m] s, ``speed`` [m] m/s and its ``sd`` [m]."""

    t: FloatArray
    speed: FloatArray
    sd: FloatArray


@dataclass(frozen=True)
class WheelMatch:
    """How wheel speeds lie to a reference: ``late_s`` how much later the wheels' stamps are and
    ``scale`` how many of theirs are one of the reference's, with sd; ``rest`` m/s what is
    left, and ``spread`` m/s how much the speed changes; ``noise`` m/s what is left while it is
    steady, beyond the reference's own and the step; ``count`` how many instants were compared."""

    late_s: float
    late_sd_s: float
    scale: float
    scale_sd: float
    rest: float
    spread: float
    noise: float
    count: int

    @property
    def unit(self) -> str:
        """The unit that the scale speaks of where it is none of a wheel, "" for m/s."""
        if abs(np.log(self.scale)) < wheel_limits.WHEELS_SCALE:
            return ""
        near = {u: abs(np.log(self.scale / n)) for u, n in UNITS.items()}
        best = min(near, key=lambda u: near[u])
        return best if near[best] < wheel_limits.WHEELS_UNIT else OTHER


def step_of(speed: FloatArray) -> float:
    """The step in m/s that all speeds [n] are multiples of, 0 where they have none.

    Printed decimals round the multiples: the step that fits all is found from the small ones on.
    """
    values = np.unique(np.round(np.abs(speed), 3))
    values = values[values > 0.0]
    if len(values) < wheel_limits.STEP_VALUES:
        return 0.0
    gaps = np.diff(values)
    # neighbours a millimetre a second apart are one step that was rounded two ways
    gaps = gaps[gaps > wheel_limits.LEAST_STEP]
    if len(gaps) == 0:
        return 0.0
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    for reach in (10.0, 30.0, 100.0, 300.0):
        near = values[values < reach * step]
        count = np.rint(near / step)
        if (count > 0).any():
            step = float(near @ count / (count @ count))
    off = values - step * np.rint(values / step)
    return step if float(np.sqrt(np.mean(off**2))) < wheel_limits.STEP_MISFIT * step else 0.0


def runs(speed: FloatArray) -> tuple[IntArray, IntArray]:
    """First and last places of stretches of equal neighbours in [n] speeds."""
    cut = np.flatnonzero(np.diff(speed) != 0.0)
    return np.concatenate([[0], cut + 1]), np.concatenate([cut, [len(speed) - 1]])


def between(
    t: FloatArray, speed: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Speeds [n] at other instants ``at`` [n] between samples [m], the variance [n] of taking them
    from a straight line, and which lie near enough to samples.

    A speed whose acceleration is white wanders off the line by q T s (1 - s) in a gap of T s, of
    which s and 1 - s are before and after (a Brownian bridge).
    """
    i = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    gap = t[i] - t[i - 1]
    share = np.clip((at - t[i - 1]) / gap, 0.0, 1.0)
    var = ROAD_ACCELERATION_PSD[0] * gap * share * (1.0 - share)
    near = (at >= t[0]) & (at <= t[-1]) & (gap < wheel_limits.WHEELS_GAP_S)
    return speed[i - 1] + share * (speed[i] - speed[i - 1]), var, np.asarray(near)


def stuck(t: FloatArray, speed: FloatArray, reference: Reference) -> BoolArray:
    """Which wheel speeds [n] are those of a counter that hangs.

    A value that stays the same while the reference changes its speed, or that is nothing while
    the reference drives; and one that stays the same between changes no vehicle makes, as where
    both are lost in a tunnel.
    """
    out = np.zeros(len(t), dtype=bool)
    step = step_of(speed)
    wide = sigmas(OUTLIER_PROBABILITY)
    first, last = runs(speed)
    with np.errstate(divide="ignore", invalid="ignore"):
        jump = np.abs(np.diff(speed)) - step > wheel_limits.FASTEST_CHANGE * np.diff(t)
    for a, b in zip(first.tolist(), last.tolist(), strict=True):
        if t[b] - t[a] < wheel_limits.STUCK_S or b - a < 2:
            continue
        if (a > 0 and jump[a - 1]) or (b < len(t) - 1 and jump[b]):
            out[a : b + 1] = True
            continue
        # the stamps may be late by some tenths of a second, and the reference's too
        during = (reference.t > t[a] + wheel_limits.STUCK_EDGE_S) & (
            reference.t < t[b] - wheel_limits.STUCK_EDGE_S
        )
        if int(during.sum()) < 2:
            continue
        seen, sd = reference.speed[during], float(np.median(reference.sd[during]))
        if speed[a] == 0.0:
            out[a : b + 1] = np.median(seen) > MOVING_SPEED + wide * sd
        else:
            low, high = np.percentile(seen, [10.0, 90.0])
            out[a : b + 1] = high - low > wide * sd + 2.0 * step + wheel_limits.STUCK_CHANGE
    return out


def match_wheels(
    t: FloatArray, speed: FloatArray, reference: Reference, reach_s: float
) -> WheelMatch | None:
    """Delay, scale and noise of wheel speeds [n] at ``t`` [n] against a reference.

    Delays up to ``reach_s`` either way are looked through. None where too little is driven at the
    same time.
    """
    speed = np.abs(speed)
    every = max(len(reference.t) // wheel_limits.MATCH_POINTS, 1)
    at, v, sd = reference.t[::every], reference.speed[::every], reference.sd[::every]
    slope = np.gradient(v, at) if len(at) > 2 else np.zeros(len(at))
    best: tuple[float, float, float] | None = None
    coarse = np.arange(
        -reach_s, reach_s + 0.5 * wheel_limits.MATCH_STEP_S, wheel_limits.MATCH_STEP_S
    )
    costs = np.full(len(coarse), np.inf)
    for i, late in enumerate(coarse.tolist()):
        found = _fit(t, speed, at, v, sd, late)
        if found is not None:
            costs[i] = found[1]
            if best is None or found[1] < best[1]:
                best = (late, found[1], found[0])
    if best is None:
        return None
    i = int(np.argmin(costs))
    late = best[0]
    if 0 < i < len(costs) - 1 and np.isfinite(costs[i - 1 : i + 2]).all():
        down, up = costs[i - 1] - costs[i], costs[i + 1] - costs[i]
        if down + up > 0.0:
            late += 0.5 * wheel_limits.MATCH_STEP_S * (down - up) / (down + up)
    told, line, near = between(t, speed, at + late)
    use = near & (v > MOVING_SPEED)
    scale = best[2]
    rest = (told - scale * v)[use]
    size = max(sd_by_median(rest), 1e-3)
    weight = huber_weight((rest / size) ** 2)
    informed = float(weight @ (scale * slope[use]) ** 2)
    late_sd = wheel_limits.MATCH_CORRELATED * size / np.sqrt(informed) if informed > 0.0 else np.inf
    scale_sd = wheel_limits.MATCH_CORRELATED * size / np.sqrt(float(weight @ v[use] ** 2))
    steady = np.abs(slope[use]) < wheel_limits.STEADY_ACCELERATION
    noise = 0.0
    if int(steady.sum()) >= LEAST_JUDGED:
        step = step_of(speed)
        own = np.median((scale * sd[use][steady]) ** 2 + line[use][steady]) + step**2 / 12.0
        noise = float(np.sqrt(max(sd_by_median(rest[steady]) ** 2 - own, 0.0))) / scale
    spread = sd_by_median(v[use] - np.median(v[use]))
    return WheelMatch(
        float(late), float(late_sd), scale, scale_sd, size / scale, spread, noise, int(use.sum())
    )


def _fit(
    t: FloatArray, speed: FloatArray, at: FloatArray, v: FloatArray, sd: FloatArray, late: float
) -> tuple[float, float] | None:
    """Scale and mean robust size of what is left at one delay."""
    told, line, near = between(t, speed, at + late)
    use = near & (v > MOVING_SPEED)
    if int(use.sum()) < LEAST_JUDGED:
        return None
    told, v, sd = told[use], v[use], np.sqrt(sd[use] ** 2 + line[use])
    scale = float(np.median(told / v))
    for _ in range(ROUNDS):
        rest = told - scale * v
        size = max(sd_by_median(rest), 1e-3)
        weight = huber_weight((rest / size) ** 2) / sd**2
        scale = float(weight @ (told * v) / (weight @ v**2))
    if not scale > 0.0:
        return None
    return scale, float(np.mean(np.abs(told / scale - v)))
