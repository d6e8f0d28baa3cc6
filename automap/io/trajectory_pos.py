"""A finished trajectory from other software as RTKLIB solution, ``trajectory.pos``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.finished import (
    DEFAULT_SD_M,
    DEFAULT_SD_M_S,
    FinishedTrajectory,
    course_attitude,
    differenced_velocity,
    given_or,
    kept_in_time,
)
from automap.io.rtklib import decode_pos
from automap.io.trajectory_table import HIGHEST_M
from automap.records import Trajectory


def read_trajectory_pos(path: Path) -> FinishedTrajectory:
    """Read an RTKLIB solution in any of its forms of time and position.

    Positions are taken as those of the IMU's origin. The file has no attitude: it is taken
    from the course (see ``course_attitude``). Missing velocities are differenced from the
    positions, for missing standard deviations 0.1 m and 0.1 m/s are taken, each with a
    warning. Raises InputError when the file cannot be used.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    fixes, notes, cut, _ = decode_pos(content, str(path))
    warnings = [f"{path}: {note}" for note in [*notes, *([] if cut is None else [cut])]]
    place = np.column_stack([fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.gps_s])
    # more seconds do not fit into nanoseconds of 64 bits
    usable = np.isfinite(place).all(axis=1) & (np.abs(fixes.gps_s) < 9.0e9)
    rows = np.flatnonzero(usable & (np.abs(fixes.height_m) <= HIGHEST_M))
    t_ns = np.rint(fixes.gps_s[rows] * 1e9).astype(np.int64)
    keep = kept_in_time(path, t_ns, len(fixes), "write the solution", warnings)
    rows, t_ns = rows[keep], t_ns[keep]
    lat, lon, height, gps_s = (column[rows] for column in place.T)
    velocity = fixes.vel_ned[rows]
    if not np.isfinite(velocity).all():
        warnings.append(f"{path} has no complete velocity; it is differenced from the positions")
        velocity = differenced_velocity((t_ns - t_ns[0]) * 1e-9, lat, lon, height)
    if not np.isfinite(fixes.sd_pos_ned[rows]).all():
        warnings.append(f"{path} lacks standard deviations; {DEFAULT_SD_M:g} m is taken there")
    velocity_sd = given_or(fixes.sd_vel_ned[rows], DEFAULT_SD_M_S)
    rpy, rpy_sd, warning = course_attitude(path, velocity, velocity_sd)
    data = Trajectory(
        t_ns=t_ns,
        gps_s=gps_s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        rpy=rpy,
        sd_pos_ned=given_or(fixes.sd_pos_ned[rows], DEFAULT_SD_M),
        sd_vel_ned=velocity_sd,
        sd_rpy=rpy_sd,
    )
    return FinishedTrajectory(data, "gps_s", (*warnings, warning))
