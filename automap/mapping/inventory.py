"""A map of signs against a list of signs that somebody keeps: the same, moved, changed, new, gone.

Each pair of a map sign and a listed one near it has a probability of being one sign in place, and
of being one that was moved; errors of the list, its common shift and the share of signs that it
lacks are estimated with them by expectation maximisation (Dempster, Laird, Rubin, Journal of the
Royal Statistical Society B 39, 1977). Who belongs to whom is then decided for all together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from automap.assignment import assign_near
from automap.earth import ecef, metres_per_radian
from automap.mapping.candidates import facing_evidence
from automap.mapping.inventory_classes import looks_otherwise, of_another_class, same_face
from automap.mapping.inventory_directions import Directions, directions_of
from automap.mapping.inventory_findings import (
    Finding,
    Inventory,
    class_belief,
    judge_classes,
    mark_sure,
    new_signs,
    not_found,
)
from automap.mapping.inventory_limits import (
    DETECTION_PRIOR,
    LARGEST_SD_M,
    LEAST_SD_M,
    LIKELIER_THAN_NOT,
    NEW_SHARE,
    ROUNDS,
    STALE,
    USUAL_PAIRS,
    USUAL_SD_M,
)
from automap.mapping.limits import MOVED_M
from automap.mapping.sightings import DriveSigns
from automap.records import BoolArray, FloatArray, IntArray, Sign
from automap.signs.codes import face_of


@dataclass(frozen=True)
class InventoryComparison:
    """``findings`` of all signs; the inventory's ``shift_m`` [2] east and north against the map,
    its error ``sd_m`` per axis without that, ``normalised_square`` of pairs in place (1 where the
    stated errors are right, NaN without pairs), ``directions`` what its directions
    mean, and ``detection``, how often a sign in view was found."""

    findings: list[Finding]
    shift_m: FloatArray
    sd_m: float
    normalised_square: float
    directions: Directions
    detection: float


@dataclass(frozen=True)
class _Pairs:
    """Candidates [k]: ``sign``, ``listed``; from listed to found ``apart`` [k, 2] m; the map's
    covariance ``cov`` [k, 2, 2]; log evidence of class and facing ``told``."""

    sign: IntArray
    listed: IntArray
    apart: FloatArray
    cov: FloatArray
    told: FloatArray


def compare_inventory(
    signs: Sequence[Sign],
    inventory: Inventory,
    drives: Sequence[DriveSigns],
    shares: Sequence[Mapping[str, float]] = (),
) -> InventoryComparison:
    """What of ``inventory`` is on the map, what is not, and what the map has besides.

    ``signs`` with positions; ``drives`` tell where cameras looked; ``shares`` what the views of
    each sign give to each class (empty: not known).
    """
    shares = shares or [{}] * len(signs)
    near, directions = None, Directions()
    if len(signs) and len(inventory):
        near = _near(signs, inventory)
        directions = directions_of(signs, inventory, *near)
    if directions.turned:
        inventory = replace(inventory, facing_rad=inventory.facing_rad + np.pi)
    if not directions.used:
        inventory = replace(inventory, facing_rad=np.full(len(inventory), np.nan))
    pairs = _candidates(signs, inventory, shares, near)
    shift, sd, part, evidence, moved, square = _fit(pairs, inventory, signs)
    pairs = replace(pairs, cov=part * pairs.cov)
    chosen = _one_to_one(pairs, evidence, len(signs))
    findings = [
        _paired(pairs, k, signs, inventory, shares, shift, sd, float(moved[k]))
        for k in chosen.tolist()
    ]
    partner = np.full(len(inventory), -1)
    partner[pairs.listed[chosen]] = pairs.sign[chosen]
    unknown = np.setdiff1d(np.arange(len(signs)), pairs.sign[chosen])
    by_sign, by_listed = _rivals(pairs, evidence, chosen, len(signs), len(inventory))
    findings = [
        _moved_after_all(f, float(moved[k]))
        for f, k in zip(judge_classes(findings), chosen.tolist(), strict=True)
    ]
    findings = [
        replace(f, probability=f.probability / float(1.0 + by_sign[f.sign] + by_listed[f.listed]))
        for f in findings
    ] + [
        replace(f, probability=f.probability / float(1.0 + by_sign[f.sign]))
        for f in new_signs(signs, unknown)
    ]
    lost, detection = not_found(inventory, partner, signs, drives, 1.0 / (1.0 + by_listed))
    order = ("matched", "moved", "class", "new", "missing", "unconfirmed", "not_seen")
    findings = mark_sure([*findings, *lost])
    findings.sort(key=lambda f: (order.index(f.kind), f.listed, f.sign))
    return InventoryComparison(findings, shift, sd, square, directions, detection)


def _near(signs: Sequence[Sign], inventory: Inventory) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs within MOVED_M, and those further apart where the errors are as large."""
    from scipy.spatial import cKDTree

    lat, lon = np.array([s.lat_rad for s in signs]), np.array([s.lon_rad for s in signs])
    ours = cKDTree(ecef(lat, lon, np.zeros(len(lat))))
    theirs = cKDTree(ecef(inventory.lat_rad, inventory.lon_rad, np.zeros(len(inventory))))
    near: Any = ours.sparse_distance_matrix(theirs, MOVED_M, output_type="coo_matrix")
    i, j = near.row.astype(np.int64), near.col.astype(np.int64)
    north, east = metres_per_radian(lat[i], 0.0)
    turn = (lon[i] - inventory.lon_rad[j] + np.pi) % (2.0 * np.pi) - np.pi
    return i, j, np.column_stack([turn * east, (lat[i] - inventory.lat_rad[j]) * north])


def _belief(sign: Sign, shares: Mapping[str, float], listed: str) -> float:
    """How surely a sign is not of the class ``listed`` but of its own, by the map alone."""
    # a person who looked at the sign has the last word
    if shares and not sign.reviewed:
        return of_another_class(shares, listed)
    return class_belief(sign)


def _candidates(
    signs: Sequence[Sign],
    inventory: Inventory,
    shares: Sequence[Mapping[str, float]],
    near: tuple[IntArray, IntArray, FloatArray] | None,
) -> _Pairs:
    if near is None:
        none = np.zeros(0, np.int64)
        return _Pairs(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    i, j, apart = near
    names = [face_of(s.class_name) for s in signs]
    share = {name: (names.count(name) + 1.0) / (len(names) + 2.0) for name in set(names)}
    # what no detector tells is taken for sure, so that a list's error is the likelier one
    believed = [class_belief(s) if math.isfinite(s.class_probability) else 1.0 for s in signs]
    told = np.zeros(len(i))
    for k, (a, b) in enumerate(zip(i.tolist(), j.tolist(), strict=True)):
        same = same_face(signs[a].class_name, inventory.class_name[b])
        # by chance two signs have one class as often as the class is on the map
        chance = share[names[a]]
        if same is not None:
            # one sign under two classes: the list is wrong, or the map
            belief = believed[a]
            if not same and shares[a]:
                belief = _belief(signs[a], shares[a], inventory.class_name[b])
            right = (1.0 - STALE) * belief
            told[k] = math.log(right / chance + 1.0 - right if same else 1.0 - right)
        turn = signs[a].facing_rad - inventory.facing_rad[b]
        if np.isfinite(turn):
            told[k] += facing_evidence(turn)
    cov = np.array([s.cov_enu[:2, :2] for s in signs], np.float64).reshape(-1, 2, 2)
    known: BoolArray = np.asarray(np.isfinite(cov).all(axis=(1, 2)))
    cov = np.where(known[:, None, None], cov, USUAL_SD_M**2 * np.eye(2))
    keep = np.isfinite(told)
    return _Pairs(i[keep], j[keep], apart[keep], cov[i[keep]], told[keep])


def _fit(
    pairs: _Pairs, inventory: Inventory, signs: Sequence[Sign]
) -> tuple[FloatArray, float, float, FloatArray, FloatArray, float]:
    """Shift and sd of the list, the part of the map's variances that is each sign's own, each
    pair's log odds against standing alone, the probability that it was moved, and the mean square
    of pairs in place over what is expected."""
    shift, sd, new = np.zeros(2), USUAL_SD_M, NEW_SHARE
    n, m = len(signs), len(inventory)
    if len(pairs.sign) == 0:
        return shift, sd, 1.0, np.zeros(0), np.zeros(0), math.nan
    area = math.pi * MOVED_M**2
    # map signs round a listed one, besides its own
    crowd = max(len(pairs.sign) / m - 1.0, 1.0) / area
    stated = inventory.sd_m[pairs.listed]
    found = DETECTION_PRIOR[0] / sum(DETECTION_PRIOR) * (1.0 - STALE)
    moved_density = STALE / area
    part = 1.0
    for _ in range(ROUNDS):
        own = np.where(np.isfinite(stated), np.clip(stated, LEAST_SD_M, LARGEST_SD_M), sd)
        total = part * pairs.cov + own[:, None, None] ** 2 * np.eye(2)
        residual = pairs.apart - shift
        weighted = np.linalg.solve(total, residual[:, :, None])[:, :, 0]
        square = np.einsum("ki,ki->k", residual, weighted)
        in_place = (1.0 - STALE) * np.exp(-0.5 * square)
        in_place /= 2.0 * math.pi * np.sqrt(np.linalg.det(total))
        alone = (1.0 - found) * new * crowd / found
        evidence = pairs.told + np.log((in_place + moved_density) / alone)
        odds = np.exp(np.minimum(evidence, 500.0))
        # of one listed sign's candidates at most one is it, and so the other way round
        share = odds / (1.0 + _sum_of(pairs.listed, odds, m)[pairs.listed])
        other = odds / (1.0 + _sum_of(pairs.sign, odds, n)[pairs.sign])
        share = np.minimum(share, other)
        stays = share * in_place / (in_place + moved_density)
        information = np.linalg.inv(total) * stays[:, None, None]
        precision = information.sum(axis=0) + np.eye(2) / USUAL_SD_M**2
        shift = np.linalg.solve(precision, np.einsum("kij,kj->i", information, pairs.apart))
        # expectation of the list's own squared error, given the pair
        mean = own[:, None] ** 2 * weighted
        left = own**2 * (2.0 - own**2 * np.trace(np.linalg.inv(total), axis1=1, axis2=2))
        squares = np.einsum("ki,ki->k", mean, mean) + left
        told = np.isnan(stated) * stays
        prior = USUAL_PAIRS * USUAL_SD_M**2
        sd = math.sqrt((0.5 * (told * squares).sum() + prior) / (told.sum() + USUAL_PAIRS))
        sd = min(max(sd, LEAST_SD_M), LARGEST_SD_M)
        # and of the map's errors the part that signs do not have in common, which the shift is not
        squares = part**2 * np.einsum("ki,kij,kj->k", weighted, pairs.cov, weighted)
        squares += 2.0 * part
        squares -= part**2 * np.einsum("kij,kji->k", np.linalg.inv(total), pairs.cov)
        part = min((0.5 * float((stays * squares).sum()) + 1.0) / max(float(stays.sum()), 1.0), 1.0)
        new = min(max((n - share.sum() + 1.0) / (n + 2.0), 0.5 / (n + 2.0)), 1.0)
    moved = moved_density / (in_place + moved_density)
    weight = float(stays.sum())
    mean_square = float((stays * square).sum() / (2.0 * weight)) if weight > 1.0 else math.nan
    return shift, sd, part, evidence, moved, mean_square


def _sum_of(place: IntArray, values: FloatArray, n: int) -> FloatArray:
    return np.asarray(np.bincount(place, values, n), np.float64)


def _one_to_one(pairs: _Pairs, evidence: FloatArray, n: int) -> IntArray:
    """The candidates that are one sign, by the greatest sum of evidence; none against the odds."""
    good = np.flatnonzero(evidence > 0.0)
    partner = assign_near(pairs.sign[good], pairs.listed[good], -evidence[good], n, 0.0)
    chosen: IntArray = good[partner[pairs.sign[good]] == pairs.listed[good]]
    return chosen


def _rivals(
    pairs: _Pairs, evidence: FloatArray, chosen: IntArray, n: int, m: int
) -> tuple[FloatArray, FloatArray]:
    """Odds of each sign [n] and each listed one [m] being of another pair than what was ``chosen``,
    one that takes the place of one pair at most."""
    of_sign, of_listed = np.zeros(n), np.zeros(m)
    of_sign[pairs.sign[chosen]] = of_listed[pairs.listed[chosen]] = evidence[chosen]
    gives_up = of_sign[pairs.sign] + of_listed[pairs.listed]
    other = (of_sign[pairs.sign] == 0.0) | (of_listed[pairs.listed] == 0.0)
    odds = np.where(other, np.exp(np.minimum(evidence - gives_up, 0.0)), 0.0)
    # or of none: half of these odds is counted with the sign, half with the listed one
    odds[chosen] = 0.5 * np.exp(-evidence[chosen])
    return _sum_of(pairs.sign, odds, n), _sum_of(pairs.listed, odds, m)


def _moved_after_all(finding: Finding, moved: float) -> Finding:
    """One of another class, of which rather the map is wrong, and which stands elsewhere than it is
    listed: moved."""
    right = 1.0 - finding.probability
    if finding.kind != "class" or min(right, moved) <= LIKELIER_THAN_NOT:
        return finding
    return replace(finding, kind="moved", probability=right * moved)


def _paired(
    pairs: _Pairs,
    k: int,
    signs: Sequence[Sign],
    inventory: Inventory,
    shares: Sequence[Mapping[str, float]],
    shift: FloatArray,
    sd: float,
    moved: float,
) -> Finding:
    i, j = int(pairs.sign[k]), int(pairs.listed[k])
    own = min(inventory.sd_m[j], LARGEST_SD_M) if np.isfinite(inventory.sd_m[j]) else sd
    east, north = (pairs.apart[k] - shift).tolist()
    error = math.sqrt(0.5 * float(np.trace(pairs.cov[k])) + float(own) ** 2)
    listed = inventory.class_name[j]
    same = same_face(signs[i].class_name, listed)
    if same is None and listed and shares[i] and not signs[i].reviewed:
        same = not looks_otherwise(shares[i], listed)
    if same is False:
        # either the list or the map is wrong, which all of these together tell
        return Finding("class", i, j, _belief(signs[i], shares[i], listed), east, north, error)
    kind, belief = ("moved", moved) if moved > 0.5 else ("matched", 1.0 - moved)
    return Finding(kind, i, j, belief, east, north, error)
