"""A receiver's epochs: wandering and white errors, dropouts, and the bytes' arrival."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from automap import earth
from automap.effects.gnss import gauss_markov, low_pass, stands
from automap.effects.limits import COURSE_SPEED
from automap.effects.measured import Distortion, Values, distortion
from automap.effects.terms import ELAPSED, POSITION, VELOCITY
from automap.effects.user import user_signal
from automap.effects.vehicle import lever_arm_motion
from automap.records import NO_TIME, FixErrors, Fixes, FixType, FloatArray, IntArray
from automap.simulation.imu import true_signals
from automap.simulation.receiver_errors import draw_errors
from automap.simulation.replay import Replayed, in_place, other_errors, replay
from automap.simulation.scenario import Gnss
from automap.simulation.trajectory import DriveMotion

_FINE_S = 0.01
"""Steps at which a velocity that passes a low-pass is sampled."""


def ideal_epochs(
    drive: DriveMotion, setup: Gnss, t_s: FloatArray, errors: Values
) -> tuple[FloatArray, FloatArray]:
    """Antenna positions (rad, rad, m) and velocities NED [n, 3] without noise of the epochs
    tagged ``t_s`` [n], in seconds of the drive.

    The antenna stands by the errors' arm away from where the setup says it is.
    """
    on_position, on_velocity = (_distortion(drive, t_s, errors, on) for on in (POSITION, VELOCITY))
    stated = np.asarray(setup.lever_arm_m)
    motion = drive.at(np.clip(t_s + on_position.late, 0.0, drive.duration_s))
    offset, _ = lever_arm_motion(motion.C_n_b, motion.turn_rate, stated + on_position.arm)
    offset = offset + on_position.added
    north, east = earth.metres_per_radian(motion.lat_rad, motion.height_m)
    place = np.stack(
        [
            motion.lat_rad + offset[:, 0] / north,
            motion.lon_rad + offset[:, 1] / east,
            motion.height_m - offset[:, 2],
        ],
        axis=1,
    )
    arm, at_velocity = stated + on_velocity.arm, t_s + on_velocity.late
    if on_velocity.lag > 0.0:
        fine = np.linspace(0.0, drive.duration_s, round(drive.duration_s / _FINE_S) + 1)
        passed = low_pass(_antenna_velocity(drive, fine, arm), float(fine[1]), on_velocity.lag)

    def told(at: FloatArray) -> FloatArray:
        if on_velocity.lag > 0.0:
            return np.stack([np.interp(at, fine, v) for v in passed.T], axis=1)
        return _antenna_velocity(drive, np.clip(at, 0.0, drive.duration_s), arm)

    velocity = told(at_velocity)
    if on_velocity.course_late.any():
        course = told(at_velocity + on_velocity.course_late)
        size = np.hypot(velocity[:, 0], velocity[:, 1])
        length = np.hypot(course[:, 0], course[:, 1])
        turned = length > COURSE_SPEED
        factor = np.where(turned, size / np.where(turned, length, 1.0), 1.0)
        velocity[:, :2] = np.where(turned[:, None], course[:, :2], velocity[:, :2])
        velocity[:, :2] *= factor[:, None]
    return place, on_velocity.longer * velocity + on_velocity.added


def _distortion(drive: DriveMotion, t_s: FloatArray, errors: Values, on: str) -> Distortion:
    """What the errors add up to at the instants that epochs are tagged with."""

    def signal(name: str) -> FloatArray:
        if name == ELAPSED:
            return t_s
        motion = drive.at(np.clip(t_s, 0.0, drive.duration_s))
        # since the first IMU sample, like everywhere
        return user_signal(name, replace(true_signals(motion), time=motion.t_s))

    return distortion(errors, on, len(t_s), signal)


def _antenna_velocity(drive: DriveMotion, t_s: FloatArray, arm: FloatArray) -> FloatArray:
    motion = drive.at(t_s)
    return motion.vel_ned + lever_arm_motion(motion.C_n_b, motion.turn_rate, arm)[1]


def receive(
    drive: DriveMotion,
    setup: Gnss,
    begin_gps_s: float,
    rng: np.random.Generator,
    errors: Values | None = None,
    recorded: FixErrors | None = None,
) -> tuple[Fixes, Replayed | None]:
    """Epochs at whole multiples of the rate in GPS time, and what was replayed for them; without a
    fix the last position is repeated, as receivers do. ``errors`` are those of the effects,
    ``recorded`` those that the setup has replayed.

    Raises:
        ConfigError: recorded errors that do not reach.
    """
    errors = errors or {}
    if recorded is not None:
        errors = other_errors(errors, recorded)
    step = 1.0 / setup.rate_hz
    first = int(np.ceil(begin_gps_s / step - 1e-6))
    count = int(np.floor((begin_gps_s + drive.duration_s) / step)) - first + 1
    gps_s: FloatArray = np.arange(first, first + count) * np.float64(step)
    t_s = gps_s - begin_gps_s
    place, velocity = ideal_epochs(drive, setup, t_s, errors)
    drawn = draw_errors(t_s, step, setup, errors, rng)
    replayed = None
    if recorded is not None and setup.replay is not None:
        replayed = replay(recorded, t_s, setup.replay, rng.spawn(1)[0])
        drawn = in_place(drawn, replayed, _direction(drive, t_s, velocity))
    n_sats = np.clip(np.rint(14 + gauss_markov(count, np.ones(1), step / 20.0, rng)[:, 0]), 6, 30)
    velocity = velocity + drawn.velocity
    velocity[stands(np.hypot(velocity[:, 0], velocity[:, 1]), errors)] = 0.0
    north, east = earth.metres_per_radian(place[:, 0], place[:, 2])
    held, lost = drawn.position_of, drawn.fix_type == FixType.NONE
    velocity, sd_velocity, sd_position = (
        velocity[drawn.velocity_of],
        drawn.sd_velocity,
        drawn.sd_position,
    )
    if setup.format == "nmea":
        velocity[:, 2] = np.nan
        sd_velocity, sd_position = np.full((2, count, 3), np.nan)
    lon = place[:, 1] + drawn.position[:, 1] / east
    lon -= 2.0 * np.pi * np.rint(lon / (2.0 * np.pi))
    fixes = Fixes(
        gps_s=gps_s,
        lat_rad=(place[:, 0] + drawn.position[:, 0] / north)[held],
        lon_rad=lon[held],
        height_m=(place[:, 2] - drawn.position[:, 2])[held],
        vel_ned=velocity,
        sd_pos_ned=sd_position,
        sd_vel_ned=sd_velocity,
        fix_type=drawn.fix_type,
        n_sats=np.where(lost, 3, n_sats).astype(np.int64),
        hdop=np.where(lost, 9.9, 11.0 / n_sats),
        geoid_sep_m=np.full(count, setup.geoid_separation_m),
        offset=np.full(count, -1, np.int64),
        arrival_ns=np.full(count, NO_TIME, np.int64),
    )
    return fixes, replayed


def _direction(drive: DriveMotion, t_s: FloatArray, velocity: FloatArray) -> FloatArray:
    """Where the vehicle goes by its velocity [n, 3], or points where it hardly moves, [n] rad."""
    yaw = drive.at(np.clip(t_s, 0.0, drive.duration_s)).rpy[:, 2]
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > COURSE_SPEED
    return np.where(moving, np.arctan2(velocity[:, 1], velocity[:, 0]), yaw)


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
