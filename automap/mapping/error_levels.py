"""Whether the drives' stated errors are honest: their levels from how drives disagree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.gates import gate
from automap.geolocation.path_errors import Equations
from automap.mapping import limits
from automap.mapping.adjustment import (
    ErrorLevels,
    TileData,
    cell_tiles,
    network_of,
    stray_weights,
)
from automap.mapping.cells import cell_of
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray


def estimate_levels(sightings: Sightings, sign: IntArray) -> ErrorLevels:
    """Factors on shared and own errors and what lasts of the shared, by restricted likelihood;
    ``sign`` [n] whose each sighting is.

    Over a sample of tiles where several drives see the same signs, with log-normal priors
    about the stated errors, so that little data change little. Patterson and Thompson 1971.
    Of what lasts of the shared variance any part is as likely as another. Were there no such part,
    an error that hardly changes along a drive would be taken for a small one.
    """
    if not len(sightings):
        return ErrorLevels()
    home = cell_of(sightings.lat, sightings.lon)
    cells, most = level_cells(*np.unique(home, return_counts=True))
    found = [level_tiles(sightings, sign, cell, most) for cell in cells]
    return levels_of_tiles([tile for tiles in found for tile in tiles])


def levels_of_tiles(tiles: Sequence[tuple[Sightings, TileData]]) -> ErrorLevels:
    """The levels that a sample of tiles tells, rounded."""
    if not tiles:
        return ErrorLevels()
    from scipy.optimize import minimize

    # what is stray is judged by how far sightings usually are
    first = [Equations(network_of(*tile, ErrorLevels(), 2)) for tile in tiles]
    told = [equations.solve().square for equations in first]
    usual = float(np.median(np.concatenate(told))) / gate(0.5, 2)
    start_levels = ErrorLevels(own=max(1.0, usual) ** 0.5)
    weights = [
        stray_weights(Equations(network_of(*tile, start_levels, 2), equations.order))
        for tile, equations in zip(tiles, first, strict=True)
    ]
    sd = limits.LEVEL_LOG_SD

    def cost(x: FloatArray) -> float:
        levels = _levels(x)
        total = float(np.sum((x[:2] / sd) ** 2))
        for tile, weight, equations in zip(tiles, weights, first, strict=True):
            network = network_of(*tile, levels, 2)
            total += Equations(network, equations.order).solve(weight).deviance
        return total

    start = np.array([0.0, 0.0, limits.LASTING_ERROR])
    most = limits.MOST_LEVEL_SIGMAS * sd
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        bounds=[(-most, most), (-most, most), (0.0, 1.0)],
        options={
            "initial_simplex": start + np.vstack([np.zeros(3), np.diag([0.5 * sd, 0.5 * sd, 0.2])]),
            "xatol": 0.002,
            "fatol": 0.005,
            "maxfev": 200,
        },
    )
    return _rounded(_levels(found.x))


def _rounded(levels: ErrorLevels) -> ErrorLevels:
    """Levels whose own errors, and what lasts and what wanders of the shared, are rounded."""
    own = limits.OWN_STEP * round(levels.own / limits.OWN_STEP)
    lasts = levels.shared * levels.lasting**0.5
    wanders = max(levels.shared, 1.0) * (1.0 - levels.lasting) ** 0.5
    lasts = limits.LASTING_STEP * round(lasts / limits.LASTING_STEP)
    wanders = limits.WANDER_STEP * round(wanders / limits.WANDER_STEP)
    both = lasts**2 + wanders**2
    if both >= 1.0:
        return ErrorLevels(both**0.5, own, lasts**2 / both)
    lasting = 1.0 - wanders**2
    return ErrorLevels(lasts / lasting**0.5, own, lasting)


def _levels(x: FloatArray) -> ErrorLevels:
    """Levels of two logarithms and a share."""
    return ErrorLevels(float(np.exp(x[0])), float(np.exp(x[1])), float(x[2]))


def level_tiles(
    sightings: Sightings, sign: IntArray, cell: int, most: int
) -> list[tuple[Sightings, TileData]]:
    """The tiles of a cell with the most sightings beyond one a sign, at ``most`` so many, each with
    its own sightings; ``sign`` [n] whose each sighting is."""
    found = [
        data
        for data in cell_tiles(sightings, sign, cell, limits.LEVEL_TILE_SIGNS)
        if _spare(data) >= limits.LEAST_REDUNDANCY and len(data.rows) <= limits.LEVEL_ROWS
    ]
    return [
        (sightings.at(data.rows), replace(data, rows=np.arange(len(data.rows))))
        for data in sorted(found, key=lambda data: -_spare(data))[:most]
    ]


def level_cells(cell: IntArray, count: IntArray) -> tuple[list[int], int]:
    """The cells of which levels are told, of the cells [k] that have ``count`` [k] sightings, and
    how many tiles of each.

    A draw by their numbers among those that have many, so that further drives hardly change it.
    """
    many = cell[2 * count >= min(2 * limits.LEVEL_ROWS, int(count.max(initial=0)))]
    drawn = np.argsort(many * 2654435761 % 2**32, kind="stable")[: limits.LEVEL_TILES]
    return sorted(many[drawn].tolist()), -(-limits.LEVEL_TILES // max(len(drawn), 1))


def _spare(data: TileData) -> int:
    return len(data.rows) - len(data.tile.signs)
