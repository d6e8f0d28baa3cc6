"""What of a long drive is as large as its readings, in a file.

At 100 Hz ten hours are 3.6 million rows, of which a path and what the filter takes of the readings
have half a gigabyte each. The filter goes section by section, what judges a path asks for its
motion alone, and what is written of it goes stretch by stretch.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray, Trajectory

ROWS = 1 << 18
"""Of a stretch: 45 minutes at 100 Hz."""


@dataclass(frozen=True)
class Columns:
    """Columns by name in ``file``, one after another: the ``place`` where each begins and how wide
    its rows are, in numbers of eight bytes; None for a column without a second axis."""

    file: IO[bytes]
    place: Mapping[str, tuple[int, int | None]]

    def write(self, name: str, start: int, values: npt.NDArray[np.floating[Any]]) -> None:
        """Put rows of a column, from ``start`` on."""
        begin, width = self.place[name]
        self.file.seek(8 * (begin + start * (1 if width is None else width)))
        self.file.write(np.ascontiguousarray(values, np.float64).reshape(-1).view(np.uint8).data)

    def read(self, name: str, rows: slice) -> FloatArray:
        """Rows of a column."""
        begin, width = self.place[name]
        shape = (rows.stop - rows.start,) if width is None else (rows.stop - rows.start, width)
        out = np.empty(shape)
        self.file.seek(8 * (begin + rows.start * (1 if width is None else width)))
        got = self.file.readinto(out.reshape(-1).view(np.uint8).data)  # type: ignore[attr-defined]
        if got != out.nbytes:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return out


@dataclass(frozen=True)
class Matrices:
    """Square matrices [n, r, r] in a column, of which stretches are read."""

    columns: Columns
    name: str
    n: int

    def __getitem__(self, rows: slice) -> FloatArray:
        start, stop, _ = rows.indices(self.n)
        values = self.columns.read(self.name, slice(start, stop))
        side = math.isqrt(values.shape[1])
        return values.reshape(-1, side, side)

    def __len__(self) -> int:
        return self.n


def columns_in(
    file: IO[bytes], n: int, widths: Mapping[str, int | None], begin: int = 0
) -> Columns:
    """Room in ``file``, from number ``begin`` on, for columns of ``n`` rows as wide as ``widths``
    say."""
    place = {}
    for name, width in widths.items():
        place[name] = begin, width
        begin += n * (1 if width is None else width)
    return Columns(file, place)


_MOTION = {
    "gps_s": None,
    "lat_rad": None,
    "lon_rad": None,
    "height_m": None,
    "vel_ned": 3,
    "rpy": 3,
}
_SIGMAS = {"sd_pos_ned": 3, "sd_vel_ned": 3, "sd_rpy": 3, "slip_sd": None}


@dataclass(frozen=True)
class Aside:
    """A trajectory at ``t_ns`` [n] whose other columns stand in a file."""

    t_ns: IntArray
    columns: Columns

    def __len__(self) -> int:
        return len(self.t_ns)

    def stretches(self) -> Iterator[tuple[slice, Trajectory]]:
        """The trajectory in stretches, and which rows they are."""
        for start in range(0, len(self), ROWS):
            rows = slice(start, min(start + ROWS, len(self)))
            values = {name: self.columns.read(name, rows) for name in (*_MOTION, *_SIGMAS)}
            yield rows, Trajectory(self.t_ns[rows], **values)

    def motion(self) -> Trajectory:
        """The whole trajectory without its sigmas, which are NaN and take no room."""
        values = {name: self.columns.read(name, slice(0, len(self))) for name in _MOTION}
        unknown = np.broadcast_to(np.nan, (len(self), 3))
        sigmas = {name: unknown for name, width in _SIGMAS.items() if width}
        return Trajectory(self.t_ns, **values, **sigmas)

    def sd_roll(self) -> FloatArray:
        """One sigma [n] of the roll, rad."""
        return np.concatenate([stretch.sd_rpy[:, 0] for _, stretch in self.stretches()])


def put_aside(stretches: Iterable[Trajectory], t_ns: IntArray, file: IO[bytes]) -> Aside:
    """Put the ``stretches`` of a trajectory at ``t_ns`` [n] into ``file``, which stays open while
    they are asked for."""
    columns = columns_in(file, len(t_ns), _MOTION | _SIGMAS)
    start = 0
    for stretch in stretches:
        for name in columns.place:
            columns.write(name, start, getattr(stretch, name))
        start += len(stretch)
    return Aside(t_ns, columns)


def whole_trajectory(stretches: Iterable[Trajectory]) -> Trajectory:
    """The stretches of a trajectory as one."""
    parts = list(stretches)
    names = [field.name for field in fields(Trajectory)]
    return Trajectory(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
