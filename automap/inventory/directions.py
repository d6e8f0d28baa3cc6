"""What the directions of a list mean: those of faces, those of traffic, or nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.frames import wrap_pi
from automap.inventory.classes import same_face
from automap.inventory.findings import Inventory
from automap.inventory.limits import LEAST_TURNS, LIKELIER_THAN_NOT, STALE, TOLD_BY_CHANCE
from automap.mapping.limits import FACING_SD
from automap.records import FloatArray, IntArray, Sign
from automap.records.sign_lists import numbers_of
from automap.review.limits import HAND_FACING_SD_DEG

_FAR = 3.0 * FACING_SD
_GON = 0.9
"""Degrees: 400 gon are a turn."""


@dataclass(frozen=True)
class Directions:
    """``turned`` where they are those of traffic, ``gon`` where they are in gon; of ``told`` ones
    that can be compared ``against`` contradict the map; ``used`` unless more of them are without
    meaning than not."""

    turned: bool = False
    gon: bool = False
    told: int = 0
    against: int = 0
    used: bool = True

    @property
    def doubtful(self) -> bool:
        """Whether more contradict the map than a list that is looked after has wrong."""
        from scipy.stats import binom

        return bool(binom.sf(self.against - 1, self.told, STALE) < TOLD_BY_CHANCE)


def directions_of(
    signs: Sequence[Sign], inventory: Inventory, sign: IntArray, listed: IntArray, apart: FloatArray
) -> Directions:
    """By the pairs of ``sign`` and ``listed`` [k] that are near one another, ``apart`` [k, 2] m."""
    facing, sd = numbers_of(signs, "facing_rad", "facing_sd_rad")
    turn = facing[sign] - inventory.facing_rad[listed]
    # what the map itself knows worse than usual contradicts nothing
    known = np.flatnonzero(np.isfinite(turn) & ~(sd[sign] > FACING_SD))
    first = _nearest(listed, apart, known)
    cosine = np.cos(turn[first])
    against, along = int((cosine < -0.5).sum()), int((cosine > 0.5).sum())
    # signs on both sides of one post are a few; three sigmas of a fair coin are not
    turned = against - along > 3.0 * math.sqrt(max(against + along, 1))
    angle = np.abs(wrap_pi(turn + (np.pi if turned else 0.0)))
    # of one class the one that agrees best: another face of it is another sign
    best: dict[int, float] = {}
    for k in known.tolist():
        j = int(listed[k])
        if same_face(signs[sign[k]].class_name, inventory.class_name[j]):
            best[j] = min(best.get(j, math.inf), float(angle[k]))
    best |= {
        int(listed[k]): float(angle[k])
        for k in first.tolist()
        if not inventory.class_name[listed[k]]
    }
    off = sum(a > _FAR for a in best.values())
    # of those without meaning some point right by chance
    empty = off / (1.0 - _FAR / np.pi)
    used = len(best) < LEAST_TURNS or empty <= LIKELIER_THAN_NOT * len(best)
    return Directions(turned, False, len(best), off, used)


def _nearest(listed: IntArray, apart: FloatArray, rows: IntArray) -> IntArray:
    """Of the pairs ``rows`` [n] the nearest of each listed sign."""
    order = rows[np.lexsort((np.hypot(*apart[rows].T), listed[rows]))]
    return order[np.unique(listed[order], return_index=True)[1]]


def in_degrees(
    signs: Sequence[Sign], inventory: Inventory, sign: IntArray, listed: IntArray, apart: FloatArray
) -> tuple[Inventory, Directions]:
    """The list with directions of faces, in rad, and what they were: in degrees, or in gon where
    that fits the map better than chance would let it."""
    told = directions_of(signs, inventory, sign, listed, apart)
    other = replace(inventory, facing_rad=inventory.facing_rad % (2.0 * np.pi) * _GON)
    as_gon = directions_of(signs, other, sign, listed, apart)
    facing, sd = numbers_of(signs, "facing_rad", "facing_sd_rad")
    alike = [
        not sd[i] > FACING_SD and bool(same_face(signs[i].class_name, inventory.class_name[j]))
        for i, j in zip(sign.tolist(), listed.tolist(), strict=True)
    ]
    first = _nearest(listed, apart, np.flatnonzero(alike))
    # nobody tells a face better; a smaller spread is chance
    finest = math.radians(HAND_FACING_SD_DEG)
    # how much likelier normal errors make the one than the other, each with its own spread
    gain = 0.0
    for one, better in ((inventory, -1.0), (other, 1.0)):
        turn = facing[sign[first]] - one.facing_rad[listed[first]]
        way = np.exp(1j * turn[np.isfinite(turn)])
        # what all are off tells no unit, and what is further off is no error of a direction
        off = np.minimum(np.abs(np.angle(way * np.conj(way.sum()))), _FAR)
        spread = math.sqrt(float(np.sum(off**2)) / max(len(off), 1))
        gain -= better * len(off) * math.log(max(spread, finest))
    if gain > -math.log(TOLD_BY_CHANCE):
        inventory, told = other, replace(as_gon, gon=True)
    if told.turned:
        inventory = replace(inventory, facing_rad=inventory.facing_rad + np.pi)
    if not told.used:
        inventory = replace(inventory, facing_rad=np.full(len(inventory), np.nan))
    return inventory, told
