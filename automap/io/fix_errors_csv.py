"""Errors of a receiver as a table: seconds, position NED, velocity along, across and down."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.csv_columns import Kind, read_columns
from automap.records import FixErrors

_POSITION = ("north_m", "east_m", "down_m")
_VELOCITY = ("along_m_s", "across_m_s", "vertical_m_s")


def read_fix_errors_csv(path: Path) -> FixErrors:
    """Read a table; of velocities any column may be missing or empty.

    Raises InputError where it cannot be read, or holds no two rows in the order of time.
    """
    needed: dict[str, Kind] = dict.fromkeys(("t_s", *_POSITION), "float")
    table = read_columns(path, needed, dict.fromkeys(_VELOCITY, "float"))
    t_s = table.floats("t_s")
    position = np.stack([table.floats(name) for name in _POSITION], axis=1)
    velocity = np.stack([table.floats(name) for name in _VELOCITY], axis=1)
    good = np.isfinite(t_s) & np.isfinite(position).all(axis=1)
    t_s, position, velocity = t_s[good], position[good], velocity[good]
    if len(t_s) < 2 or (t_s[1:] <= t_s[:-1]).any():
        raise InputError(
            f"{path}: errors need two rows or more, t_s increasing; sort it, without repeated rows."
        )
    return FixErrors(t_s, position, velocity)


def fix_errors_csv(errors: FixErrors) -> str:
    """The table; seconds count from its first row, and delays stay outside."""
    rows = np.column_stack([errors.gps_s - errors.gps_s[0], errors.position, errors.velocity])
    lines = [",".join("" if np.isnan(v) else f"{v:.4f}" for v in row) for row in rows]
    return "\n".join([",".join(("t_s", *_POSITION, *_VELOCITY)), *lines]) + "\n"
