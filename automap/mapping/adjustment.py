"""Where the signs stand, from all sightings together, and the covariance of that."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from automap.earth import metres_per_radian
from automap.gates import gate
from automap.mapping import limits
from automap.mapping.adjustment_kernels import add_drives, drive_offsets
from automap.mapping.association import Association
from automap.mapping.sightings import Sightings
from automap.mapping.tiles import Tile, cut_tiles
from automap.records import FloatArray, IntArray

_NO_HEIGHT = 1e12
"""Variance of a height that is not known, m^2."""
_REWEIGHTINGS, _SETTLED = 3, 0.1
"""Times that stray sightings are looked for anew, unless no weight changes by more than a tenth."""


@dataclass(frozen=True)
class ErrorLevels:
    """How the drives' stated errors compare with what they show.

    Factors on the standard deviations, ``shared`` by a drive's signs and each sighting's
    ``own``, and the time constant ``tau_s`` of the shared part.
    """

    shared: float = 1.0
    own: float = 1.0
    tau_s: float = limits.TAU_S


@dataclass(frozen=True)
class Adjusted:
    """Signs [m]: ``lat``, ``lon`` rad, ``height`` m (NaN unknown), ``cov_enu`` [m, 3, 3] m^2.

    ``offset`` [n, 3] east, north, up of every sighting's drive there, m. Per drive [d]:
    ``drive_offset`` [d, 3] its mean and ``drive_sd`` [d, 3], not less than the truth of it;
    NaN for a drive without sightings; ``drive_count`` [d, 3] sightings that they are means of.
    """

    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    cov_enu: FloatArray
    offset: FloatArray
    drive_offset: FloatArray
    drive_sd: FloatArray
    drive_count: FloatArray


@dataclass(frozen=True)
class TileData:
    """Sightings of a tile's signs: ``rows`` [n] of all sightings, ``first`` [d + 1] where each
    drive begins, ``sign`` [n] place in ``tile.signs``, ``measured`` [n, 3] east, north, up of
    ``origin`` (lat, lon rad, height m)."""

    tile: Tile
    rows: IntArray
    first: IntArray
    sign: IntArray
    measured: FloatArray
    origin: tuple[float, float, float]


def adjust(
    sightings: Sightings,
    association: Association,
    levels: ErrorLevels | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    only: Container[int] | None = None,
) -> Adjusted:
    """Places of all signs by generalised least squares (A. C. Aitken, Proceedings of the Royal
    Society of Edinburgh 55, 1936), tile by tile.

    In a tile every drive's sightings have the full covariance of what they share, so that the
    covariance of a sign is that of its mean under all errors; sightings outside the tile's
    margin are left aside, which costs a little precision and no truth. With ``only`` the signs of
    those cells are placed, the others stay NaN.
    """
    levels = levels or ErrorLevels()
    m, n = association.n_signs, len(sightings)
    result = Adjusted(
        np.full(m, np.nan), np.full(m, np.nan), np.full(m, np.nan), np.full((m, 3, 3), np.nan),
        np.zeros((n, 3)), np.full((sightings.n_drives, 3), np.nan),
        np.full((sightings.n_drives, 3), np.nan), np.zeros((sightings.n_drives, 3)),
    )  # fmt: skip
    if m == 0:
        return result
    lat, lon = rough_places(sightings, association.sign)
    members = Members(association.sign)
    tiles = list(cut_tiles(lat, lon, only=only))
    sums, sds = (np.zeros((sightings.n_drives, 3)) for _ in range(2))
    counts = result.drive_count

    def work(tile: Tile) -> tuple[TileData, list[FloatArray], list[FloatArray]]:
        data = tile_data(sightings, members, tile, lat, lon)
        factor = stray_factors(sightings, data, levels)
        plan, up = (_solve(sightings, data, levels, factor, axes) for axes in (2, 1))
        return data, plan, up

    # cells are placed by several processes at once
    with ThreadPoolExecutor(max(1, os.cpu_count() or 1) if only is None else 1) as pool:
        for done, (data, plan, up) in enumerate(pool.map(work, tiles)):
            _store(result, data, plan, up)
            _add_offsets(data, plan, up, sightings.drive, sums, sds, counts)
            progress((done + 1) / len(tiles))
    seen = counts > 0
    result.drive_offset[seen] = sums[seen] / counts[seen]
    # neighbouring tiles share sightings, so their errors may be the same: sds are added
    result.drive_sd[seen] = sds[seen] / counts[seen]
    return result


class Members:
    """The sightings of every sign, found without a search."""

    def __init__(self, sign: IntArray) -> None:
        self.order = np.argsort(sign, kind="stable")
        count = int(sign.max()) + 1 if len(sign) else 0
        self.edges = np.searchsorted(sign[self.order], np.arange(count + 1))

    def of(self, signs: IntArray) -> tuple[IntArray, IntArray]:
        """Rows [n] of the sightings of ``signs`` [k], and the place in ``signs`` of each."""
        starts, stops = self.edges[signs], self.edges[signs + 1]
        lengths = stops - starts
        place = np.repeat(np.arange(len(signs)), lengths)
        within = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return self.order[np.repeat(starts, lengths) + within], place


def rough_places(sightings: Sightings, sign: IntArray) -> tuple[FloatArray, FloatArray]:
    """Plain means [m] of the sightings' latitudes and longitudes."""
    count = np.bincount(sign)
    first = np.zeros(len(count), np.int64)
    first[sign[::-1]] = np.arange(len(sign))[::-1]
    turn = sightings.lon - sightings.lon[first][sign]
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    mean_lon = sightings.lon[first] + np.bincount(sign, turn) / count
    mean_lon = (mean_lon + np.pi) % (2 * np.pi) - np.pi
    return np.bincount(sign, sightings.lat) / count, mean_lon


def own_variance(sightings: Sightings, sign: IntArray) -> FloatArray:
    """Variance [m] in m^2 per level axis of what is a sign's own error, its drives' left out."""
    own = 0.5 * (sightings.own[:, 0] + sightings.own[:, 2])
    return np.asarray(1.0 / np.bincount(sign, 1.0 / own), np.float64)


def stray_factors(sightings: Sightings, data: TileData, levels: ErrorLevels) -> FloatArray:
    """Factor [n] on the own variance of a tile's sightings that lie too far from their sign.

    Beyond ``STRAY_PROBABILITY``, with the drive's offset taken off, the variance grows with the
    square of the distance in sigmas: a stray sighting says little. Reweighted least squares (P. W.
    Holland, R. E. Welsch, Communications in Statistics A 6, 1977).
    """
    factor = np.ones(len(data.rows))
    alone = np.bincount(data.sign)[data.sign] < limits.STRAY_MEMBERS
    for _ in range(_REWEIGHTINGS):
        far = squares(sightings, data, levels, factor) / gate(limits.STRAY_PROBABILITY, 2)
        before, factor = factor, np.where(alone, 1.0, np.maximum(1.0, far))
        if np.max(np.abs(factor / before - 1.0), initial=0.0) < _SETTLED:
            break
    return factor


def squares(
    sightings: Sightings, data: TileData, levels: ErrorLevels, factor: FloatArray
) -> FloatArray:
    """Squared distances [n] in plan of a tile's sightings from their signs, their drives' offsets
    taken off, in sigmas of their own errors; weighed with ``factor`` [n] on the own variances."""
    v = sightings.own[data.rows] * levels.own**2
    place, _, offset, *_ = _solve(sightings, data, levels, factor, 2)
    east, north = (data.measured[:, :2] - place[data.sign] - offset).T
    square = v[:, 2] * east**2 - 2 * v[:, 1] * east * north + v[:, 0] * north**2
    return np.asarray(square / (v[:, 0] * v[:, 2] - v[:, 1] ** 2))


def tile_data(
    sightings: Sightings, members: Members, tile: Tile, lat: FloatArray, lon: FloatArray
) -> TileData:
    """What the sums over a tile need."""
    rows, place = members.of(tile.signs)
    order = np.argsort(rows)
    rows, place = rows[order], place[order]
    drive = sightings.drive[rows]
    first = np.concatenate([[0], np.flatnonzero(np.diff(drive)) + 1, [len(rows)]])
    height = sightings.height[rows]
    known = height[np.isfinite(height)]
    core = tile.core[0]
    origin = (float(lat[core]), float(lon[core]), float(np.median(known)) if len(known) else 0.0)
    north, east = (float(v) for v in metres_per_radian(origin[0], origin[2]))
    turn = (sightings.lon[rows] - origin[1] + np.pi) % (2 * np.pi) - np.pi
    measured = np.column_stack(
        [turn * east, (sightings.lat[rows] - origin[0]) * north, height - origin[2]]
    )
    return TileData(tile, rows, first.astype(np.int64), place, measured, origin)


def columns_of(
    sightings: Sightings, data: TileData, levels: ErrorLevels, factor: FloatArray, axes: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``measured`` [n, 2], ``own`` [n, 3] and ``shared`` [n, 2] of a tile in plan (two axes)
    or in height (one); ``factor`` [n] on the own variances; an unknown height has no weight."""
    rows = data.rows
    scale = levels.own**2 * factor
    if axes == 2:
        own = sightings.own[rows] * scale[:, None]
        shared = sightings.shared_sd[rows, :2] * levels.shared
        return data.measured[:, :2].copy(), own, shared
    height = data.measured[:, 2]
    known = np.isfinite(height)
    own = np.zeros((len(rows), 3))
    own[:, 0] = np.where(known, sightings.own_u[rows] * scale, _NO_HEIGHT)
    shared = np.zeros((len(rows), 2))
    shared[:, 0] = np.where(known, sightings.shared_sd[rows, 2] * levels.shared, 0.0)
    measured = np.zeros((len(rows), 2))
    measured[:, 0] = np.where(known, height, 0.0)
    return measured, own, shared


def _solve(
    sightings: Sightings, data: TileData, levels: ErrorLevels, factor: FloatArray, axes: int
) -> list[FloatArray]:
    """Place [m, 2], covariance [axes m, axes m], offsets [n, 2], drives' means and variances."""
    measured, own, shared = columns_of(sightings, data, levels, factor, axes)
    m = len(data.tile.signs)
    normal, right = np.zeros((axes * m, axes * m)), np.zeros(axes * m)
    time = sightings.time_s[data.rows]
    weights = np.empty(weights_size(data, axes))
    add_drives(
        data.first, data.sign, axes, time, measured, own, shared, levels.tau_s, normal, right,
        weights,
    )  # fmt: skip
    covariance = np.linalg.inv(normal)
    covariance = 0.5 * (covariance + covariance.T)
    place = np.zeros((m, 2))
    place[:, :axes] = (covariance @ right).reshape(m, axes)
    offset = np.zeros((len(data.rows), 2))
    mean, variance = np.zeros((2, len(data.first) - 1, 2))
    drive_offsets(
        data.first, data.sign, axes, time, measured, shared, levels.tau_s, weights, place,
        covariance, offset, mean, variance,
    )  # fmt: skip
    return [place, covariance, offset, mean, variance]


def weights_size(data: TileData, axes: int) -> int:
    """Numbers in the drives' weight matrices, one after another."""
    return int(np.sum((axes * np.diff(data.first)) ** 2))


def _store(
    result: Adjusted, data: TileData, plan: Sequence[FloatArray], up: Sequence[FloatArray]
) -> None:
    core = data.tile.core
    k = np.arange(len(core))
    north, east = (float(v) for v in metres_per_radian(data.origin[0], data.origin[2]))
    result.lat[core] = data.origin[0] + plan[0][k, 1] / north
    turn = data.origin[1] + plan[0][k, 0] / east
    result.lon[core] = (turn + np.pi) % (2 * np.pi) - np.pi
    variance = up[1][k, k]
    known = variance < 1e-3 * _NO_HEIGHT
    result.height[core] = np.where(known, data.origin[2] + up[0][k, 0], np.nan)
    cov = np.zeros((len(core), 3, 3))
    for a in range(2):
        for b in range(2):
            cov[:, a, b] = plan[1][2 * k + a, 2 * k + b]
    cov[:, 2, 2] = np.where(known, variance, np.nan)
    cov += limits.COMMON_SD_M**2 * np.eye(3)
    result.cov_enu[core] = cov
    own = data.sign < len(core)
    result.offset[data.rows[own], :2] = plan[2][own]
    result.offset[data.rows[own], 2] = up[2][own, 0]


def _add_offsets(
    data: TileData,
    plan: Sequence[FloatArray],
    up: Sequence[FloatArray],
    drive: IntArray,
    sums: FloatArray,
    sds: FloatArray,
    counts: FloatArray,
) -> None:
    own = (data.sign < len(data.tile.core)).astype(np.float64)
    n_core = np.add.reduceat(own, data.first[:-1])
    who = drive[data.rows[data.first[:-1]]]
    mean = np.column_stack([plan[3], up[3][:, 0]])
    sd = np.sqrt(np.column_stack([plan[4], up[4][:, 0]]))
    np.add.at(sums, who, n_core[:, None] * mean)
    np.add.at(sds, who, n_core[:, None] * sd)
    np.add.at(counts, who, n_core[:, None])
