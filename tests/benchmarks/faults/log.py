"""A receiver's log as epochs that can be changed: what each says, and the bytes that say it.

A fault changes the columns of ``Log.now``; only the messages of epochs that say something else
than they did are written anew, and of those only the fields that changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

METRES_PER_DEGREE = 111_195.0
"""Of a sphere of 6371 km: metres that a fault moves a position by need no ellipsoid."""


@dataclass
class Fixes:
    """What epochs say, a column [n] each, NaN where the format does not say it.

    ``time`` s of the log's own scale, ``lat``, ``lon`` deg, ``height`` m (above the sea where
    the format has ``geoid``, the geoid's height in m, else above the ellipsoid), ``speed`` m/s,
    ``course`` deg, ``climb`` m/s upwards, ``dop`` the accuracy as told: the HDOP, or what the
    stated sigmas are multiplied by.
    """

    time: Floats
    lat: Floats
    lon: Floats
    height: Floats
    geoid: Floats
    speed: Floats
    course: Floats
    climb: Floats
    dop: Floats

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: Ints) -> Fixes:
        """A copy of these rows."""
        return Fixes(**{f.name: getattr(self, f.name)[rows].copy() for f in fields(self)})

    def epoch(self, row: int) -> dict[str, float]:
        """One row by column."""
        return {f.name: float(getattr(self, f.name)[row]) for f in fields(self)}

    def hold(self, rows: Mask, columns: str) -> None:
        """The columns keep, in these rows, what the first of them says."""
        first = int(np.flatnonzero(rows)[0])
        for name in columns.split():
            column = getattr(self, name)
            column[rows] = column[first]

    def move(self, north: Floats | float, east: Floats | float, rows: Mask | None = None) -> None:
        """Add metres to the positions; arrays are of all rows."""
        part = np.ones(len(self), bool) if rows is None else rows
        metres_east = METRES_PER_DEGREE * np.cos(np.radians(self.lat))
        dlat = np.broadcast_to(north, len(self)) / METRES_PER_DEGREE
        dlon = np.broadcast_to(east, len(self)) / metres_east
        self.lat[part] += dlat[part]
        self.lon[part] += dlon[part]

    def add_velocity(self, north: Floats | float, east: Floats | float, rows: Mask) -> None:
        """Add m/s to the velocities of some rows."""
        angle = np.radians(self.course)
        vn = self.speed * np.cos(angle) + north
        ve = self.speed * np.sin(angle) + east
        self.speed[rows] = np.hypot(vn, ve)[rows]
        self.course[rows] = (np.degrees(np.arctan2(ve, vn)) % 360.0)[rows]


Write = Callable[[list[bytes], dict[str, float], dict[str, float]], list[bytes]]
"""Messages of an epoch, what they say and what they shall say to the messages that say it."""


@dataclass
class Log:
    """Epochs in the order of the file.

    ``messages`` of each epoch, ``arrival`` [n] ns of its first byte (or -1), ``was`` what the
    messages say, ``now`` what they shall say, ``gps_offset_s`` GPS time less the log's scale,
    ``head`` bytes before the first epoch.
    """

    messages: list[list[bytes]]
    arrival: Ints
    was: Fixes
    write: Write
    gps_offset_s: float
    head: bytes = b""
    now: Fixes = field(default=None)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.now is None:
            self.now = self.was.take(np.arange(len(self.was)))

    def __len__(self) -> int:
        return len(self.messages)

    @property
    def gps_s(self) -> Floats:
        """GPS times [n] at which the epochs were in truth."""
        return np.asarray(self.was.time + self.gps_offset_s)

    def take(self, rows: Ints) -> Log:
        """A log of these epochs, in this order."""
        return replace(
            self,
            messages=[list(self.messages[row]) for row in rows],
            arrival=self.arrival[rows].copy(),
            was=self.was.take(rows),
            now=self.now.take(rows),
        )

    def with_epochs(self, other: Log) -> Log:
        """Both logs' epochs in the order in which they arrived, or of their time."""
        both = replace(
            self,
            messages=self.messages + other.messages,
            arrival=np.concatenate([self.arrival, other.arrival]),
            was=_joined(self.was, other.was),
            now=_joined(self.now, other.now),
        )
        key = both.arrival if (both.arrival >= 0).all() else both.now.time
        return both.take(np.argsort(key, kind="stable"))

    def data(self) -> tuple[bytes, list[tuple[int, int]]]:
        """The bytes of the log, and by epoch the offset and its arrival in ns."""
        parts, arrivals, at = [self.head], [], len(self.head)
        for row, other in enumerate(differing(self.was, self.now)):
            part = b"".join(self._written(row) if other else self.messages[row])
            arrivals.append((at, int(self.arrival[row])))
            parts.append(part)
            at += len(part)
        return b"".join(parts), arrivals

    def _written(self, row: int) -> list[bytes]:
        return self.write(self.messages[row], self.was.epoch(row), self.now.epoch(row))


def differing(was: Fixes, now: Fixes) -> Mask:
    """Rows [n] in which a column differs; NaN is like NaN."""
    rows = np.zeros(len(was), bool)
    for f in fields(was):
        a, b = getattr(was, f.name), getattr(now, f.name)
        rows |= (a != b) & ~(np.isnan(a) & np.isnan(b))
    return rows


def changed(was: dict[str, float], now: dict[str, float]) -> set[str]:
    """Names of the columns that differ; NaN is like NaN."""
    return {k for k in was if was[k] != now[k] and not (was[k] != was[k] and now[k] != now[k])}


def _joined(a: Fixes, b: Fixes) -> Fixes:
    names = [f.name for f in fields(a)]
    return Fixes(**{n: np.concatenate([getattr(a, n), getattr(b, n)]) for n in names})
