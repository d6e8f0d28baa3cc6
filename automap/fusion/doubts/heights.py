"""The receiver's heights against the hills that the vehicle drives."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY, UNKNOWN_HEIGHT_SD_M
from automap.gates import OUTSIDE_95, exceeds_ratio, sigmas
from automap.geoid import (
    GEOID_OFF_M,
    GEOID_SD_M,
    MOST_GEOID_M,
    WRONG_GEOID_M,
    maybe_above_sea,
    separations,
    sign_turned,
)
from automap.records import Fixes, FloatArray, Trajectory
from automap.robust import cauchy_weight

_EVEN = 1e-12
"""Squares of hills over those of the way: a fifth of a millimetre in 200 m."""


def height_doubts(path: Trajectory, fixes: Fixes, lifts: float = 0.0) -> Iterator[Reason]:
    """Whether the heights of ``fixes`` rise as the vehicle climbs, by its pitch on the ``path``.

    ``lifts`` rad/(m/s^2) is by how much the nose is known to rise as the vehicle gathers speed.
    The slope of the heights' changes on the climbs is one for metres. The pitch of the body against
    the road is the same all the way, and is estimated with it. A height by the pressure inside a
    vehicle, which falls with the square of its speed, falls as well.
    """
    told = np.isfinite(fixes.gps_s + fixes.lat_rad + fixes.height_m)
    t = fixes.gps_s[told] - path.gps_s[0]
    order = np.argsort(t, kind="stable")
    height, t = fixes.height_m[told][order], t[order]
    keep = np.diff(t, prepend=-np.inf) > limits.SAME_FIX_S
    changes = _changes(path, t[keep], height[keep], lifts)
    if changes is None:
        return
    found = _slope(changes)
    if found is not None and (_in_another_unit(found) or _known_otherwise(found)):
        yield _scaled(found, height)
        return
    by_speed = _fit(changes.square, changes.length, changes.height - changes.climb)
    chance = 1.0 if by_speed is None else by_speed.chance(0.0, limits.SQUAT)
    if by_speed is not None and chance < OUTSIDE_95:
        speed = float(np.percentile(np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1]), 95.0))
        off = by_speed.value * speed**2
        steady = chance > DOUBT_PROBABILITY
        yield Reason(
            "height_by_pressure",
            f"the receiver's heights are {off:+.0f} m at {speed:.0f} m/s beside where the vehicle "
            f"climbs (sigma {by_speed.sd * speed**2:.1f} m), and right at rest: "
            + (
                "that may be chance, and the stated uncertainty includes it"
                if steady
                else "they are of a barometer in the vehicle, whose pressure changes with the "
                "speed; log the heights of its satellites"
            ),
            height_m=abs(off),
            state="good" if steady else "doubtful",
        )


def separation_doubts(fixes: Fixes, known: Iterable[Reason] = ()) -> list[Reason]:
    """The reason that heights give whose separation of the geoid is none, or one that the geoid has
    not, unless their unit is ``known`` to be wrong."""
    told = separations(fixes)
    if told is None or any(reason.code == "height_scale" for reason in known):
        return []
    stated, there = told
    if maybe_above_sea(fixes, stated):
        return [
            Reason(
                "height_surface",
                "the log does not say whether its heights are above the ellipsoid or the sea, "
                f"which is {there:+.0f} m there: they are taken as above the ellipsoid, and the "
                "stated uncertainty includes that; log the separation of the geoid too",
                height_m=float(np.hypot(there, GEOID_SD_M)),
                state="good",
            )
        ]
    # a sign that is turned stops a drive, unless somebody knows better
    if stated == 0.0 or abs(stated - there) < WRONG_GEOID_M or sign_turned(stated, there):
        return []
    text = (
        f"the receiver's log has the geoid {stated:+.0f} m from the ellipsoid, and it is "
        f"{there:+.0f} m there"
    )
    feet = limits.HEIGHT_UNITS[0][0]
    unit, off = "another unit", UNKNOWN_HEIGHT_SD_M
    if abs(stated / feet - there) < GEOID_OFF_M:
        unit = "feet"
        off = float(np.nanmax(np.abs(fixes.height_m))) * (1.0 - 1.0 / feet)
    elif abs(stated) <= MOST_GEOID_M:
        return [
            Reason(
                "height_surface",
                f"{text}: the separation is another place's, and heights may be off by as much; "
                "let the receiver's own stand in the log",
                height_m=abs(stated - there),
            )
        ]
    return [
        Reason(
            "height_scale",
            f"{text}: its heights seem to be in {unit}, and those of the path and of the signs are "
            "as wrong; check the unit of the heights in it",
            height_m=off,
        )
    ]


@dataclass(frozen=True)
class _Found:
    """A slope with its sigma, of so many degrees of ``freedom``."""

    value: float
    sd: float
    freedom: int

    def chance(self, right: float, usual: float) -> float:
        """How likely chance makes it so far from the ``right`` one, which varies by what is
        ``usual`` (Student)."""
        beyond = max(abs(self.value - right) - usual, 0.0) / self.sd
        return exceeds_ratio(beyond**2, 1, self.freedom)

    def within(self, right: float) -> bool:
        """Whether chance may make it from the ``right`` one."""
        return self.chance(right, 0.0) > DOUBT_PROBABILITY

    def odds(self, other: float, right: float, usual: float) -> float:
        """How many times likelier an ``other`` one makes it than the ``right`` one does."""
        far = max(abs(self.value - right) - usual, 0.0) / self.sd
        near = (self.value - other) / self.sd
        ratio = (self.freedom + far**2) / (self.freedom + near**2)
        return float(ratio ** (0.5 * (self.freedom + 1.0)))


def _in_another_unit(found: _Found) -> bool:
    """Whether feet, or metres taken for feet, make the slope far likelier than metres."""
    odds = (found.odds(factor, 1.0, limits.SLOPE_OFF) for factor, _ in limits.HEIGHT_UNITS)
    return max(odds) > limits.UNIT_ODDS


def _known_otherwise(found: _Found) -> bool:
    """Whether the slope is known, and is not that of metres."""
    # of few windows the scatter is little known
    from scipy.special import stdtrit

    wide = -float(stdtrit(found.freedom, 0.5 * DOUBT_PROBABILITY)) / sigmas(DOUBT_PROBABILITY)
    if wide * found.sd > limits.KNOWN_CLIMB_SD * max(abs(found.value), 1.0):
        return False
    return found.chance(1.0, limits.SLOPE_OFF) < DOUBT_PROBABILITY


def _scaled(found: _Found, height: FloatArray) -> Reason:
    slope = found.value
    unit = next((text for factor, text in limits.HEIGHT_UNITS if found.within(factor)), "")
    off = UNKNOWN_HEIGHT_SD_M
    if slope > 0.0:
        off = float(np.abs(height).max()) * abs(1.0 - 1.0 / slope)
    return Reason(
        "height_scale",
        f"the receiver's heights rise {slope:.2f} times as far as the vehicle climbs (sigma "
        f"{found.sd:.2f}){unit}: the heights of the path and of the signs are as wrong; check the "
        "unit of the heights in the receiver's log",
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


def _changes(
    path: Trajectory, t: FloatArray, height: FloatArray, lifts: float = 0.0
) -> _Changes | None:
    """Changes beside the ``height`` [m] m at ``t`` [m] s from the path's first row; None where too
    few windows are driven."""
    at = path.gps_s - path.gps_s[0]
    step = np.diff(at, prepend=at[0])
    speed = np.hypot(path.vel_ned[:, 0], path.vel_ned[:, 1])
    way = np.cumsum(speed * step)
    # the acceleration's part of the pitch: int k a v dt = k v^2 / 2
    climb = np.cumsum(speed * np.tan(path.rpy[:, 1]) * step) - 0.5 * lifts * speed**2
    far = np.interp(t, at, way)
    # windows of as much road, end to end: heights of a receiver err for as long as it stands, too
    edges = np.arange(0.0, way[-1], limits.CLIMB_WAY_M)
    rows = np.searchsorted(far, edges)
    rows = np.unique(rows[(rows > 0) & (rows < len(t))])
    if len(rows) < limits.LEAST_CLIMBS:
        return None
    # a height that is held, as of dead reckoning, is in no unit
    told = np.diff(np.cumsum(np.diff(height, prepend=height[:1]) != 0.0)[rows]) > 0
    if np.count_nonzero(told) < limits.LEAST_CLIMBS - 1:
        return None
    values = height, np.interp(t, at, climb), far, np.interp(t, at, speed**2)
    return _Changes(*(np.diff(v[rows])[told] for v in values))


def _slope(changes: _Changes) -> _Found | None:
    """How many times the climb the height changes; None on a road without any hill."""
    return _fit(changes.climb, changes.length, changes.height)


def _fit(x: FloatArray, length: FloatArray, y: FloatArray) -> _Found | None:
    """How many times ``x`` [k] ``y`` [k] is, beside what goes with ``length``; None where ``x``
    goes with it."""
    # less is the pseudo-inverse's rounding
    rest = x - length * float(x @ length) / float(length @ length)
    if float(rest @ rest) < _EVEN * float(length @ length):
        return None
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
    return _Found(slope, float(np.sqrt(normal[0, 0] * variance)), len(y) - 2)
