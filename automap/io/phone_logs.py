"""What logs of phone applications have in common: tables of sensors that each have their own times.

Axes are those of Android's SensorEvent (m/s^2, rad/s; x right, y up, z out of the screen).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.nmea_writer import Positions
from automap.records import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class PhoneLog:
    """IMU [n, 3] in rad/s and m/s^2 (specific force) at ``imu_t_ns``, positions and the host
    times ``position_t_ns`` [k] at which they came."""

    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    positions: Positions | None
    position_t_ns: IntArray | None
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


class Table:
    """Columns of a CSV by name; a cell that is no number is NaN."""

    def __init__(self, name: str, header: list[str], rows: list[list[str]]) -> None:
        self.name = name
        self.index = {column.strip().lower(): i for i, column in enumerate(header)}
        self.rows = [row for row in rows if len(row) >= len(header)]

    def __len__(self) -> int:
        return len(self.rows)

    def floats(self, column: str) -> FloatArray:
        """A column [n]; NaN throughout where there is no such column."""
        at = self.index.get(column.lower())
        if at is None:
            return np.full(len(self.rows), np.nan)
        return np.array([_number(row[at]) for row in self.rows], np.float64)

    def stamps(self, column: str) -> IntArray:
        """A column of whole numbers [n]; InputError where one is not."""
        at = self.index.get(column.lower())
        if at is None:
            raise InputError(
                f"{self.name} has no column {column}; columns are {', '.join(self.index)}."
            )
        cell = ""
        try:
            whole = []
            for row in self.rows:
                cell = row[at]
                whole.append(int(cell.split(".")[0]) if "e" not in cell.lower() else int(cell))
            return np.array(whole, np.int64)
        except (ValueError, OverflowError):
            raise InputError(
                f"{self.name}: column {column} holds {cell[:30]!r}, no whole number such as the "
                "application writes (a spreadsheet rounds these times); export it again."
            ) from None

    def triad(self, x: str, y: str, z: str) -> FloatArray:
        """Three columns [n, 3]; InputError where one is missing."""
        for column in (x, y, z):
            if column.lower() not in self.index:
                raise InputError(
                    f"{self.name} has no column {column}; columns are {', '.join(self.index)}."
                )
        return np.column_stack([self.floats(column) for column in (x, y, z)])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def placed(lat_deg: FloatArray, lon_deg: FloatArray, name: str) -> BoolArray:
    """Which positions [n] are on Earth. Raises InputError where most latitudes are longitudes."""
    known = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    beyond = known & (np.abs(lat_deg) > 90.0)
    if 2 * int(beyond.sum()) > int(known.sum()):
        raise InputError(
            f"{name}: its latitudes are beyond 90 degrees (the first is {lat_deg[beyond][0]:.6g}): "
            "they are exchanged with the longitudes; exchange the names of the two columns."
        )
    return np.asarray(known & ~beyond & (np.abs(lon_deg) <= 180.0))


def first_of(tables: dict[str, Table], names: Iterable[str]) -> Table | None:
    return next((tables[name] for name in names if name in tables and len(tables[name])), None)


def together(
    t_accel: IntArray, accel: FloatArray, t_gyro: IntArray, gyro: FloatArray, name: str
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Both sensors at the accelerometer's stamps, where both were on."""
    good = np.isfinite(accel).all(axis=1)
    t_accel, accel = t_accel[good], accel[good]
    good = np.isfinite(gyro).all(axis=1)
    t_gyro, gyro = t_gyro[good], gyro[good]
    if len(t_accel) and len(t_gyro):
        order = np.argsort(t_accel, kind="stable")
        t_accel, accel = t_accel[order], accel[order]
        inside = (t_accel >= t_gyro.min()) & (t_accel <= t_gyro.max())
        t_accel, accel = t_accel[inside], accel[inside]
    if len(t_accel) < 2 or not len(t_gyro):
        raise InputError(f"{name}: accelerometer and gyroscope share no time; record both.")
    turns = np.column_stack([at_times(t_accel, t_gyro, gyro[:, k]) for k in range(3)])
    return t_accel, turns, accel


def at_times(t: IntArray, times: IntArray, values: FloatArray) -> FloatArray:
    base = int(times[0])
    order = np.argsort(times, kind="stable")
    seconds = (times[order] - base) * 1e-9
    return np.asarray(np.interp((t - base) * 1e-9, seconds, values[order]))
