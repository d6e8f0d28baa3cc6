"""A drive over hills, fixes of it whose heights are in any unit, and fixes of a town drive."""

from __future__ import annotations

import numpy as np

from automap.records import Fixes, FloatArray, Trajectory
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


def hilly(seconds: int = 600, climb: float = 0.04, lean: float = 0.0) -> Trajectory:
    """A drive over hills at 15 m/s, 10 rows a second; ``climb`` the steepest slope."""
    n = seconds * 10
    t: FloatArray = np.asarray(0.1 * np.arange(n))
    pitch = climb * np.sin(2.0 * np.pi * t / 80.0)
    height = 500.0 + np.cumsum(15.0 * np.tan(pitch)) * 0.1
    zero, three = np.zeros(n), np.zeros((n, 3))
    velocity = np.stack([15.0 + zero, zero, -15.0 * np.tan(pitch)], axis=1)
    rpy = np.stack([lean + zero, pitch, zero], axis=1)
    stamps = np.rint(t * 1e9).astype(np.int64)
    sds = three + 1.0, three + 0.1, three + 0.01
    return Trajectory(
        stamps,
        np.asarray(1.4e9 + t),
        np.asarray(15.0 * t / 6.37e6),
        zero,
        height,
        velocity,
        rpy,
        *sds,
    )


def fixes_of(path: Trajectory, factor: float, wander: float, seed: int) -> Fixes:
    """Fixes a second apart whose heights are ``factor`` times the path's and wander by as much."""
    rng = np.random.default_rng(seed)
    rows = np.arange(0, len(path), 10)
    n, nothing, whole = len(rows), np.full(len(rows), np.nan), np.full(len(rows), -1)
    error = np.zeros(n)
    for i in range(1, n):
        error[i] = 0.983 * error[i - 1] + wander * np.sqrt(1.0 - 0.983**2) * rng.standard_normal()
    return Fixes(
        *(path.gps_s[rows], path.lat_rad[rows], path.lon_rad[rows]),
        factor * (path.height_m[rows] + error),
        *(path.vel_ned[rows], np.full((n, 3), np.nan), np.full((n, 3), np.nan)),
        *(np.full(n, 3), whole, nothing, nothing, whole, whole),
    )


def town_fixes() -> Fixes:
    """Four minutes of fixes a second apart."""
    return receive(city_drive(240.0, 4), Receiver(rate=1.0), 5)
