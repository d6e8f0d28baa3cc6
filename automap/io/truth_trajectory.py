"""A truth trajectory: any subset of the trajectory's columns, NaN for the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import Kind, read_columns
from automap.io.trajectory_table import COLUMNS
from automap.records import NO_TIME, FloatArray, Trajectory


def read_truth_trajectory(path: Path, warnings: list[str] | None = None) -> Trajectory:
    """Read ``path``, a CSV with ``t_ns`` or ``gps_s``, ``lat_deg``, ``lon_deg`` and whatever
    other columns of ``trajectory.parquet`` it has.

    Missing columns are NaN (``t_ns`` NO_TIME). Rows without a position are left out, rows
    are put in the order of time; ``warnings`` gets a sentence on rows that cannot be read.
    Raises InputError when the file cannot be used.
    """
    optional: dict[str, Kind] = {"t_ns": "int", **{name: "float" for name in COLUMNS[1:]}}
    table = read_columns(path, {"lat_deg": "float", "lon_deg": "float"}, optional)
    if not {"t_ns", "gps_s"} & set(table.columns):
        raise InputError(
            f"{path}: the truth lacks t_ns or gps_s; it has {', '.join(table.columns)}."
        )
    if warnings is not None:
        warnings += table.warnings()
    column = table.floats
    if "t_ns" in table.columns:
        t_ns = np.asarray(table.columns["t_ns"], np.int64)
        order_key = t_ns.astype(np.float64)
    else:
        t_ns = np.full(len(table), NO_TIME, np.int64)
        order_key = column("gps_s")
    usable = np.isfinite(order_key)
    usable &= np.isfinite(column("lat_deg")) & np.isfinite(column("lon_deg"))
    rows = np.flatnonzero(usable)
    rows = rows[np.argsort(order_key[rows], kind="stable")]

    def stack(*columns: str, scale: float = 1.0) -> FloatArray:
        return np.column_stack([column(name)[rows] for name in columns]) * scale

    degree = np.pi / 180.0
    return Trajectory(
        t_ns=t_ns[rows],
        gps_s=column("gps_s")[rows],
        lat_rad=column("lat_deg")[rows] * degree,
        lon_rad=column("lon_deg")[rows] * degree,
        height_m=column("height_m")[rows],
        vel_ned=stack("vn", "ve", "vd"),
        rpy=stack("roll_deg", "pitch_deg", "yaw_deg", scale=degree),
        sd_pos_ned=stack("sd_n_m", "sd_e_m", "sd_d_m"),
        sd_vel_ned=stack("sd_vn", "sd_ve", "sd_vd"),
        sd_rpy=stack("sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg", scale=degree),
    )
