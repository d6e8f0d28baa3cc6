"""A receiver with known errors for the fusion's tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pymap3d

from automap.records import NO_TIME, Fixes, FixType, FloatArray
from automap.simulation.scenario import Gnss
from tests.unit.fusion_motion import Motion, Truth

GPS0 = 1_400_000_000.0


@dataclass(frozen=True)
class Receiver:
    """A receiver's errors: 1-sigma per axis NED, correlation time s, delays s.

    ``slow`` is a second, slower wander with times of its own, ``short`` a third of seconds,
    ``lasting`` a velocity error that wanders; the course is ``course_latency`` older than the
    speed. ``says_all`` is False for NMEA: neither accuracies, but HDOP, nor vertical velocity.
    """

    rate: float = 5.0
    wander: tuple[float, float, float] = (1.0, 1.0, 1.8)
    tau: float = 60.0
    white: tuple[float, float, float] = (0.25, 0.25, 0.45)
    velocity: float = 0.07
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)
    latency: float = 0.0
    vel_latency: float = 0.0
    course_latency: float = 0.0
    slow: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slow_tau: tuple[float, float, float] = (600.0, 600.0, 600.0)
    short: float = 0.0
    short_tau: float = 10.0
    lasting: float = 0.0
    lasting_tau: float = 2.0
    says_all: bool = True


WHITE = "white"
"""Of the receivers by name the one whose velocities have white errors, see ``receiver_named``."""


def receiver_named(name: str) -> Receiver:
    """``WHITE``, or the linear and Gaussian part of a receiver of ``configs/receivers``: what an
    optimal smoother can be compared on. Its steps, frozen positions and thresholds are left out.
    """
    from pipeline.simulate.receivers import with_receiver

    if name == WHITE:
        return Receiver()
    given = with_receiver({"gnss": {"receiver": name}})
    setup, effects = Gnss.model_validate(given["gnss"]), given["errors"]
    assert not setup.solutions, f"{name} changes its kind of solution, which no linear model does"
    level, height = (effects.get(f"gnss_{kind}_wander", {}) for kind in ("slow", "height"))
    short, lasting = (effects.get(f"gnss_{e}", {}) for e in ("multipath", "velocity_wander"))
    late = {e: v["s"] for e, v in effects.items() if e.endswith("latency")}
    low_pass = effects.get("gnss_velocity_lag", {}).get("tau", 0.0)
    return Receiver(
        rate=setup.rate_hz,
        wander=setup.sigma_correlated_m,
        tau=setup.correlation_s,
        white=setup.sigma_white_m,
        velocity=setup.sigma_velocity[0],
        latency=late.get("gnss_latency", 0.0),
        vel_latency=late.get("gnss_velocity_latency", 0.0) + low_pass,
        course_latency=late.get("gnss_course_latency", 0.0),
        slow=tuple(part.get("sigma", 0.0) for part in (level, level, height)),
        slow_tau=tuple(part.get("tau", 600.0) for part in (level, level, height)),
        short=short.get("sigma", 0.0),
        short_tau=short.get("tau", 10.0),
        lasting=lasting.get("sigma", 0.0),
        lasting_tau=lasting.get("tau", 2.0),
        says_all=setup.format != "nmea",
    )


def gauss_markov(n: int, step: float, tau: float, sd: FloatArray, rng: np.random.Generator):
    """First-order Gauss-Markov sequences [n, 3], stationary from the start."""
    from scipy.signal import lfilter

    d = np.exp(-step / tau)
    drive = rng.standard_normal((n, 3)) * np.sqrt(1.0 - d * d)
    drive[0] = rng.standard_normal(3)
    return lfilter([1.0], [1.0, -d], drive, axis=0) * sd


def receive(
    motion: Motion, receiver: Receiver, seed: int, begin: float = 0.0, end: float | None = None
) -> Fixes:
    """Fixes over ``begin`` to ``end`` s of the motion."""
    rng = np.random.default_rng(seed)
    stop = motion.duration if end is None else end
    t = begin + np.arange(int((stop - begin) * receiver.rate) + 1) / receiver.rate
    lever = np.array(receiver.lever)
    place = motion.at(t - receiver.latency)
    n = len(t)
    wander, white = np.array(receiver.wander), np.array(receiver.white)
    error = gauss_markov(n, 1.0 / receiver.rate, receiver.tau, wander, rng)
    error = error + rng.standard_normal((n, 3)) * white
    # from a stream of their own: others draw what they drew without them
    more = np.random.default_rng([seed, 1])
    for axis, (sd, tau) in enumerate(zip(receiver.slow, receiver.slow_tau, strict=True)):
        error[:, axis] += gauss_markov(n, 1.0 / receiver.rate, tau, np.full(3, sd), more)[:, 0]
    if receiver.short:
        sd = np.full(3, receiver.short)
        error += gauss_markov(n, 1.0 / receiver.rate, receiver.short_tau, sd, more)
    offset = place.c_n_b @ lever + error
    lat, lon, height = pymap3d.ned2geodetic(
        *offset.T, place.lat, place.lon, place.height, deg=False
    )
    late = t - receiver.latency - receiver.vel_latency
    vel = _antenna_velocity(motion.at(late), lever)
    if receiver.course_latency:
        turned = _antenna_velocity(motion.at(late - receiver.course_latency), lever)
        size = np.hypot(vel[:, 0], vel[:, 1]) / np.maximum(np.hypot(*turned[:, :2].T), 1e-9)
        vel[:, :2] = turned[:, :2] * size[:, None]
    vel = vel + rng.standard_normal((n, 3)) * receiver.velocity
    if receiver.lasting:
        sd = np.full(3, receiver.lasting)
        vel = vel + gauss_markov(n, 1.0 / receiver.rate, receiver.lasting_tau, sd, more)
    sd_pos, sd_vel = np.tile(_stated_sd(receiver), (n, 1)), np.full((n, 3), receiver.velocity)
    sd_vel = np.hypot(sd_vel, receiver.lasting)
    if not receiver.says_all:
        sd_pos, sd_vel = np.full((2, n, 3), np.nan)
        vel[:, 2] = np.nan
    return Fixes(
        gps_s=GPS0 + t,
        lat_rad=lat,
        lon_rad=(lon + np.pi) % (2 * np.pi) - np.pi,
        height_m=height,
        vel_ned=vel,
        sd_pos_ned=sd_pos,
        sd_vel_ned=sd_vel,
        fix_type=np.full(n, FixType.THREE_D, np.int64),
        n_sats=np.full(n, 12, np.int64),
        hdop=np.ones(n),
        geoid_sep_m=np.full(n, np.nan),
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def _antenna_velocity(true: Truth, lever: FloatArray) -> FloatArray:
    return true.vel + np.einsum("nij,nj->ni", true.c_n_b, np.cross(true.turn, lever))


def _stated_sd(receiver: Receiver) -> FloatArray:
    """The largest part of the position's error by axis [3]."""
    return np.max([receiver.wander, receiver.white, receiver.slow], axis=0)


def select(fixes: Fixes, rows: FloatArray) -> Fixes:
    """The fixes of a mask or index."""
    return Fixes(**{k: v[rows] for k, v in vars(fixes).items()})


def shifted(fixes: Fixes, metres_ned: FloatArray) -> Fixes:
    """Fixes moved by metres [n, 3]."""
    lat, lon, height = pymap3d.ned2geodetic(
        *metres_ned.T, fixes.lat_rad, fixes.lon_rad, fixes.height_m, deg=False
    )
    return replace(fixes, lat_rad=lat, lon_rad=lon, height_m=height)
