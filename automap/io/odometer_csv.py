"""Wheel or CAN speed: a CSV with the columns t_ns and speed_m_s, or others that say as much."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.named_table import read_table
from automap.io.table_form import TableForm
from automap.records import WheelSpeed

MAX_SPEED = 120.0
"""Beyond this a speed in m/s is none of a road vehicle."""


@dataclass(frozen=True)
class WheelRecording:
    """Speeds in time order; ``warnings`` say what was left out, ``notes`` what was guessed."""

    data: WheelSpeed
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()


def read_odometer_csv(path: Path, form: TableForm | None = None) -> WheelRecording:
    """Read ``t_ns, speed_m_s``; other names, times and units as ``form`` says or by a guess.

    Raises InputError for a missing column, an unreadable file, or speeds in another unit.
    """
    table = read_table(path, "odometer", form)
    if table.t_ns is None:
        raise InputError(
            f"{path}: no column is a time; name it t_ns, or say in drive.toml which one is and "
            'what it counts: columns = { t = "..." }, time_format = "ms".'
        )
    t_ns, speed = table.t_ns, table.columns["speed"]
    warnings = table.rows.warnings()
    good = np.isfinite(speed)
    if not good.all():
        warnings.append(f"{path}: {int((~good).sum())} rows without a speed left out")
    t_ns, speed = t_ns[good], speed[good]
    if len(speed) and float(np.percentile(np.abs(speed), 99)) > MAX_SPEED:
        raise InputError(
            f"{path}: speeds reach {float(np.abs(speed).max()):.0f}, too much for m/s; write "
            'units = { speed = "km/h" } in [odometer], or what they are in.'
        )
    order = np.argsort(t_ns, kind="stable")
    t_ns, speed = t_ns[order], speed[order]
    first = np.concatenate([[True], np.diff(t_ns) > 0]) if len(t_ns) else np.zeros(0, bool)
    if not first.all():
        warnings.append(f"{path}: {int((~first).sum())} rows with a repeated t_ns left out")
    return WheelRecording(WheelSpeed(t_ns[first], speed[first]), tuple(warnings), table.notes)


def write_odometer_csv(path: Path, wheels: WheelSpeed) -> None:
    """Write the speeds as ``t_ns, speed_m_s``."""
    rows = [f"{t},{v:.4f}\n" for t, v in zip(wheels.t_ns, wheels.speed, strict=True)]
    path.write_text("t_ns,speed_m_s\n" + "".join(rows), encoding="utf-8", newline="\n")
