"""Parts of a list that lie elsewhere than the rest of it, all by the same way.

Signs that were moved go each its own way; entries that came from another source, datum or zone go
all the same. Among the ways from listed signs to the map's signs of their class such a part is a
mode (a Hough transform of translations), which is told where the ways of that length in other
directions, and those the opposite way along the same street, are too few for it to be chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from automap.earth import ecef, metres_per_radian
from automap.frames import wrap_pi
from automap.inventory.classes import same_face
from automap.inventory.findings import Inventory
from automap.inventory.limits import CIRCLE_95, TOLD_BY_CHANCE, USUAL_SD_M
from automap.mapping.grid import east_north
from automap.mapping.limits import FACING_LIMIT
from automap.records import BoolArray, FloatArray, IntArray, Sign
from automap.records.sign_lists import numbers_of

REACH_M = 300.0
"""National datums of before satellites lie up to some 300 m off."""
_FAR = 4.45
"""Of twenty places of a map one is off by more than so many sigmas once in a thousand times."""
_APART = 6.3
"""Path errors of two places differ by a root of two times their sigma, of which 4.45 are that
chance. What is nearer may be the map's own."""
_MOST_PARTS = 5
_MOST_WAYS = 100_000
"""By which modes are looked for: some seconds."""
NEAREST = 5
"""Entries about one that say whether it belongs to a part: an odd number, as many as a post or a
page has. Chosen."""


@dataclass(frozen=True)
class Parts:
    """``part`` [m] of a listed sign: 0 where most lie, 1 and on those elsewhere, -1 where no way
    tells; ``way`` [p, 2] of each part from where its entries are listed to where the map has them,
    over that of part 0, east and north in m."""

    part: IntArray
    way: FloatArray

    @property
    def displaced(self) -> BoolArray:
        """Entries [m] of a part that lies elsewhere."""
        return self.part > 0

    def moved_back(self, inventory: Inventory) -> Inventory:
        """The list with its parts where the rest of it is."""
        north, east = metres_per_radian(inventory.lat_rad, 0.0)
        by = self.way[np.maximum(self.part, 0)]
        return replace(
            inventory,
            lat_rad=inventory.lat_rad + by[:, 1] / north,
            lon_rad=inventory.lon_rad + by[:, 0] / east,
        )

    def about(self, place: FloatArray, among: FloatArray) -> FloatArray:
        """The share of displaced ones among the entries nearest to each ``place`` [k, d], by what
        stands for an entry's place ``among`` [m, d]; such as no way tells of do not count."""
        known = np.flatnonzero(self.part >= 0)
        count = min(NEAREST, len(known))
        if not count or not len(place):
            return np.zeros(len(place))
        near = cKDTree(among[known]).query(place, count)[1].reshape(len(place), count)
        return np.asarray(self.displaced[known[near]].mean(axis=1))


def displaced_parts(signs: Sequence[Sign], inventory: Inventory) -> Parts:
    """By signs of a map with positions."""
    m = len(inventory)
    whole = Parts(np.full(m, 0, np.int64), np.zeros((1, 2)))
    if not signs or not m:
        return whole
    sd = _usual_sd(signs)
    radius, least = CIRCLE_95 * sd, _APART * sd
    street = _Street(signs, inventory)
    sign, listed, ways = street.ways(street.some(), np.zeros(2), REACH_M)
    modes: list[FloatArray] = []
    members: list[IntArray] = []
    left = np.ones(len(listed), np.bool_)
    while len(modes) < _MOST_PARTS:
        mode = _mode(listed[left], ways[left], radius)
        if mode is None:
            break
        modes.append(mode)
        claimed, own_listed, _ = street.ways(np.arange(m), mode, radius)
        members.append(own_listed)
        # an entry is of one part, and a sign is one entry
        left &= ~np.isin(listed, own_listed) & ~np.isin(sign, claimed)
        left &= np.hypot(*(ways - mode).T) > least
    if len(modes) < 2:
        return whole
    order = sorted(range(len(modes)), key=lambda k: float(np.hypot(*modes[k])))
    part = np.full(m, -1, np.int64)
    for k in range(len(modes) - 1, -1, -1):
        part[members[order[k]]] = k
    return Parts(part, np.array([modes[k] for k in order]) - modes[order[0]])


def with_taken_off(
    parts: Parts, signs: Sequence[Sign], listed: IntArray, common: FloatArray
) -> Parts:
    """The parts, and such as neighbours gave away: ``common`` [k, 2] of entries ``listed`` [k] is
    what the entries about them are off from the list's shift, from listed to found in m.

    That is taken off as the map's error, and where it is more than that can be it is the list's.
    """
    least = _FAR * _usual_sd(signs)
    left = ~parts.displaced[listed]
    listed, common = listed[left], common[left]
    part, way = parts.part.copy(), list(parts.way)
    while len(way) <= _MOST_PARTS and len(far := common[np.hypot(*common.T) > least]):
        tree = cKDTree(far)
        crowd = tree.query_ball_point(far, least, return_length=True)
        near = tree.query_ball_point(far[int(np.argmax(crowd))], least)
        way.append(np.median(far[near], axis=0))
        # and those at its edge, that are off by rather that than nothing
        own = np.hypot(*(common - way[-1]).T) < np.hypot(*common.T)
        part[listed[own]] = len(way) - 1
        listed, common = listed[~own], common[~own]
    return Parts(part, np.array(way))


def _usual_sd(signs: Sequence[Sign]) -> float:
    """Median of what a map states of its positions, m per axis."""
    own = np.array([0.5 * np.trace(s.cov_enu[:2, :2]) for s in signs])
    own = own[np.isfinite(own)]
    return float(np.sqrt(np.median(own))) if len(own) else USUAL_SD_M


class _Street:
    """A map's signs and a list's by place, class and direction."""

    def __init__(self, signs: Sequence[Sign], inventory: Inventory) -> None:
        self.inventory = inventory
        self.lat, self.lon, self.facing = numbers_of(signs, "lat_rad", "lon_rad", "facing_rad")
        self.tree = cKDTree(ecef(self.lat, self.lon, np.zeros(len(self.lat))))
        ours, self.our_class = np.unique([s.class_name for s in signs], return_inverse=True)
        named, self.their_class = np.unique(list(inventory.class_name), return_inverse=True)
        self.alike = np.array([
            [same_face(a, b) is not False for b in named.tolist()] for a in ours.tolist()
        ])  # fmt: skip

    def some(self) -> IntArray:
        """Entries by which modes are looked for: all, of a crowded list a part."""
        one = self.inventory
        theirs = ecef(one.lat_rad, one.lon_rad, np.zeros(len(one)))
        crowd: Any = self.tree.query_ball_point(theirs, REACH_M, return_length=True)
        order = np.random.default_rng(0).permutation(len(one))
        within = np.cumsum(crowd[order]) <= _MOST_WAYS
        return np.sort(order[within])

    def ways(
        self, rows: IntArray, way: FloatArray, reach_m: float
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Signs [k], entries of ``rows`` of their class and direction, and the ways [k, 2] from
        there, m: those that are within ``reach_m`` of ``way``."""
        one = self.inventory
        lat, lon = one.lat_rad[rows], one.lon_rad[rows]
        north, east = metres_per_radian(lat, 0.0)
        there = ecef(lat + way[1] / north, lon + way[0] / east, np.zeros(len(rows)))
        near: Any = self.tree.query_ball_point(there, reach_m)
        j = np.repeat(rows, [len(k) for k in near])
        i = np.concatenate([np.zeros(0, np.int64), *(np.array(k, np.int64) for k in near)])
        turn = np.abs(wrap_pi(self.facing[i] - one.facing_rad[j]))
        keep = self.alike[self.our_class[i], self.their_class[j]] & ~(turn > FACING_LIMIT)
        i, j = i[keep], j[keep]
        return i, j, east_north(self.lat[i], self.lon[i], one.lat_rad[j], one.lon_rad[j])


def _mode(listed: IntArray, ways: FloatArray, radius: float) -> FloatArray | None:
    """The way [2] that the most entries have in common, None where that may be chance."""
    from scipy.stats import poisson

    if not len(ways):
        return None
    tree = cKDTree(ways)
    number = tree.query_ball_point(ways, radius, return_length=True)
    at = ways[int(np.argmax(number))]
    at = np.median(ways[tree.query_ball_point(at, radius)], axis=0)
    count = len(np.unique(listed[tree.query_ball_point(at, radius)]))
    opposite = len(np.unique(listed[tree.query_ball_point(-at, radius)]))
    length = float(np.hypot(*at))
    far = np.hypot(*ways.T)
    inner, outer = max(length - radius, 0.0), length + radius
    ring = (far > inner) & (far < outer) & (np.hypot(*(ways - at).T) > radius)
    area = outer**2 - inner**2
    usual = ring.sum() * radius**2 / max(area - radius**2, radius**2)
    # the opposite way is the same one where it is no way at all
    usual = max(usual, opposite + 1.0 if length > radius else 1.0)
    chance = poisson.sf(count - 1, usual) * len(ways)
    return at if chance < TOLD_BY_CHANCE else None
