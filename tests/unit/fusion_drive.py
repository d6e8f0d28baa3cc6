"""Drives with known truth for the fusion's tests, built apart from the project's simulator.

The motion is given on the tangent plane of the start, in Earth-fixed axes; readings follow
from Newton's law in that plane. No transport rate and no navigation-frame formula enters, so
that a sign shared by simulator and filter cannot hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pymap3d
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from automap.earth import gravity
from automap.records import NO_TIME, ClockModel, Fixes, FixType, FloatArray, ImuData, Trajectory
from automap.simulation.scenario import Gnss

EARTH_RATE = 7.292115e-5
GRID_S = 0.02
GPS0 = 1_400_000_000.0
BASE_NS = 5_000_000_000
CLOCK = ClockModel(BASE_NS, GPS0, 0.0, 1e-4, 1e-9, "identity")


def _rot_e_ned(lat: FloatArray, lon: FloatArray) -> FloatArray:
    """C_e_n [n, 3, 3] of the local NED at latitude and longitude in rad."""
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    zero = np.zeros_like(s)
    north = np.stack([-s * cl, -s * sl, c], axis=-1)
    east = np.stack([-sl, cl, zero], axis=-1)
    down = np.stack([-c * cl, -c * sl, -s], axis=-1)
    return np.stack([north, east, down], axis=-1)


def _euler(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    sr, cr, sp, cp, sy, cy = (f(a) for a in (roll, pitch, yaw) for f in (np.sin, np.cos))
    return np.stack(
        [
            np.stack([cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy], axis=-1),
            np.stack([cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy], axis=-1),
            np.stack([-sp, sr * cp, cr * cp], axis=-1),
        ],
        axis=-2,
    )


@dataclass(frozen=True)
class Truth:
    """Motion at times ``t`` [n]: geodetic position (rad, m), velocity and attitude in NED,
    perfect readings in vehicle axes, rate against the Earth in vehicle axes."""

    t: FloatArray
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    vel: FloatArray
    c_n_b: FloatArray
    gyro: FloatArray
    accel: FloatArray
    turn: FloatArray


@dataclass(frozen=True)
class Motion:
    """A drive as splines on the tangent plane of ``origin`` (lat, lon rad, height m)."""

    duration: float
    origin: tuple[float, float, float]
    velocity: CubicSpline
    angles: CubicSpline

    def at(self, t: FloatArray) -> Truth:
        t = np.asarray(t, np.float64)
        vel_t = self.velocity(t)
        acc_t = self.velocity(t, 1)
        pos_t = self._position()(t)
        roll, pitch, yaw = self.angles(t).T
        rates = self.angles(t, 1)
        c_t_b = _euler(roll, pitch, yaw)
        place = pymap3d.ned2geodetic(*pos_t.T, *self.origin, deg=False)
        # a single instant comes back as a scalar
        lat, lon, height = (np.atleast_1d(p) for p in place)
        c_e_t = _rot_e_ned(np.array(self.origin[0]), np.array(self.origin[1]))
        c_n_t = np.swapaxes(_rot_e_ned(lat, lon), 1, 2) @ c_e_t
        g = np.zeros((len(t), 3))
        g[:, 2] = gravity(lat, height)
        g_t = np.einsum("nji,nj->ni", c_n_t, g)
        w_t = c_e_t.T @ np.array([0.0, 0.0, EARTH_RATE])
        force_t = acc_t + 2.0 * np.cross(w_t, vel_t) - g_t
        turn = np.stack(
            [
                rates[:, 0] - np.sin(pitch) * rates[:, 2],
                np.cos(roll) * rates[:, 1] + np.sin(roll) * np.cos(pitch) * rates[:, 2],
                -np.sin(roll) * rates[:, 1] + np.cos(roll) * np.cos(pitch) * rates[:, 2],
            ],
            axis=1,
        )
        return Truth(
            t,
            lat,
            lon,
            height,
            np.einsum("nij,nj->ni", c_n_t, vel_t),
            c_n_t @ c_t_b,
            turn + np.einsum("nji,j->ni", c_t_b, w_t),
            np.einsum("nji,nj->ni", c_t_b, force_t),
            turn,
        )

    def _position(self) -> object:
        return self.velocity.antiderivative()


def make_motion(
    speed: Sequence[tuple[float, float]],
    turns: Sequence[tuple[float, float, float]],
    duration: float,
    origin_deg: tuple[float, float, float] = (-35.28, 149.13, 580.0),
    heading_deg: float = 30.0,
    slope: float = 0.03,
    slip_seed: int | None = None,
) -> Motion:
    """A drive of ``duration`` s. With ``slip_seed`` it slides sideways at random, 0.04 m/s over one
    second and 0.03 m/s more for each m/s^2 of lateral acceleration, and bounces twice as much.

    ``speed`` knots (time s, m/s), negative in reverse; ``turns`` (begin s, length s, angle
    deg). Corners are rounded over half a second; the body leans and the road rises gently.
    """
    pad = 5.0
    t = np.arange(-round(pad / GRID_S), round((duration + pad) / GRID_S) + 1) * GRID_S
    smooth = 0.5 / GRID_S
    knots = np.array(speed, float)
    v = gaussian_filter1d(np.interp(t, knots[:, 0], knots[:, 1]), smooth, mode="nearest")
    yaw = np.full_like(t, np.radians(heading_deg))
    for begin, length, angle in turns:
        yaw += np.radians(angle) * np.clip((t - begin) / length, 0.0, 1.0)
    yaw = gaussian_filter1d(yaw, smooth, mode="nearest")
    way = np.cumsum(v) * GRID_S
    pitch = slope * np.sin(way / 150.0)
    lateral = v * np.gradient(yaw, t)
    roll = -0.006 * gaussian_filter1d(lateral, smooth)
    vel = v[:, None] * np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], axis=1
    )
    if slip_seed is not None:
        rng = np.random.default_rng(slip_seed)
        slide = gaussian_filter1d(rng.standard_normal((2, len(t))), smooth, axis=1)
        # the filtered noise keeps the white noise's density, one over the grid step
        density = np.hypot(0.04, 0.03 * gaussian_filter1d(lateral, smooth))
        slide *= density / np.sqrt(GRID_S) * np.minimum(np.abs(v) / 3.0, 1.0)
        zero = np.zeros_like(roll)
        body = np.stack([zero, slide[0], 2.0 * slide[1]], axis=1)
        vel = vel + np.einsum("nij,nj->ni", _euler(roll, pitch, yaw), body)
    lat, lon, height = origin_deg
    return Motion(
        duration,
        (np.radians(lat), np.radians(lon), height),
        CubicSpline(t, vel),
        CubicSpline(t, np.stack([roll, pitch, yaw], axis=1)),
    )


def city_drive(
    duration: float,
    seed: int,
    rest_s: float = 8.0,
    origin_deg: tuple[float, float, float] = (-35.28, 149.13, 580.0),
    start_speed: float = 0.0,
    slip: bool = False,
) -> Motion:
    """Stops, bends and straights at random; at rest for ``rest_s`` unless it starts moving."""
    rng = np.random.default_rng(seed)
    speed = [(0.0, start_speed), (0.0 if start_speed else rest_s, start_speed)]
    now, v = speed[-1]
    while now < duration:
        want = 0.0 if rng.random() < 0.2 and v > 0 else rng.uniform(6.0, 18.0)
        now += abs(want - v) / rng.uniform(1.0, 2.2) + 0.2
        speed.append((now, want))
        now += rng.uniform(3.0, 8.0) if want == 0.0 else rng.uniform(6.0, 20.0)
        speed.append((now, want))
        v = want
    knots = np.array(speed)
    turns, now = [], rest_s + 6.0
    while now < duration - 10.0:
        length = rng.uniform(4.0, 8.0)
        typical = float(np.interp(now + 0.5 * length, knots[:, 0], knots[:, 1]))
        slowest = float(np.interp(np.linspace(now, now + length, 9), *knots.T).min())
        if slowest > 4.0:
            angle = rng.choice([-90.0, 90.0, -45.0, 45.0, 25.0]) * min(1.0, 12.0 / typical)
            turns.append((now, length, float(angle)))
            now += length
        now += rng.uniform(3.0, 15.0)
    return make_motion(
        speed,
        turns,
        duration,
        origin_deg,
        heading_deg=float(rng.uniform(-180.0, 180.0)),
        slip_seed=seed if slip else None,
    )


@dataclass(frozen=True)
class Sensor:
    """Errors of an inertial sensor in SI units; densities per root hertz. ``vibration`` of the
    moving car in m/s^2, which tells driving from standing."""

    gyro_noise: float = 3e-4
    accel_noise: float = 3e-3
    gyro_bias: tuple[float, float, float] = (0.006, -0.004, 0.003)
    accel_bias: tuple[float, float, float] = (0.10, -0.08, 0.05)
    gyro_scale: tuple[float, float, float] = (0.004, -0.003, 0.005)
    accel_scale: tuple[float, float, float] = (-0.003, 0.004, 0.002)
    gyro_walk: float = 1e-5
    accel_walk: float = 2e-4
    vibration: float = 0.04


PERFECT = Sensor(0.0, 0.0, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, 0.0, 0.0, 0.0)


class _Readings(NamedTuple):
    gyro: FloatArray
    accel: FloatArray
    speed: FloatArray


def record(
    motion: Motion,
    sensor: Sensor,
    seed: int,
    rate: float = 100.0,
    delay_s: float = 0.0,
    c_v_s: FloatArray | None = None,
    lost: Sequence[tuple[float, float]] = (),
) -> ImuData:
    """Readings stamped ``delay_s`` late, in sensor axes where ``c_v_s`` [3, 3] is given."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(motion.duration * rate) + 1) / rate
    # in pieces: a long drive's attitude matrices would fill the memory
    pieces = [
        _Readings(true.gyro, true.accel, np.linalg.norm(true.vel, axis=1))
        for true in (motion.at(part) for part in np.array_split(t, len(t) // 100_000 + 1))
    ]
    true_gyro = np.concatenate([p.gyro for p in pieces])
    true_accel = np.concatenate([p.accel for p in pieces])
    lively = np.concatenate([np.minimum(p.speed / 8.0, 1.0) for p in pieces])
    del pieces
    out = []
    for signal, bias, scale, noise, walk in (
        (true_gyro, sensor.gyro_bias, sensor.gyro_scale, sensor.gyro_noise, sensor.gyro_walk),
        (true_accel, sensor.accel_bias, sensor.accel_scale, sensor.accel_noise, sensor.accel_walk),
    ):
        drift = np.cumsum(rng.standard_normal(signal.shape), axis=0) * walk / np.sqrt(rate)
        white = rng.standard_normal(signal.shape) * noise * np.sqrt(rate)
        out.append(signal * (1.0 + np.array(scale)) + np.array(bias) + drift + white)
    gyro, accel = out
    accel = accel + rng.standard_normal(accel.shape) * sensor.vibration * lively[:, None]
    if c_v_s is not None:
        gyro, accel = gyro @ c_v_s, accel @ c_v_s
    keep = np.ones(len(t), bool)
    for begin, length in lost:
        keep &= (t < begin) | (t >= begin + length)
    t_ns = BASE_NS + np.rint((t + delay_s) * 1e9).astype(np.int64)
    return ImuData(t_ns[keep], gyro[keep], accel[keep], axes_known=c_v_s is None)


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
        geoid_sep_m=np.zeros(n),
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


def errors(estimate: Trajectory, motion: Motion, late_s: float = 0.0) -> FloatArray:
    """Position (m NED), velocity and rotation (rad NED) errors [n, 9] at the estimate's rows.

    The rows' stamps are ``late_s`` later than the instants whose truth is compared.
    """
    t = (estimate.t_ns - BASE_NS) * 1e-9 - late_s
    true = motion.at(t)
    pos = np.stack(
        pymap3d.geodetic2ned(
            estimate.lat_rad,
            estimate.lon_rad,
            estimate.height_m,
            true.lat,
            true.lon,
            true.height,
            deg=False,
        ),
        axis=1,
    )
    c = _euler(*estimate.rpy.T)
    turn = c @ np.swapaxes(true.c_n_b, 1, 2)
    phi = 0.5 * np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    return np.concatenate([pos, estimate.vel_ned - true.vel, phi], axis=1)


def horizontal_rms(error: FloatArray) -> float:
    """RMS of the horizontal position error over rows [n, >= 2]."""
    return float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)))
