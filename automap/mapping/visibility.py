"""Which drives had a sign in view: in front of a camera, near enough, its face to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from automap.earth import metres_per_radian
from automap.frames import wrap_pi
from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.grid import Table, delta, filled_table, neighbours, turned
from automap.mapping.sightings import CameraView
from automap.records import BoolArray, DrivePath, FloatArray, IntArray

STRIDE = 2
"""Rows of a path from one that is looked at to the next."""

DEFAULT_CAMERA = CameraView(0.0, 0.5)


class Passage(Protocol):
    """Where a drive went and where its cameras looked."""

    @property
    def path(self) -> DrivePath | None:
        """Its path, None where it is not known."""

    @property
    def cameras(self) -> Sequence[CameraView]:
        """Its cameras."""


@dataclass(frozen=True)
class Opportunities:
    """Pairs [p] of a sign and a drive that had it in view, ordered by drive, then sign.

    ``sign``, ``drive``; where the drive was nearest: its ``heading`` in rad and ``offset``, how
    far to the right of its axis the sign was, m; ``rows`` of the path from which it was in view.
    """

    sign: IntArray
    drive: IntArray
    heading: FloatArray
    offset: FloatArray
    rows: IntArray

    def __len__(self) -> int:
        return len(self.sign)

    def at(self, rows: IntArray | BoolArray) -> Opportunities:
        """Some of the pairs."""
        return Opportunities(*(column[rows] for column in vars(self).values()))


class PathErrors(NamedTuple):
    """How far paths are off where they pass signs, as their sightings of the signs beside tell:
    between them in time it goes straight, before the first and after the last it holds.

    ``home`` [m] cell of every sign: by the sightings of its own signs alone, so that a cell tells
    the same by itself. Of the sightings [n], ordered by drive and time, the ``sign``, the
    ``drive``, ``time_s`` and the ``offset`` [n, 2] m east, north by which the drive is off there.
    """

    home: IntArray
    sign: IntArray
    drive: IntArray
    time_s: FloatArray
    offset: FloatArray

    def of(self, drive: int, time_s: FloatArray) -> tuple[FloatArray, IntArray]:
        """Errors [c, k, 2] of a drive at times [k], and which of them each of the signs [m] has."""
        own = slice(*np.searchsorted(self.drive, [drive, drive + 1]))
        seen_in, known = self.home[self.sign[own]], (self.time_s[own], *self.offset[own].T)
        cells = np.unique(seen_in)
        errors = np.zeros((len(cells) + 1, len(time_s), 2))
        for k, cell in enumerate(cells):
            at_s, *axes = (column[seen_in == cell] for column in known)
            errors[k] = np.column_stack([np.interp(time_s, at_s, axis) for axis in axes])
        told = np.isin(self.home, cells)
        return np.nan_to_num(errors), np.where(told, np.searchsorted(cells, self.home), len(cells))


def opportunities(
    drives: Sequence[Passage],
    lat: FloatArray,
    lon: FloatArray,
    facing: FloatArray,
    stride: int = STRIDE,
    errors: PathErrors | None = None,
) -> Opportunities:
    """Which of the signs [m] each drive had in view, by its path and its cameras.

    Positions in rad; a sign whose ``facing`` is NaN can be seen from all sides. A drive
    without a path or without cameras says nothing. Paths are taken less their ``errors``, where
    these are known.
    """
    table = filled_table(lat, lon, limits.FARTHEST_M)
    none, zero = np.zeros(0, np.int64), np.zeros(0)
    errors = errors or PathErrors(np.zeros(len(lat), np.int64), none, none, zero, np.zeros((0, 2)))
    parts = [(none, none, zero, zero, none)]
    touched = np.empty(len(lat), np.int64)
    for number, drive in enumerate(drives):
        path = drive.path
        if path is None or len(path) == 0 or not drive.cameras or not len(lat):
            continue
        per_lat, per_lon = metres_per_radian(path.lat_rad, 0.0)
        views = np.array([[c.yaw_rad, limits.EDGE_SHARE * c.half_angle_rad] for c in drive.cameras])
        count, nearest = np.zeros(len(lat), np.int64), np.full((len(lat), 3), np.inf)
        # a path that was read is not to be written to: for that it would all be compiled once more
        car = [np.require(a, None, "W") for a in (path.lat_rad, path.lon_rad, path.yaw_rad)]
        off, which = errors.of(number, path.gps_s)
        n = _look(
            stride, car[0], car[1], car[2], per_lat, per_lon, views, table,
            lat, lon, facing, off, which, count, nearest, touched,
        )  # fmt: skip
        seen = np.sort(touched[:n])
        seen = seen[count[seen] >= limits.LEAST_ROWS]
        heading, offset = nearest[seen, 1:].T
        parts.append((seen, np.full(len(seen), number, np.int64), heading, offset, count[seen]))
    return Opportunities(*(np.concatenate([part[k] for part in parts]) for k in range(5)))


@kernel
def _look(
    stride: int,
    car_lat: FloatArray,
    car_lon: FloatArray,
    yaw: FloatArray,
    per_lat: FloatArray,
    per_lon: FloatArray,
    views: FloatArray,
    table: Table,
    lat: FloatArray,
    lon: FloatArray,
    facing: FloatArray,
    off: FloatArray,
    which: IntArray,
    count: IntArray,
    nearest: FloatArray,
    touched: IntArray,
) -> int:
    """Count the rows of a path from which each sign is in view; returns how many signs are.

    ``nearest`` gets the smallest distance with heading and offset there, ``touched`` the signs.
    """
    near = np.empty(4096, np.int64)
    n = 0
    for row in range(0, len(car_lat), stride):
        if not (car_lat[row] == car_lat[row] and yaw[row] == yaw[row]):
            continue
        found = neighbours(table, car_lat[row], car_lon[row], 1, near)
        for place in range(found):
            k = near[place]
            east, north = delta(
                lat[k], lon[k], car_lat[row], car_lon[row], per_lat[row], per_lon[row]
            )
            # further off a cell that is looked at by itself has no path
            if np.hypot(east, north) > limits.FARTHEST_M:
                continue
            east, north = east + off[which[k], row, 0], north + off[which[k], row, 1]
            distance = np.hypot(east, north)
            if distance < limits.NEAREST_M or distance > limits.FARTHEST_M:
                continue
            azimuth = np.arctan2(east, north)
            # NaN compares false: a face of unknown direction is seen from everywhere
            if abs(turned(azimuth + np.pi - facing[k])) > limits.FACE_LIMIT:
                continue
            for camera in range(len(views)):
                if abs(turned(azimuth - yaw[row] - views[camera, 0])) < views[camera, 1]:
                    if count[k] == 0:
                        touched[n] = k
                        n += 1
                    count[k] += 1
                    if distance < nearest[k, 0]:
                        nearest[k, 0] = distance
                        nearest[k, 1] = yaw[row]
                        nearest[k, 2] = distance * np.sin(azimuth - yaw[row])
                    break
    return n


def alike(views: Opportunities, seen: BoolArray) -> BoolArray:
    """Which pairs [p] approach their sign as a drive did that saw it (``seen`` [p]).

    A sign on the next street may be in the field of view and behind a house; only a drive
    that came the way of one that saw it should have seen it too.
    """
    order = np.argsort(views.sign, kind="stable")
    result = np.zeros(len(views), np.bool_)
    result[order] = _alike(
        views.sign[order], views.heading[order], views.offset[order], seen[order]
    )
    return result


@kernel
def _alike(sign: IntArray, heading: FloatArray, offset: FloatArray, seen: BoolArray) -> BoolArray:
    result = seen.copy()
    start = 0
    while start < len(sign):
        stop = start
        while stop < len(sign) and sign[stop] == sign[start]:
            stop += 1
        for i in range(start, stop):
            if seen[i]:
                continue
            for j in range(start, stop):
                if (
                    seen[j]
                    and abs(turned(heading[i] - heading[j])) < limits.SAME_HEADING
                    and abs(offset[i] - offset[j]) < limits.SAME_LATERAL_M
                ):
                    result[i] = True
                    break
        start = stop
    return result


def head_on(views: Opportunities, facing: FloatArray) -> BoolArray:
    """Which pairs [p] came straight at the face of their sign along its own road.

    For signs [m] of which nobody knows any more from where they were seen.
    """
    turn = np.abs(wrap_pi(views.heading + np.pi - facing[views.sign]))
    return np.asarray(~(turn > limits.HEAD_ON) & (np.abs(views.offset) < limits.HEAD_ON_M))
