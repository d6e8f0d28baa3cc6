"""A long path put aside in a file, of which columns and stretches are read back.

At 100 Hz ten hours are 3.6 million rows, half a gigabyte. What judges a path asks for its motion
alone, and what is written of it goes stretch by stretch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import IO

import numpy as np

from automap.records import FloatArray, IntArray, Trajectory

_WIDTHS = {"gps_s": 1, "lat_rad": 1, "lon_rad": 1, "height_m": 1, "vel_ned": 3, "rpy": 3}
_WIDTHS |= {"sd_pos_ned": 3, "sd_vel_ned": 3, "sd_rpy": 3}
"""Columns of a row by field, in the file's order."""
_MOTION = ("gps_s", "lat_rad", "lon_rad", "height_m", "vel_ned", "rpy")


@dataclass(frozen=True)
class Aside:
    """A trajectory at ``t_ns`` [n] whose other columns stand in ``file``, in stretches that end
    before the rows ``ends``."""

    t_ns: IntArray
    file: IO[bytes]
    ends: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.t_ns)

    def stretches(self) -> Iterator[tuple[slice, Trajectory]]:
        """The stretches and which rows they are."""
        self.file.seek(0)
        width, start = sum(_WIDTHS.values()), 0
        for end in self.ends:
            data = np.frombuffer(self.file.read(8 * width * (end - start)))
            parts = np.split(data, np.cumsum([w * (end - start) for w in _WIDTHS.values()])[:-1])
            values = {
                name: part if columns == 1 else part.reshape(-1, columns)
                for (name, columns), part in zip(_WIDTHS.items(), parts, strict=True)
            }
            yield slice(start, end), Trajectory(self.t_ns[start:end], **values)
            start = end

    def motion(self) -> Trajectory:
        """The whole trajectory without its sigmas, which are NaN and take no room."""
        n = len(self)
        shapes = {name: n if _WIDTHS[name] == 1 else (n, 3) for name in _MOTION}
        values: dict[str, FloatArray] = {name: np.empty(shape) for name, shape in shapes.items()}
        for rows, stretch in self.stretches():
            for name, column in values.items():
                column[rows] = getattr(stretch, name)
        unknown = np.broadcast_to(np.nan, (n, 3))
        sigmas = dict.fromkeys(("sd_pos_ned", "sd_vel_ned", "sd_rpy"), unknown)
        return Trajectory(self.t_ns, **values, **sigmas)

    def sd_roll(self) -> FloatArray:
        """One sigma [n] of the roll, rad."""
        return np.concatenate([stretch.sd_rpy[:, 0] for _, stretch in self.stretches()])


def put_aside(stretches: Iterable[Trajectory], file: IO[bytes]) -> Aside:
    """Put the ``stretches`` of a trajectory into ``file``, which stays open while they are asked
    for."""
    t_ns, ends = [], [0]
    for stretch in stretches:
        t_ns.append(stretch.t_ns)
        ends.append(ends[-1] + len(stretch))
        for name in _WIDTHS:
            file.write(np.ascontiguousarray(getattr(stretch, name)).data)
    return Aside(np.concatenate(t_ns), file, tuple(ends[1:]))


def whole_trajectory(stretches: Iterable[Trajectory]) -> Trajectory:
    """The stretches of a trajectory as one."""
    parts = list(stretches)
    names = [field.name for field in fields(Trajectory)]
    return Trajectory(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
