"""A trajectory at other instants than its rows'."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.interpolation import LONGEST_GAP_S, poses_at, poses_at_gps
from automap.records import FloatArray, IntArray, Trajectory


def at_instants(
    trajectory: Trajectory, t_ns: IntArray | None = None, gps_s: FloatArray | None = None
) -> Trajectory:
    """The trajectory at stamps ``t_ns`` [m] or at GPS times ``gps_s`` [m], in their order.

    Position is a cubic Hermite on the velocities, attitude turns at a constant rate, the rest is
    linear. Raises InputError for instants before the first row, after the last, or between rows
    more than three seconds apart: nothing is extrapolated.
    """
    if t_ns is not None:
        poses = poses_at(trajectory, t_ns)
        wanted, own, unit = (t_ns * 1e-9), trajectory.t_ns * 1e-9, "t_ns (in seconds)"
    elif gps_s is not None:
        poses = poses_at_gps(trajectory, gps_s)
        wanted, own, unit = gps_s, trajectory.gps_s, "gps_s"
    else:
        raise ValueError("either t_ns or gps_s is needed")
    lost = np.flatnonzero(~poses.covered)
    if len(lost):
        raise InputError(
            f"{len(lost)} of {len(wanted)} instants lie outside the trajectory, which has {unit} "
            f"{own[0]:.3f} to {own[-1]:.3f}, or between rows more than {LONGEST_GAP_S:g} s apart; "
            f"the first is {wanted[lost[0]]:.3f}, in row {lost[0] + 1}. Leave them out."
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
