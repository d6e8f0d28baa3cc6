"""Whether the drives' stated errors are honest: their levels from how drives disagree."""

from __future__ import annotations

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
from automap.mapping.sightings import Sightings
from automap.mapping.tiles import cut_tiles
from automap.records import FloatArray


def estimate_levels(sightings: Sightings, association: Association) -> ErrorLevels:
    """Factors on shared and own errors and the time constant, by restricted likelihood.

    Over a sample of tiles where several drives see the same signs, with log-normal priors
    about the stated errors, so that little data change little. Patterson and Thompson 1971.
    """
    if association.n_signs == 0:
        return ErrorLevels()
    tiles = _sample(sightings, association)
    if not tiles:
        return ErrorLevels()
    from scipy.optimize import minimize

    # what is stray is judged by how far sightings usually are
    told = [squares(sightings, data, ErrorLevels(), np.ones(len(data.rows))) for data in tiles]
    usual = float(np.median(np.concatenate(told))) / gate(0.5, 2)
    start_levels = ErrorLevels(own=max(1.0, usual) ** 0.5)
    factors = [stray_factors(sightings, data, start_levels) for data in tiles]

    sd = np.array([limits.LEVEL_LOG_SD, limits.LEVEL_LOG_SD, limits.TAU_LOG_SD])

    def cost(x: FloatArray) -> float:
        levels = _levels(x)
        total = float(np.sum((x / sd) ** 2))
        for data, factor in zip(tiles, factors, strict=True):
            total += deviance(sightings, data, levels, factor)
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


def _sample(sightings: Sightings, association: Association) -> list[TileData]:
    """Tiles with the most to say, spread over the map."""
    lat, lon = rough_places(sightings, association.sign)
    members = Members(association.sign)
    found: list[tuple[int, int, TileData]] = []
    tiles = list(cut_tiles(lat, lon, core=limits.LEVEL_TILE_SIGNS, margin_m=0.0))
    step = max(1, len(tiles) // (4 * limits.LEVEL_TILES))
    for tile in tiles[::step]:
        data = tile_data(sightings, members, tile, lat, lon)
        spare = len(data.rows) - len(tile.signs)
        if spare >= limits.LEAST_REDUNDANCY and len(data.rows) <= limits.LEVEL_ROWS:
            found.append((spare, len(found), data))
    found.sort(key=lambda item: (-item[0], item[1]))
    return [data for _, _, data in found[: limits.LEVEL_TILES]]
