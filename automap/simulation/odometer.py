"""What counting wheels report of the vehicle's speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from automap.effects.measured import Values
from automap.effects.user import user_signal
from automap.effects.vehicle import lever_arm_motion, wheel_instants, wheel_speed
from automap.records import FloatArray, IntArray, WheelSpeed
from automap.simulation.imu import true_signals
from automap.simulation.scenario import Odometer
from automap.simulation.trajectory import DriveMotion

_STANDING = 0.05
"""Below this speed in m/s no pulse comes in time and the wheels are said to stand."""


def forward_speed(drive: DriveMotion, t_s: FloatArray) -> FloatArray:
    """Forward speed [n] m/s at ``t_s`` [n] of the point that does not slide."""
    motion = drive.at(t_s)
    _, swing = lever_arm_motion(motion.C_n_b, motion.turn_rate, drive.axle_m)
    return np.asarray(np.einsum("nj,nj->n", motion.C_n_b[:, :, 0], motion.vel_ned + swing))


def reported_speed(drive: DriveMotion, t_s: FloatArray, errors: Values) -> FloatArray:
    """What wheels without noise report [n] m/s, stamped ``t_s`` [n] s of the drive."""
    told = np.clip(wheel_instants(t_s, errors), 0.0, drive.duration_s)
    return wheel_speed(
        forward_speed(drive, told),
        errors,
        lambda name: user_signal(name, replace(true_signals(drive.at(told)), time=told)),
    )


def count_wheels(
    drive: DriveMotion,
    setup: Odometer,
    errors: Values,
    host_ns: Callable[[FloatArray], IntArray],
    rng: np.random.Generator,
) -> WheelSpeed:
    """Speeds at the setup's rate; ``host_ns`` gives host stamps of seconds of the drive."""
    t: FloatArray = np.arange(0.0, drive.duration_s, 1.0 / setup.rate_hz)
    speed = reported_speed(drive, t, errors)
    moving = np.abs(speed) > _STANDING
    speed = np.where(moving, speed + rng.standard_normal(len(t)) * setup.noise, 0.0)
    if setup.resolution > 0.0:
        speed = np.rint(speed / setup.resolution) * setup.resolution
    return WheelSpeed(host_ns(t), speed)
