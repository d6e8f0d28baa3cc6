"""Cells cut into tiles of a bounded number of signs, each with a margin round it."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from automap.earth import MEAN_RADIUS
from automap.mapping import limits
from automap.mapping.cells import cell_of, groups
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class Tile:
    """``core`` signs, which are the tile's own, and ``signs``, those and the ones around that
    help to see how far off each drive was."""

    core: IntArray
    signs: IntArray


def cut_tiles(
    lat: FloatArray,
    lon: FloatArray,
    core: int = limits.CORE_SIGNS,
    margin_m: float = limits.MARGIN_M,
    only: Container[int] | None = None,
) -> Iterator[Tile]:
    """Tiles of at most ``core`` signs at positions in rad [m], each sign in exactly one.

    The longer side of a cell is halved at the median until few enough are left, so that signs
    elsewhere change nothing; ``only`` gives the tiles of those cells alone. Around a tile lies a
    margin in which at most ``limits.MOST_SIGNS`` in all are taken, the nearest first.
    """
    if len(lat) == 0:
        return
    east = np.cos(lat)
    # chords on the unit sphere serve as distances for the search
    sphere = np.column_stack([east * np.cos(lon), east * np.sin(lon), np.sin(lat)])
    tree = cKDTree(sphere)
    home = cell_of(lat, lon)
    order = np.argsort(home, kind="stable")
    wanted = (order[at] for cell, at in groups(home[order]) if only is None or cell in only)
    for rows in (part for own in wanted for part in _halve(sphere, own, core)):
        near = np.concatenate(tree.query_ball_point(sphere[rows], margin_m / MEAN_RADIUS))
        others = np.setdiff1d(near.astype(np.int64), rows)
        if len(others):
            gap = np.asarray(cKDTree(sphere[rows]).query(sphere[others])[0], np.float64)
            nearest = np.argsort(gap, kind="stable")
            nearest = nearest[gap[nearest] * MEAN_RADIUS < margin_m]
            others = others[nearest[: limits.MOST_SIGNS - len(rows)]]
        yield Tile(rows, np.concatenate([rows, np.sort(others)]))


def _halve(points: FloatArray, rows: IntArray, most: int) -> Iterator[IntArray]:
    waiting = [rows]
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            yield np.sort(part)
            continue
        extent = np.ptp(points[part], axis=0)
        axis = int(np.argmax(extent))
        order = part[np.argsort(points[part, axis], kind="stable")]
        half = len(order) // 2
        waiting += [order[half:], order[:half]]
