"""Pose of a trajectory at any time between its rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.earth import metres_per_radian
from automap.frames import quat_to_rpy, rpy_to_quat
from automap.records import FloatArray, IntArray, Trajectory

LONGEST_GAP_S = 3.0
"""Between two rows that are further apart nobody knows the way, unless a caller says otherwise."""


@dataclass(frozen=True)
class Poses:
    """Poses at requested times, one row each.

    ``lat_rad``, ``lon_rad``, ``height_m`` [n], ``vel_ned`` [n, 3], ``rpy`` [n, 3] rad and
    the sds as in ``records.Trajectory``; everything is NaN where ``covered`` [n] is False.
    ``gap_s`` [n] is the length of the interval between the two rows around the time: an
    interval much longer than the usual one means that the sensors were silent there.
    """

    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    rpy: FloatArray
    sd_pos_ned: FloatArray
    sd_vel_ned: FloatArray
    sd_rpy: FloatArray
    slip_sd: FloatArray
    covered: npt.NDArray[np.bool_]
    gap_s: FloatArray

    def __len__(self) -> int:
        return len(self.lat_rad)


def poses_at(trajectory: Trajectory, t_ns: IntArray, max_gap_s: float = LONGEST_GAP_S) -> Poses:
    """Poses at host stamps ``t_ns`` [n].

    Position is a cubic Hermite through the neighbouring rows and their velocities (a
    straight line where a velocity is unknown), attitude turns at a constant rate between
    them, the rest is linear. Times before the first row, after the last or inside a gap
    longer than ``max_gap_s`` are not covered.
    """
    return _interpolate(trajectory, trajectory.t_ns, np.asarray(t_ns, np.int64), 1e-9, max_gap_s)


def poses_at_gps(
    trajectory: Trajectory, gps_s: FloatArray, max_gap_s: float = LONGEST_GAP_S
) -> Poses:
    """The same as ``poses_at`` at GPS times ``gps_s`` [n]."""
    gps_s = np.asarray(gps_s, np.float64)
    return _interpolate(trajectory, trajectory.gps_s, gps_s, 1.0, max_gap_s)


def _interpolate(
    trajectory: Trajectory,
    stamps: FloatArray | IntArray,
    asked: FloatArray | IntArray,
    unit_s: float,
    max_gap_s: float,
) -> Poses:
    """Poses where the rows' ``stamps`` and those ``asked`` for count units of ``unit_s``.

    Takes no longer for a long trajectory: only the rows beside what is asked for are looked at.
    """
    n_rows, n = len(stamps), len(asked)
    if n_rows < 2:
        one, three = np.full(n, np.nan), np.full((n, 3), np.nan)
        none = np.zeros(n, np.bool_)
        return Poses(one, one, one, three, three, three, three, three, one, none, one)
    tolerance = 1e-6  # GPS seconds near 1.4e9 resolve a quarter of a microsecond
    left = np.clip(np.searchsorted(stamps, asked, side="right") - 1, 0, n_rows - 2)
    right = left + 1
    query, before, after = ((s - stamps[0]) * unit_s for s in (asked, stamps[left], stamps[right]))
    end_s = (stamps[-1] - stamps[0]) * unit_s
    gap = after - before
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.where(gap > 0.0, (query - before) / gap, 0.0)
    covered = (query >= -tolerance) & (query <= end_s + tolerance) & np.isfinite(query)
    # A time that falls on a row needs no neighbour, however long the gap beside it.
    on_row = (np.abs(query - before) <= tolerance) | (np.abs(query - after) <= tolerance)
    covered &= (gap <= max_gap_s) | on_row
    fraction = np.clip(np.nan_to_num(fraction), 0.0, 1.0)

    # the shorter way round, also across 180 degrees
    lon = np.unwrap(np.column_stack([trajectory.lon_rad[left], trajectory.lon_rad[right]]), axis=1)
    per_lat, per_lon = metres_per_radian(
        trajectory.lat_rad[left], np.nan_to_num(trajectory.height_m[left])
    )
    rate = np.column_stack([1.0 / per_lat, 1.0 / per_lon, -np.ones(n)])
    start, end = (
        np.column_stack([trajectory.lat_rad[k], lon[:, side], trajectory.height_m[k]])
        for side, k in enumerate((left, right))
    )
    position = _hermite(
        start,
        end,
        trajectory.vel_ned[left] * rate * gap[:, None],
        trajectory.vel_ned[right] * rate * gap[:, None],
        fraction[:, None],
    )

    def linear(values: FloatArray) -> FloatArray:
        mixed = values[left] + fraction[:, None] * (values[right] - values[left])
        return np.where(covered[:, None], mixed, np.nan)

    position[~covered] = np.nan
    wrapped_lon = (position[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    rpy = _slerp(trajectory.rpy[left], trajectory.rpy[right], fraction)
    rpy[~covered] = np.nan
    return Poses(
        lat_rad=position[:, 0],
        lon_rad=wrapped_lon,
        height_m=position[:, 2],
        vel_ned=linear(trajectory.vel_ned),
        rpy=rpy,
        sd_pos_ned=linear(trajectory.sd_pos_ned),
        sd_vel_ned=linear(trajectory.sd_vel_ned),
        sd_rpy=linear(trajectory.sd_rpy),
        slip_sd=linear(trajectory.slip_sd[:, None])[:, 0],
        covered=covered,
        gap_s=np.where(covered, gap, np.nan),
    )


def _hermite(
    start: FloatArray, end: FloatArray, v_start: FloatArray, v_end: FloatArray, u: FloatArray
) -> FloatArray:
    """Cubic Hermite [n, k]; a component with an unknown slope becomes a straight line."""
    chord = end - start
    known = np.isfinite(v_start) & np.isfinite(v_end)
    v_start, v_end = np.where(known, v_start, chord), np.where(known, v_end, chord)
    bend = u * (1.0 - u) * ((1.0 - u) * (v_start - chord) - u * (v_end - chord))
    return np.asarray(start + u * chord + bend)


def _slerp(start: FloatArray, end: FloatArray, fraction: FloatArray) -> FloatArray:
    """Attitude [n, 3] (roll, pitch, yaw) a fraction of the way along the shortest turn, NaN where
    one is unknown (Shoemake, SIGGRAPH 1985)."""
    first, last = rpy_to_quat(start), rpy_to_quat(end)
    last *= np.where(np.sum(first * last, axis=1) < 0.0, -1.0, 1.0)[:, None]
    apart, along = (np.linalg.norm(last + sign * first, axis=1) for sign in (-1.0, 1.0))
    angle = 2.0 * np.arctan2(apart, along)
    with np.errstate(invalid="ignore"):
        parts = [
            np.where(angle > 0.0, np.sin(part * angle) / np.sin(angle), part)[:, None]
            for part in (1.0 - fraction, fraction)
        ]
    return quat_to_rpy(parts[0] * first + parts[1] * last)
