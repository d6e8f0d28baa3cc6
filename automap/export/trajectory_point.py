"""The trajectory of another point of the vehicle, and at other instants than its rows'."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from automap.earth import metres_per_radian
from automap.errors import InputError
from automap.frames import matrix_to_rotation_vector, rpy_to_matrix, wrap_pi
from automap.interpolation import poses_at, poses_at_gps
from automap.records import FloatArray, IntArray, Trajectory

RATE_WINDOW_S = 0.1
"""Over this time the attitude is differenced for the turn rate."""
MAX_GAP_S = 3.0
"""Between rows further apart nothing is interpolated."""
_TILT = 1e-6


def moved_to(trajectory: Trajectory, lever_arm_m: npt.ArrayLike) -> Trajectory:
    """The same drive at the point ``lever_arm_m`` [3], metres forward, right, down of the IMU.

    Position by the attitude, velocity also by the turn rate, which is the attitude's change over
    a tenth of a second. The point's standard deviations hold those of the attitude, taken as
    independent of the IMU's position and velocity. Source: Groves, Principles of GNSS, Inertial,
    and Multisensor Integrated Navigation Systems, 2nd ed., section 2.5.5.
    """
    arm = np.asarray(lever_arm_m, dtype=np.float64)
    if not arm.any() or not len(trajectory):
        return trajectory
    swing = np.cross(turn_rate(trajectory), arm)
    offset, offset_var = _turned(trajectory, np.broadcast_to(arm, swing.shape))
    extra, extra_var = _turned(trajectory, swing)
    north, east = metres_per_radian(trajectory.lat_rad, trajectory.height_m)
    return replace(
        trajectory,
        lat_rad=trajectory.lat_rad + offset[:, 0] / north,
        lon_rad=wrap_pi(trajectory.lon_rad + offset[:, 1] / east),
        height_m=trajectory.height_m - offset[:, 2],
        vel_ned=trajectory.vel_ned + extra,
        sd_pos_ned=np.sqrt(trajectory.sd_pos_ned**2 + offset_var),
        sd_vel_ned=np.sqrt(trajectory.sd_vel_ned**2 + extra_var),
    )


def turn_rate(trajectory: Trajectory) -> FloatArray:
    """Turn rate [n, 3] in rad/s, body axes, against the navigation frame."""
    n = len(trajectory)
    if n < 2:
        return np.zeros((n, 3))
    t = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    width = max(round(0.5 * RATE_WINDOW_S / max(float(np.median(np.diff(t))), 1e-6)), 1)
    rows = np.arange(n)
    before, after = np.maximum(rows - width, 0), np.minimum(rows + width, n - 1)
    c = rpy_to_matrix(trajectory.rpy)
    # the turn from before to after, in the axes of their middle
    turn = matrix_to_rotation_vector(np.swapaxes(c[before], 1, 2) @ c[after])
    return np.asarray(turn / (t[after] - t[before])[:, None])


def _turned(trajectory: Trajectory, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Body vectors [n, 3] in NED, and the variance [n, 3] that the attitude's sd gives them."""
    turned = np.einsum("nij,nj->ni", rpy_to_matrix(trajectory.rpy), vector)
    variance = np.zeros_like(turned)
    for angle in range(3):
        tilted = trajectory.rpy.copy()
        tilted[:, angle] += _TILT
        moved = np.einsum("nij,nj->ni", rpy_to_matrix(tilted), vector)
        slope = (moved - turned) / _TILT
        variance += (slope * trajectory.sd_rpy[:, angle, None]) ** 2
    return turned, variance


def at_instants(
    trajectory: Trajectory, t_ns: IntArray | None = None, gps_s: FloatArray | None = None
) -> Trajectory:
    """The trajectory at stamps ``t_ns`` [m] or at GPS times ``gps_s`` [m], in their order.

    Position is a cubic Hermite on the velocities, attitude turns at a constant rate, the rest is
    linear. Raises InputError for instants before the first row, after the last, or between rows
    more than three seconds apart: nothing is extrapolated.
    """
    if t_ns is not None:
        poses = poses_at(trajectory, t_ns, MAX_GAP_S)
        wanted, own, unit = (t_ns * 1e-9), trajectory.t_ns * 1e-9, "t_ns (in seconds)"
    elif gps_s is not None:
        poses = poses_at_gps(trajectory, gps_s, MAX_GAP_S)
        wanted, own, unit = gps_s, trajectory.gps_s, "gps_s"
    else:
        raise ValueError("either t_ns or gps_s is needed")
    lost = np.flatnonzero(~poses.covered)
    if len(lost):
        raise InputError(
            f"{len(lost)} of {len(wanted)} instants lie outside the trajectory, which has {unit} "
            f"{own[0]:.3f} to {own[-1]:.3f}, or between rows more than {MAX_GAP_S:g} s apart; the "
            f"first is {wanted[lost[0]]:.3f}, in row {lost[0] + 1}. Leave them out."
        )
    stamps, times = _both_clocks(trajectory, t_ns, gps_s)
    return Trajectory(
        t_ns=stamps,
        gps_s=times,
        lat_rad=poses.lat_rad,
        lon_rad=poses.lon_rad,
        height_m=poses.height_m,
        vel_ned=poses.vel_ned,
        rpy=poses.rpy,
        sd_pos_ned=poses.sd_pos_ned,
        sd_vel_ned=poses.sd_vel_ned,
        sd_rpy=poses.sd_rpy,
        slip_sd=poses.slip_sd,
    )


def _both_clocks(
    trajectory: Trajectory, t_ns: IntArray | None, gps_s: FloatArray | None
) -> tuple[IntArray, FloatArray]:
    """Stamps and GPS times of instants given in one of them."""
    seconds = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    # the difference of the two clocks changes slowly and keeps its digits
    apart = trajectory.gps_s - trajectory.gps_s[0] - seconds
    if t_ns is not None:
        since = (t_ns - trajectory.t_ns[0]) * 1e-9
        return t_ns, trajectory.gps_s[0] + since + np.interp(since, seconds, apart)
    assert gps_s is not None
    since = gps_s - trajectory.gps_s[0]
    since = since - np.interp(since, seconds + apart, apart)
    return trajectory.t_ns[0] + np.rint(since * 1e9).astype(np.int64), gps_s
