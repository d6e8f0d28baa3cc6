"""The receiver's heights against the hills that the vehicle drives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY, UNKNOWN_HEIGHT_SD_M
from automap.gates import sigmas
from automap.records import Fixes, FloatArray, Trajectory
from automap.robust import cauchy_weight

_EVEN = 1e-12
"""Squares of hills over those of the way: a fifth of a millimetre in 200 m."""


def height_doubts(path: Trajectory, fixes: Fixes) -> Iterator[Reason]:
    """Whether the heights of ``fixes`` rise as the vehicle climbs, by its pitch on the ``path``.

    The slope of the heights' changes on the climbs is one for metres. The pitch of the body against
    the road is the same all the way, and is estimated with it. A height by the pressure inside a
    vehicle, which falls with the square of its speed, falls as well.
    """
    told = np.isfinite(fixes.gps_s + fixes.lat_rad + fixes.height_m)
    t = fixes.gps_s[told] - path.gps_s[0]
    order = np.argsort(t, kind="stable")
    height, t = fixes.height_m[told][order], t[order]
    keep = np.diff(t, prepend=-np.inf) > limits.SAME_FIX_S
    changes = _changes(path, t[keep], height[keep])
    if changes is None:
        return
    found = _slope(changes)
    if found is not None and _beyond(found[0] - 1.0, found[1], limits.SLOPE_OFF):
        yield _scaled(*found, height)
        return
    by_speed, sd = _fit(changes.square, changes.length, changes.height - changes.climb)
    if _beyond(by_speed, sd, limits.SQUAT):
        speed = float(np.percentile(np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]), 95.0))
        off = by_speed * speed**2
        yield Reason(
            "height_by_pressure",
            f"the receiver's heights are {off:+.0f} m at {speed:.0f} m/s beside where the vehicle "
            f"climbs (sigma {sd * speed**2:.1f} m), and right at rest: they are of a barometer in "
            "the vehicle, whose pressure changes with the speed; log the heights of its satellites",
            height_m=abs(off),
        )


def _beyond(off: float, sd: float, usual: float) -> bool:
    return abs(off) > usual + sigmas(DOUBT_PROBABILITY) * sd


def _scaled(slope: float, sd: float, height: FloatArray) -> Reason:
    unit = next(
        (
            text
            for factor, text in limits.HEIGHT_UNITS
            if abs(slope / factor - 1.0) < sigmas(DOUBT_PROBABILITY) * sd / factor
        ),
        "",
    )
    off = UNKNOWN_HEIGHT_SD_M
    if slope > 0.0:
        off = float(np.abs(height).max()) * abs(1.0 - 1.0 / slope)
    return Reason(
        "height_scale",
        f"the receiver's heights rise {slope:.2f} times as far as the vehicle climbs (sigma "
        f"{sd:.2f}){unit}: the heights of the path and of the signs are as wrong; check the unit "
        "of the heights in the receiver's log",
        height_m=off,
    )


@dataclass(frozen=True)
class _Changes:
    """From window to window of as much road [k]: of the receiver's ``height``, of what the vehicle
    has climbed and driven (``climb``, ``length``), m, and of its speed's ``square``, m^2/s^2."""

    height: FloatArray
    climb: FloatArray
    length: FloatArray
    square: FloatArray


def _changes(path: Trajectory, t: FloatArray, height: FloatArray) -> _Changes | None:
    """Changes beside the ``height`` [m] m at ``t`` [m] s from the path's first row; None where too
    few windows are driven."""
    at = path.gps_s - path.gps_s[0]
    step = np.diff(at, prepend=at[0])
    speed = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    way = np.cumsum(speed * step)
    climb = np.cumsum(speed * np.tan(path.rpy[:, 1]) * step)
    far = np.interp(t, at, way)
    # windows of as much road, end to end: heights of a receiver err for as long as it stands, too
    edges = np.arange(0.0, way[-1], limits.CLIMB_WAY_M)
    rows = np.searchsorted(far, edges)
    rows = np.unique(rows[(rows > 0) & (rows < len(t))])
    if len(rows) < limits.LEAST_CLIMBS:
        return None
    values = height, np.interp(t, at, climb), far, np.interp(t, at, speed**2)
    return _Changes(*(np.diff(np.interp(t[rows], t, v)) for v in values))


def _slope(changes: _Changes) -> tuple[float, float] | None:
    """How many times the climb the height changes, and its sigma; None on a road too level to
    say."""
    x, length = changes.climb, changes.length
    # beside what rises evenly, which the body's pitch does; less is the pseudo-inverse's rounding
    hills = x - length * float(x @ length) / float(length @ length)
    if float(hills @ hills) < _EVEN * float(length @ length):
        return None
    slope, sd = _fit(x, length, changes.height)
    return (slope, sd) if sd < limits.KNOWN_CLIMB_SD * max(abs(slope), 1.0) else None


def _fit(x: FloatArray, length: FloatArray, y: FloatArray) -> tuple[float, float]:
    """How many times ``x`` [k] ``y`` [k] is, beside what goes with ``length``, and its sigma."""
    from scipy.special import stdtrit

    design: FloatArray = np.asarray(np.column_stack([x, length]), np.float64)
    weight = np.ones(len(y))
    normal: FloatArray = np.eye(2)
    slope, rest = 0.0, y
    for _ in range(limits.SLOPE_ROUNDS):
        normal = np.asarray(np.linalg.pinv((design * weight[:, None]).T @ design), np.float64)
        found = normal @ ((design * weight[:, None]).T @ y)
        slope, rest = float(found[0]), y - design @ found
        weight = cauchy_weight((rest / (1.4826 * float(np.median(np.abs(rest))) + 1e-9)) ** 2)
    # no less than heights are told to: a level that never changes is no certainty
    variance = max(float(weight @ rest**2 / weight.sum()), limits.LEAST_HEIGHT_SD_M**2)
    # of few windows the scatter is little known (Student)
    wide = -float(stdtrit(len(y) - 2, 0.5 * DOUBT_PROBABILITY)) / sigmas(DOUBT_PROBABILITY)
    return slope, wide * float(np.sqrt(normal[0, 0] * variance))
