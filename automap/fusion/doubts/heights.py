"""The receiver's heights against the hills that the vehicle drives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY
from automap.gates import sigmas
from automap.records import Fixes, FloatArray, Trajectory
from automap.robust import cauchy_weight

_EVEN = 1e-12
"""Squares of hills over those of the way: a fifth of a millimetre in 200 m."""


def height_doubts(path: Trajectory, fixes: Fixes) -> Iterator[Reason]:
    """Whether the heights of ``fixes`` rise as the vehicle climbs, by its pitch on the ``path``.

    The slope of the heights' changes on the climbs is one for metres. The pitch of the body against
    the road is the same all the way, and is estimated with it.
    """
    told = np.isfinite(fixes.gps_s + fixes.lat_rad + fixes.height_m)
    t = fixes.gps_s[told] - path.gps_s[0]
    order = np.argsort(t, kind="stable")
    height, t = fixes.height_m[told][order], t[order]
    keep = np.diff(t, prepend=-np.inf) > limits.SAME_FIX_S
    t, height = t[keep], height[keep]
    found = _slope(path, t, height)
    if found is None:
        return
    slope, sd = found
    if abs(slope - 1.0) <= limits.SLOPE_OFF + sigmas(DOUBT_PROBABILITY) * sd:
        return
    unit = next(
        (
            text
            for factor, text in limits.HEIGHT_UNITS
            if abs(slope / factor - 1.0) < sigmas(DOUBT_PROBABILITY) * sd / factor
        ),
        "",
    )
    yield Reason(
        "height_scale",
        f"the receiver's heights rise {slope:.2f} times as far as the vehicle climbs (sigma "
        f"{sd:.2f}){unit}: the heights of the path and of the signs are as wrong; check the unit "
        "of the heights in the receiver's log",
        height_m=float(np.abs(height).max()) * abs(1.0 - 1.0 / slope) if slope > 0.0 else np.inf,
    )


def _slope(path: Trajectory, t: FloatArray, height: FloatArray) -> tuple[float, float] | None:
    """How many times the climb the ``height`` [m] m at ``t`` [m] s from the path's first row
    changes, and its sigma; None on a road too level to say."""
    from scipy.special import stdtrit

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
    y, x, length = (
        np.diff(np.interp(t[rows], t, v)) for v in (height, np.interp(t, at, climb), far)
    )
    # beside what rises evenly, which the body's pitch does; less is the pseudo-inverse's rounding
    hills = x - length * float(x @ length) / float(length @ length)
    if float(hills @ hills) < _EVEN * float(length @ length):
        return None
    design = np.column_stack([x, length])
    weight = np.ones(len(y))
    normal, slope, rest = np.eye(2), 0.0, y
    for _ in range(limits.SLOPE_ROUNDS):
        normal = np.linalg.pinv((design * weight[:, None]).T @ design)
        found = normal @ ((design * weight[:, None]).T @ y)
        slope, rest = float(found[0]), y - design @ found
        weight = cauchy_weight((rest / (1.4826 * float(np.median(np.abs(rest))) + 1e-9)) ** 2)
    # no less than heights are told to: a level that never changes is no certainty
    variance = max(float(weight @ rest**2 / weight.sum()), limits.LEAST_HEIGHT_SD_M**2)
    # of few windows the scatter is little known (Student)
    wide = -float(stdtrit(len(y) - 2, 0.5 * DOUBT_PROBABILITY)) / sigmas(DOUBT_PROBABILITY)
    sd = wide * float(np.sqrt(normal[0, 0] * variance))
    return (slope, sd) if sd < limits.KNOWN_CLIMB_SD * max(abs(slope), 1.0) else None
