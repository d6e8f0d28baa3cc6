"""Which sign of a map is which of a list: candidates, how likely each is one sign, and the choice.

Errors of the list, its common shift, the share of signs that it lacks and that of its signs which
the map has are estimated with the pairs by expectation maximisation (Dempster, Laird, Rubin,
Journal of the Royal Statistical Society B 39, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from automap.assignment import assign_near
from automap.earth import ecef
from automap.inventory import limits
from automap.inventory.classes import of_another_class, same_face
from automap.inventory.findings import Inventory, class_belief, existence_belief
from automap.inventory.neighbours import (
    Looks,
    facing_evidences,
    neighbour_density,
    neighbours_of,
)
from automap.inventory.wander import Anchors, common_errors
from automap.mapping.candidates import facing_variance
from automap.mapping.grid import east_north
from automap.mapping.limits import FACING_SD, MOVED_M
from automap.records import BoolArray, FloatArray, IntArray, Sign
from automap.records.sign_lists import numbers_of
from automap.signs.codes import face_of

AREA_M2 = math.pi * MOVED_M**2


@dataclass(frozen=True)
class Pairs:
    """Candidates [k]: ``sign``, ``listed``; from listed to found ``apart`` [k, 2] m; the map's
    covariance ``cov`` [k, 2, 2]; log evidence of class and facing ``told``, against those of any
    sign; ``beside`` other signs per square metre that would be found there and look like it;
    ``common`` [k] variance per axis of what signs about it are off in common, m^2."""

    sign: IntArray
    listed: IntArray
    apart: FloatArray
    cov: FloatArray
    told: FloatArray
    beside: FloatArray
    common: FloatArray


@dataclass(frozen=True)
class Fit:
    """``shift_m`` [2] and ``sd_m`` of the list; of each pair the log odds ``evidence`` [k] against
    standing alone, the probability that it was ``moved`` [k] and that it is one sign in place,
    ``stays`` [k]; ``variance`` [k] per axis of one in place; mean ``square`` of those over what is
    expected."""

    shift_m: FloatArray
    sd_m: float
    evidence: FloatArray
    moved: FloatArray
    stays: FloatArray
    variance: FloatArray
    square: float


def near_pairs(
    signs: Sequence[Sign], inventory: Inventory
) -> tuple[IntArray, IntArray, FloatArray]:
    """Signs and listed ones within MOVED_M of one another, and from listed to found [k, 2], m."""
    lat, lon = numbers_of(signs, "lat_rad", "lon_rad")
    ours = cKDTree(ecef(lat, lon, np.zeros(len(lat))))
    theirs = cKDTree(ecef(inventory.lat_rad, inventory.lon_rad, np.zeros(len(inventory))))
    near: Any = ours.sparse_distance_matrix(theirs, MOVED_M, output_type="coo_matrix")
    i, j = near.row.astype(np.int64), near.col.astype(np.int64)
    return i, j, east_north(lat[i], lon[i], inventory.lat_rad[j], inventory.lon_rad[j])


def belief_in_another(sign: Sign, shares: Mapping[str, float], listed: str, at_home: bool) -> float:
    """How surely a sign is not of the class ``listed`` but of its own, by the map alone."""
    # a person who looked at the sign has the last word
    if shares and not sign.reviewed:
        return of_another_class(shares, listed, at_home)
    return class_belief(sign)


def candidates(
    signs: Sequence[Sign],
    inventory: Inventory,
    shares: Sequence[Mapping[str, float]],
    near: tuple[IntArray, IntArray, FloatArray] | None,
    at_home: bool,
) -> Pairs:
    """The pairs ``near`` that may be one sign, by class and facing."""
    if near is None:
        none, zero = np.zeros(0, np.int64), np.zeros(0)
        return Pairs(none, none, np.zeros((0, 2)), np.zeros((0, 2, 2)), zero, zero, zero)
    i, j, apart = near
    names = [face_of(s.class_name) for s in signs]
    share = {name: (names.count(name) + 1.0) / (len(names) + 2.0) for name in set(names)}
    # what no detector tells is taken for sure, so that a list's error is the likelier one
    believed = [class_belief(s) if math.isfinite(s.class_probability) else 1.0 for s in signs]
    told, looks = np.zeros(len(i)), Looks.blank(len(i))
    for k, (a, b) in enumerate(zip(i.tolist(), j.tolist(), strict=True)):
        same = same_face(signs[a].class_name, inventory.class_name[b])
        # by chance two signs have one class as often as the class is on the map
        chance = share[names[a]]
        if same is not None:
            # one sign under two classes: the list is wrong, or the map
            belief = believed[a]
            if not same and shares[a]:
                listed = inventory.class_name[b]
                belief = belief_in_another(signs[a], shares[a], listed, at_home)
            right = (1.0 - limits.STALE) * belief
            told[k] = math.log(right / chance + 1.0 - right if same else 1.0 - right)
            looks.of_class(k, same, chance, share.get(face_of(inventory.class_name[b]), 0.0))
        looks.turn_rad[k] = signs[a].facing_rad - inventory.facing_rad[b]
        # half of what two drives' faces differ by is the list's
        looks.variance[k] = facing_variance(signs[a].facing_sd_rad) + 0.5 * FACING_SD**2
    turn = np.flatnonzero(np.isfinite(looks.turn_rad))
    told[turn] += facing_evidences(looks.turn_rad[turn, None], looks.variance[turn])[:, 0]
    cov = np.array([s.cov_enu[:2, :2] for s in signs], np.float64).reshape(-1, 2, 2)
    known: BoolArray = np.asarray(np.isfinite(cov).all(axis=(1, 2)))
    cov = np.where(known[:, None, None], cov, limits.USUAL_SD_M**2 * np.eye(2))[i]
    sd = np.sqrt(0.5 * np.trace(cov, axis1=1, axis2=2))
    # signs that no list has stand somewhere: beforehand, one within reach
    beside = 1.0 / AREA_M2 + neighbour_density(
        neighbours_of(inventory), np.hypot(*apart.T), sd, looks
    )
    keep = np.isfinite(told)
    zero = np.zeros(int(keep.sum()))
    return Pairs(i[keep], j[keep], apart[keep], cov[keep], told[keep], beside[keep], zero)


def doubts(signs: Sequence[Sign]) -> FloatArray:
    """Odds [n] that there is no sign, by the map alone."""
    exists = np.array([existence_belief(s) for s in signs], np.float64)
    exists = np.clip(exists, 1.0 - limits.MOST_SURE, limits.MOST_SURE)
    return np.asarray((1.0 - exists) / exists, np.float64)


def fit(pairs: Pairs, inventory: Inventory, doubt: FloatArray, looked: BoolArray) -> Fit:
    """By a map's signs [n], of which there is ``doubt`` [n]; ``looked`` [m] whether drives had a
    listed sign in view."""
    shift, sd, new = np.zeros(2), limits.USUAL_SD_M, limits.NEW_SHARE
    n, m = len(doubt), len(inventory)
    if len(pairs.sign) == 0:
        return Fit(shift, sd, *(np.zeros(0),) * 4, math.nan)
    stated = inventory.sd_m[pairs.listed]
    usual = limits.DETECTION_PRIOR[0] * (1.0 - limits.STALE), sum(limits.DETECTION_PRIOR)
    found = np.full(m, usual[0] / usual[1])
    moved_density = limits.STALE / AREA_M2
    # what a path is off all signs have alike to every side; what one's views do not tell, along one
    # axis, is its own
    least = np.linalg.eigvalsh(pairs.cov)[:, 0]
    parts = [least[:, None, None] * np.eye(2)]
    parts.append(pairs.cov - parts[0])
    scale = np.ones(2)
    for _ in range(limits.ROUNDS):
        own = np.where(
            np.isfinite(stated), np.clip(stated, limits.LEAST_SD_M, limits.LARGEST_SD_M), sd
        )
        total = scale[0] * parts[0] + scale[1] * parts[1]
        total += (own**2 + pairs.common)[:, None, None] * np.eye(2)
        residual = pairs.apart - shift
        weighted = np.linalg.solve(total, residual[:, :, None])[:, :, 0]
        square = np.einsum("ki,ki->k", residual, weighted)
        in_place = (1.0 - limits.STALE) * np.exp(-0.5 * square)
        in_place /= 2.0 * math.pi * np.sqrt(np.linalg.det(total))
        # the listed one unseen, and what was found not listed, or no sign, which stands anywhere
        unseen = (1.0 - found[pairs.listed]) / found[pairs.listed]
        alone = unseen * (new * pairs.beside + doubt[pairs.sign] / AREA_M2)
        evidence = pairs.told + np.log((in_place + moved_density) / alone)
        odds = np.exp(np.minimum(evidence, 500.0))
        # of one listed sign's candidates at most one is it, and so the other way round
        share = odds / (1.0 + sum_of(pairs.listed, odds, m)[pairs.listed])
        other = odds / (1.0 + sum_of(pairs.sign, odds, n)[pairs.sign])
        share = np.minimum(share, other)
        stays = share * in_place / (in_place + moved_density)
        information = np.linalg.inv(total) * stays[:, None, None]
        precision = information.sum(axis=0) + np.eye(2) / limits.USUAL_SD_M**2
        shift = np.linalg.solve(precision, np.einsum("kij,kj->i", information, pairs.apart))
        # expectation of the list's own squared error, given the pair
        mean = own[:, None] ** 2 * weighted
        left = own**2 * (2.0 - own**2 * np.trace(np.linalg.inv(total), axis1=1, axis2=2))
        squares = np.einsum("ki,ki->k", mean, mean) + left
        told = np.isnan(stated) * stays
        prior = limits.USUAL_PAIRS * limits.USUAL_SD_M**2
        sd = math.sqrt((0.5 * (told * squares).sum() + prior) / (told.sum() + limits.USUAL_PAIRS))
        sd = min(max(sd, limits.LEAST_SD_M), limits.LARGEST_SD_M)
        # and of the map's errors the part that signs do not have in common, which the shift is not
        inverse = np.linalg.inv(total)
        for k, (cov, rank) in enumerate(zip(parts, (2.0, 1.0), strict=True)):
            squares = np.einsum("ki,kij,kj->k", weighted, cov, weighted)
            squares -= np.einsum("kij,kji->k", inverse, cov)
            left = float(stays @ (scale[k] ** 2 * squares + rank * scale[k])) / rank
            scale[k] = min((left + 1.0) / (float(stays.sum()) + 1.0), 1.0)
        new = min(max((n - share.sum() + 1.0) / (n + 2.0), 0.5 / (n + 2.0)), 1.0)
        paired = np.minimum(sum_of(pairs.listed, share, m), 1.0)[looked].sum()
        found[looked] = (paired + usual[0]) / (looked.sum() + usual[1])
    moved = moved_density / (in_place + moved_density)
    weight = float(stays.sum())
    mean_square = float((stays * square).sum() / (2.0 * weight)) if weight > 1.0 else math.nan
    variance = 0.5 * np.trace(total, axis1=1, axis2=2)
    return Fit(shift, sd, evidence, moved, stays, variance, mean_square)


def left_out_odds(
    signs: Sequence[Sign], inventory: Inventory, known: Fit, at_home: bool
) -> FloatArray:
    """Odds [m] that a listed sign is one of ``signs`` that drives saw and the map leaves out as
    unlikely: that others did not see what is listed there makes it no clutter. The list's shift and
    error are ``known``; how far the map errs about them is not."""
    if not len(signs) or not len(inventory):
        return np.zeros(len(inventory))
    near = near_pairs(signs, inventory)
    pairs = candidates(signs, inventory, [{}] * len(signs), near, at_home)
    stated = inventory.sd_m[pairs.listed]
    own = np.clip(stated, limits.LEAST_SD_M, limits.LARGEST_SD_M)
    own = np.where(np.isfinite(stated), own, known.sd_m)
    total = pairs.cov + own[:, None, None] ** 2 * np.eye(2)
    residual = pairs.apart - known.shift_m
    square = np.einsum("ki,kij,kj->k", residual, np.linalg.inv(total), residual)
    in_place = (1.0 - limits.STALE) * np.exp(-0.5 * square)
    in_place /= 2.0 * math.pi * np.sqrt(np.linalg.det(total))
    # what was found not listed, or no sign, which stands anywhere
    alone = limits.NEW_SHARE * pairs.beside + doubts(signs)[pairs.sign] / AREA_M2
    odds = np.exp(np.minimum(pairs.told, 500.0)) * (in_place + limits.STALE / AREA_M2) / alone
    return sum_of(pairs.listed, odds, len(inventory))


def without_common_errors(pairs: Pairs, known: Fit, signs: Sequence[Sign]) -> Pairs:
    """The pairs with what signs about them are off in common taken off."""
    chosen = one_to_one(pairs, known.evidence, len(signs))
    chosen = chosen[known.stays[chosen] > limits.LIKELIER_THAN_NOT]
    anchors = Anchors(
        pairs.sign[chosen],
        pairs.listed[chosen],
        pairs.apart[chosen] - known.shift_m,
        # what may be none counts the less
        known.variance[chosen] / known.stays[chosen],
    )
    mean, variance = common_errors(signs, anchors, pairs.sign, pairs.listed)
    return replace(pairs, apart=pairs.apart - mean, common=variance)


def sum_of(place: IntArray, values: FloatArray, n: int) -> FloatArray:
    """Sums [n] of values by their place."""
    return np.asarray(np.bincount(place, values, n), np.float64)


def one_to_one(pairs: Pairs, evidence: FloatArray, n: int) -> IntArray:
    """The candidates that are one sign, by the greatest sum of evidence; none against the odds."""
    good = np.flatnonzero(evidence > 0.0)
    partner = assign_near(pairs.sign[good], pairs.listed[good], -evidence[good], n, 0.0)
    chosen: IntArray = good[partner[pairs.sign[good]] == pairs.listed[good]]
    return chosen


def rivals(
    pairs: Pairs, evidence: FloatArray, chosen: IntArray, n: int, m: int
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
    return sum_of(pairs.sign, odds, n), sum_of(pairs.listed, odds, m)
