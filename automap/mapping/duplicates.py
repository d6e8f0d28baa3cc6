"""Map signs that are one: founded twice because a drive's offset was found too late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from automap.earth import ecef, ecef_axes
from automap.frames import wrap_pi
from automap.mapping import limits
from automap.mapping.association import Association, Members, renumbered
from automap.mapping.candidates import (
    D_E,
    D_N,
    D_U,
    PLACES,
    V_EE,
    V_EN,
    V_NN,
    V_U,
    facing_evidence,
)
from automap.mapping.classes import class_evidence
from automap.mapping.offset_kernels import agreement
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray

_PASSES = 6
"""At most; ends where none is joined."""


@dataclass(frozen=True)
class _Places:
    """Per sign: mean ``position`` [m, 3] Earth-fixed, ``axes`` [m, 3, 3] east, north, up in
    them, information ``weight`` [m, 4] (ee, en, nn, u), ``wander`` [m, 3] variance of the
    members' offsets, ``facing`` [m] and its variance ``facing_var`` [m], ``code``
    [m]."""

    position: FloatArray
    axes: FloatArray
    weight: FloatArray
    wander: FloatArray
    facing: FloatArray
    facing_var: FloatArray
    code: IntArray


def join_duplicates(
    sightings: Sightings, association: Association, detection: float = limits.DETECTION
) -> Association:
    """Join map signs where one sign explains the sightings better than two.

    Two signs side by side are seen together by most drives, one sign founded twice by none.
    Against each other stand: every drive that saw only one of them (a miss of the other, with
    probability 1 - ``detection``), every drive that saw both (a sign found twice), the distance
    in sigmas or as an outlier, class and facing; a sign that was replaced by another in between
    is two.
    """
    if len(association.sign) == 0:
        return association
    sign = association.sign.copy()
    evidence = class_evidence(sightings.classes)
    for _ in range(_PASSES):
        places = _places(sightings, association, sign)
        pairs = _close_pairs(places)
        if len(pairs) == 0:
            break
        members = Members(sign)
        scored = []
        for a, b in pairs.tolist():
            rows = members[a], members[b]
            score = _evidence_for_one(places, sightings, evidence, a, b, *rows, detection)
            if score > 0.0:
                scored.append((-score, a, b))
        taken: set[int] = set()
        for _, a, b in sorted(scored):
            if a not in taken and b not in taken:
                taken |= {a, b}
                sign[members[b]] = a
        if not scored:
            break
        sign = renumbered(sign)
    return Association(renumbered(sign), association.offset, association.offset_var)


def _places(sightings: Sightings, association: Association, sign: IntArray) -> _Places:
    m = int(sign.max()) + 1
    first = np.unique(sign, return_index=True)[1]
    turn = wrap_pi(sightings.lon - sightings.lon[first][sign])
    east = turn * sightings.per_lon - association.offset[:, 0]
    north = (sightings.lat - sightings.lat[first][sign]) * sightings.per_lat
    north = north - association.offset[:, 1]
    own = sightings.own
    det = own[:, 0] * own[:, 2] - own[:, 1] ** 2
    w = np.column_stack([own[:, 2] / det, -own[:, 1] / det, own[:, 0] / det])
    known = np.isfinite(sightings.height)
    up = np.where(known, sightings.height - association.offset[:, 2], 0.0)
    w_u = np.where(known, 1.0 / sightings.own_u, 0.0)

    def total(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(sign, values, m), np.float64)

    a_ee, a_en, a_nn = (total(w[:, k]) for k in range(3))
    b_e = total(w[:, 0] * east + w[:, 1] * north)
    b_n = total(w[:, 1] * east + w[:, 2] * north)
    det = a_ee * a_nn - a_en**2
    mean_e, mean_n = (a_nn * b_e - a_en * b_n) / det, (a_ee * b_n - a_en * b_e) / det
    a_u = total(w_u)
    with np.errstate(invalid="ignore", divide="ignore"):
        height = total(w_u * up) / a_u
    lat = sightings.lat[first] + mean_n / sightings.per_lat[first]
    lon = sightings.lon[first] + mean_e / sightings.per_lon[first]
    position, axes = ecef(lat, lon, np.nan_to_num(height)), ecef_axes(lat, lon)
    enu = np.stack([axes[:, :, 1], axes[:, :, 0], -axes[:, :, 2]], axis=1)
    count = np.bincount(sign, minlength=m)
    wander = np.stack([total(association.offset_var[:, k]) / count**2 for k in range(3)], axis=1)
    told = np.isfinite(sightings.facing)
    sure = told / np.fmax(0.5 * limits.FACING_SD**2, sightings.facing_sd_rad**2)
    facing = np.arctan2(
        total(sure * np.nan_to_num(np.sin(sightings.facing))),
        total(sure * np.nan_to_num(np.cos(sightings.facing))),
    )
    with np.errstate(invalid="ignore"):
        # each drive took the same road's direction for it, so that many know it no better than one
        facing_var = total(told.astype(np.float64)) / total(sure)
    facing[~np.isfinite(facing_var)] = np.nan
    return _Places(
        position, enu, np.column_stack([a_ee, a_en, a_nn, a_u]), wander, facing, facing_var,
        dominant_code(sign, sightings.code, sightings.confidence),
    )  # fmt: skip


def dominant_code(sign: IntArray, code: IntArray, confidence: FloatArray) -> IntArray:
    """Class [m] with the greatest sum of confidence among each sign's sightings."""
    width = int(code.max()) + 1 if len(code) else 1
    keys, place = np.unique(sign * width + code, return_inverse=True)
    weight = np.bincount(place, np.maximum(confidence, limits.LEAST_CONFIDENCE))
    order = np.lexsort((keys, -weight, keys // width))
    _, first = np.unique(keys[order] // width, return_index=True)
    return np.asarray(keys[order][first] % width, np.int64)


def _close_pairs(places: _Places) -> IntArray:
    tree = cKDTree(places.position)
    # heights may be unknown on one side, so the reach is taken in plan afterwards
    pairs = tree.query_pairs(limits.REACH_M + 2.0, output_type="ndarray")
    if len(pairs) == 0:
        return np.zeros((0, 2), np.int64)
    a, b = pairs.T
    difference = places.position[b] - places.position[a]
    plan = np.einsum("nij,nj->ni", places.axes[a], difference)[:, :2]
    return np.asarray(pairs[np.hypot(*plan.T) < limits.REACH_M], np.int64)


def _evidence_for_one(
    places: _Places,
    sightings: Sightings,
    evidence: FloatArray,
    a: int,
    b: int,
    rows_a: IntArray,
    rows_b: IntArray,
    detection: float,
) -> float:
    """Nats by which one sign explains two groups of sightings better than two signs do."""
    facing = 0.0
    if np.isfinite(places.facing[a]) and np.isfinite(places.facing[b]):
        variance = places.facing_var[a] + places.facing_var[b]
        facing = float(facing_evidence(places.facing[a] - places.facing[b], variance))
        if facing == -np.inf:
            return facing
    drives_a, drives_b = (set(sightings.drive[rows].tolist()) for rows in (rows_a, rows_b))
    both = len(drives_a & drives_b)
    single = len(drives_a ^ drives_b)
    missed = single * np.log(1.0 - detection)
    if both == 0 and (max(drives_a) < min(drives_b) or max(drives_b) < min(drives_a)):
        missed = max(missed, np.log(limits.REPLACED))
    seen_twice = both * (np.log(limits.TWICE_IN_DRIVE) - np.log(detection))
    return float(
        seen_twice
        - missed
        + facing
        + evidence[places.code[a], places.code[b]]
        + _place_evidence(places, a, b, min(len(rows_a), len(rows_b)))
    )


def _place_evidence(places: _Places, a: int, b: int, fewer: int) -> float:
    values = np.zeros(PLACES)
    values[[D_E, D_N, D_U]] = places.axes[a] @ (places.position[b] - places.position[a])
    for k in (a, b):
        ee, en, nn, _ = places.weight[k]
        values[[V_EE, V_EN, V_NN]] += np.array([nn, -en, ee]) / (ee * nn - en**2)
    slack = limits.SLACK_M**2 + places.wander[a] + places.wander[b]
    up = places.weight[[a, b], 3]
    values[V_U] = (1.0 / up).sum() + slack[2] if (up > 0).all() else np.nan
    told = agreement(values, 0.0, 0.0, 0.0, slack[0], slack[1])
    # signs stand closer about a sign than new ones do about the map's
    told += np.log(limits.NEW_PER_M2 / limits.NEAR_PER_M2)
    told += np.log(limits.NEW_PER_M / limits.NEAR_PER_M) if np.isfinite(values[V_U]) else 0.0
    stray = fewer * np.log(limits.OUTLIER_SHARE / (np.pi * limits.REACH_M**2) / limits.NEAR_PER_M2)
    return float(max(told, stray))
