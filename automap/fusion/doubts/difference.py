"""How far a path differs from another one, and from itself at another instant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import local_ned
from automap.fusion import limits
from automap.fusion.doubts.limits import STRETCHES_S
from automap.interpolation import poses_at_gps
from automap.records import FloatArray, Trajectory


@dataclass(frozen=True)
class Difference:
    """Sizes of differences at a path's rows: ``position`` [m] m horizontally, ``velocity`` [m, 3]
    m/s NED, ``heading`` [m] and ``tilt`` [m, 2], roll and pitch, rad, ``height`` [m] m; zero where
    there is nothing to compare."""

    position: FloatArray
    velocity: FloatArray
    heading: FloatArray
    height: FloatArray
    tilt: FloatArray


def no_difference(n: int) -> Difference:
    """Of ``n`` rows."""
    return Difference(*(np.zeros(shape) for shape in (n, (n, 3), n, n, (n, 2))))


def between(path: Trajectory, other: Trajectory) -> Callable[[FloatArray], Difference]:
    """From ``path`` to ``other``, at rows of the path given by their ``gps_s``: distances row by
    row, velocities and headings by their root mean square over the seconds about a row, for what
    two paths differ by sways from row to row.

    A heading that is a course is one while the vehicle drives, and lasts until it does again.
    """
    at = poses_at_gps(path, other.gps_s)
    rows = np.flatnonzero(at.covered)
    if not len(rows):
        return lambda gps_s: no_difference(len(gps_s))
    t = other.gps_s[rows]
    ref = (float(other.lat_rad[0]), float(other.lon_rad[0]), float(other.height_m[0]))
    one = local_ned(other.lat_rad[rows], other.lon_rad[rows], other.height_m[rows], ref)
    two = local_ned(at.lat_rad[rows], at.lon_rad[rows], at.height_m[rows], ref)
    apart = (one.reshape(-1, 3) - two.reshape(-1, 3))[:, :2]
    slower = other.vel_ned[rows] - at.vel_ned[rows]
    driving = np.hypot(*other.vel_ned[rows, :2].T) > limits.DRIVING_SPEED
    turned = np.angle(np.exp(1j * (other.rpy[rows, 2] - at.rpy[rows, 2])))
    far, sizes = np.hypot(*apart.T), [_size(t, slower[:, k]) for k in range(3)]
    turned_by = _size(t[driving], turned[driving]) if driving.any() else None

    def at_rows(gps_s: FloatArray) -> Difference:
        velocity = np.column_stack([np.interp(gps_s, t, size) for size in sizes])
        heading = np.zeros(len(gps_s))
        if turned_by is not None:
            heading = np.interp(gps_s, t[driving], turned_by)
        none = no_difference(len(gps_s))
        return replace(none, position=np.interp(gps_s, t, far), velocity=velocity, heading=heading)

    return at_rows


def off_course(path: Trajectory, other: Trajectory) -> float:
    """Root mean square of the angle, rad, between the headings of ``path`` and the courses of
    another path while the vehicle drives; infinite where it never does."""
    at = poses_at_gps(path, other.gps_s)
    rows = at.covered & (np.hypot(*other.vel_ned[:, :2].T) > limits.DRIVING_SPEED)
    if not rows.any():
        return math.inf
    turned = np.angle(np.exp(1j * (other.rpy[rows, 2] - at.rpy[rows, 2])))
    return float(np.sqrt(np.mean(turned**2)))


def _size(t: FloatArray, values: FloatArray) -> FloatArray:
    """Root mean square [k] of ``values`` [k] at ``t`` [k] over a stretch about each."""
    half = 0.5 * STRETCHES_S[0]
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(values) ** 2)])
    first = np.searchsorted(t, t - half, side="left")
    stop = np.searchsorted(t, t + half, side="right")
    return np.asarray(np.sqrt((total[stop] - total[first]) / (stop - first)))


def within(path: Trajectory, late_s: FloatArray, rows: slice) -> Difference:
    """From each of the ``rows`` [m] to the path ``late_s`` [m] s before or after it, whichever is
    further."""
    if not late_s.any():
        return no_difference(len(late_s))
    ref = (float(path.lat_rad[0]), float(path.lon_rad[0]), float(path.height_m[0]))
    # and one row more than may be asked for
    t, most = path.gps_s[rows], float(late_s.max())
    first = max(int(np.searchsorted(path.gps_s, t[0] - most)) - 1, 0)
    near = slice(first, int(np.searchsorted(path.gps_s, t[-1] + most, "right")) + 1)
    at, place = path.gps_s[near], (path.lat_rad[near], path.lon_rad[near], path.height_m[near])
    level = local_ned(*place, ref).reshape(-1, 3)[:, :2]
    values = np.column_stack(
        [level, place[2], path.vel_ned[near], np.unwrap(path.rpy[near], axis=0)],
    )
    own = values[rows.start - first : rows.stop - first]
    both = [
        np.abs(np.column_stack([np.interp(t + s * late_s, at, v) for v in values.T]) - own)
        for s in (-1.0, 1.0)
    ]
    position = np.maximum(*(np.hypot(off[:, 0], off[:, 1]) for off in both))
    off = np.maximum(*both)
    return Difference(position, off[:, 3:6], off[:, 8], off[:, 2], off[:, 6:8])
