"""The trajectory of another point of the vehicle, and what an unknown arm to it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from automap.earth import metres_per_radian
from automap.frames import matrix_to_rotation_vector, rpy_to_matrix, wrap_pi
from automap.records import FloatArray, Trajectory

RATE_WINDOW_S = 0.1
"""Over this time the attitude is differenced for the turn rate."""
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


def arm_covariance(attitude: FloatArray, rate: FloatArray, arm_sd: FloatArray) -> FloatArray:
    """Covariance [k, 6, 6] of position and velocity in NED, m and m/s, of a point to which the arm
    is unknown by ``arm_sd`` [3] m along the body's axes, as it takes a motion to be its own.

    ``attitude`` [k, 3, 3] body axes to NED, ``rate`` [k, 3] rad/s in NED at which they turn. An arm
    that is wrong by l puts the point C l off and makes it w x C l faster (Groves, section 2.5.5).
    """
    off = attitude * arm_sd
    swing = np.swapaxes(np.cross(rate[:, None], np.swapaxes(off, 1, 2)), 1, 2)
    both = np.concatenate([off, swing], axis=1)
    return np.asarray(both @ np.swapaxes(both, 1, 2))


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
