"""How likely another sign stands where a map's sign was found beside a listed one.

Signs stand in company: on one post, on the two posts of a gate, one after another. That the sign
found two metres off is the listed one's neighbour, which the list lacks, while the listed one was
not seen, is as likely as listed signs have neighbours there that look that way and are of such a
class: the list's own pairs tell (the product density of a point process by kernels: B. D. Ripley,
Journal of the Royal Statistical Society B 39, 1977). Lists of some hundred signs have one or two
pairs at each distance, which tell chance: of what class a neighbour there is and which way it
looks, all pairs on a post, and all that stand further off, say as much as one more would (a unit
information prior: R. E. Kass and L. Wasserman, J. American Statistical Association 90, 1995).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import i0e

from automap.earth import ecef
from automap.inventory.classes import same_face
from automap.inventory.findings import Inventory
from automap.inventory.limits import LEAST_SD_M
from automap.jit import kernel
from automap.mapping.candidates import facing_evidence
from automap.mapping.grid import east_north
from automap.mapping.limits import FACING_SD, MOVED_M
from automap.records import FloatArray, IntArray

_STEP_M = 0.5
"""Of distances: about what one drive's map errs by, finer ones are not told apart."""
_REACH_M = 1.25 * MOVED_M
"""What stands a little further off than candidates do may be found among them."""
_TURNS = 24
"""Sectors of 15 deg: a little more than half of what a face's direction errs by."""
_CLASSES = {True: 0, False: 1, None: 2}


@dataclass(frozen=True)
class Looks:
    """What candidates [k] look like: ``turn_rad`` the found sign's direction against the listed
    one's (NaN unknown) and its ``variance``, rad^2, ``classes`` [k, 3] how many times likelier than
    by chance a neighbour would have the found sign's class if its own is that of the listed one,
    another, or not known."""

    turn_rad: FloatArray
    variance: FloatArray
    classes: FloatArray

    @classmethod
    def blank(cls, n: int) -> Looks:
        """Of ``n`` candidates of which nothing is known."""
        return cls(np.full(n, np.nan), np.full(n, FACING_SD**2), np.ones((n, 3)))

    def of_class(self, k: int, same: bool, chance: float, chance_listed: float) -> None:
        """Candidate ``k`` is of the listed class or not; shares of either class on the map."""
        self.classes[k, 0] = 1.0 / chance if same else 0.0
        self.classes[k, 1] = 0.0 if same else 1.0 / (1.0 - chance_listed)


@kernel
def facing_evidences(turn: FloatArray, variance: FloatArray) -> FloatArray:
    """Evidence in nats [k, n] of the angles ``turn`` between two faces, of ``variance`` [k]."""
    told = np.empty(turn.shape)
    for k in range(len(turn)):
        for n in range(turn.shape[1]):
            told[k, n] = facing_evidence(turn[k, n], variance[k])
    return told


def neighbours_of(inventory: Inventory) -> FloatArray:
    """Neighbours of a listed sign, on average [3, d, 25]: by class (the same, another, not known),
    distance in steps of 0.5 m, of which the first is one post, and the turn of their face against
    its own in sectors of 15 deg, the last one for unknown turns."""
    count = np.zeros((3, round(_REACH_M / _STEP_M), _TURNS + 1))
    lat, lon, facing = inventory.lat_rad, inventory.lon_rad, inventory.facing_rad
    tree = cKDTree(ecef(lat, lon, np.zeros(len(inventory))))
    a, b = tree.query_pairs(_REACH_M, output_type="ndarray").T
    apart = np.hypot(*east_north(lat[a], lon[a], lat[b], lon[b]).T)
    step = np.minimum((apart / _STEP_M).astype(np.int64), count.shape[1] - 1)
    names = inventory.class_name
    both = zip(a.tolist(), b.tolist(), strict=True)
    alike = np.array([_CLASSES[same_face(names[i], names[j])] for i, j in both], np.int64)
    for one, other in ((a, b), (b, a)):
        np.add.at(count, (alike, step, _sector(facing[other] - facing[one])), 1.0)
    for part in (count[:, :1], count[:, 1:]):
        usual = part.sum(axis=1, keepdims=True) / max(part.sum(), 1.0)
        there = part.sum(axis=(0, 2))[:, None]
        # a pair is counted from either end
        part[:] = there * (part + 2.0 * usual) / (there + 2.0)
    return count / max(len(inventory), 1)


def _sector(turn: FloatArray) -> IntArray:
    known = np.isfinite(turn)
    part = np.where(known, turn, 0.0) / (2.0 * np.pi) % 1.0
    return np.where(known, np.minimum((part * _TURNS).astype(np.int64), _TURNS - 1), _TURNS)


def neighbour_density(
    neighbours: FloatArray, apart_m: FloatArray, sd_m: FloatArray, looks: Looks
) -> FloatArray:
    """Neighbours [k] per square metre that would be found ``apart_m`` from a listed sign, with an
    error of ``sd_m`` per axis, and look like what was found, over how likely any sign looks so."""
    ring = (np.arange(neighbours.shape[1]) + 0.5) * _STEP_M
    variance = np.maximum(sd_m, LEAST_SD_M)[:, None] ** 2
    # where a point that stands anywhere on a ring is found
    place = i0e(apart_m[:, None] * ring / variance) / (2.0 * np.pi * variance)
    place *= np.exp(-0.5 * (apart_m[:, None] - ring) ** 2 / variance)
    middle = (np.arange(_TURNS) + 0.5) * 2.0 * np.pi / _TURNS
    turns = np.ones((len(apart_m), _TURNS + 1))
    known = np.isfinite(looks.turn_rad)
    turn = looks.turn_rad[known, None] - middle
    turns[known, :_TURNS] = np.exp(facing_evidences(turn, looks.variance[known]))
    density = np.zeros(len(apart_m))
    for kind in _CLASSES.values():
        density += looks.classes[:, kind] * ((place @ neighbours[kind]) * turns).sum(axis=1)
    return density
