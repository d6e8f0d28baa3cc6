"""What a user's effect may be a function of: the quantities of a drive, by name.

Forces and rates are in vehicle axes (forward, right, down). One vocabulary serves formulas in
TOML, functions in Python and the formulas that the gap finder reports.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import NamedTuple

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.effects.limits import (
    AROUND_S,
    BLEND_S,
    COURSE_SPEED,
    FORCE_S,
    LEAST_STEP_S,
    MOVING_SPEED,
    REFERENCE_C,
)
from automap.records import FloatArray


@dataclass(frozen=True)
class Signals:
    """Quantities [n] at instants of a drive.

    ``time`` s since its first IMU sample, ``speed`` m/s, ``heading`` rad (north 0, east pi/2),
    ``acceleration`` m/s^2 along the track, ``lateral_acceleration`` m/s^2 to the right,
    ``rate_x`` .. ``rate_z`` rad/s, ``force_x`` .. ``force_z`` m/s^2 (specific force), their changes
    ``angular_acceleration_x`` .. rad/s^2 and ``jerk_x`` .. m/s^3 without vibration,
    ``temperature`` deg C and ``temperature_rate`` K/s (constant where nobody measured it).
    """

    time: FloatArray
    speed: FloatArray
    heading: FloatArray
    acceleration: FloatArray
    lateral_acceleration: FloatArray
    rate_x: FloatArray
    rate_y: FloatArray
    rate_z: FloatArray
    force_x: FloatArray
    force_y: FloatArray
    force_z: FloatArray
    angular_acceleration_x: FloatArray
    angular_acceleration_y: FloatArray
    angular_acceleration_z: FloatArray
    jerk_x: FloatArray
    jerk_y: FloatArray
    jerk_z: FloatArray
    temperature: FloatArray
    temperature_rate: FloatArray

    @property
    def rate(self) -> FloatArray:
        """Size of the turn rate in rad/s."""
        return np.sqrt(self.rate_x**2 + self.rate_y**2 + self.rate_z**2)

    @property
    def force(self) -> FloatArray:
        """Size of the specific force in m/s^2."""
        return np.sqrt(self.force_x**2 + self.force_y**2 + self.force_z**2)

    @property
    def climb(self) -> FloatArray:
        """How fast it climbs, m/s: what the force forward is beyond the acceleration is the road's
        slope, and the body's."""
        slope = (self.force_x - self.acceleration) / STANDARD_GRAVITY
        return np.asarray(self.speed * slope)

    @property
    def travel_n(self) -> FloatArray:
        """North part of the direction of travel, nothing at rest."""
        return np.asarray(self._travel[0])

    @property
    def travel_e(self) -> FloatArray:
        """East part of the direction of travel, nothing at rest."""
        return np.asarray(self._travel[1])

    @cached_property
    def _travel(self) -> FloatArray:
        """Both [2, n]: every problem of a drive asks for them."""
        return _travel(self.speed, self.heading)

    def at(self, time: FloatArray) -> Signals:
        """The quantities at other instants, in s since the first sample, linear in between."""
        return Signals(*(np.interp(time, self.time, getattr(self, n)) for n in FIELDS))


FIELDS = tuple(f.name for f in fields(Signals))
VOCABULARY = (*FIELDS, "rate", "force", "climb")


def signals_of(
    time: FloatArray,
    vel_ned: FloatArray,
    heading: FloatArray,
    acceleration: FloatArray,
    rate: FloatArray,
    force: FloatArray,
    temp_c: FloatArray | None,
) -> Signals:
    """Quantities of a known motion: ``time`` and ``heading`` [n], the others [n, 3] or [n]."""
    speed = np.linalg.norm(vel_ned, axis=1)
    warm = _temperature(temp_c, len(time))
    side = speed * rate[:, 2]
    change = _change(rate, time), _change(force, time)
    calm = CalmReadings(rate, force, *change)
    return _signals(time, speed, heading, acceleration, side, calm, warm)


class CalmReadings(NamedTuple):
    """Turn rates in rad/s, specific forces in m/s^2 and their changes a second [n, 3], without
    vibration."""

    rate: FloatArray
    force: FloatArray
    turning: FloatArray
    jerk: FloatArray


def calm_readings(time: FloatArray, gyro: FloatArray, accel: FloatArray) -> CalmReadings:
    """Readings [n, 3] at instants [n] in s without vibration, with their changes."""
    from scipy.ndimage import gaussian_filter1d

    step = max(float(np.median(np.diff(time))), LEAST_STEP_S)
    rate, force = (gaussian_filter1d(each, FORCE_S / step, axis=0) for each in (gyro, accel))
    return CalmReadings(rate, force, _change(rate, time), _change(force, time))


def travel_of_fixes(time: FloatArray, fix_time: FloatArray, fix_vel: FloatArray) -> FloatArray:
    """North and east part [2, n] of the direction of travel, nothing at rest, as the velocities of
    fixes [m, 3] NED show it."""
    return _travel(*_shown(time, fix_time, fix_vel))


def signals_of_readings(
    time: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    temp_c: FloatArray | None,
    fix_time: FloatArray,
    fix_vel: FloatArray,
    calm: CalmReadings | None = None,
) -> Signals:
    """Quantities at IMU samples [n] from the readings and the velocities of fixes [m, 3] NED;
    ``calm`` readings where they are known.

    Acceleration along the track is slow from the fixes' speed and fast from the accelerometer.
    """
    from scipy.ndimage import gaussian_filter1d

    calm = calm or calm_readings(time, gyro, accel)
    step = max(float(np.median(np.diff(time))), LEAST_STEP_S)
    speed, heading = _shown(time, fix_time, fix_vel)
    force = calm.force[:, 0]
    along = force + gaussian_filter1d(np.gradient(speed, time) - force, BLEND_S / step)
    warm = _temperature(temp_c, len(time))
    side = speed * calm.rate[:, 2]
    return _signals(time, speed, heading, along, side, calm, warm)


def _signals(
    time: FloatArray,
    speed: FloatArray,
    heading: FloatArray,
    along: FloatArray,
    side: FloatArray,
    calm: CalmReadings,
    warm: FloatArray,
) -> Signals:
    rate, force, turning, jerk = calm
    return Signals(
        time=time,
        speed=speed,
        heading=heading,
        acceleration=along,
        lateral_acceleration=side,
        rate_x=rate[:, 0],
        rate_y=rate[:, 1],
        rate_z=rate[:, 2],
        force_x=force[:, 0],
        force_y=force[:, 1],
        force_z=force[:, 2],
        angular_acceleration_x=turning[:, 0],
        angular_acceleration_y=turning[:, 1],
        angular_acceleration_z=turning[:, 2],
        jerk_x=jerk[:, 0],
        jerk_y=jerk[:, 1],
        jerk_z=jerk[:, 2],
        temperature=warm,
        temperature_rate=_slope(warm, time),
    )


def _shown(
    time: FloatArray, fix_time: FloatArray, fix_vel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Speed and direction of travel [n] between the velocities of fixes [m, 3]; zero without."""
    if len(fix_time) < 2:
        fix_time, fix_vel = time[[0, -1]], np.zeros((2, 3))
    speed = np.interp(time, fix_time, np.linalg.norm(fix_vel, axis=1))
    return speed, np.interp(time, fix_time, _course(_around(fix_time, fix_vel)))


def _around(time: FloatArray, vel: FloatArray) -> FloatArray:
    """Mean velocity [m, 3] of the fixes for ``AROUND_S`` before and after each, of one at least,
    without its own: along a direction that its noise had a say in a velocity is too long."""
    count = max(round(AROUND_S / max(float(np.median(np.diff(time))), LEAST_STEP_S)), 1)
    at, sums = np.arange(len(vel)), np.concatenate([np.zeros((1, 3)), np.cumsum(vel, axis=0)])
    first, last = np.maximum(at - count, 0), np.minimum(at + count, len(vel) - 1)
    return np.asarray((sums[last + 1] - sums[first] - vel) / (last - first)[:, None])


def _travel(speed: FloatArray, heading: FloatArray) -> FloatArray:
    return np.asarray(np.tanh(speed / MOVING_SPEED) * np.stack([np.cos(heading), np.sin(heading)]))


def _course(vel: FloatArray) -> FloatArray:
    """Direction of travel [m] in rad without jumps, held where the vehicle hardly moves."""
    moving = np.hypot(vel[:, 0], vel[:, 1]) > COURSE_SPEED
    if not moving.any():
        return np.zeros(len(vel))
    course = np.unwrap(np.arctan2(vel[moving, 1], vel[moving, 0]))
    latest = np.cumsum(moving) - 1
    return np.asarray(course[np.maximum(latest, 0)])


def _temperature(temp_c: FloatArray | None, n: int) -> FloatArray:
    if temp_c is None or not np.isfinite(temp_c).any():
        return np.full(n, REFERENCE_C)
    good = np.isfinite(temp_c)
    rows = np.arange(n)
    return np.interp(rows, rows[good], temp_c[good])


def _change(readings: FloatArray, time: FloatArray) -> FloatArray:
    """Slopes [n, 3] of readings [n, 3] a second, of their average over ``FORCE_S``: a gyro's white
    noise at 100 Hz would be ten times what a car's turning is."""
    from scipy.ndimage import gaussian_filter1d

    if len(time) < 2:
        return np.zeros_like(readings)
    step = max(float(np.median(np.diff(time))), LEAST_STEP_S)
    slow = gaussian_filter1d(readings, FORCE_S / step, axis=0)
    return np.asarray(np.gradient(slow, time, axis=0))


def _slope(values: FloatArray, time: FloatArray) -> FloatArray:
    return np.gradient(values, time) if len(time) > 1 else np.zeros(len(time))
