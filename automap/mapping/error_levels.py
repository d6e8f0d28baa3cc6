"""Whether the drives' stated errors are honest: their levels from how drives disagree."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from automap.gates import gate
from automap.mapping import limits
from automap.mapping.adjustment import (
    ErrorLevels,
    Members,
    TileData,
    columns_of,
    rough_places,
    squares,
    stray_factors,
    tile_data,
    weights_size,
)
from automap.mapping.adjustment_kernels import add_drives
from automap.mapping.association import Association
from automap.mapping.cells import cell_of
from automap.mapping.sightings import Sightings
from automap.mapping.tiles import cut_tiles
from automap.records import FloatArray, IntArray


def estimate_levels(sightings: Sightings, association: Association) -> ErrorLevels:
    """Factors on shared and own errors and the time constant, by restricted likelihood.

    Over a sample of tiles where several drives see the same signs, with log-normal priors
    about the stated errors, so that little data change little. Patterson and Thompson 1971.
    """
    if association.n_signs == 0:
        return ErrorLevels()
    rich = richest_cells(*np.unique(cell_of(sightings.lat, sightings.lon), return_counts=True))
    return levels_of_tiles(level_tiles(sightings, association.sign, rich))


def levels_of_tiles(tiles: Sequence[tuple[Sightings, TileData]]) -> ErrorLevels:
    """The levels that a sample of tiles tells."""
    if not tiles:
        return ErrorLevels()
    from scipy.optimize import minimize

    # what is stray is judged by how far sightings usually are
    told = [squares(*tile, ErrorLevels(), np.ones(len(tile[0]))) for tile in tiles]
    usual = float(np.median(np.concatenate(told))) / gate(0.5, 2)
    start_levels = ErrorLevels(own=max(1.0, usual) ** 0.5)
    factors = [stray_factors(*tile, start_levels) for tile in tiles]
    sd = np.array([limits.LEVEL_LOG_SD, limits.LEVEL_LOG_SD, limits.TAU_LOG_SD])

    def cost(x: FloatArray) -> float:
        levels = _levels(x)
        total = float(np.sum((x / sd) ** 2))
        for tile, factor in zip(tiles, factors, strict=True):
            total += deviance(*tile, levels, factor)
        return total

    start = np.vstack([np.zeros(3), np.diag(0.5 * sd)])
    most = limits.MOST_LEVEL_SIGMAS * sd
    found = minimize(
        cost,
        np.zeros(3),
        method="Nelder-Mead",
        options={"initial_simplex": start, "xatol": 0.02, "fatol": 0.05, "maxfev": 90},
    )
    return _levels(np.clip(found.x, -most, most))


def _levels(x: FloatArray) -> ErrorLevels:
    return ErrorLevels(float(np.exp(x[0])), float(np.exp(x[1])), float(limits.TAU_S * np.exp(x[2])))


def deviance(
    sightings: Sightings, data: TileData, levels: ErrorLevels, factor: FloatArray
) -> float:
    """Minus twice the restricted log likelihood of a tile's places in plan, less a constant
    (H. D. Patterson, R. Thompson, Biometrika 58, 1971)."""
    measured, own, shared = columns_of(sightings, data, levels, factor, 2)
    m = len(data.tile.signs)
    normal, right = np.zeros((2 * m, 2 * m)), np.zeros(2 * m)
    time = sightings.time_s[data.rows]
    weights = np.empty(weights_size(data, 2))
    total = add_drives(
        data.first, data.sign, 2, time, measured, own, shared, levels.tau_s, normal, right, weights
    )
    lower = np.linalg.cholesky(normal)
    whitened = np.linalg.solve(lower, right)
    return float(total + 2.0 * np.sum(np.log(np.diag(lower))) - whitened @ whitened)


def level_tiles(
    sightings: Sightings, sign: IntArray, only: Container[int]
) -> list[tuple[Sightings, TileData]]:
    """The tiles of the cells ``only`` with the most to say, each with its own sightings; ``sign``
    [n] whose each sighting is."""
    lat, lon = rough_places(sightings, sign)
    members = Members(sign)
    found: list[tuple[Sightings, TileData]] = []
    for tile in cut_tiles(lat, lon, limits.LEVEL_TILE_SIGNS, 0.0, only):
        data = tile_data(sightings, members, tile, lat, lon)
        if _spare(data) >= limits.LEAST_REDUNDANCY and len(data.rows) <= limits.LEVEL_ROWS:
            found.append((sightings.at(data.rows), replace(data, rows=np.arange(len(data.rows)))))
    return best_tiles(found)


def best_tiles(tiles: Sequence[tuple[Sightings, TileData]]) -> list[tuple[Sightings, TileData]]:
    """Those with the most sightings beyond one a sign, the earlier of equals."""
    return sorted(tiles, key=lambda item: -_spare(item[1]))[: limits.LEVEL_TILES]


def richest_cells(cell: IntArray, count: IntArray) -> set[int]:
    """The cells [k] with the most sightings, of which levels are told."""
    order = np.lexsort((cell, -count))
    return set(cell[order[: limits.LEVEL_TILES]].tolist())


def _spare(data: TileData) -> int:
    return len(data.rows) - len(data.tile.signs)
