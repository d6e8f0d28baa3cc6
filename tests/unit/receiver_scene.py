"""A simulated receiver in a car: fixes with the errors that recorded ones have, which last.

Speed and heading are those of a town: corners, stops, bends. Positions wander and jump, velocities
err for seconds in a row and are late, each by what a recorded receiver does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from automap.earth import metres_per_radian
from automap.records import NO_TIME, Fixes, FixType, FloatArray

GPS_START = 1_400_000_000.0
START_RAD = (-0.6, 2.5)


@dataclass(frozen=True)
class Receiver:
    """What a receiver errs by; ``rate_hz`` fixes a second."""

    rate_hz: float = 1.0
    speed_lag_s: float = 0.0
    course_lag_s: float = 0.0
    wander_m: float = 2.0
    noise_m: float = 0.3
    velocity_error: float = 0.25
    velocity_tau_s: float = 2.0
    jumps_an_hour: float = 20.0
    jump_m: float = 4.0


def any_receiver(rng: np.random.Generator) -> Receiver:
    """One of those that are sold: every figure anywhere in its range."""
    return Receiver(
        rate_hz=float(rng.choice([1.0, 1.0, 4.0, 5.0, 10.0])),
        speed_lag_s=rng.uniform(0.0, 0.7),
        course_lag_s=rng.uniform(0.0, 0.65),
        wander_m=rng.uniform(1.0, 4.0),
        noise_m=rng.uniform(0.01, 0.5),
        velocity_error=rng.uniform(0.05, 0.3),
        velocity_tau_s=rng.uniform(1.0, 3.0),
    )


def lasting(rng: np.random.Generator, t: FloatArray, sd: float, tau_s: float) -> FloatArray:
    """A first-order Gauss-Markov error [n, 3] at times [n]."""
    keep = np.exp(-np.diff(t, prepend=t[0]) / tau_s)
    white = rng.normal(0.0, sd, (len(t), 3))
    out = white.copy()
    for k in range(1, len(t)):
        out[k] = keep[k] * out[k - 1] + np.sqrt(1.0 - keep[k] ** 2) * white[k]
    return out


def motion(
    rng: np.random.Generator, seconds: float, fast: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Times [n] 0.05 s apart, speed, heading, and rate of climb [n] of a drive in a town."""
    step = 0.05
    t = np.arange(0.0, seconds + 2.0, step)
    wanted, heading, grade = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    at, course, slope = 0, rng.uniform(0.0, 2.0 * np.pi), 0.0
    while at < len(t):
        end = at + int(rng.uniform(5.0, 25.0) / step)
        stands = rng.random() < 0.2
        wanted[at:end] = 0.0 if stands else fast * rng.uniform(0.4, 1.0)
        course += 0.0 if stands else rng.choice([-1.0, 0.0, 1.0]) * rng.uniform(0.3, 1.6)
        slope = rng.normal(0.0, 0.04)
        heading[at:end], grade[at:end] = course, slope
        at = end
    speed = np.empty(len(t))
    now = wanted[0]
    for k, target in enumerate(wanted):
        now += float(np.clip(target - now, -2.5 * step, 1.5 * step))
        speed[k] = now
    # corners and slopes take seconds
    box = np.ones(81) / 81.0
    smooth = [np.convolve(np.pad(v, 40, mode="edge"), box, mode="valid") for v in (heading, grade)]
    return t, speed, smooth[0], speed * smooth[1]


def simulated_fixes(
    seed: int, receiver: Receiver | None = None, seconds: float = 180.0, fast: float = 14.0
) -> Fixes:
    """Fixes of a receiver, any one if none is given, on a drive of its own; ``fast`` m/s at most,
    0 for a car that stands."""
    rng = np.random.default_rng(seed)
    receiver = receiver or any_receiver(rng)
    t, speed, heading, climb = motion(rng, seconds, fast)
    rates = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), -climb])
    ned = cumulative_trapezoid(rates, t, axis=0, initial=0.0)
    at = np.arange(1.5, seconds, 1.0 / receiver.rate_hz)
    n = len(at)
    place = np.column_stack([np.interp(at, t, axis) for axis in ned.T])
    place += lasting(rng, at, receiver.wander_m, 60.0) + rng.normal(0.0, receiver.noise_m, (n, 3))
    jumps = rng.random(n) < receiver.jumps_an_hour / 3600.0 / receiver.rate_hz
    place += np.cumsum(jumps[:, None] * rng.normal(0.0, receiver.jump_m, (n, 3)), axis=0)
    told_speed = np.interp(at - receiver.speed_lag_s, t, speed)
    told_course = np.interp(at - receiver.course_lag_s, t, heading)
    velocity = np.column_stack(
        [
            told_speed * np.cos(told_course),
            told_speed * np.sin(told_course),
            -np.interp(at - receiver.speed_lag_s, t, climb),
        ]
    )
    velocity += lasting(rng, at, receiver.velocity_error, receiver.velocity_tau_s)
    unknown = np.full(n, np.nan)
    lat = START_RAD[0] + place[:, 0] / metres_per_radian(START_RAD[0], 0.0)[0]
    return Fixes(
        gps_s=GPS_START + at,
        lat_rad=lat,
        lon_rad=START_RAD[1] + place[:, 1] / metres_per_radian(lat, 0.0)[1],
        height_m=60.0 - place[:, 2],
        vel_ned=velocity,
        sd_pos_ned=np.full((n, 3), np.nan),
        sd_vel_ned=np.full((n, 3), np.nan),
        fix_type=np.full(n, FixType.THREE_D, np.int64),
        n_sats=np.full(n, 9, np.int64),
        hdop=unknown,
        geoid_sep_m=unknown,
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )
