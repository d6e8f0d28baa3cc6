"""Map signs that are one: founded twice because a drive's offset was found too late."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.association import Association, Members, renumbered
from automap.mapping.candidates import (
    D_E,
    D_N,
    D_U,
    HEIGHT,
    LAT,
    LON,
    PLACES,
    V_EE,
    V_EN,
    V_NN,
    V_U,
    Columns,
    MapSigns,
    add_member,
    agreement,
    columns_of,
    empty_map,
    face_of,
    facing_evidence,
    found_sign,
    mean_of,
    variances_of,
)
from automap.mapping.classes import class_evidence
from automap.mapping.grid import delta, neighbours
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray

TwoSigns = Callable[[IntArray, IntArray], bool]


def join_duplicates(
    sightings: Sightings, association: Association, two: TwoSigns = lambda a, b: False
) -> IntArray:
    """The sign [n] of every sighting, with map signs joined where one explains the sightings better
    than two.

    Two signs side by side are seen together by most drives, one sign founded twice by none.
    Against each other stand: every drive that saw only one of them (a miss of the other, with
    probability 1 - ``DETECTION``), every drive that saw both (a sign found twice), the distance
    in sigmas or as an outlier, class and facing; a sign that was replaced by another in between
    is two, and so is what ``two`` knows for sure by the rows of the sightings of both.
    """
    sign = association.sign.copy()
    evidence, seen = class_evidence(sightings.classes), columns_of(sightings)
    while True:
        members = Members(sign)
        rows, edges = members.order, members.edges
        offset, signs = (association.offset, association.offset_var), empty_map(len(edges) - 1)
        scored = _gains(rows, edges, sightings.drive[rows], seen, *offset, evidence, signs)
        taken: set[int] = set()
        for _, a, b in sorted(scored):
            own, others = (rows[edges[k] : edges[k + 1]] for k in (a, b))
            if a not in taken and b not in taken and not two(own, others):
                taken |= {a, b}
                sign[others] = a
        sign = renumbered(sign)
        if not taken:
            return sign


@kernel
def _gains(
    rows: IntArray,
    edges: IntArray,
    drive: IntArray,
    seen: Columns,
    offset: FloatArray,
    offset_var: FloatArray,
    evidence: FloatArray,
    signs: MapSigns,
) -> list[tuple[float, int, int]]:
    """Pairs of signs near one another that one sign explains better than two do: less the nats by
    which it does, and their numbers. Sign k is of the sightings ``rows[edges[k] : edges[k + 1]]``,
    ``drive`` [n] in this order; ``signs`` is empty."""
    # of their places by how unsure the drives' offsets are, m^2
    wander = np.zeros((len(edges) - 1, 3))
    for k in range(len(edges) - 1):
        own = rows[edges[k] : edges[k + 1]]
        founder = own[0]
        for i in own[::-1]:
            # heights are relative to the founder's
            if seen.height[i] == seen.height[i]:
                founder = i
        found_sign(k, founder, seen, offset[founder], signs)
        for i in own:
            add_member(k, i, 1.0, seen, offset[i], signs)
            wander[k] += offset_var[i] / len(own) ** 2
    scored = [(0.0, 0, 0) for _ in range(0)]
    near, values = np.empty(256, np.int64), np.zeros(PLACES)
    for a in range(len(edges) - 1):
        of_a, founder = signs.state[a], rows[edges[a]]
        per_lat, per_lon = seen.per_lat[founder], seen.per_lon[founder]
        for place in range(neighbours(signs.table, of_a[LAT], of_a[LON], np.int64(1), near)):
            b = near[place]
            of_b = signs.state[b]
            de, dn = delta(of_b[LAT], of_b[LON], of_a[LAT], of_a[LON], per_lat, per_lon)
            one, other = mean_of(of_a), mean_of(of_b)
            values[D_E], values[D_N] = de + other[0] - one[0], dn + other[1] - one[1]
            if b <= a or values[D_E] ** 2 + values[D_N] ** 2 > limits.REACH_M**2:
                continue
            (face_a, var_a), (face_b, var_b) = face_of(of_a), face_of(of_b)
            told = 0.0
            if face_a == face_a and face_b == face_b:
                told = facing_evidence(face_a - face_b, var_a + var_b)
            class_a = signs.slot_class[a, np.argmax(signs.slot_weight[a])]
            class_b = signs.slot_class[b, np.argmax(signs.slot_weight[b])]
            told += evidence[class_a, class_b]
            own, others = drive[edges[a] : edges[a + 1]], drive[edges[b] : edges[b + 1]]
            told += _by_drives(own, others)
            slack = limits.SLACK_M**2 + wander[a] + wander[b]
            v_a, v_b = variances_of(of_a), variances_of(of_b)
            values[V_EE], values[V_NN] = v_a[0] + v_b[0], v_a[2] + v_b[2]
            values[V_EN] = v_a[1] + v_b[1]
            up = of_b[HEIGHT] + other[2] - of_a[HEIGHT] - one[2]
            values[D_U], values[V_U] = up, v_a[3] + v_b[3] if up == up else np.nan
            by_place = agreement(values, np.zeros(3), slack)
            # signs stand closer about a sign than new ones do about the map's
            by_place += math.log(limits.NEW_PER_M2 / limits.NEAR_PER_M2)
            by_place += math.log(limits.NEW_PER_M / limits.NEAR_PER_M) if up == up else 0.0
            stray = limits.OUTLIER_SHARE / (math.pi * limits.REACH_M**2) / limits.NEAR_PER_M2
            told += max(by_place, min(len(own), len(others)) * math.log(stray))
            if told > 0.0:
                scored.append((-told, a, b))
    return scored


@kernel
def _by_drives(a: IntArray, b: IntArray) -> float:
    """Nats for one sign by the drives, ascending, of the sightings of two."""
    a, b = np.unique(a), np.unique(b)
    both = 0
    for drive in a:
        both += (b == drive).sum()
    missed = (len(a) + len(b) - 2 * both) * math.log(1.0 - limits.DETECTION)
    if both == 0 and (a[-1] < b[0] or b[-1] < a[0]):
        missed = max(missed, math.log(limits.REPLACED))
    return float(both * math.log(limits.TWICE_IN_DRIVE / limits.DETECTION) - missed)
