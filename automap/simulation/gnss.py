"""A receiver's epochs: wandering and white errors, dropouts, and the bytes' arrival."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from automap import earth
from automap.records import NO_TIME, Fixes, FixType, FloatArray, IntArray
from automap.simulation.scenario import Gnss
from automap.simulation.trajectory import DriveMotion, Motion


def antenna(motion: Motion, lever_arm_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offset of the antenna from the IMU and its velocity, both NED [n, 3] (m, m/s)."""
    offset = motion.C_n_b @ lever_arm_m
    swing = np.einsum("nij,nj->ni", motion.C_n_b, np.cross(motion.turn_rate, lever_arm_m))
    return offset, motion.vel_ned + swing


def gauss_markov(
    n: int, sigma: FloatArray, step_over_tau: float, rng: np.random.Generator
) -> FloatArray:
    """First-order Gauss-Markov sequences [n, k] that start in their stationary state."""
    decay = np.exp(-step_over_tau)
    drive = rng.standard_normal((n, len(sigma))) * sigma
    drive[1:] *= np.sqrt(1.0 - decay**2)
    out = np.empty_like(drive)
    out[0] = drive[0]
    for i in range(1, n):
        out[i] = decay * out[i - 1] + drive[i]
    return out


def receive(drive: DriveMotion, setup: Gnss, begin_gps_s: float, rng: np.random.Generator) -> Fixes:
    """Epochs at whole multiples of the rate in GPS time; a dropout repeats the last position
    and says that there is no fix, as receivers do."""
    step = 1.0 / setup.rate_hz
    first = int(np.ceil(begin_gps_s / step - 1e-6))
    count = int(np.floor((begin_gps_s + drive.duration_s) / step)) - first + 1
    gps_s: FloatArray = np.arange(first, first + count) * np.float64(step)
    motion = drive.at(np.clip(gps_s - begin_gps_s, 0.0, drive.duration_s))
    lever = np.asarray(setup.lever_arm_m)
    offset, velocity = antenna(motion, lever)
    wander, white = np.asarray(setup.sigma_correlated_m), np.asarray(setup.sigma_white_m)
    error = gauss_markov(count, wander, step / setup.correlation_s, rng)
    error += rng.standard_normal((count, 3)) * white
    sd_pos = np.tile(np.hypot(wander, white), (count, 1))
    sd_vel = np.tile(np.asarray(setup.sigma_velocity), (count, 1))
    velocity = velocity + rng.standard_normal((count, 3)) * setup.sigma_velocity
    shift = offset + error
    north, east = earth.metres_per_radian(motion.lat_rad, motion.height_m)
    lat = motion.lat_rad + shift[:, 0] / north
    lon = motion.lon_rad + shift[:, 1] / east
    height = motion.height_m - shift[:, 2]

    n_sats = np.clip(np.rint(14 + gauss_markov(count, np.ones(1), step / 20.0, rng)[:, 0]), 6, 30)
    lost = np.zeros(count, bool)
    for begin, length in setup.dropouts:
        t = gps_s - begin_gps_s
        lost |= (t >= begin) & (t < begin + length)
    lost[0] = False
    held = np.maximum.accumulate(np.where(lost, 0, np.arange(count)))
    since = (np.arange(count) - held) * step
    return Fixes(
        gps_s=gps_s,
        lat_rad=lat[held],
        lon_rad=lon[held],
        height_m=height[held],
        vel_ned=velocity[held],
        sd_pos_ned=sd_pos * (1.0 + 5.0 * since[:, None]),
        sd_vel_ned=sd_vel * (1.0 + 5.0 * since[:, None]),
        fix_type=np.where(lost, FixType.NONE, FixType.THREE_D).astype(np.int64),
        n_sats=np.where(lost, 3, n_sats).astype(np.int64),
        hdop=np.where(lost, 9.9, 11.0 / n_sats),
        geoid_sep_m=np.full(count, setup.geoid_separation_m),
        offset=np.full(count, -1, np.int64),
        arrival_ns=np.full(count, NO_TIME, np.int64),
    )


def arrivals(
    gps_s: FloatArray,
    setup: Gnss,
    host_ns: Callable[[FloatArray], IntArray],
    rng: np.random.Generator,
) -> IntArray:
    """Host stamps [n] at which the epochs' first bytes arrive, never out of order.

    The delay is at least ``output_delay_s``; scheduling adds a positive jitter, and now and
    then the host is busy and several messages come in a burst.
    """
    n = len(gps_s)
    delay = setup.output_delay_s + rng.exponential(setup.arrival_jitter_s, n)
    busy = rng.random(n) < setup.burst_probability
    delay += np.where(busy, rng.exponential(setup.burst_s, n), 0.0)
    arrival = np.maximum.accumulate(gps_s + delay)
    stamps = host_ns(arrival)
    # messages of one burst are read one after the other
    return np.asarray(np.maximum.accumulate(stamps - np.arange(n)) + np.arange(n), np.int64)
