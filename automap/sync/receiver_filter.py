"""The low-pass filter that a receiver's fixes came through, by what an IMU felt meanwhile.

A filter that smooths tells a bend late and too round. One of the first order is undone exactly: its
input is a difference of two outputs (A. E. Bryson and L. J. Henrikson, Estimation using sampled
data containing sequentially correlated noise, Journal of Spacecraft and Rockets 5(6), 1968).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.gates import sd_by_median
from automap.records import (
    BoolArray,
    ClockModel,
    Fixes,
    FloatArray,
    ImuData,
    IntArray,
    ReceiverFilter,
)
from automap.sync import limits
from automap.sync.between_fixes import nothing_new
from automap.sync.correlation import channels_between
from automap.sync.motion import GnssMotion, ImuMotion, imu_motion
from automap.sync.motion_clock import gnss_motions, in_imu_time


def receiver_filter(
    imu: ImuData, fixes: Fixes, clock: ClockModel, late_s: float = 0.0
) -> ReceiverFilter | None:
    """The filters without which what the receiver saw of the turns is a million times less likely;
    None where there is none.

    ``clock`` need not be better than a second or two: filters are told from delays by how they
    round a bend. Velocities are told ``late_s`` s later than positions: by about a filter's own
    lateness where one of the two comes through it alone, by less where both do.
    """
    motion = imu_motion(imu)
    if len(motion.t_s) < 2:
        return None
    gains = {}
    for source, gnss in gnss_motions(fixes):
        own = in_imu_time(gnss, clock, imu)
        # differences of positions are means over a step of the log, which no filter made
        step = float(np.median(np.diff(own.start))) if source == "position" else 0.0
        gains[source] = _Turns(motion.averaged(step), own, motion.turn_noise()).gains()
    alike = _likeliest(np.sum(list(gains.values()), axis=0)) if gains else 0.0
    if abs(late_s) < 0.5 * alike:
        return ReceiverFilter(*(alike * (name in gains) for name in ("velocity", "position")))
    found = {source: _likeliest(gain) for source, gain in gains.items()}
    if not any(found.values()):
        return None
    return ReceiverFilter(found.get("velocity", 0.0), found.get("position", 0.0))


def _likeliest(gains: FloatArray) -> float:
    """The time constant, s, where the gains [k], nats, of ``FILTERS_S`` have their top; 0 where the
    best one may be chance among as many."""
    best = int(np.argmax(gains))
    if gains[best] < limits.CERTAIN_LEAD_NATS + np.log(len(gains)):
        return 0.0
    if best in (0, len(gains) - 1):
        return limits.FILTERS_S[best]
    near = slice(best - 1, best + 2)
    curve = np.polyfit(np.log(limits.FILTERS_S[near]), gains[near], 2)
    return float(np.exp(-0.5 * curve[1] / curve[0]))


def taken_back(fixes: Fixes, behind: ReceiverFilter | None) -> Fixes:
    """Fixes as they were before the filters; unknown at the first one and at rows that say what
    others said already.

    A road's slope hardly changes within a filter's time: heights are taken from as much later as
    they are late, which does not raise their noise, and one in two of its times, whose errors are
    each other's no more.
    """
    if behind is None:
        return fixes
    again = nothing_new(fixes)

    def before(values: FloatArray, time_s: float) -> FloatArray:
        return _input(fixes.gps_s, values, time_s, again) if time_s else values

    late_s = behind.position_s
    lon, known = fixes.lon_rad.copy(), np.isfinite(fixes.lon_rad)
    lon[known] = np.unwrap(lon[known])
    return replace(
        fixes,
        vel_ned=np.column_stack([before(v, behind.velocity_s) for v in fixes.vel_ned.T]),
        lat_rad=before(fixes.lat_rad, late_s),
        lon_rad=np.asarray((before(lon, late_s) + np.pi) % (2.0 * np.pi) - np.pi),
        height_m=_later(fixes.gps_s, fixes.height_m, late_s, again),
    )


def _rows(gps_s: FloatArray, values: FloatArray, again: BoolArray) -> IntArray:
    """The rows of values [n] that were measured, in order of their times [n]."""
    rows = np.flatnonzero(np.isfinite(gps_s) & np.isfinite(values) & ~again)
    rows = rows[np.argsort(gps_s[rows], kind="stable")]
    return np.asarray(rows[np.diff(gps_s[rows], prepend=-np.inf) > 1e-3])


def _input(gps_s: FloatArray, output: FloatArray, time_s: float, again: BoolArray) -> FloatArray:
    """What went into a filter at times [n], by what came out [n]."""
    found = np.full_like(output, np.nan)
    rows = _rows(gps_s, output, again)
    keeps = np.exp(-np.diff(gps_s[rows]) / time_s)
    found[rows[1:]] = output[rows[:-1]] + np.diff(output[rows]) / (1.0 - keeps)
    return found


def _later(gps_s: FloatArray, values: FloatArray, late_s: float, again: BoolArray) -> FloatArray:
    """Values [n] of times [n] as they are told when a filter of ``late_s`` s shows them, one in
    twice as long; unknown behind the last."""
    rows = _rows(gps_s, values, again)
    if not late_s or not len(rows):
        return values
    step = float(np.median(np.diff(gps_s[rows]))) if len(rows) > 1 else late_s
    # a filter is late by its time less half a step of the log, as far as it is one of steps
    t = gps_s[rows] + step / np.expm1(step / late_s)
    new = np.diff(np.floor(gps_s[rows] / (2.0 * late_s)), prepend=-1.0) > 0.0
    found = np.full_like(values, np.nan)
    found[rows[new]] = np.interp(t[new], gps_s[rows], values[rows], right=np.nan)
    return found


class _Turns:
    """Turns that a receiver saw, beside those that an IMU felt behind filters, whose rate has white
    ``noise``, rad^2/s."""

    def __init__(self, motion: ImuMotion, gnss: GnssMotion, noise: float) -> None:
        self.motion, self.gnss = motion, gnss.apart(limits.FILTER_INTERVALS)
        speed = gnss.speed[np.isfinite(gnss.turn)]
        self.noise = noise * (float(np.median(speed)) if len(speed) else 0.0) ** 2
        longest = limits.FILTERS_S[-1]
        plain = self._rest(0.0, -longest - limits.LAG_REACH_S, longest)
        self.lag_s, self.plain = (0.0, np.zeros(0)) if plain is None else plain

    def gains(self) -> FloatArray:
        """By how many nats each of ``FILTERS_S`` makes the turns likelier; 0 of all where none of
        the first ones does."""
        known = {time_s: self.gain(time_s) for time_s in limits.SCREENED_FILTERS_S}
        if max(known.values()) <= 0.0:
            return np.zeros(len(limits.FILTERS_S))
        missing = set(limits.FILTERS_S) - known.keys()
        known |= {time_s: self.gain(time_s) for time_s in missing}
        return np.array([known[time_s] for time_s in limits.FILTERS_S])

    def gain(self, time_s: float) -> float:
        """By how many nats a filter makes the turns likelier, but for what it takes off the gyro's
        own noise.

        White noise of a rate, rad^2/s, turns by its spectrum times a window; behind a filter by
        less, as long as ``time_s`` (1 - exp(-window / ``time_s``)) would have shown.
        """
        if not len(self.plain):
            return 0.0
        low, high = (self.lag_s + time_s + side * limits.LAG_REACH_S for side in (-1.0, 1.0))
        behind = self._rest(time_s, low, high)
        if behind is None:
            return 0.0
        window = float(np.median(self.gnss.end - self.gnss.start))
        less = -self.noise * time_s * float(np.expm1(-window / time_s))
        return len(self.plain) * (_misfit(self.plain) - _misfit(behind[1], less))

    def _rest(self, time_s: float, low: float, high: float) -> tuple[float, FloatArray] | None:
        """The best lag from ``low`` to ``high`` s, and what is left of the turns [n] there."""
        motion = self.motion.filtered(time_s) if time_s else self.motion
        turns = [c for c in channels_between(motion, self.gnss, low, high) if c.is_turn]
        if not turns:
            return None
        channel = turns[0]
        lag = 0.0
        # how far the antenna is ahead takes up what is left of a lag
        near = limits.COARSE_S * np.arange(-3.0, 4.0)
        for tried in (np.arange(low, high, limits.OFFSET_STEP_S), near):
            lags = np.asarray(lag + tried, np.float64)
            lag = float(lags[np.argmin(channel.scores(lags))])
            channel.reweight(lag)
        return lag, channel.fit(lag)[0]


def _misfit(rest: FloatArray, more: float = 0.0) -> float:
    """Mean negative log likelihood of residuals [n] of Student's t with two degrees of freedom,
    which receivers' errors have; its scale is theirs, with a variance ``more``."""
    scale = sd_by_median(rest) + 1e-9
    shape = 1.5 * np.mean(np.log1p(0.5 * (rest / scale) ** 2))
    return float(0.5 * np.log(scale**2 + more) + shape)
