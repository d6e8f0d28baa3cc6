"""A finished trajectory from other software as CSV, ``trajectory.csv``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import CsvColumns, read_columns
from automap.io.finished import (
    DEFAULT_SD_DEG,
    DEFAULT_SD_M,
    DEFAULT_SD_M_S,
    FinishedTrajectory,
    course_attitude,
    differenced_velocity,
    given_or,
    kept_in_time,
)
from automap.io.trajectory_table import COLUMNS, HIGHEST_M
from automap.records import FloatArray, IntArray, Trajectory

_MOST_S = 9e9  # in nanoseconds still a 64-bit integer


def read_trajectory_csv(path: Path) -> FinishedTrajectory:
    """Read the columns of ``trajectory.parquet`` from CSV.

    ``lat_deg``, ``lon_deg`` and ``t_ns`` or ``gps_s`` are required. Without sd columns
    0.1 m, 0.1 m/s and 0.1 deg are taken. Missing velocities are differenced from the
    positions; missing attitude is taken from the course, level; a missing height is 0: each
    with a warning. Raises InputError when the file cannot be used.
    """
    table = read_columns(
        path,
        {"lat_deg": "float", "lon_deg": "float"},
        {"t_ns": "int", **{name: "float" for name in COLUMNS if name not in ("t_ns",)}},
    )
    warnings = table.warnings()
    t_ns, gps_s, time = _stamps(path, table)
    lat, lon = np.radians(table.floats("lat_deg")), np.radians(table.floats("lon_deg"))
    usable = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= np.pi / 2)
    usable &= np.abs(lon) <= 2 * np.pi
    if "height_m" in table.columns:
        usable &= ~(np.abs(table.floats("height_m")) > HIGHEST_M)
    if time != "t_ns":
        usable &= np.isfinite(gps_s)
    rows = np.flatnonzero(usable)
    rows = rows[kept_in_time(path, t_ns[rows], len(table), "export the trajectory", warnings)]
    t_ns, gps_s, lat, lon = t_ns[rows], gps_s[rows], lat[rows], lon[rows]
    seconds = (t_ns - t_ns[0]) * 1e-9
    height = _height(path, table, rows, warnings)
    velocity = _velocity(path, table, rows, warnings, seconds, lat, lon, height)
    velocity_sd = _sd(table, rows, ("sd_vn", "sd_ve", "sd_vd"), DEFAULT_SD_M_S)
    rpy, rpy_sd, slip_sd = _attitude(path, table, rows, warnings, velocity, velocity_sd)
    data = Trajectory(
        t_ns=t_ns,
        gps_s=gps_s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        rpy=rpy,
        sd_pos_ned=_sd(table, rows, ("sd_n_m", "sd_e_m", "sd_d_m"), DEFAULT_SD_M),
        sd_vel_ned=velocity_sd,
        sd_rpy=rpy_sd,
        slip_sd=slip_sd,
    )
    return FinishedTrajectory(data, time, tuple(warnings))


def _stamps(path: Path, table: CsvColumns) -> tuple[IntArray, FloatArray, str]:
    gps_s = table.floats("gps_s")
    gps_s = np.where(np.abs(gps_s) < _MOST_S, gps_s, np.nan)
    if "t_ns" in table.columns:
        time = "both" if "gps_s" in table.columns else "t_ns"
        return np.asarray(table.columns["t_ns"], dtype=np.int64), gps_s, time
    if "gps_s" not in table.columns:
        raise InputError(
            f"{path}: line {table.header_line} names neither t_ns nor gps_s; add one of them."
        )
    filled = np.where(np.isfinite(gps_s), gps_s, 0.0)
    return np.rint(filled * 1e9).astype(np.int64), gps_s, "gps_s"


def _columns(table: CsvColumns, rows: IntArray, columns: tuple[str, ...]) -> FloatArray | None:
    """Columns as [n, k], None unless all are there with finite values."""
    if any(name not in table.columns for name in columns):
        return None
    values = np.column_stack([table.floats(name)[rows] for name in columns])
    return values if np.all(np.isfinite(values)) else None


def _height(path: Path, table: CsvColumns, rows: IntArray, warnings: list[str]) -> FloatArray:
    height = _columns(table, rows, ("height_m",))
    if height is not None:
        return height[:, 0]
    warnings.append(f"{path} has no complete column height_m (ellipsoidal); 0 is taken")
    return np.zeros(len(rows))


def _velocity(
    path: Path,
    table: CsvColumns,
    rows: IntArray,
    warnings: list[str],
    seconds: FloatArray,
    lat: FloatArray,
    lon: FloatArray,
    height: FloatArray,
) -> FloatArray:
    velocity = _columns(table, rows, ("vn", "ve", "vd"))
    if velocity is not None:
        return velocity
    warnings.append(f"{path} has no complete velocity; it is differenced from the positions")
    return differenced_velocity(seconds, lat, lon, height)


def _attitude(
    path: Path,
    table: CsvColumns,
    rows: IntArray,
    warnings: list[str],
    velocity: FloatArray,
    velocity_sd: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Roll, pitch, yaw [n, 3], their sd [n, 3] and what of the yaw's is slip [n], rad."""
    columns = ("sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg")
    rpy = _columns(table, rows, ("roll_deg", "pitch_deg", "yaw_deg"))
    if rpy is not None:
        sd_deg = _sd(table, rows, columns, DEFAULT_SD_DEG)
        # no more than there is
        slip_deg = np.clip(table.floats("sd_slip_deg")[rows], 0.0, sd_deg[:, 2])
        return np.radians(rpy), np.radians(sd_deg), np.radians(slip_deg)
    found, sd, warning = course_attitude(path, velocity, velocity_sd)
    warnings.append(warning)
    return found, sd, np.full(len(rows), np.nan)


def _sd(table: CsvColumns, rows: IntArray, columns: tuple[str, ...], default: float) -> FloatArray:
    """One-sigma columns [n, 3]; the default where a value is missing or not positive."""
    values = np.column_stack([table.floats(name)[rows] for name in columns])
    return given_or(values, default)
