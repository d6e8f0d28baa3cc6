"""What an IMU and a receiver both see of a motion, whatever way the IMU is mounted.

Only the direction of gravity is needed: it turns the gyro into a rate of heading and the
accelerometer into two horizontal components of unknown azimuth. Everything is compared as
increments over an interval, integrals of the IMU against differences of the receiver's
velocity, so that neither side is low-pass filtered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from automap.earth import MEAN_RADIUS
from automap.gates import sd_by_median
from automap.records import Fixes, FixType, FloatArray, ImuData, IntArray
from automap.sync import limits


@dataclass(frozen=True)
class ImuMotion:
    """Running integrals of the IMU at times ``t_s`` [n] after its first stamp.

    ``integral`` [n, 4]: heading (rad, clockwise from above), two horizontal components of
    the specific force (m/s), and the seconds lost in gaps.
    """

    t_s: FloatArray
    integral: FloatArray

    def at(self, t_s: FloatArray) -> FloatArray:
        """The integrals [..., 4] at times [...]; those at the ends beyond them."""
        right, part = self._place(t_s)
        before = self.integral[right - 1]
        return np.asarray(before + part[..., None] * (self.integral[right] - before))

    def rate(self, t_s: FloatArray) -> FloatArray:
        """Rate of heading at times [...], rad/s, the mean over a tenth of a second."""
        return (self._heading(t_s + 0.05) - self._heading(t_s - 0.05)) / 0.1

    def turn_noise(self) -> float:
        """Spectral density of the rate's white noise, rad^2/s, by how neighbours differ."""
        change = np.diff(self.integral[:, 0], 2)
        if not len(change):
            return 0.0
        # of two integrals by trapezia: half of what rates two samples apart differ by
        return 2.0 * sd_by_median(change) ** 2 / float(np.median(np.diff(self.t_s)))

    def _heading(self, t_s: FloatArray) -> FloatArray:
        right, part = self._place(t_s)
        before = self.integral[right - 1, 0]
        return np.asarray(before + part * (self.integral[right, 0] - before))

    def _place(self, t_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """The sample after each time [...] and how far towards it, 0 to 1."""
        right = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        before, after = self.t_s[right - 1], self.t_s[right]
        return right, np.clip((t_s - before) / (after - before), 0.0, 1.0)

    def between(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Increments [..., 3] over intervals [...]; NaN outside the recording and across gaps."""
        steps = self.at(end) - self.at(start)
        lost = (start < self.t_s[0]) | (end > self.t_s[-1]) | (steps[..., 3] > 1e-9)
        steps[lost] = np.nan
        return steps[..., :3]

    def filtered(self, time_s: float) -> ImuMotion:
        """The integrals behind a first-order low-pass of the time constant ``time_s``; the seconds
        lost in gaps stay as they are."""
        from scipy.signal import lfilter

        step = limits.FILTER_STEP_S
        t = np.arange(self.t_s[0], self.t_s[-1], step)
        sampled = np.column_stack([np.interp(t, self.t_s, column) for column in self.integral.T])
        keeps = float(np.exp(-step / time_s))
        first = sampled[0, :3]
        sampled[:, :3] = first + lfilter([1.0 - keeps], [1.0, -keeps], sampled[:, :3] - first, 0)
        return ImuMotion(t, sampled)

    def averaged(self, length_s: float) -> ImuMotion:
        """The means of the integrals over ``length_s`` about each time; the seconds lost in gaps
        stay as they are."""
        if not length_s:
            return self
        steps = 0.5 * (self.integral[1:, :3] + self.integral[:-1, :3])
        total = np.zeros((len(self.t_s), 3))
        np.cumsum(steps * np.diff(self.t_s)[:, None], axis=0, out=total[1:])
        low, high = (self.t_s + side * length_s for side in (-0.5, 0.5))
        low, high = np.maximum(low, self.t_s[0]), np.minimum(high, self.t_s[-1])
        mean = [np.interp(high, self.t_s, c) - np.interp(low, self.t_s, c) for c in total.T]
        mean = np.column_stack(mean) / (high - low)[:, None]
        return ImuMotion(self.t_s, np.column_stack([mean, self.integral[:, 3]]))

    def part(self, first: float, last: float) -> ImuMotion:
        """The integrals at the times from ``first`` to ``last``."""
        rows = slice(*np.searchsorted(self.t_s, (first, last)))
        return ImuMotion(self.t_s[rows], self.integral[rows])


@dataclass(frozen=True)
class GnssMotion:
    """Changes of the receiver's velocity over intervals [n] of GPS time.

    ``turn`` is the change of course times the mean speed (m/s, NaN when too slow), ``surge``
    the change of speed (m/s), ``speed`` the mean speed.
    """

    start: FloatArray
    end: FloatArray
    turn: FloatArray
    surge: FloatArray
    speed: FloatArray

    def shifted(self, seconds: float) -> GnssMotion:
        """The same motion dated ``seconds`` later."""
        return replace(self, start=self.start + seconds, end=self.end + seconds)

    def apart(self, most: int) -> GnssMotion:
        """Intervals of which none begins before the last one ends: ``most`` at most, evenly over
        the drive."""
        if len(self.start) < 2:
            return self
        step, length = np.median(np.diff(self.start)), np.median(self.end - self.start)
        every = max(1, round(float(length / step)), -(-len(self.start) // most))
        return GnssMotion(*(getattr(self, item.name)[::every] for item in fields(self)))

    def part(self, first: float, last: float) -> GnssMotion:
        """The intervals that start in ``first`` to ``last``."""
        rows = (self.start >= first) & (self.start < last)
        return GnssMotion(*(getattr(self, item.name)[rows] for item in fields(self)))


def imu_motion(imu: ImuData) -> ImuMotion:
    """Integrals of an IMU recording; its axes need not be known."""
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    down = -np.median(imu.accel, axis=0)
    norm = float(np.linalg.norm(down))
    down = down / norm if norm > 0.0 else np.array([0.0, 0.0, 1.0])
    # any two directions square to down and to one another
    helper = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = np.cross(down, helper)
    first /= np.linalg.norm(first)
    axes = np.column_stack([first, np.cross(down, first)])
    rates = np.column_stack(
        [np.einsum("ij,j->i", imu.gyro, down), np.einsum("ij,jk->ik", imu.accel, axes)]
    )
    rates -= np.median(rates, axis=0)
    dt = np.diff(t)
    usual = float(np.median(dt)) if len(dt) else 0.0
    gap = dt > max(limits.IMU_GAP_S, limits.IMU_GAP_STEPS * usual)
    steps = np.column_stack([0.5 * (rates[1:] + rates[:-1]) * dt[:, None], np.where(gap, dt, 0.0)])
    integral = np.concatenate([np.zeros((1, 4)), np.cumsum(steps, axis=0)])
    return ImuMotion(t_s=t, integral=integral)


def velocity_motion(fixes: Fixes, window_s: float = 1.0) -> GnssMotion:
    """Increments of the receiver's own (Doppler) velocity."""
    good = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.gps_s)
    velocity = fixes.vel_ned[:, :2]
    good &= np.isfinite(velocity).all(axis=1)
    return _increments(fixes.gps_s[good], velocity[good], window_s)


def position_motion(fixes: Fixes, window_s: float = 1.0) -> GnssMotion:
    """Increments of the velocity that the receiver's positions give by difference.

    A difference of two positions is the mean velocity between them and is dated at the
    middle, so that its delay is the positions' and not that of the Doppler velocity.
    """
    good = (fixes.fix_type >= FixType.TWO_D) & np.isfinite(fixes.gps_s + fixes.lat_rad)
    good &= np.isfinite(fixes.lon_rad)
    order = np.flatnonzero(good)[np.argsort(fixes.gps_s[good], kind="stable")]
    t, lat, lon = fixes.gps_s[order], fixes.lat_rad[order], fixes.lon_rad[order]
    dt = np.diff(t)
    # scale errors of a spherical Earth (0.5 %) do not matter, the comparison has a free scale
    north = np.diff(lat) * MEAN_RADIUS
    east = np.diff(np.unwrap(lon)) * MEAN_RADIUS * np.cos(0.5 * (lat[1:] + lat[:-1]))
    usable = (dt > 1e-3) & (dt < limits.FIX_GAP_S)
    velocity = np.column_stack([north, east])[usable] / dt[usable, None]
    return _increments((t[:-1] + 0.5 * dt)[usable], velocity, window_s)


def _increments(t: FloatArray, velocity: FloatArray, window_s: float) -> GnssMotion:
    order = np.argsort(t, kind="stable")
    t, velocity = t[order], velocity[order]
    distinct = np.concatenate([[True], np.diff(t) > 1e-3]) if len(t) else np.zeros(0, np.bool_)
    t, velocity = t[distinct], velocity[distinct]
    if len(t) < 3:
        nothing = np.zeros(0)
        return GnssMotion(nothing, nothing, nothing, nothing, nothing)
    stride = max(1, round(window_s / float(np.median(np.diff(t)))))
    start, end = t[:-stride], t[stride:]
    v0, v1 = velocity[:-stride], velocity[stride:]
    speed0, speed1 = np.hypot(*v0.T), np.hypot(*v1.T)
    speed = 0.5 * (speed0 + speed1)
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    turned = _wrap(course[stride:] - course[:-stride])
    turn = np.where(np.minimum(speed0, speed1) > limits.SLOW_M_S, turned * speed, np.nan)
    keep = (end - start < 1.6 * window_s + 0.2) & (speed < limits.FASTEST_M_S)
    # one wild fix is a turn and a speed, and outweighs all others where either explains the other
    change = v1 - v0
    chance = math.sqrt(2.0 * limits.CERTAIN_LEAD_NATS) * sd_by_median(change.ravel())
    keep &= np.hypot(*change.T) < limits.HARD_BRAKING * (end - start) + chance
    return GnssMotion(
        start=start[keep],
        end=end[keep],
        turn=turn[keep],
        surge=(speed1 - speed0)[keep],
        speed=speed[keep],
    )


def _wrap(angle: npt.NDArray[np.float64]) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
