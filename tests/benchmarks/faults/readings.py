"""The IMU's file as lines whose cells can be changed; lines that are not meant keep their bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.benchmarks.faults.log import Floats, Ints, Mask

GRAVITY = 9.80665


@dataclass
class Readings:
    """``columns`` and ``lines`` of imu.csv; ``t_ns`` [n] in the order of the file;
    ``gyro_unit``, ``accel_unit`` what one unit of the file is in rad/s and m/s^2."""

    columns: list[str]
    lines: list[str]
    t_ns: Ints
    gyro_unit: float
    accel_unit: float

    @classmethod
    def parse(cls, text: str, gyro: str, accel: str) -> Readings:
        """Units as drive.toml names them."""
        head, *lines = text.splitlines()
        columns = head.split(",")
        at = columns.index("t_ns")
        stamps = np.array([int(line.split(",")[at]) for line in lines], np.int64)
        units = {"deg/s": np.pi / 180.0, "g": GRAVITY}
        return cls(columns, lines, stamps, units.get(gyro, 1.0), units.get(accel, 1.0))

    def text(self) -> str:
        """The file."""
        return "\n".join([",".join(self.columns), *self.lines]) + "\n"

    def values(self, name: str) -> Floats:
        """A column [n] in rad/s or m/s^2."""
        at = self.columns.index(name)
        unit = self.gyro_unit if name[0] == "g" else self.accel_unit
        return np.array([float(line.split(",")[at]) for line in self.lines]) * unit

    def put(self, name: str, rows: Mask, values: Floats | float) -> None:
        """Write a column, in rad/s or m/s^2; ``values`` one, or [n] of all rows."""
        at = self.columns.index(name)
        unit = self.gyro_unit if name[0] == "g" else self.accel_unit
        told = np.broadcast_to(np.asarray(values) / unit, len(self.lines))
        self._edit(rows, lambda row, cells: cells.__setitem__(at, f"{told[row]:.7f}"))

    def put_stamps(self, rows: Mask, t_ns: Ints) -> None:
        """Write the stamps [n] of some rows."""
        at = self.columns.index("t_ns")
        self._edit(rows, lambda row, cells: cells.__setitem__(at, str(int(t_ns[row]))))
        self.t_ns = np.where(rows, t_ns, self.t_ns)

    def hold(self, rows: Mask) -> None:
        """All readings of some rows as in the first of them, the stamps going on."""
        at = self.columns.index("t_ns")
        first = self.lines[int(np.flatnonzero(rows)[0])].split(",")

        def change(row: int, cells: list[str]) -> None:
            cells[:] = [cells[at] if k == at else first[k] for k in range(len(cells))]

        self._edit(rows, change)

    def keep(self, rows: Mask) -> None:
        """Leave the other rows out."""
        self.lines = [line for line, kept in zip(self.lines, rows, strict=True) if kept]
        self.t_ns = self.t_ns[rows]

    def _edit(self, rows: Mask, change: Callable[[int, list[str]], None]) -> None:
        for row in np.flatnonzero(rows):
            cells = self.lines[row].split(",")
            change(int(row), cells)
            self.lines[row] = ",".join(cells)
