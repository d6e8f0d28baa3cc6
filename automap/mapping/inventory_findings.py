"""What becomes of each sign of a map and of a list, and how sure that is.

Every probability takes the share of such faults into account, which the signs themselves tell: a
sign that is not listed is the likelier a mistake of the map the more complete the list is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.mapping.inventory_limits import (
    DETECTION_PRIOR,
    GLIMPSE_PRIOR,
    HALF_APPROACH_ROWS,
    MOST_SURE,
    NEW_SHARE,
    ROUNDS,
    STALE,
    STALE_WEIGHT,
    SURE,
)
from automap.mapping.inventory_missing import counts, standing
from automap.mapping.limits import ALTERNATIVES, CLASS_RIGHT
from automap.mapping.sightings import DriveSigns
from automap.mapping.visibility import head_on, opportunities
from automap.records import FloatArray, IntArray, Sign


@dataclass(frozen=True)
class Inventory:
    """Listed signs [n]: ``ids``; ``class_name`` ("" not told or not understood); positions and
    ``facing_rad`` in rad, ``sd_m`` one sigma per axis (NaN unknown)."""

    ids: Sequence[str]
    class_name: Sequence[str]
    lat_rad: FloatArray
    lon_rad: FloatArray
    facing_rad: FloatArray
    sd_m: FloatArray

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Finding:
    """What became of one sign. ``kind`` "matched", "moved", "class", "new", "missing",
    "unconfirmed" (not found, but missed signs are as likely) or "not_seen" (no drive had it in
    view); ``sign`` and ``listed`` its places in map and inventory (-1 none); ``probability`` of
    the kind; from listed to found ``east_m``, ``north_m``, and ``sd_m`` per axis of that."""

    kind: str
    sign: int
    listed: int
    probability: float
    east_m: float = float("nan")
    north_m: float = float("nan")
    sd_m: float = float("nan")

    @property
    def sure(self) -> bool:
        """Whether it is likely enough to be acted on."""
        return self.probability >= SURE

    @property
    def distance_m(self) -> float:
        """How far it was found from where it is listed."""
        return math.hypot(self.east_m, self.north_m)


def not_found(
    inventory: Inventory,
    partner: IntArray,
    signs: Sequence[Sign],
    drives: Sequence[DriveSigns],
) -> tuple[list[Finding], float]:
    """Listed signs without a ``partner`` [m] (-1) on the map, and how often a drive finds one.

    Signs of unknown facing may look away from every drive: those to the left and to the right of
    the path are found at rates of their own, as are those that were in view for less than half an
    approach.
    """
    facing = np.asarray(inventory.facing_rad, np.float64)
    views = opportunities(drives, inventory.lat_rad, inventory.lon_rad, facing)
    views = head_on(views, facing)
    # of several drives the best look counts
    rows = np.zeros(len(inventory), np.int64)
    np.maximum.at(rows, views.sign, views.rows)
    group = np.zeros(len(inventory), np.int64)
    unknown = np.isnan(facing)
    group[views.sign] = np.where(unknown[views.sign], np.where(views.offset > 0.0, 2, 1), 0)
    group[rows < HALF_APPROACH_ROWS] = 3
    number = {drive.name: k for k, drive in enumerate(drives)}
    all_of_them = frozenset(number.values())
    seen_by: list[frozenset[int] | None] = []
    for k in partner.tolist():
        named = frozenset(number[d] for d in signs[k].drives if d in number) if k >= 0 else None
        # a map of one drive names it or not; where views of many are one, all saw it
        seen_by.append(all_of_them if named is not None and not named else named)
    tries, hits = counts(views, len(inventory), seen_by)
    known = standing(tries, hits, group, (*[DETECTION_PRIOR] * 3, GLIMPSE_PRIOR))
    result = []
    for j in np.flatnonzero(partner < 0).tolist():
        gone = float(known.gone[j])
        if math.isnan(gone):
            result.append(Finding("not_seen", -1, j, 1.0))
            continue
        kind = "missing" if gone > 0.5 else "unconfirmed"
        result.append(Finding(kind, -1, j, max(gone, 1.0 - gone)))
    return result, known.rate


def class_belief(sign: Sign) -> float:
    """How surely a sign that is there is of its class.

    Where the detector tells no probability, ``confidence`` joins that with ``existence``. In a
    merged map it is the share of the drives' belief, and two drives of three that agree are surer
    than two thirds.
    """
    if math.isfinite(sign.class_probability):
        return _probability(sign.class_probability)
    belief = _probability(sign.confidence)
    if math.isfinite(sign.existence) and sign.existence > 0.0:
        belief = min(belief / sign.existence, MOST_SURE)
    drives = len(sign.drives)
    if drives < 2:
        return belief
    ahead = (2.0 * belief - 1.0) * drives
    odds = ahead * math.log(CLASS_RIGHT / (1.0 - CLASS_RIGHT) * ALTERNATIVES)
    return min(1.0 / (1.0 + math.exp(-min(odds, 50.0))), MOST_SURE)


def _exists(sign: Sign, merged: bool) -> float:
    """How surely there is a sign at all.

    A merge's existence counts the drives that saw it and those that did not; where one alone saw
    it, what that one believed is in its confidence, unless that is of the class alone.
    """
    single = merged and len(sign.drives) < 2 and not math.isfinite(sign.class_probability)
    if single or not math.isfinite(sign.existence):
        return _probability(sign.confidence)
    return _probability(sign.existence)


def _probability(value: float) -> float:
    return min(max(float(value), 0.0), MOST_SURE)


def new_signs(signs: Sequence[Sign], unknown: IntArray, paired: int, merged: bool) -> list[Finding]:
    """The map's signs that the list does not have: those that are real, as far as can be told.

    A sign that is none is in no list, so that not to be listed speaks against it; the share of real
    ones that are not listed comes from the data. ``paired`` signs are listed; ``merged`` says
    whether the map is of several drives.
    """
    exists = np.array([_exists(signs[k], merged) for k in unknown.tolist()], np.float64)
    share = NEW_SHARE
    real = exists
    for _ in range(ROUNDS):
        real = exists * share / (exists * share + 1.0 - exists)
        share = (float(real.sum()) + 1.0) / (float(real.sum()) + paired + 1.0 / NEW_SHARE)
    return [Finding("new", k, -1, p) for k, p in zip(unknown.tolist(), real.tolist(), strict=True)]


def judge_classes(findings: list[Finding], signs: Sequence[Sign]) -> list[Finding]:
    """Findings of another class with the probability that the list is wrong and not the map; how
    often the list is, comes from the data."""
    told = [k for k, f in enumerate(findings) if f.kind == "class"]
    right = np.array([class_belief(signs[findings[k].sign]) for k in told], np.float64)
    wrong, share = right, STALE
    for _ in range(ROUNDS):
        wrong = right * share / (right * share + (1.0 - right) * (1.0 - share))
        share = (float(wrong.sum()) + STALE * STALE_WEIGHT) / (len(findings) + STALE_WEIGHT)
    judged = list(findings)
    for k, p in zip(told, wrong.tolist(), strict=True):
        judged[k] = replace(findings[k], probability=p)
    return judged
