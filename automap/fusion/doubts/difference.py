"""How far a path differs from another one, and from itself at another instant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.fusion import limits
from automap.fusion.doubts.limits import STRETCHES_S
from automap.interpolation import poses_at_gps
from automap.records import FloatArray, Trajectory


@dataclass(frozen=True)
class Difference:
    """Sizes of differences at a path's rows: ``position`` [m] m horizontally, ``velocity`` [m, 3]
    m/s NED, ``heading`` [m] rad; zero where there is nothing to compare."""

    position: FloatArray
    velocity: FloatArray
    heading: FloatArray


def no_difference(n: int) -> Difference:
    """Of ``n`` rows."""
    return Difference(np.zeros(n), np.zeros((n, 3)), np.zeros(n))


def between(path: Trajectory, other: Trajectory) -> Difference:
    """From ``path`` to ``other``: distances row by row, velocities and headings by their root mean
    square over the seconds about a row, for what two paths differ by sways from row to row.

    A heading that is a course is one while the vehicle drives, and lasts until it does again.
    """
    at = poses_at_gps(path, other.gps_s)
    rows = np.flatnonzero(at.covered)
    if not len(rows):
        return no_difference(len(path.gps_s))
    t = other.gps_s[rows]
    ref = (float(other.lat_rad[0]), float(other.lon_rad[0]), float(other.height_m[0]))
    one = local_ned(other.lat_rad[rows], other.lon_rad[rows], other.height_m[rows], ref)
    two = local_ned(at.lat_rad[rows], at.lon_rad[rows], at.height_m[rows], ref)
    apart = (one.reshape(-1, 3) - two.reshape(-1, 3))[:, :2]
    slower = other.vel_ned[rows] - at.vel_ned[rows]
    driving = np.hypot(*other.vel_ned[rows, :2].T) > limits.DRIVING_SPEED
    turned = np.angle(np.exp(1j * (other.rpy[rows, 2] - at.rpy[rows, 2])))
    velocity = np.column_stack([_size(t, slower[:, k], path.gps_s) for k in range(3)])
    heading = np.zeros(len(path.gps_s))
    if driving.any():
        heading = _size(t[driving], turned[driving], path.gps_s)
    return Difference(np.interp(path.gps_s, t, np.hypot(*apart.T)), velocity, heading)


def off_course(path: Trajectory, other: Trajectory) -> float:
    """Root mean square of the angle, rad, between the headings of ``path`` and the courses of
    another path while the vehicle drives; infinite where it never does."""
    at = poses_at_gps(path, other.gps_s)
    rows = at.covered & (np.hypot(*other.vel_ned[:, :2].T) > limits.DRIVING_SPEED)
    if not rows.any():
        return math.inf
    turned = np.angle(np.exp(1j * (other.rpy[rows, 2] - at.rpy[rows, 2])))
    return float(np.sqrt(np.mean(turned**2)))


def _size(t: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Root mean square of ``values`` [k] at ``t`` [k] over a stretch about each, at ``at`` [m]."""
    half = 0.5 * STRETCHES_S[0]
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(values) ** 2)])
    first = np.searchsorted(t, t - half, side="left")
    stop = np.searchsorted(t, t + half, side="right")
    return np.asarray(np.interp(at, t, np.sqrt((total[stop] - total[first]) / (stop - first))))


def within(path: Trajectory, late_s: FloatArray) -> Difference:
    """From each row to the path ``late_s`` [m] s before or after it, whichever is further."""
    n = len(path.gps_s)
    if not late_s.any():
        return no_difference(n)
    t = path.gps_s
    ref = (float(path.lat_rad[0]), float(path.lon_rad[0]), float(path.height_m[0]))
    place = local_ned(path.lat_rad, path.lon_rad, path.height_m, ref).reshape(-1, 3)[:, :2]
    values = np.column_stack([place, path.vel_ned, np.unwrap(path.rpy[:, 2])])
    both = [
        np.abs(np.column_stack([np.interp(t + s * late_s, t, v) for v in values.T]) - values)
        for s in (-1.0, 1.0)
    ]
    position = np.maximum(*(np.hypot(off[:, 0], off[:, 1]) for off in both))
    off = np.maximum(*both)
    return Difference(position, off[:, 2:5], off[:, 5])
