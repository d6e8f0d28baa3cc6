"""Gyroscope and accelerometer in tables of their own, as phones write them, made one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import AutoMapError
from automap.evaluation import limits
from automap.io.csv_layout import read_layout
from automap.io.header_names import meaning, take_apart
from automap.io.imu_csv import write_imu_csv
from automap.io.named_table import NamedTable, read_table
from automap.io.phone_logs import together
from automap.io.table_form import ACCEL, GYRO, TableForm
from automap.io.table_units import UNITS
from automap.records import FloatArray, ImuData, IntArray


@dataclass(frozen=True)
class Triad:
    """One sensor's table: stamps [n] of ``clock`` and readings [n, 3] in ``unit``, None where
    nothing tells it."""

    path: Path
    clock: str
    t_ns: IntArray
    values: FloatArray
    unit: str | None


@dataclass(frozen=True)
class Joined:
    """Both sensors at the accelerometer's stamps, in SI or in the unit that is None."""

    imu: ImuData
    clock: str
    gyro: Triad
    accel: Triad


def join(paths: Sequence[Path]) -> Joined | None:
    """The gyroscope's and the accelerometer's table of some, None where two do not belong together.

    Of several accelerations that with gravity in it is taken.
    """
    turning = [t for t in (_triad(path, GYRO) for path in paths) if t is not None]
    felt = [t for t in (_triad(path, ACCEL) for path in paths) if t is not None]
    felt.sort(key=lambda triad: not _has_gravity(triad))
    for accel, gyro in product(felt, turning):
        if accel.path == gyro.path or accel.clock != gyro.clock:
            continue
        try:
            t_ns, turns, force = together(
                accel.t_ns, _si(accel), gyro.t_ns, _si(gyro), str(accel.path)
            )
        except AutoMapError:
            continue
        imu = ImuData(t_ns=t_ns, gyro=turns, accel=force, temp_c=None, axes_known=False)
        return Joined(imu, accel.clock, gyro, accel)
    return None


def write_joined(joined: Joined, path: Path) -> None:
    """The joined readings as ``imu.csv``."""
    write_imu_csv(path, joined.imu)


def _triad(path: Path, roles: tuple[str, ...]) -> Triad | None:
    """A table as that of one sensor; by its own name where its columns are x, y, z alone."""
    table = _read(path, roles, TableForm())
    if table is None:
        said = meaning(take_apart(path.stem).words, "imu").ideas
        sensor = GYRO if "gyro" in said else ACCEL if "accel" in said else None
        if sensor != roles or "other" in said:
            return None
        table = _read(path, roles, TableForm(columns=dict(zip(roles, "xyz", strict=True))))
    if table is None or table.t_ns is None or len(table) < 2:
        return None
    values = np.column_stack([table.columns[role] for role in roles])
    return Triad(path, table.clock, table.t_ns, values, table.unit(roles))


def _read(path: Path, roles: tuple[str, ...], form: TableForm) -> NamedTable | None:
    try:
        layout = read_layout(path, form)
        if form.columns and not set("xyz") <= {name.lower() for name in layout.names}:
            return None
        return read_table(path, "imu", form, needed=roles)
    except AutoMapError:
        return None


def _si(triad: Triad) -> FloatArray:
    factor = {**UNITS["rate"], **UNITS["acceleration"]}.get(triad.unit or "", 1.0)
    return triad.values * factor


def _has_gravity(triad: Triad) -> bool:
    """Whether a triad is as long as gravity, in any unit that it may be in."""
    size = float(np.nanmedian(np.linalg.norm(triad.values, axis=1)))
    factors = UNITS["acceleration"]
    tried = factors.values() if triad.unit is None else (factors[triad.unit],)
    return any(abs(size * f / STANDARD_GRAVITY - 1.0) < limits.GRAVITY_TOLERANCE for f in tried)
