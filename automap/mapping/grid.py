"""Cells of some metres on the globe and a growing hash table of what lies in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from automap.earth import MEAN_RADIUS, metres_per_radian
from automap.frames import wrap_pi
from automap.jit import kernel
from automap.records import FloatArray, IntArray


class Table(NamedTuple):
    """Numbers [n] by the cell that each lies in: chains from ``head`` [2^k] by ``following`` [n],
    which -1 ends; ``cells`` [n, 2] the row and column of each, in cells of ``cell_m``."""

    head: IntArray
    following: IntArray
    cells: IntArray
    cell_m: float


@kernel
def cell_row(lat: float, cell_m: float) -> int:
    """Row of a latitude in rad."""
    return int(np.floor(lat * MEAN_RADIUS / cell_m))


@kernel
def cells_around(row: int, cell_m: float) -> int:
    """Number of cells in a row; never narrower than ``cell_m``."""
    edge = max(abs(row), abs(row + 1)) * cell_m / MEAN_RADIUS
    return max(1, int(2.0 * np.pi * MEAN_RADIUS * max(np.cos(edge), 0.0) / cell_m))


@kernel
def cell_column(lon: float, around: int) -> int:
    """Column of a longitude in rad in a row of ``around`` cells."""
    turns = (lon + np.pi) / (2.0 * np.pi)
    return min(int((turns - np.floor(turns)) * around), around - 1)


@kernel
def bucket(row: int, column: int, mask: int) -> int:
    """Place of a cell in the table of ``mask`` + 1 chains."""
    return ((row * 73856093) ^ (column * 19349663)) & mask


@kernel
def insert(table: Table, number: int, lat: float, lon: float) -> None:
    """Put ``number`` into the cell of a position in rad."""
    row = cell_row(lat, table.cell_m)
    column = cell_column(lon, cells_around(row, table.cell_m))
    place = bucket(row, column, len(table.head) - 1)
    table.cells[number, 0], table.cells[number, 1] = row, column
    table.following[number] = table.head[place]
    table.head[place] = number


@kernel
def neighbours(table: Table, lat: float, lon: float, reach: int, found: IntArray) -> int:
    """Numbers in the cells up to ``reach`` cells from that of a position into ``found``.

    All that are nearer than ``reach`` times ``cell_m`` are among them. Returns how many, at most
    the length of ``found``.
    """
    head, following, cells, cell_m = table
    count = 0
    middle = cell_row(lat, cell_m)
    for row in range(middle - reach, middle + reach + 1):
        around = cells_around(row, cell_m)
        column = cell_column(lon, around)
        # near a pole a row has few cells
        for step in range(min(2 * reach + 1, around)):
            beside = (column + step - reach) % around
            number = head[bucket(row, beside, len(head) - 1)]
            while number >= 0:
                if cells[number, 0] == row and cells[number, 1] == beside:
                    if count == len(found):
                        return count
                    found[count] = number
                    count += 1
                number = following[number]
    return count


@kernel
def turned(angle: float) -> float:
    """The same angle between -pi and pi."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@kernel
def delta(
    lat_a: float, lon_a: float, lat_b: float, lon_b: float, per_lat: float, per_lon: float
) -> tuple[float, float]:
    """Metres east and north from b to a, which lie close together."""
    return turned(lon_a - lon_b) * per_lon, (lat_a - lat_b) * per_lat


def east_north(
    lat: npt.ArrayLike, lon: npt.ArrayLike, from_lat: npt.ArrayLike, from_lon: npt.ArrayLike,
    height_m: npt.ArrayLike = 0.0,
) -> FloatArray:  # fmt: skip
    """Metres [n, 2] east and north to positions in rad from others near them."""
    north, east = metres_per_radian(lat, height_m)
    turn = wrap_pi(np.subtract(lon, from_lon))
    return np.stack([turn * east, np.subtract(lat, from_lat) * north], axis=-1)


def empty_table(n: int, cell_m: float) -> Table:
    """A table for up to ``n`` numbers."""
    # a power of two above twice as many
    size = 1 << max(4, int(2 * max(n, 1)).bit_length())
    chains = np.full(size, -1, np.int64), np.empty(n, np.int64)
    return Table(*chains, np.empty((n, 2), np.int64), cell_m)


def filled_table(lat: FloatArray, lon: FloatArray, cell_m: float) -> Table:
    """A table of the positions [n] as numbers 0 to n - 1."""
    table = empty_table(len(lat), cell_m)
    _fill(table, lat, lon)
    return table


@kernel
def _fill(table: Table, lat: FloatArray, lon: FloatArray) -> None:
    for number in range(len(lat)):
        insert(table, number, lat[number], lon[number])
