"""Cells of the globe that a map is merged by: tiles of the web maps, named by their quadkeys.

A cell's result depends on what lies in it and in a margin round it, so cells can be merged in any
order and by any number of processes, and what is far from a new drive need not be merged again.
Beyond the latitude where the tiles end all is in one cell round each pole.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.records import BoolArray, FloatArray, IntArray

LEVEL = 14
"""Of the tiles: 2.4 km at the equator, 1.5 km at 50 deg. Chosen: some 100,000 sightings of a town
that is driven daily fit into little memory, and the margins are no larger than the cells."""
COLOURS = 5
"""Cells of one colour do not touch; the cells round the poles, which touch many, have the last."""
_SIDE = 1 << LEVEL
_END = float(np.arctan(np.sinh(np.pi)))
"""Latitude at which the tiles end, rad."""


def cell_of(lat: FloatArray, lon: FloatArray) -> IntArray:
    """Cell [n] of every position in rad."""
    x, y = _column(lon), _row(lat)
    return np.asarray(y * _SIDE + np.where(np.abs(lat) > _END, 0, x), np.int64)


def colour_of(cell: int) -> int:
    """One of ``COLOURS``."""
    y, x = divmod(cell, _SIDE)
    return COLOURS - 1 if x == 0 and y in (0, _SIDE - 1) else x % 2 + 2 * (y % 2)


def quadkey(cell: int) -> str:
    """The cell's name in the web maps' tiling."""
    y, x = divmod(cell, _SIDE)
    return "".join(str((x >> k & 1) + 2 * (y >> k & 1)) for k in reversed(range(LEVEL)))


def cell_named(name: str) -> int:
    """The inverse of ``quadkey``."""
    x = sum((int(digit) & 1) << k for k, digit in enumerate(reversed(name)))
    y = sum((int(digit) >> 1) << k for k, digit in enumerate(reversed(name)))
    return y * _SIDE + x


class Squares(NamedTuple):
    """Cells that squares round places meet [n]: ``first_x`` of their westernmost column, how many
    ``columns``, the ``first_y`` of their first row, how many ``rows``, and the cell round a
    ``pole`` that they meet too (-1 none)."""

    first_x: IntArray
    columns: IntArray
    first_y: IntArray
    rows: IntArray
    pole: IntArray


def squares(lat: FloatArray, lon: FloatArray, margin_m: float) -> Squares:
    """All that lies within ``margin_m`` of places [n] in rad, and a little more at corners."""
    up = margin_m / MEAN_RADIUS
    low, high = np.clip(lat - up, -np.pi / 2, np.pi / 2), np.clip(lat + up, -np.pi / 2, np.pi / 2)
    widest = np.minimum(np.maximum(np.abs(low), np.abs(high)), _END)
    aside = up / np.cos(widest)
    first_x, wide = _column(lon - aside), 2.0 * aside / (2.0 * np.pi) * _SIDE
    columns = np.minimum((_column(lon + aside) - first_x) % _SIDE + 1, np.ceil(wide + 1.0))
    first_y = _row(high)
    polar = (low > _END) | (high < -_END)
    south = (_SIDE - 1) * _SIDE
    pole = np.where(high > _END, 0, np.where(low < -_END, south, -1))
    columns = np.where(polar, 0, columns).astype(np.int64)
    return Squares(first_x, columns, first_y, _row(low) - first_y + 1, pole)


def meets(cell: int, around: Squares) -> BoolArray:
    """Whether each square [n] meets a cell."""
    y, x = divmod(cell, _SIDE)
    right, down = (x - around.first_x) % _SIDE, y - around.first_y
    inside = (right < around.columns) & (down >= 0) & (down < around.rows)
    # a margin over the end of the tiles meets the cell round the pole too
    return np.asarray(inside | (around.pole == cell), np.bool_)


def beside(cell: int, margin_m: float) -> list[int] | None:
    """All cells, ascending, that may reach within ``margin_m`` of ``cell``, itself among them; None
    near a pole, where they are many."""
    own_y, own_x = divmod(cell, _SIDE)
    reach = _reach(own_y, margin_m)
    if not reach < own_y < _SIDE - 1 - reach:
        return None
    columns = sorted({(own_x + k) % _SIDE for k in range(-reach, reach + 1)})
    return [y * _SIDE + x for y in range(own_y - reach, own_y + reach + 1) for x in columns]


def _reach(row: int, margin_m: float) -> int:
    """How many tiles beyond one of a row may lie within a margin of it."""
    # the tiles are as high as they are wide, and smallest on the side of the pole
    edge = max(abs(1.0 - 2.0 * row / _SIDE), abs(1.0 - 2.0 * (row + 1) / _SIDE)) * np.pi
    wide = 2.0 * np.pi * MEAN_RADIUS / _SIDE / np.cosh(edge)
    return int(np.ceil(margin_m / wide)) + 1


def groups(cell: IntArray) -> Iterator[tuple[int, slice]]:
    """Each cell of an ascending array [k] and where it stands."""
    edges = np.flatnonzero(np.diff(cell, prepend=-1, append=-1))
    for lo, hi in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        yield int(cell[lo]), slice(lo, hi)


def _column(lon: FloatArray) -> IntArray:
    turns = (np.asarray(lon, np.float64) + np.pi) / (2.0 * np.pi)
    return np.minimum((turns - np.floor(turns)) * _SIDE, _SIDE - 1).astype(np.int64)


def _row(lat: FloatArray) -> IntArray:
    north = np.arcsinh(np.tan(np.clip(lat, -_END, _END))) / np.pi
    return np.clip(np.floor((1.0 - north) / 2.0 * _SIDE), 0, _SIDE - 1).astype(np.int64)
