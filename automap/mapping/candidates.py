"""Signs of a map as it grows, and which of them a sighting may be before the drive's offset."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.grid import Table, delta, empty_table, insert, neighbours, turned
from automap.mapping.sightings import Sightings
from automap.records import BoolArray, FloatArray, IntArray

# columns of the map's state, one row per sign
LAT, LON, HEIGHT = 0, 1, 2  # where the sign was founded; its mean is relative to that
A_EE, A_EN, A_NN, A_U = 3, 4, 5, 6  # information of the members' own errors, 1/m^2
B_E, B_N, B_U = 7, 8, 9  # information times place
FACE_N, FACE_E, FACE_W, FACES = 10, 11, 12, 13  # faces by their information, 1/rad^2, and number
SUPPORT = 14
STATE = 15
"""Number of these columns."""

CLASS_SLOTS = 4
"""Classes that are kept of a map sign."""

PLACES = 8
"""Number of a candidate's columns."""
# columns of a candidate: place relative to the map sign, variances of both, evidence
D_E, D_N, D_U, V_EE, V_EN, V_NN, V_U, EVIDENCE = 0, 1, 2, 3, 4, 5, 6, 7

CELL_M = 16.0
"""Of the table of map signs; founding and mean place of a sign differ by little."""
_NEAR = 1024
"""Map signs that are looked at round a place, at most: one on 30 m^2 within ``SEEN_FROM_M``."""
_SEEN_ODDS = limits.DETECTION / (1.0 - limits.DETECTION)
_LEAST_INFORMATION = 1e-9
"""On the place of a sign without members, 1/m^2."""


class Columns(NamedTuple):
    """The columns of ``Sightings`` that kernels take."""

    time_s: FloatArray
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    per_lat: FloatArray
    per_lon: FloatArray
    own: FloatArray
    own_u: FloatArray
    shared_sd: FloatArray
    facing: FloatArray
    facing_sd_rad: FloatArray
    code: IntArray
    confidence: FloatArray


class MapSigns(NamedTuple):
    """Signs [m] of the map as it grows: ``state`` [m, STATE], of ``CLASS_SLOTS`` classes each
    ``slot_class`` and ``slot_weight``, which are ``active``, and ``table`` of where they stand."""

    state: FloatArray
    slot_class: IntArray
    slot_weight: FloatArray
    active: BoolArray
    table: Table


def columns_of(sightings: Sightings) -> Columns:
    """What kernels take of some sightings, in one layout wherever they come from: for another the
    kernels would be compiled once more."""
    found = (getattr(sightings, name) for name in Columns._fields)
    return Columns(*(np.require(values, None, ("C", "W")) for values in found))


def empty_map(room: int) -> MapSigns:
    """A map without signs, for up to ``room`` of them."""
    return MapSigns(
        np.empty((room, STATE)),
        np.empty((room, CLASS_SLOTS), np.int64),
        np.empty((room, CLASS_SLOTS)),
        np.zeros(room, np.bool_),
        empty_table(room, CELL_M),
    )


@kernel
def mean_of(state: FloatArray) -> tuple[float, float, float]:
    """Mean place of a map sign relative to where it was founded: east, north, up in m."""
    det = state[A_EE] * state[A_NN] - state[A_EN] * state[A_EN]
    east = (state[A_NN] * state[B_E] - state[A_EN] * state[B_N]) / det
    north = (state[A_EE] * state[B_N] - state[A_EN] * state[B_E]) / det
    up = state[B_U] / state[A_U] if state[A_U] > 0.0 else np.nan
    return east, north, up


@kernel
def variances_of(state: FloatArray) -> tuple[float, float, float, float]:
    """Variances ee, en, nn, u in m^2 of that mean by its members' own errors."""
    det = state[A_EE] * state[A_NN] - state[A_EN] * state[A_EN]
    return state[A_NN] / det, -state[A_EN] / det, state[A_EE] / det, 1.0 / state[A_U]


@kernel
def face_of(state: FloatArray) -> tuple[float, float]:
    """Direction a map sign faces, rad, and its variance; NaN where none is known. Each drive took
    the same road's direction for it, so that many know it no better than one."""
    if state[FACE_N] ** 2 + state[FACE_E] ** 2 > 1e-9:
        return np.arctan2(state[FACE_E], state[FACE_N]), state[FACES] / state[FACE_W]
    return np.nan, np.nan


@kernel
def add_member(
    k: int, i: int, sign: float, seen: Columns, offset: FloatArray, signs: MapSigns
) -> None:
    """Add sighting ``i``, moved by its drive's ``offset`` [3], to map sign ``k``.

    ``sign`` -1 takes out what +1 put in.
    """
    state, own, height, facing = signs.state, seen.own, seen.height, seen.facing
    det = own[i, 0] * own[i, 2] - own[i, 1] ** 2
    w_ee, w_en, w_nn = own[i, 2] / det, -own[i, 1] / det, own[i, 0] / det
    at = state[k, LAT], state[k, LON]
    de, dn = delta(seen.lat[i], seen.lon[i], *at, seen.per_lat[i], seen.per_lon[i])
    de, dn = de - offset[0], dn - offset[1]
    state[k, A_EE] += sign * w_ee
    state[k, A_EN] += sign * w_en
    state[k, A_NN] += sign * w_nn
    state[k, B_E] += sign * (w_ee * de + w_en * dn)
    state[k, B_N] += sign * (w_en * de + w_nn * dn)
    if height[i] == height[i] and state[k, HEIGHT] == state[k, HEIGHT]:
        state[k, A_U] += sign / seen.own_u[i]
        state[k, B_U] += sign * (height[i] - state[k, HEIGHT] - offset[2]) / seen.own_u[i]
    if facing[i] == facing[i]:
        w = sign / facing_variance(seen.facing_sd_rad[i])
        state[k, FACE_N] += w * np.cos(facing[i])
        state[k, FACE_E] += w * np.sin(facing[i])
        state[k, FACE_W] += w
        state[k, FACES] += sign
    state[k, SUPPORT] += sign
    weight = sign * max(seen.confidence[i], limits.LEAST_CONFIDENCE)
    free = -1
    for slot in range(CLASS_SLOTS):
        if signs.slot_weight[k, slot] > 1e-6:
            if signs.slot_class[k, slot] == seen.code[i]:
                signs.slot_weight[k, slot] += weight
                return
        elif free < 0:
            free = slot
    if sign > 0.0 and free >= 0:
        signs.slot_class[k, free] = seen.code[i]
        signs.slot_weight[k, free] = weight


@kernel
def found_sign(k: int, i: int, seen: Columns, offset: FloatArray, signs: MapSigns) -> None:
    """Make map sign ``k``, still without members, where sighting ``i`` sees it."""
    state = signs.state
    state[k] = 0.0
    state[k, A_EE] = state[k, A_NN] = state[k, A_U] = _LEAST_INFORMATION
    state[k, LAT] = seen.lat[i] - offset[1] / seen.per_lat[i]
    state[k, LON] = seen.lon[i] - offset[0] / seen.per_lon[i]
    state[k, HEIGHT] = seen.height[i] - offset[2]
    signs.slot_weight[k] = 0.0
    signs.active[k] = True
    insert(signs.table, k, state[k, LAT], state[k, LON])


@kernel
def facing_variance(sd: float) -> float:
    """Variance, rad^2, of a face's direction by the one sigma that its drive states (NaN: none):
    at least what is usual, half of that between two drives."""
    usual = 0.5 * limits.FACING_SD**2
    return float(sd * sd) if sd * sd > usual else usual


@kernel
def facing_evidence(difference: float, variance: float = limits.FACING_SD**2) -> float:
    """Evidence in nats of an angle between two faces that may be one; -inf beyond the limit.

    ``variance`` rad^2 of the angle: a face that a drive saw at a slant, and may be its mirror
    image, says little either way, and the limit is as many sigmas as that of well seen ones.
    """
    turn, sd = abs(turned(difference)), math.sqrt(variance)
    if not turn * limits.FACING_SD <= limits.FACING_LIMIT * sd:
        return -np.inf
    best = math.log(2.0 * math.pi / (math.sqrt(2.0 * math.pi) * sd))
    return float(best - 0.5 * (turn / sd) ** 2)


@kernel
def match_gain(v_ee: float, v_en: float, v_nn: float, v_u: float) -> float:
    """Evidence in nats of a perfect agreement of place, against a sign new to the map."""
    gain = -math.log(2.0 * math.pi * math.sqrt(v_ee * v_nn - v_en * v_en) * limits.NEW_PER_M2)
    if v_u == v_u:
        gain -= math.log(math.sqrt(2.0 * math.pi * v_u) * limits.NEW_PER_M)
    return gain


@kernel
def agreement(values: FloatArray, offset: FloatArray, variance: FloatArray) -> float:
    """Evidence in nats for one candidate when the drive's ``offset`` [3] is known with
    ``variance`` [3]."""
    v_ee, v_en, v_nn = values[V_EE] + variance[0], values[V_EN], values[V_NN] + variance[1]
    v_u = values[V_U] + variance[2]
    de, dn, du = values[D_E] - offset[0], values[D_N] - offset[1], values[D_U] - offset[2]
    det = v_ee * v_nn - v_en * v_en
    square = (v_nn * de * de - 2.0 * v_en * de * dn + v_ee * dn * dn) / det
    if v_u == v_u:
        square += du * du / v_u
    return float(values[EVIDENCE] + match_gain(v_ee, v_en, v_nn, v_u) - 0.5 * square)


@kernel
def find_candidates(
    lo: int,
    hi: int,
    seen: Columns,
    evidence: FloatArray,
    signs: MapSigns,
    index: IntArray,
    values: FloatArray,
) -> None:
    """Fill ``index`` [n, MOST] (-1 none) and ``values`` [n, MOST, PLACES] for rows lo to hi of the
    sightings ``seen``; ``evidence`` [k, k] of their classes.

    The likeliest are kept: within the gate of everything including the offset, in plan and in
    height; faces that look away from one another are never one sign. Beforehand a sighting is of a
    sign the likelier the more often that was seen (a Dirichlet process mixture: R. M. Neal, Journal
    of Computational and Graphical Statistics 9, 2000), by the odds of a sign to be seen rather than
    missed (Y. Bar-Shalom, X.-R. Li, Multitarget-Multisensor Tracking, 1995): so the sightings of a
    sign that was founded twice go over to the one that more drives saw.
    """
    state, slot_class, slot_weight, active, table = signs
    lat, lon, own, shared_sd, facing = seen.lat, seen.lon, seen.own, seen.shared_sd, seen.facing
    near, kept = np.empty(_NEAR, np.int64), np.empty(_NEAR, np.int64)
    against, found_values = np.empty(_NEAR), np.empty((_NEAR, PLACES))
    slack = limits.SLACK_M * limits.SLACK_M
    for i in range(lo, hi):
        count = 0
        # the map's own frame is some other drive's, as far off as this one
        wander = 2.0 * shared_sd[i] ** 2
        p_plan, p_u = wander[0] + wander[1], wander[2]
        reach_m = math.sqrt(limits.SAME_GATE * (own[i, 0] + own[i, 2] + p_plan))
        reach_m = min(max(reach_m, CELL_M), limits.SEEN_FROM_M)
        found = neighbours(table, lat[i], lon[i], math.ceil(reach_m / CELL_M), near)
        for place in range(found):
            k = near[place]
            if not active[k]:
                continue
            e, n, u = mean_of(state[k])
            per_lat, per_lon = seen.per_lat[i], seen.per_lon[i]
            de, dn = delta(lat[i], lon[i], state[k, LAT], state[k, LON], per_lat, per_lon)
            de, dn = de - e, dn - n
            square = de * de + dn * dn
            if square > reach_m * reach_m:
                continue
            v_ee, v_en, v_nn, v_u = variances_of(state[k])
            v_ee, v_en, v_nn = own[i, 0] + v_ee + slack, own[i, 1] + v_en, own[i, 2] + v_nn + slack
            if square > limits.SAME_GATE * (v_ee + v_nn + p_plan):
                continue
            du, v_u = seen.height[i] - state[k, HEIGHT] - u, seen.own_u[i] + v_u + slack
            if du * du > limits.SAME_GATE * (v_u + p_u):
                continue
            du, v_u = (du, v_u) if du == du else (0.0, np.nan)
            told = 0.0
            direction, variance = face_of(state[k])
            if direction == direction and facing[i] == facing[i]:
                variance += facing_variance(seen.facing_sd_rad[i])
                told = facing_evidence(facing[i] - direction, variance)
                if told == -np.inf:
                    continue
            total, weight = 0.0, 0.0
            for slot in range(CLASS_SLOTS):
                if slot_weight[k, slot] > 0.0:
                    weight += slot_weight[k, slot]
                    total += slot_weight[k, slot] * evidence[seen.code[i], slot_class[k, slot]]
            if weight > 0.0:
                told += total / weight
            # a drive that saw another one here missed this, which the more drives saw
            told += math.log(max(state[k, SUPPORT], 1.0) * _SEEN_ODDS)
            kept[count] = k
            found_values[count] = np.array([de, dn, du, v_ee, v_en, v_nn, v_u, told])
            # where drives are as far off as they usually are
            against[count] = -agreement(found_values[count], np.zeros(3), wander)
            count += 1
        likeliest = np.argsort(against[:count])[: limits.MOST]
        index[i - lo] = -1
        index[i - lo, : len(likeliest)] = kept[likeliest]
        values[i - lo, : len(likeliest)] = found_values[likeliest]
