"""A truth trajectory: any subset of the trajectory's columns, NaN for the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.records import NO_TIME, FloatArray, Trajectory


def read_truth_trajectory(path: Path) -> Trajectory:
    """Read ``path``, a CSV with ``t_ns`` or ``gps_s``, ``lat_deg``, ``lon_deg`` and whatever
    other columns of ``trajectory.parquet`` it has.

    Missing columns are NaN (``t_ns`` NO_TIME). Rows without a position are left out, rows
    are put in the order of time. Raises InputError when the file cannot be used.
    """
    import pyarrow as pa
    from pyarrow import csv

    integers = csv.ConvertOptions(column_types={"t_ns": pa.int64()})
    try:
        table = csv.read_csv(path, convert_options=integers)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: the truth cannot be read as CSV ({error}).") from error
    names = set(table.column_names)
    wanted = {"lat_deg", "lon_deg"} - names
    if wanted or not ({"t_ns", "gps_s"} & names):
        lacking = ", ".join(sorted(wanted)) or "t_ns or gps_s"
        raise InputError(
            f"{path}: the truth lacks {lacking}; it has {', '.join(table.column_names)}."
        )

    def column(name: str) -> FloatArray:
        if name not in names:
            return np.full(len(table), np.nan)
        try:
            values = table[name].cast(pa.float64()).to_numpy()
            return np.asarray(values, np.float64)
        except pa.ArrowException as error:
            raise InputError(f"{path}: column {name} is not numeric ({error}).") from error

    if "t_ns" in names:
        t_ns = table["t_ns"].fill_null(NO_TIME).to_numpy().astype(np.int64)
        order_key = t_ns.astype(np.float64)
        usable = t_ns != NO_TIME
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
