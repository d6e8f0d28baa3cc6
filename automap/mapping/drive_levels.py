"""How each drive's errors compare with the levels that all drives have in common.

A receiver that errs by less than another of the same stated accuracy shows it in every drive. One
drive tells little of it, so its levels are a compromise: the squares of its errors, as they were
found with the common levels, over how many of them the signs tell (``Equations.components``), with
the common levels as so many further squares as say that stated errors are trusted to
``LEVEL_LOG_SD`` (the mean of an inverse chi-square distribution by its degrees of freedom:
A. Gelman et al., Bayesian Data Analysis, 2013, chapter 2).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from automap.geolocation.path_errors import Equations
from automap.mapping import limits
from automap.mapping.adjustment import (
    ErrorLevels,
    TileData,
    cell_tiles,
    network_of,
    stray_weights,
)
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray

LEVELS = ("wanders", "lasts", "own")
"""What each drive has factors on, in the order of their columns."""
_ROUNDS = 3
"""Of the levels in a cell. Chosen: what more of them would change was not measured."""
_FREEDOM = 0.5 / limits.LEVEL_LOG_SD**2
"""Squares that tell a standard deviation as well as it is stated."""


def drive_squares(
    sightings: Sightings, sign: IntArray, cell: int, levels: ErrorLevels
) -> tuple[IntArray, FloatArray]:
    """Drives [k] of a cell's signs, and [k, 3, 2] of what wanders, what lasts and what is a
    sighting's own the squares in units of the common levels and how many they are; ``sign`` [n]
    whose each sighting is.

    What is told depends on how large it is, so the drives' own levels, as far as the cell knows
    them, take the place of the common ones (Fisher scoring).
    """
    tiles = cell_tiles(sightings, sign, cell)
    whole = [Equations(network_of(sightings, data, levels, 2)) for data in tiles]
    weights = [stray_weights(equations) for equations in whole]
    factors = np.ones((sightings.n_drives, 3))
    for _ in range(_ROUNDS):
        total, count = np.zeros((sightings.n_drives, 3, 2)), np.zeros(sightings.n_drives)
        for data, first, weight in zip(tiles, whole, weights, strict=True):
            network = network_of(sightings, data, levels, 2, factors)
            seen = np.unique(sightings.drive[data.rows])
            total[seen] += _squares(Equations(network, first.order), weight, data, len(seen))
            count[seen] += 1.0
        known = np.flatnonzero(count)
        squares = total[known]
        # one error in all tiles
        squares[:, 1] /= count[known, None]
        squares[:, :, 0] *= factors[known] ** 2
        factors[known] = np.exp(_log_factors(squares))
    return known, squares


def _squares(equations: Equations, weight: FloatArray, data: TileData, drives: int) -> FloatArray:
    """Squares and their number [d, 3, 2] of the drives of a tile, in its order."""
    lengths = np.diff(data.first)
    drive = np.repeat(np.arange(drives), lengths)
    # nodes of what wanders, then one for each drive
    node = equations.network.node
    path = np.zeros(equations.nodes, np.int64)
    path[node[:, :2]] = drive[:, None]
    path[node[:, 2]] = drives + drive
    found = equations.solve(weight)
    parts = equations.components(found, weight, path, 2 * drives + drive, 3 * drives)
    return np.stack(parts, axis=-1).reshape(3, drives, 2).swapaxes(0, 1)


def drive_factors(cells: Iterable[tuple[IntArray, FloatArray]], n_drives: int) -> FloatArray:
    """Factors [d, 3] of each drive on the common levels, by the squares of ``cells``."""
    total, count = np.zeros((n_drives, 3, 2)), np.zeros(n_drives)
    for drive, squares in cells:
        total[drive] += squares
        count[drive] += 1.0
    total[:, 1] /= np.maximum(count, 1.0)[:, None]
    step = limits.DRIVE_LEVEL_STEP
    return np.asarray(np.exp(step * np.rint(_log_factors(total) / step)))


def _log_factors(squares: FloatArray) -> FloatArray:
    """Logarithms [d, 3] of the factors that squares and their numbers [d, 3, 2] tell."""
    found, freedom = np.moveaxis(np.maximum(squares, 0.0), -1, 0)
    return np.asarray(0.5 * np.log((_FREEDOM + found) / (_FREEDOM + freedom)))
