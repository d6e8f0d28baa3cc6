"""Where the signs stand, from all sightings together, and the covariance of that."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from automap.earth import metres_per_radian
from automap.frames import wrap_pi
from automap.gates import gate
from automap.mapping import limits
from automap.mapping.association import Members
from automap.mapping.path_errors import Equations, Network, network, path_nodes
from automap.mapping.sightings import Sightings
from automap.mapping.size_errors import own_parts
from automap.mapping.tiles import Tile, cut_tiles
from automap.records import FloatArray, IntArray

_NO_HEIGHT = 1e12
"""Variance of a height that is not known, m^2."""
_REWEIGHTINGS = 3
"""Times that stray sightings are looked for anew."""
PLAN, HEIGHT = slice(0, 2), slice(2, 3)
"""Of east, north and up."""


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
    ``origin`` (lat, lon rad, height m); ``own`` [n, 3, 3] m^2 of each sighting's own error, without
    what all of a sign's have in common: ``common`` [m, 3] of every sign of the tile, one sigma."""

    tile: Tile
    rows: IntArray
    first: IntArray
    sign: IntArray
    measured: FloatArray
    origin: tuple[float, float, float]
    own: FloatArray
    common: FloatArray


def adjust(
    sightings: Sightings,
    sign: IntArray,
    levels: FloatArray | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    only: Container[int] | None = None,
    factors: FloatArray | None = None,
) -> Adjusted:
    """Places of all signs, ``sign`` [n] whose each sighting is, by generalised least squares (A. C.
    Aitken, Proceedings of the Royal Society of Edinburgh 55, 1936), tile by tile.

    In a tile the drives' errors are solved with the signs, as those of a drive's passes are, so
    that the covariance of a sign is that of its mean under all errors; sightings outside the
    tile's margin are left aside, which costs a little precision and no truth. With ``only`` the
    signs of those cells are placed, the others stay NaN. ``levels`` [3] and ``factors`` [d, 3] of
    each drive on them as ``drive_levels.py`` tells them.
    """
    levels = np.ones(3) if levels is None else levels
    m, n = int(sign.max(initial=-1)) + 1, len(sightings)
    lost, sums = np.full((3, m), np.nan), np.zeros((3, sightings.n_drives, 3))
    result = Adjusted(
        lost[0], lost[1], lost[2], np.full((m, 3, 3), np.nan), np.zeros((n, 3)),
        sums[0], sums[1], sums[2],
    )  # fmt: skip
    tiles = list(tiles_of(sightings, sign, only=only))

    def work(told: Callable[[], TileData]) -> tuple[IntArray, FloatArray]:
        return _place(result, sightings, told(), levels, factors)

    # cells are placed by several processes at once
    with ThreadPoolExecutor(max(1, os.cpu_count() or 1) if only is None else 1) as pool:
        for done, (drives, told) in enumerate(pool.map(work, tiles)):
            # neighbouring tiles share sightings, so their errors may be the same: sds are added
            sums[:, drives] += told
            progress((done + 1) / len(tiles))
    with np.errstate(invalid="ignore"):
        sums[:2] /= sums[2]
    return result


def offsets_of(sightings: Sightings, sign: IntArray) -> FloatArray:
    """Offset [n, 3] m east, north, up of each sighting's drive there, as of ``adjust`` where every
    sighting counts as stated and no covariance is asked for, a quarter of the work."""
    offset = np.zeros((len(sightings), 3))
    for told in tiles_of(sightings, sign):
        data = told()
        own = data.sign < len(data.tile.core)
        for equations, axes in _by_axes(sightings, data, np.ones(3)):
            offset[data.rows[own], axes] = equations.solve().moved[own]
    return offset


def rough_places(sightings: Sightings, sign: IntArray) -> tuple[FloatArray, FloatArray]:
    """Plain means [m] of the sightings' latitudes and longitudes."""
    count = np.bincount(sign)
    first = np.unique(sign, return_index=True)[1]
    turn = wrap_pi(sightings.lon - sightings.lon[first][sign])
    mean_lon = wrap_pi(sightings.lon[first] + np.bincount(sign, turn) / count)
    return np.bincount(sign, sightings.lat) / count, mean_lon


def own_variance(sightings: Sightings, sign: IntArray) -> FloatArray:
    """Variance [m] in m^2 per level axis of what is a sign's own error, its drives' left out."""
    own = 0.5 * (sightings.own[:, 0] + sightings.own[:, 2])
    return np.asarray(1.0 / np.bincount(sign, 1.0 / own), np.float64)


def stray_weights(
    equations: Equations, usual: float = 1.0, square: FloatArray | None = None
) -> FloatArray:
    """Weight [n] of a network's sightings: less for those that lie too far from their sign.

    Beyond ``STRAY_PROBABILITY``, with the drive's offset taken off, the variance grows with the
    square of the distance in sigmas, ``usual`` times as large as stated as a rule: a stray sighting
    says little. ``square`` [n] as ``Equations.weights`` has them.
    """
    sign = equations.network.sign
    alone = np.bincount(sign)[sign] < limits.STRAY_MEMBERS
    most = usual * gate(limits.STRAY_PROBABILITY, equations.network.measured.shape[1])

    def weigh(square: FloatArray) -> FloatArray:
        return np.where(alone, 1.0, np.minimum(1.0, most / np.maximum(square, 1e-12)))

    return equations.weights(weigh, _REWEIGHTINGS, square)


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
    turn = wrap_pi(sightings.lon[rows] - origin[1])
    measured = np.column_stack(
        [turn * east, (sightings.lat[rows] - origin[0]) * north, height - origin[2]]
    )
    own = own_parts(sightings, rows, place)
    return TileData(tile, rows, first.astype(np.int64), place, measured, origin, *own)


def tiles_of(sightings: Sightings, sign: IntArray, **cut: Any) -> Iterator[Callable[[], TileData]]:
    """What makes the tiles of the signs, as ``cut_tiles`` cuts them; ``sign`` [n] whose each
    sighting is."""
    lat, lon = rough_places(sightings, sign)
    members = Members(sign)
    for tile in cut_tiles(lat, lon, **cut):
        yield partial(tile_data, sightings, members, tile, lat, lon)


def network_of(
    sightings: Sightings,
    data: TileData,
    levels: FloatArray,
    axes: slice,
    factors: FloatArray | None = None,
) -> Network:
    """A tile's sightings in the ``PLAN`` or in ``HEIGHT``; an unknown height tells nothing.

    ``levels`` [3] factors on the stated sd of what wanders and what lasts of a path's error and of
    a sighting's own, ``factors`` [d, 3] of each drive on these. Errors that last are smaller than
    stated in plan only, where that was found: heights err by the air as well.
    """
    rows, n = data.rows, len(data.rows)
    nodes = path_nodes(sightings.time_s[rows], data.first)
    by_drive = np.ones((n, 3)) if factors is None else factors[sightings.drive[rows]]
    own = (levels[2] * by_drive[:, 2, None, None]) ** 2 * data.own[:, axes, axes]
    wanders, lasts = levels[:2] ** 2 * [1.0 - limits.LASTING_ERROR, limits.LASTING_ERROR]
    parts = np.sqrt([wanders, lasts]) * by_drive[:, :2]
    if axes == HEIGHT:
        parts = np.tile(np.sqrt([wanders, max(lasts, 1.0 - wanders)]), (n, 1))
    known = np.isfinite(data.measured[:, axes])
    own = np.where(known[:, :, None], own, _NO_HEIGHT)
    shared = np.where(known, sightings.shared_sd[rows, axes], 0.0)
    measured = np.where(known, data.measured[:, axes], 0.0)
    return network(nodes, data.sign, parts, shared, measured, own)


def _by_axes(
    sightings: Sightings, data: TileData, levels: FloatArray, factors: FloatArray | None = None
) -> Iterator[tuple[Equations, slice]]:
    """The equations of a tile in plan and in height, and which of the three axes these are."""
    plan = Equations(network_of(sightings, data, levels, PLAN, factors))
    yield plan, PLAN
    yield Equations(network_of(sightings, data, levels, HEIGHT, factors), plan.order), HEIGHT


def _place(
    result: Adjusted,
    sightings: Sightings,
    data: TileData,
    levels: FloatArray,
    factors: FloatArray | None,
) -> tuple[IntArray, FloatArray]:
    """Put a tile's signs and offsets into the ``result``. Returns its drives [d], and [3, d, 3]
    their offsets and standard deviations, each by how many sightings of the tile's own signs they
    are of, and these numbers."""
    core, rows, first = data.tile.core, data.rows, data.first
    m, drives, lengths = len(core), len(first) - 1, np.diff(first)
    own, drive = data.sign < m, np.repeat(np.arange(drives), lengths)
    count = np.bincount(drive[own], minlength=drives).astype(np.float64)
    place, cov = np.zeros((m, 3)), np.zeros((m, 3, 3))
    told, weight = np.repeat(count[None, :, None], 3, axis=0) * np.ones(3), None
    # the sightings of each drive, as many columns as the longest has
    columns = np.arange(int(lengths.max()))
    members = np.where(columns < lengths[:, None], first[:-1, None] + columns, -1)
    for equations, axes in _by_axes(sightings, data, levels, factors):
        weight = stray_weights(equations) if weight is None else weight
        found = equations.solve(weight)
        sd, node = equations.network.sd, equations.network.node
        place[:, axes], cov[:, axes, axes] = found.place[:m], found.place_variances(m)
        result.offset[rows[own], axes] = found.moved[own]
        for k, axis in enumerate(range(axes.start, axes.stop)):
            told[0, :, axis] *= np.bincount(drive, found.moved[:, k]) / lengths
            index = np.where(members[:, :, None] >= 0, sd.shape[2] * node[members] + k, -1)
            share = sd[members, :, k] / lengths[:, None, None]
            index, share = index.reshape(drives, -1), share.reshape(drives, -1)
            told[1, :, axis] *= np.sqrt(found.factor.variances_of(index, share))
    north, east = (float(v) for v in metres_per_radian(data.origin[0], data.origin[2]))
    result.lat[core] = data.origin[0] + place[:, 1] / north
    result.lon[core] = wrap_pi(data.origin[1] + place[:, 0] / east)
    common = data.common[:m]
    cov += common[:, :, None] * common[:, None, :]
    known = cov[:, 2, 2] < 1e-3 * _NO_HEIGHT
    result.height[core] = np.where(known, data.origin[2] + place[:, 2], np.nan)
    cov[:, 2, 2] = np.where(known, cov[:, 2, 2], np.nan)
    result.cov_enu[core] = cov + limits.COMMON_SD_M**2 * np.eye(3)
    return sightings.drive[rows[first[:-1]]], told
