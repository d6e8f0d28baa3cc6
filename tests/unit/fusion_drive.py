"""Drives with known truth for the fusion's tests, built apart from the project's simulator.

The motion is given on the tangent plane of the start, in Earth-fixed axes; readings follow
from Newton's law in that plane. No transport rate and no navigation-frame formula enters, so
that a sign shared by simulator and filter cannot hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pymap3d

from automap.records import ClockModel, FloatArray, ImuData, Trajectory
from tests.unit.fusion_motion import Motion, _euler
from tests.unit.fusion_receiver import GPS0

BASE_NS = 5_000_000_000
CLOCK = ClockModel(BASE_NS, GPS0, 0.0, 1e-4, 1e-9, "identity")


@dataclass(frozen=True)
class Sensor:
    """Errors of an inertial sensor in SI units; densities per root hertz. ``vibration`` of the
    moving car in m/s^2, which tells driving from standing. ``gyro_angles`` xy xz yx yz zx zy and
    ``accel_angles`` yx zx zy rad: what an axis, named first, reads of another."""

    gyro_noise: float = 3e-4
    accel_noise: float = 3e-3
    gyro_bias: tuple[float, float, float] = (0.006, -0.004, 0.003)
    accel_bias: tuple[float, float, float] = (0.10, -0.08, 0.05)
    gyro_scale: tuple[float, float, float] = (0.004, -0.003, 0.005)
    accel_scale: tuple[float, float, float] = (-0.003, 0.004, 0.002)
    gyro_walk: float = 1e-5
    accel_walk: float = 2e-4
    vibration: float = 0.04
    gyro_angles: tuple[float, ...] = (0.0,) * 6
    accel_angles: tuple[float, ...] = (0.0,) * 3


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
    crooked = np.zeros((2, 3, 3))
    crooked[0][~np.eye(3, dtype=bool)] = sensor.gyro_angles
    crooked[1][np.tril_indices(3, -1)] = sensor.accel_angles
    gyro, accel = gyro + true_gyro @ crooked[0].T, accel + true_accel @ crooked[1].T
    accel = accel + rng.standard_normal(accel.shape) * sensor.vibration * lively[:, None]
    if c_v_s is not None:
        gyro, accel = gyro @ c_v_s, accel @ c_v_s
    keep = np.ones(len(t), bool)
    for begin, length in lost:
        keep &= (t < begin) | (t >= begin + length)
    t_ns = BASE_NS + np.rint((t + delay_s) * 1e9).astype(np.int64)
    return ImuData(t_ns[keep], gyro[keep], accel[keep], axes_known=c_v_s is None)


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
