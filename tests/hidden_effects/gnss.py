"""What a receiver reports of the true motion of its antenna.

``gnss_latency`` > 0: the data are older than their tag; ``gnss_velocity_latency``: the velocity
still older than the position; ``gnss_velocity_lag``: a first-order low-pass of the velocity.
``gnss_lever_arm``: the antenna is that far from where the manifest says.

With a ``Replay`` the receiver is a recorded one: its delays act on this motion, and its errors are
laid over it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tests.hidden_effects.extras import FixExtra
from tests.hidden_effects.geodesy import Array, meridian_radius, normal_radius
from tests.hidden_effects.imu import Effects
from tests.hidden_effects.motion import Motion, displaced, to_nav
from tests.hidden_effects.noise import GnssNoise, coloured, heavy
from tests.hidden_effects.real_receiver import Replay
from tests.hidden_effects.route import MARGIN_S


@dataclass(frozen=True)
class GnssRecord:
    """``tag`` [n] s of the recording; ``lat``, ``lon`` rad, ``height`` m [n]; ``vel`` [n, 3]
    m/s; ``sd_pos``, ``sd_vel`` [n, 3] the receiver's own figures; ``error_pos`` [n, 3] m and
    ``error_vel`` [n, 3] against the ideal antenna of the manifest at ``tag``. ``hdop`` [n] is all
    that a recorded receiver states."""

    tag: Array
    lat: Array
    lon: Array
    height: Array
    vel: Array
    sd_pos: Array
    sd_vel: Array
    error_pos: Array
    error_vel: Array
    hdop: Array | None = None


def record_gnss(
    motion: Motion,
    effects: Effects,
    noise: GnssNoise,
    rng: np.random.Generator,
    lever_arm: Array,
    extra: FixExtra | None = None,
    tag: Array | None = None,
    replay: Replay | None = None,
) -> GnssRecord:
    """Fixes at ``noise.rate_hz`` of an antenna at ``lever_arm`` [3] m by the manifest, or at
    the instants ``tag`` [n]; of a ``replay`` at its tags."""
    if replay is not None:
        tag = replay.tags(motion.seconds)
    elif tag is None:
        tag = draw_tags(motion.seconds, noise, rng)
    n = len(tag)
    latency = effects.get("gnss_latency", {}).get("s", 0.0)
    if replay is not None:
        latency += replay.series().position_s
    later = effects.get("gnss_velocity_latency", {}).get("s", 0.0)
    lag = effects.get("gnss_velocity_lag", {}).get("s", 0.0)
    shift = effects.get("gnss_lever_arm", {})
    arm = lever_arm + np.array([shift.get(axis, 0.0) for axis in "xyz"])
    then = motion.at(tag - latency)
    lat, lon, height = displaced(then, arm)
    hdop = None
    more_pos, more_vel = np.zeros((n, 3)), np.zeros((n, 3))
    if extra is not None:
        more_pos, more_vel = extra(motion, then.t)
    datum = effects.get("gnss_datum_shift", {})
    more_pos = more_pos + [datum.get(name, 0.0) for name in "ned"]
    if replay is None:
        vel = _antenna_velocity(motion, tag - latency - later, arm, lag)
        noise_pos, noise_vel, sd_pos, sd_vel = _noise(tag, effects, noise, rng)
    else:
        noise_pos, along, across, hdop = replay.errors(motion.seconds)
        vel = _recorded_velocity(motion, replay, tag, arm, along, across)
        noise_vel = np.zeros((n, 3))
        more_vel = np.where(np.linalg.norm(vel, axis=1)[:, None] > 0.0, more_vel, 0.0)
        sd_pos = sd_vel = np.full((n, 3), np.nan)
    wrong = more_pos + noise_pos
    radius_n, radius_e = meridian_radius(lat) + height, normal_radius(lat) + height
    lat = lat + wrong[:, 0] / radius_n
    lon = lon + wrong[:, 1] / (radius_e * np.cos(lat))
    height = height - wrong[:, 2]
    vel = vel + more_vel + noise_vel
    now = motion.at(tag)
    ideal = displaced(now, lever_arm)
    error_pos = np.column_stack(
        [
            (lat - ideal[0]) * radius_n,
            (lon - ideal[1]) * radius_e * np.cos(ideal[0]),
            ideal[2] - height,
        ]
    )
    swing = to_nav(now.C_n_b, np.cross(now.rate_nav, np.broadcast_to(lever_arm, (n, 3))))
    error_vel = vel - now.vel_ned - swing
    return GnssRecord(tag, lat, lon, height, vel, sd_pos, sd_vel, error_pos, error_vel, hdop)


def _recorded_velocity(
    motion: Motion, replay: Replay, tag: Array, arm: Array, along: Array, across: Array
) -> Array:
    """Velocity NED [n, 3] as a recorded receiver tells it: a speed and a course, each of its own
    instant, no vertical part, nothing below its threshold."""
    series = replay.series()
    swift = _antenna_velocity(motion, tag - series.speed_s, arm, 0.0)
    turned = _antenna_velocity(motion, tag - series.course_s, arm, 0.0)
    true_speed = np.hypot(swift[:, 0], swift[:, 1])
    speed = np.maximum(true_speed + along, 0.0)
    course = np.arctan2(turned[:, 1], turned[:, 0])
    course = course + np.arctan2(across, np.maximum(speed, 1.0))
    speed = np.where(true_speed < series.rest, 0.0, speed)
    return np.column_stack([speed * np.cos(course), speed * np.sin(course), np.zeros_like(speed)])


def draw_tags(seconds: float, noise: GnssNoise, rng: np.random.Generator) -> Array:
    """Times of the fixes, with the outage that ``noise`` asks for."""
    tag = np.arange(1, round(seconds * noise.rate_hz)) / noise.rate_hz
    if noise.outage_s > 0.0:
        begin = rng.uniform(0.3, 0.8) * seconds
        tag = tag[(tag < begin) | (tag > begin + noise.outage_s)]
    return np.asarray(tag)


def _antenna_velocity(motion: Motion, t: Array, arm: Array, lag: float) -> Array:
    def velocity(at: Array) -> Array:
        state = motion.at(at)
        swing = np.cross(state.rate_nav, np.broadcast_to(arm, (len(at), 3)))
        return state.vel_ned + to_nav(state.C_n_b, swing)

    if lag <= 0.0:
        return velocity(t)
    step = 0.005
    grid = np.arange(-MARGIN_S + 1.0, motion.seconds + 1.0, step)
    # exact response to a velocity that is linear between grid points
    decay = np.exp(-step / lag)
    b0 = 1.0 - lag / step * (1.0 - decay)
    b1 = lag / step * (1.0 - decay) - decay
    raw = velocity(grid)
    smooth = np.empty_like(raw)
    for axis in range(3):
        start = [(b1 + decay) * raw[0, axis]]
        smooth[:, axis], _ = lfilter([b0, b1], [1.0, -decay], raw[:, axis], zi=start)
    return np.column_stack([np.interp(t, grid, smooth[:, axis]) for axis in range(3)])


def _noise(
    tag: Array, effects: Effects, noise: GnssNoise, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Errors of position and velocity and the receiver's own figures for them, each [n, 3]."""
    n = len(tag)
    axes = np.array([1.0, 1.0, noise.vertical])
    factor = effects.get("gnss_noise_scale", {}).get("factor", 1.0)
    wander = effects.get("gnss_correlated_noise", {})
    sigma, constant = wander.get("sigma", noise.wander), wander.get("tau", noise.wander_s)
    pos = heavy(rng, (n, 3), noise.tail) * noise.white * axes
    vel = heavy(rng, (n, 3), noise.tail) * noise.velocity * axes
    index = np.rint(tag * noise.rate_hz).astype(np.int64)  # the wander goes on through an outage
    for axis in range(3):
        long = index[-1] + 1
        slow = coloured(rng, long, sigma * axes[axis], constant, 1.0 / noise.rate_hz)
        pos[:, axis] += slow[index]
        if noise.velocity_wander > 0.0:
            slow = coloured(
                rng,
                long,
                noise.velocity_wander * axes[axis],
                noise.velocity_wander_s,
                1.0 / noise.rate_hz,
                noise.tail,
            )
            vel[:, axis] += slow[index]
    pos, vel = factor * pos, factor * vel
    wild = rng.random(n) < effects.get("gnss_outliers", {}).get("fraction", 0.0)
    direction = rng.normal(size=(n, 3)) * wild[:, None]
    # far against the fix's own accuracy, so that it is an outlier and not a tail
    far = rng.uniform(8.0, 40.0, (n, 1))
    pos = pos + direction * far * np.hypot(noise.white, noise.wander) * axes
    vel = vel + direction * far * 0.5 * noise.velocity * axes
    told_pos = np.hypot(noise.white, noise.wander) * axes
    told_vel = np.hypot(noise.velocity, noise.velocity_wander) * axes
    return pos, vel, np.tile(told_pos, (n, 1)), np.tile(told_vel, (n, 1))
