"""How large the drives' errors are: of all in common, and of each drive compared with that.

Every drive shows it in how far it is from the others where they see the same signs: the squares of
its errors, over how many of them the signs tell (variance components: ``Equations.components``).
All drives together tell the common levels. A receiver that errs by less than another of the same
stated accuracy shows it in every drive, but one drive tells little of it, so its own levels are a
compromise with the common ones, which count as so many further squares as say that stated errors
are trusted to ``LEVEL_LOG_SD`` (the mean of an inverse chi-square distribution by its degrees of
freedom: A. Gelman et al., Bayesian Data Analysis, 2013, chapter 2).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from automap.gates import gate
from automap.mapping import limits
from automap.mapping.adjustment import PLAN, TileData, network_of, stray_weights, tiles_of
from automap.mapping.path_errors import Equations
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray

LEVELS = ("wanders", "lasts", "own")
"""What there are levels of, and what each drive has factors on, in the order of their columns."""
_ROUNDS = 3
"""Of the levels in a cell. Chosen: what more of them would change was not measured."""
_FREEDOM = 0.5 / limits.LEVEL_LOG_SD**2
"""Squares that tell a standard deviation as well as it is stated."""


def drive_squares(sightings: Sightings, sign: IntArray, cell: int) -> tuple[IntArray, FloatArray]:
    """Drives [k] of a cell's signs, and [k, 3, 2] of what wanders, what lasts and what is a
    sighting's own the squares in units of what is stated and how many they are; ``sign`` [n]
    whose each sighting is.

    What is told depends on how large it is, so the drives' levels, as far as the cell knows them,
    take the place of the stated ones (Fisher scoring).
    """
    tiles = [told() for told in tiles_of(sightings, sign, margin_m=0.0, only={cell})]
    if not tiles:
        return np.zeros(0, np.int64), np.zeros((0, 3, 2))
    stated, factors = np.ones(3), np.ones((sightings.n_drives, 3))
    whole = [Equations(network_of(sightings, data, stated, PLAN)) for data in tiles]
    # what is stray is judged by how far sightings usually are
    far = [equations.solve().square for equations in whole]
    usual = max(1.0, float(np.median(np.concatenate(far))) / gate(0.5, 2))
    weights = [stray_weights(each, usual, square) for each, square in zip(whole, far, strict=True)]
    for _ in range(_ROUNDS):
        total, count = np.zeros((sightings.n_drives, 3, 2)), np.zeros(sightings.n_drives)
        for data, first, weight in zip(tiles, whole, weights, strict=True):
            network = network_of(sightings, data, stated, PLAN, factors)
            seen = np.unique(sightings.drive[data.rows])
            total[seen] += _squares(Equations(network, first.order), weight, data, len(seen))
            count[seen] += 1.0
        known = np.flatnonzero(count)
        squares = total[known]
        # one error in all tiles
        squares[:, 1] /= count[known, None]
        squares[:, :, 0] *= factors[known] ** 2
        common = _common(squares)
        factors[known] = common * _own(squares, common)
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


def error_levels(
    cells: Iterable[tuple[IntArray, FloatArray]], n_drives: int
) -> tuple[FloatArray, FloatArray]:
    """The common levels [3], factors on the sd that drives state, and factors [d, 3] of each drive
    on them, by the squares of ``cells``; rounded, so that some more drives do not move all that was
    placed."""
    total, count = np.zeros((n_drives, 3, 2)), np.zeros(n_drives)
    for drive, squares in cells:
        total[drive] += squares
        count[drive] += 1.0
    total[:, 1] /= np.maximum(count, 1.0)[:, None]
    # a drive's own on the rounded ones: else each drive more would move some of all others'
    common = _rounded(_common(total), np.array(limits.LEVEL_STEPS))
    return common, _rounded(_own(total, common), limits.DRIVE_LEVEL_STEP)


def _rounded(levels: FloatArray, step: float | FloatArray) -> FloatArray:
    return np.asarray(np.exp(step * np.rint(np.log(levels) / step)))


def _common(squares: FloatArray) -> FloatArray:
    """The levels [3] that the squares [d, 3, 2] of all drives tell, in what is stated."""
    return _told(np.maximum(squares, 0.0).sum(axis=0))


def _own(squares: FloatArray, common: FloatArray) -> FloatArray:
    """The factors [d, 3] of each drive on the levels ``common`` [3]."""
    return _told(squares / np.stack([common**2, np.ones(3)], axis=-1))


def _told(squares: FloatArray) -> FloatArray:
    found, freedom = np.moveaxis(np.maximum(squares, 0.0), -1, 0)
    return np.asarray(np.sqrt((_FREEDOM + found) / (_FREEDOM + freedom)))
