"""What logs do to a receiver's fixes: other units, turned courses, values that repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.earth import metres_per_radian
from automap.records import BoolArray, Fixes, FloatArray
from automap.sync.epoch_means import AROUND, BEFORE
from automap.sync.receiver_path import receiver_path


def scaled(fixes: Fixes, factor: float) -> Fixes:
    """Horizontal velocities in another unit."""
    return replace(fixes, vel_ned=fixes.vel_ned * [factor, factor, 1.0])


def redirected(fixes: Fixes, matrix: list[list[float]]) -> Fixes:
    """Horizontal velocities through ``matrix`` [2, 2]."""
    velocity = fixes.vel_ned.copy()
    velocity[:, :2] = velocity[:, :2] @ np.array(matrix).T
    return replace(fixes, vel_ned=velocity)


def upside_down(fixes: Fixes) -> Fixes:
    """Vertical velocities with the wrong sign."""
    return replace(fixes, vel_ned=fixes.vel_ned * [1.0, 1.0, -1.0])


def held(fixes: Fixes, rows: BoolArray, *columns: str) -> Fixes:
    """``columns`` repeat what they were before, in the rows [n] of one stretch."""
    first = max(int(np.flatnonzero(rows)[0]) - 1, 0)
    changed = {}
    for name in columns:
        values = getattr(fixes, name).copy()
        values[rows] = values[first]
        changed[name] = values
    return replace(fixes, **changed)


def zeroed(fixes: Fixes, rows: BoolArray) -> Fixes:
    """Velocities of the rows [n] are zero."""
    return replace(fixes, vel_ned=np.where(rows[:, None], 0.0, fixes.vel_ned))


def shifted(fixes: Fixes, rows: BoolArray | FloatArray, metres: float) -> Fixes:
    """Positions lie ``metres`` times ``rows`` [n] further north."""
    per_lat = metres_per_radian(fixes.lat_rad, 0.0)[0]
    return replace(fixes, lat_rad=fixes.lat_rad + rows * metres / per_lat)


def driving(fixes: Fixes, seconds: float) -> BoolArray:
    """Rows [n] of the stretch of so many seconds in which the speed changes most."""
    t = fixes.gps_s - fixes.gps_s[0]
    speed: FloatArray = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    starts = np.arange(5.0, t[-1] - seconds - 5.0)
    stretches = [(t >= start) & (t <= start + seconds) for start in starts]
    # moving at the start, so that what repeats is a motion
    spread = [
        float(np.std(speed[rows])) * float(speed[rows].mean()) * float(speed[rows][0] > 3.0)
        for rows in stretches
    ]
    return stretches[int(np.argmax(spread))]


def derived(fixes: Fixes, interval: str, digits: int = 2) -> Fixes:
    """Fixes whose velocities are the ways of their positions, as tables print them."""
    path = receiver_path(fixes)
    way = np.diff(path.place) / np.diff(path.t)
    velocity = np.full((len(fixes), 3), np.nan)
    if interval == AROUND:
        told, rows = np.gradient(path.place, path.t), path.row
    else:
        told, rows = way, path.row[1:] if interval == BEFORE else path.row[:-1]
    velocity[rows, 0], velocity[rows, 1] = told.real, told.imag
    return replace(fixes, vel_ned=np.round(velocity, digits))
