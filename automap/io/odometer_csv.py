"""Wheel or CAN speed: CSV with the columns t_ns and speed_m_s."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import read_columns
from automap.records import WheelSpeed

MAX_SPEED = 120.0
"""Beyond this a speed in m/s is none of a road vehicle."""


def read_odometer_csv(path: Path) -> tuple[WheelSpeed, list[str]]:
    """Speeds in time order, and a warning for every kind of row that was left out.

    Raises InputError for a missing column, an unreadable file, or speeds in another unit.
    """
    table = read_columns(path, {"t_ns": "int", "speed_m_s": "float"})
    t_ns = np.asarray(table.columns["t_ns"], dtype=np.int64)
    speed = np.asarray(table.columns["speed_m_s"], dtype=np.float64)
    warnings = []
    if table.bad_rows:
        warnings.append(f"{path}: {table.bad_rows} unreadable rows left out ({table.first_bad})")
    good = np.isfinite(speed)
    if not good.all():
        warnings.append(f"{path}: {int((~good).sum())} rows without a speed left out")
    t_ns, speed = t_ns[good], speed[good]
    if len(speed) and float(np.percentile(np.abs(speed), 99)) > MAX_SPEED:
        raise InputError(
            f"{path}: speeds reach {float(np.abs(speed).max()):.0f}, too much for m/s; give "
            "speed_m_s in metres per second"
        )
    order = np.argsort(t_ns, kind="stable")
    t_ns, speed = t_ns[order], speed[order]
    first = np.concatenate([[True], np.diff(t_ns) > 0]) if len(t_ns) else np.zeros(0, bool)
    if not first.all():
        warnings.append(f"{path}: {int((~first).sum())} rows with a repeated t_ns left out")
    return WheelSpeed(t_ns[first], speed[first]), warnings


def write_odometer_csv(path: Path, wheels: WheelSpeed) -> None:
    """Write the speeds as ``t_ns, speed_m_s``."""
    rows = [f"{t},{v:.4f}\n" for t, v in zip(wheels.t_ns, wheels.speed, strict=True)]
    path.write_text("t_ns,speed_m_s\n" + "".join(rows), encoding="utf-8", newline="\n")
