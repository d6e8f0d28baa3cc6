"""A map of signs against a list of signs that somebody keeps: the same, moved, changed, new, gone.

Each pair of a map sign and a listed one near it has a probability of being one sign in place, and
of being one that was moved. Who belongs to whom is then decided for all together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.inventory.classes import listed_wrong, same_face
from automap.inventory.directions import Directions, in_degrees
from automap.inventory.displaced import Parts, displaced_parts, with_taken_off
from automap.inventory.findings import (
    Finding,
    Inventory,
    judge_classes,
    looks_at,
    mark_sure,
    new_signs,
    not_found,
)
from automap.inventory.limits import HALF_APPROACH_ROWS, LIKELIER_THAN_NOT
from automap.inventory.pairs import (
    Fit,
    Pairs,
    belief_in_another,
    candidates,
    doubts,
    fit,
    left_out_odds,
    near_pairs,
    one_to_one,
    rivals,
    without_common_errors,
)
from automap.mapping.sightings import DriveSigns
from automap.records import FloatArray, Sign


@dataclass(frozen=True)
class InventoryComparison:
    """``findings`` of all signs; the inventory's ``shift_m`` [2] east and north against the map,
    its error ``sd_m`` per axis without that, ``normalised_square`` of pairs in place (1 where the
    stated errors are right, NaN without pairs), ``directions`` what its directions
    mean, ``detection``, how often a sign in view was found, and ``parts`` of the list that lie
    elsewhere than the rest."""

    findings: list[Finding]
    shift_m: FloatArray
    sd_m: float
    normalised_square: float
    directions: Directions
    detection: float
    parts: Parts


def compare_inventory(
    signs: Sequence[Sign],
    inventory: Inventory,
    drives: Sequence[DriveSigns],
    shares: Sequence[Mapping[str, float]] = (),
    at_home: bool = True,
    left_out: Sequence[Sign] = (),
) -> InventoryComparison:
    """What of ``inventory`` is on the map, what is not, and what the map has besides.

    ``signs`` with positions; ``drives`` tell where cameras looked; ``shares`` what the views of
    each sign give to each class (empty: not known), read ``at_home`` with a country's own; what
    drives saw and the map has ``left_out`` as unlikely speaks for listed signs beside it.
    """
    shares = shares or [{}] * len(signs)
    near, directions = None, Directions()
    if len(signs) and len(inventory):
        near = near_pairs(signs, inventory)
        inventory, directions = in_degrees(signs, inventory, *near)
    parts = displaced_parts(signs, inventory)
    if parts.displaced.any():
        inventory = parts.moved_back(inventory)
        near = near_pairs(signs, inventory)
    pairs = candidates(signs, inventory, shares, near, at_home)
    views, rows = looks_at(inventory, drives)
    looked = rows >= HALF_APPROACH_ROWS
    off, doubt = pairs.apart, doubts(signs)
    pairs = without_common_errors(pairs, fit(pairs, inventory, doubt, looked), signs)
    known = fit(pairs, inventory, doubt, looked)
    chosen = one_to_one(pairs, known.evidence, len(signs))
    parts = with_taken_off(parts, signs, pairs.listed[chosen], (off - pairs.apart)[chosen])
    findings = [
        _paired(pairs, k, signs, inventory, shares, known, at_home) for k in chosen.tolist()
    ]
    partner = np.full(len(inventory), -1)
    partner[pairs.listed[chosen]] = pairs.sign[chosen]
    unknown = np.setdiff1d(np.arange(len(signs)), pairs.sign[chosen])
    by_sign, by_listed = rivals(pairs, known.evidence, chosen, len(signs), len(inventory))
    findings = [
        _moved_after_all(f, float(known.moved[k]))
        for f, k in zip(judge_classes(findings), chosen.tolist(), strict=True)
    ]
    findings = [
        replace(f, probability=f.probability / float(1.0 + by_sign[f.sign] + by_listed[f.listed]))
        for f in findings
    ] + [
        replace(f, probability=f.probability / float(1.0 + by_sign[f.sign]))
        for f in new_signs(signs, unknown)
    ]
    alone = 1.0 / (1.0 + by_listed + left_out_odds(left_out, inventory, known, at_home))
    lost, detection = not_found(inventory, partner, signs, drives, alone, views, rows)
    order = ("matched", "moved", "class", "new", "missing", "unconfirmed", "not_seen")
    findings = mark_sure([_from_where_listed(f, parts) for f in (*findings, *lost)])
    findings.sort(key=lambda f: (order.index(f.kind), f.listed, f.sign))
    return InventoryComparison(
        findings, known.shift_m, known.sd_m, known.square, directions, detection, parts
    )


def _from_where_listed(finding: Finding, parts: Parts) -> Finding:
    """The finding with the way from where the list has it."""
    if finding.listed < 0 or parts.part[finding.listed] <= 0:
        return finding
    east, north = parts.way[parts.part[finding.listed]].tolist()
    return replace(finding, east_m=finding.east_m + east, north_m=finding.north_m + north)


def _moved_after_all(finding: Finding, moved: float) -> Finding:
    """One of another class, of which rather the map is wrong, and which stands elsewhere than it is
    listed: moved."""
    right = 1.0 - finding.probability
    if finding.kind != "class" or min(right, moved) <= LIKELIER_THAN_NOT:
        return finding
    return replace(finding, kind="moved", probability=right * moved)


def _paired(
    pairs: Pairs,
    k: int,
    signs: Sequence[Sign],
    inventory: Inventory,
    shares: Sequence[Mapping[str, float]],
    known: Fit,
    at_home: bool,
) -> Finding:
    i, j, moved = int(pairs.sign[k]), int(pairs.listed[k]), float(known.moved[k])
    east, north = (pairs.apart[k] - known.shift_m).tolist()
    error = math.sqrt(known.variance[k])
    listed = inventory.class_name[j]
    same, wrong = same_face(signs[i].class_name, listed), 0.0
    if same is None and listed and shares[i] and not signs[i].reviewed:
        wrong = listed_wrong(shares[i], listed, at_home)
    if same is False or wrong > LIKELIER_THAN_NOT:
        # either the list or the map is wrong, which all of these together tell
        belief = belief_in_another(signs[i], shares[i], listed, at_home)
        return Finding("class", i, j, belief, east, north, error)
    kind, belief = ("moved", moved) if moved > 0.5 else ("matched", (1.0 - moved) * (1.0 - wrong))
    return Finding(kind, i, j, belief, east, north, error)
