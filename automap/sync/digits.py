"""How coarsely positions and courses of a receiver were written. What was rounded is off by up to
half a step, by the same where it does not change: a course for as long as a road is straight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.records import Fixes, FixType
from automap.sync import limits

ROUNDED_SD = 1.0 / math.sqrt(12.0)
"""Of what was rounded, in steps."""


@dataclass(frozen=True)
class PlaceDigits:
    """Positions are written with ``decimals`` of ``unit``, which are steps of ``step_m`` m."""

    step_m: float
    decimals: int
    unit: str


def place_digits(fixes: Fixes) -> PlaceDigits | None:
    """The digits of positions that were cut to steps far above what a receiver errs by."""
    good = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.lat_rad)
    lat, lon = (np.unique(np.degrees(each[good])) for each in (fixes.lat_rad, fixes.lon_rad))
    if min(len(lat), len(lon)) < limits.FEW_STEPS:
        return None
    for unit, most, digits in (("a degree", 1.0, range(5)), ("a minute", 60.0, range(3))):
        for n in digits:
            steps = np.concatenate([lat, lon]) * most * 10.0**n
            if np.all(np.abs(steps - np.rint(steps)) < limits.ROUNDED):
                return PlaceDigits(math.radians(1.0 / (most * 10.0**n)) * MEAN_RADIUS, n, unit)
    return None


def rounded_m(fixes: Fixes) -> float:
    """What the digits of positions make them err by, m one sigma of a coordinate."""
    digits = place_digits(fixes)
    return 0.0 if digits is None else ROUNDED_SD * digits.step_m


def course_step(fixes: Fixes) -> float:
    """The step, rad, of courses that were cut to ones of which, at the speeds of the drive,
    velocities are more in error than by all else; 0 where they are finer."""
    velocity = fixes.vel_ned[np.isfinite(fixes.vel_ned[:, :2]).all(axis=1), :2]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    course = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))[speed > limits.SLOW_M_S]
    if len(course) < limits.LEAST_INTERVALS:
        return 0.0
    fast = float(np.quantile(speed, limits.FAST_QUANTILE))
    for step in limits.COURSE_STEPS_DEG:
        sectors = course / step
        off = np.abs(sectors - np.rint(sectors)) * step
        if off.max() > limits.COURSE_DIGIT_DEG:
            continue
        few = len(np.unique(np.rint(sectors))) < limits.LEAST_SECTORS
        coarse = ROUNDED_SD * math.radians(step) * fast > limits.VELOCITY_ERROR_SD
        return math.radians(step) if coarse and not few else 0.0
    return 0.0


def course_held(fixes: Fixes) -> bool:
    """Whether courses mostly stay the same, to the last digit, where positions turn, as the
    bearings of a map's roads do: no receiver measures that."""
    told = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.gps_s + fixes.lat_rad)
    told &= np.isfinite(fixes.vel_ned[:, :2]).all(axis=1)
    rows = np.flatnonzero(told)
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    t, velocity = fixes.gps_s[rows], fixes.vel_ned[rows]
    if len(t) < limits.LEAST_INTERVALS:
        return False
    step = max(1, round(limits.BEND_S / max(float(np.median(np.diff(t))), limits.TICK_S)))
    before, middle, after = slice(None, -2 * step), slice(step, -step), slice(2 * step, None)
    lat, lon = fixes.lat_rad[rows], np.unwrap(fixes.lon_rad[rows])
    place = MEAN_RADIUS * (lat + 1j * lon * np.cos(lat[0]))
    ways = place[middle] - place[before], place[after] - place[middle]
    way = np.minimum(np.abs(ways[0]), np.abs(ways[1]))
    turned = np.abs(np.angle(ways[1] * np.conj(ways[0])))
    bends = (turned > limits.HELD_TURN_RAD) & (way > limits.SLOW_M_S * limits.BEND_S)
    bends &= t[after] - t[before] < 3.0 * limits.BEND_S
    # a velocity that is held altogether is another fault's
    bends &= (velocity[after, :2] != velocity[before, :2]).any(axis=1)
    # neighbours share all but a step of their ways
    if np.count_nonzero(bends) < step * limits.FEW_STEPS:
        return False
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    held = np.abs(course[after] - course[before]) < math.radians(limits.COURSE_DIGIT_DEG)
    return bool(np.mean(held[bends]) > limits.HELD_SHARE)
