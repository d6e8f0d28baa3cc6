"""A simulated car for the tests of sync: speed and heading change, the IMU is mounted anyhow."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from automap.records import NO_TIME, Fixes, FixType, FloatArray, ImuData

GPS_START = 1_400_000_000.0


def drive(
    seconds: float = 180.0,
    imu_rate: float = 100.0,
    mounting: Rotation | None = None,
    seed: int = 3,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Times [n] from 0, gyro [n, 3], accel [n, 3] in sensor axes, speed and heading [n, 2]."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / imu_rate)
    speed, rate = np.full(len(t), 10.0), np.zeros(len(t))
    for _ in range(int(seconds / 8)):
        centre, width = rng.uniform(0, seconds), rng.uniform(1.0, 3.0)
        bump = np.exp(-0.5 * ((t - centre) / width) ** 2)
        speed += rng.uniform(-4.0, 4.0) * bump
        rate += rng.uniform(-0.4, 0.4) * bump
    speed = np.maximum(speed, 3.0)
    heading = np.cumsum(rate) / imu_rate
    gyro = np.column_stack([np.zeros(len(t)), np.zeros(len(t)), rate])
    accel = np.column_stack([np.gradient(speed, t), speed * rate, np.full(len(t), -9.81)])
    turn = mounting or Rotation.identity()
    gyro, accel = turn.inv().apply(gyro), turn.inv().apply(accel)
    gyro += rng.normal(0, 0.01, gyro.shape) + rng.normal(0, 0.02, 3)
    accel += rng.normal(0, 0.2, accel.shape) + rng.normal(0, 0.1, 3)
    return t, gyro, accel, np.column_stack([speed, heading])


def fixes_of(
    t: FloatArray, motion: FloatArray, rate: float = 5.0, seed: int = 5, noise: float = 0.05
) -> Fixes:
    """Receiver epochs of a ``drive`` with white velocity noise."""
    rng = np.random.default_rng(seed)
    epochs = np.arange(t[0] + 0.3, t[-1], 1.0 / rate)
    speed, heading = (np.interp(epochs, t, motion[:, i]) for i in range(2))
    v = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), np.zeros(len(epochs))])
    full = motion[:, :1] * np.column_stack([np.cos(motion[:, 1]), np.sin(motion[:, 1])])
    path = np.cumsum(full * (t[1] - t[0]), axis=0)
    north, east = (np.interp(epochs, t, path[:, i]) for i in range(2))
    n = len(epochs)
    unknown = np.full(n, np.nan)
    return Fixes(
        gps_s=GPS_START + epochs,
        lat_rad=0.5 + north / 6.371e6,
        lon_rad=0.3 + east / (6.371e6 * np.cos(0.5)),
        height_m=np.full(n, 100.0),
        vel_ned=v + rng.normal(0, noise, v.shape),
        sd_pos_ned=np.full((n, 3), np.nan),
        sd_vel_ned=np.full((n, 3), np.nan),
        fix_type=np.full(n, FixType.THREE_D, np.int64),
        n_sats=np.full(n, -1, np.int64),
        hdop=unknown,
        geoid_sep_m=unknown,
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def imu_of(t: FloatArray, gyro: FloatArray, accel: FloatArray, start_ns: int) -> ImuData:
    """The recording with stamps that begin at ``start_ns``."""
    return ImuData(start_ns + np.rint(t * 1e9).astype(np.int64), gyro, accel, axes_known=False)
