"""What becomes of each sign of a map and of a list, and how sure that is.

Every probability takes the share of such faults into account, which the signs themselves tell: a
sign that is not listed is the likelier a mistake of the map the more complete the list is. What is
called sure are the likeliest of a kind, as many as are expected to be right nine times of ten (the
Bayesian rate of false discoveries: M. A. Newton and others, Biostatistics 5, 2004).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit

from automap.earth import ecef
from automap.inventory import limits
from automap.inventory.classes import groups_of
from automap.inventory.hidden import gaps, gone_by_gaps, hidden_for_good
from automap.inventory.missing import counts, standing
from automap.mapping.limits import ALTERNATIVES, CLASS_RIGHT, MOVED_M
from automap.mapping.sightings import DriveSigns
from automap.mapping.visibility import Opportunities, head_on, opportunities
from automap.records import BoolArray, FloatArray, IntArray, Sign
from automap.signs.codes import face_of

_NODES = 8
"""Of the quadrature over how many signs something hides."""


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
    the kind; from listed to found ``east_m``, ``north_m``, and ``sd_m`` per axis of that. ``sure``
    whether it is of those of its kind that are for work; ``more_drives`` that would have to look
    and see nothing until an unconfirmed one is surely gone (0: it is, or no number would tell)."""

    kind: str
    sign: int
    listed: int
    probability: float
    east_m: float = float("nan")
    north_m: float = float("nan")
    sd_m: float = float("nan")
    sure: bool = False
    more_drives: int = 0

    @property
    def distance_m(self) -> float:
        """How far it was found from where it is listed."""
        return math.hypot(self.east_m, self.north_m)


def mark_sure(findings: Sequence[Finding]) -> list[Finding]:
    """The findings with ``sure`` set: of each kind the likeliest, as long as the mean of their
    probabilities is ``SURE`` and none is less likely than not. In all that was not found is one
    unknown, how much of what stands something hides, so that many err together and their mean is
    no likelier than one: each of these must be as likely by itself (B. Efron, Simultaneous
    inference: when should hypothesis testing problems be combined?, Annals of Applied Statistics 2,
    2008)."""
    marked = list(findings)
    for kind in {f.kind for f in findings}:
        own = [k for k, f in enumerate(findings) if f.kind == kind]
        own.sort(key=lambda k: -findings[k].probability)
        told = np.array([findings[k].probability for k in own])
        mean = told if kind == "missing" else np.cumsum(told) / np.arange(1, len(own) + 1)
        good = mean >= limits.SURE
        for k in np.array(own)[good & (told > limits.LIKELIER_THAN_NOT)].tolist():
            marked[k] = replace(findings[k], sure=True)
    return marked


def looks_at(inventory: Inventory, drives: Sequence[DriveSigns]) -> tuple[Opportunities, IntArray]:
    """Which drives had which listed signs in view; from how many places [m] the one that had the
    best look."""
    facing = np.asarray(inventory.facing_rad, np.float64)
    views = opportunities(drives, inventory.lat_rad, inventory.lon_rad, facing)
    views = views.at(head_on(views, facing))
    rows = np.zeros(len(inventory), np.int64)
    np.maximum.at(rows, views.sign, views.rows)
    return views, rows


def seldom_found(
    inventory: Inventory, found: BoolArray, in_view: BoolArray, beside: Sequence[str] = ()
) -> BoolArray:
    """Which listed signs [m] are of a shape and colour, or without a class, of which less than half
    of those ``in_view`` [m] were ``found`` [m], or of such a class of which there are several: a
    detector may not know them. Of signs of unknown facing, of which half may look away, none was.
    Classes of signs that were found ``beside`` the list's count as found: it knows these.
    """
    n = len(inventory)
    classes = [*inventory.class_name, *beside]
    faces = [face_of(name) for name in classes]
    looks = ["|".join(sorted(groups_of(c))) or c for c in classes]
    away = np.isnan(np.asarray(inventory.facing_rad, np.float64))
    seldom = np.zeros(n, np.bool_)
    for names, least in ((looks, 1), (faces, limits.LEAST_TURNS)):
        which = np.unique(np.array([*names, ""]), return_inverse=True)[1][:-1]
        also = np.bincount(which[n:], minlength=int(which.max(initial=0)) + 1)[which[:n]]
        kind = 2 * which[:n] + away
        number = np.bincount(kind, in_view)[kind] + also
        good = np.bincount(kind, in_view & found)[kind] + also
        few = np.where(away, good == 0, good < limits.LIKELIER_THAN_NOT * number)
        seldom |= few & (number >= least)
    return seldom & in_view


def screens(inventory: Inventory, partner: IntArray, seen_share: FloatArray) -> FloatArray:
    """How much of what may hide a listed sign [m] is possible still, where a face beside it on its
    post that looks the same way was found (``partner`` [m], -1 none), of which ``seen_share`` of
    the map's signs [n] was in sight: what hides the one hides the other."""
    from scipy.spatial import cKDTree

    place = ecef(inventory.lat_rad, inventory.lon_rad, np.zeros(len(inventory)))
    beside = cKDTree(place).query_pairs(limits.SAME_POST_M, output_type="ndarray")
    i, j = np.vstack([beside, beside[:, ::-1]]).T
    facing = np.asarray(inventory.facing_rad, np.float64)
    alike = (partner[j] >= 0) & (np.cos(facing[i] - facing[j]) > limits.SAME_WAY)
    left = np.ones(len(inventory))
    np.minimum.at(left, i[alike], 1.0 - seen_share[partner[j[alike]]])
    return left


def not_found(
    inventory: Inventory,
    partner: IntArray,
    signs: Sequence[Sign],
    drives: Sequence[DriveSigns],
    alone: FloatArray,
    views: Opportunities,
    rows: IntArray,
) -> tuple[list[Finding], float]:
    """Listed signs without a ``partner`` [m] (-1) on the map, and how often a drive finds one;
    ``alone`` [m] the probability that no sign of the map is it; ``views`` and ``rows`` of
    ``looks_at``.

    Signs of unknown facing may look away from every drive: those to the left and to the right of
    the path are found at rates of their own, as are those that were in view for less than half an
    approach. Of kinds that are seldom found nothing is called missing.
    """
    group = np.zeros(len(inventory), np.int64)
    unknown = np.isnan(np.asarray(inventory.facing_rad, np.float64))
    group[views.sign] = np.where(unknown[views.sign], np.where(views.offset > 0.0, 2, 1), 0)
    group[rows < limits.HALF_APPROACH_ROWS] = 3
    number = {drive.name: k for k, drive in enumerate(drives)}
    all_of_them = frozenset(number.values())
    seen_by: list[frozenset[int] | None] = []
    for k in partner.tolist():
        named = frozenset(number[d] for d in signs[k].drives if d in number) if k >= 0 else None
        # a map of one drive names it or not; where views of many are one, all saw it
        seen_by.append(all_of_them if named is not None and not named else named)
    tries, hits = counts(views, len(inventory), seen_by)
    in_view = (tries > 0) | (partner >= 0)
    beside = np.setdiff1d(np.arange(len(signs)), partner)
    names = [signs[k].class_name for k in beside.tolist()]
    unknown_kind = seldom_found(inventory, partner >= 0, in_view, names) & (tries > 0)
    # they tell nothing of what is gone, nor of how often a drive finds what it knows
    tries[unknown_kind] = 0
    looked = np.array([sign.n_looked for sign in signs], np.int64)
    share = np.nan_to_num([sign.seen_share for sign in signs])
    n_drives = np.array([len(sign.drives) for sign in signs], np.int64)
    found = gaps(np.rint(share * looked).astype(np.int64), looked, n_drives)
    priors = (*[limits.DETECTION_PRIOR] * 3, limits.GLIMPSE_PRIOR)
    screened = screens(inventory, partner, share * (looked > 0))
    # without frames every share is as likely: that none saw a sign says little then
    known = standing(tries, hits, group, priors, hidden_for_good(found, _NODES).tolist(), screened)
    if looked.any() and tries.max(initial=0) == 1:
        # counts of drives say nothing then, but frames do
        whole = (group == 0) & (tries == 1)
        unseen = whole & (hits == 0)
        known.gone[unseen] = gone_by_gaps(
            found, int(whole.sum()), int(unseen.sum()), screened[unseen]
        )
    result = []
    for j in np.flatnonzero(partner < 0).tolist():
        gone = float(known.gone[j])
        if unknown_kind[j]:
            gone = limits.STALE
        elif math.isnan(gone):
            result.append(Finding("not_seen", -1, j, 1.0))
            continue
        gone *= float(alone[j])
        kind = "missing" if gone > limits.LIKELIER_THAN_NOT else "unconfirmed"
        more = int(known.more_drives[j])
        result.append(Finding(kind, -1, j, max(gone, 1.0 - gone), more_drives=more))
    return result, known.rate


def class_belief(sign: Sign) -> float:
    """How surely a sign that is there is of its class; one that a person looked at is.

    Where the detector tells no probability, ``confidence`` joins that with ``existence``. In a
    merged map it is the share of the drives' belief, and two drives of three that agree are surer
    than two thirds.
    """
    if sign.reviewed:
        return limits.MOST_SURE
    if math.isfinite(sign.class_probability):
        return _probability(sign.class_probability)
    belief = _probability(sign.confidence)
    if math.isfinite(sign.existence) and sign.existence > 0.0:
        belief = min(belief / sign.existence, limits.MOST_SURE)
    drives = len(sign.drives)
    if drives < 2:
        return belief
    ahead = (2.0 * belief - 1.0) * drives
    odds = ahead * math.log(CLASS_RIGHT / (1.0 - CLASS_RIGHT) * ALTERNATIVES)
    return min(1.0 / (1.0 + math.exp(-min(odds, 50.0))), limits.MOST_SURE)


def existence_belief(sign: Sign) -> float:
    """How surely there is a sign at all; one that a person looked at is there, and so is one of
    which nothing tells a doubt."""
    if sign.reviewed or not (math.isfinite(sign.existence) or math.isfinite(sign.confidence)):
        return limits.MOST_SURE
    return _probability(sign.existence if math.isfinite(sign.existence) else sign.confidence)


def _probability(value: float) -> float:
    return min(max(float(value), 0.0), limits.MOST_SURE)


def new_signs(signs: Sequence[Sign], unknown: IntArray) -> list[Finding]:
    """The map's signs ``unknown`` [k] to the list: those that are real, as far as can be told.

    What is no sign is in no list, so that not to be listed speaks against it; and of what the map
    believes alike, the more is listed, the more is real. So the share of real signs that the list
    lacks, and a factor on the map's doubts in logarithmic odds below its surest (after J. Platt, in
    Advances in Large Margin Classifiers, 1999), are the likeliest for who is listed and who is not.
    One that may stand further off than its entry was looked for may be listed there.
    """
    from scipy.optimize import minimize

    exists = np.clip([existence_belief(s) for s in signs], 1.0 - limits.MOST_SURE, limits.MOST_SURE)
    doubt = logit(limits.MOST_SURE) - logit(np.asarray(exists, np.float64).reshape(-1))
    listed = np.ones(len(signs), np.bool_)
    listed[unknown] = False

    def against(x: FloatArray) -> float:
        real, lacks = expit(logit(limits.MOST_SURE) - np.exp(x[0]) * doubt), expit(x[1])
        told = real * (1.0 - lacks)
        likely = np.log(np.maximum(np.where(listed, told, 1.0 - told), 1e-12)).sum()
        likely += limits.NEW_SHARE * np.log(lacks) + (1.0 - limits.NEW_SHARE) * np.log1p(-lacks)
        return float(0.5 * (x[0] / limits.DOUBT_FACTOR_LOG_SD) ** 2 - likely)

    factor, lacks = minimize(against, [0.0, float(logit(limits.NEW_SHARE))]).x
    real, lacks = expit(logit(limits.MOST_SURE) - np.exp(factor) * doubt[unknown]), expit(lacks)
    told = real * lacks / (real * lacks + 1.0 - real) * _within_reach([signs[k] for k in unknown])
    return [Finding("new", k, -1, p) for k, p in zip(unknown.tolist(), told.tolist(), strict=True)]


def _within_reach(signs: Sequence[Sign]) -> FloatArray:
    """How probably each sign [k] is off by less than ``MOVED_M``, by the longest axis of its error
    to every side."""
    cov = np.array([s.cov_enu[:2, :2] for s in signs], np.float64).reshape(-1, 2, 2)
    variance = np.linalg.eigvalsh(np.where(np.isfinite(cov), cov, 0.0))[:, 1]
    return np.asarray(-np.expm1(-(MOVED_M**2) / (2.0 * np.maximum(variance, limits.LEAST_SD_M**2))))


def judge_classes(findings: list[Finding]) -> list[Finding]:
    """Findings of another class with the probability that the list is wrong and not the map, in
    place of how surely the map is right; how often the list is wrong comes from the data."""
    told = [k for k, f in enumerate(findings) if f.kind == "class"]
    right = np.array([findings[k].probability for k in told], np.float64)
    wrong, share = right, limits.STALE
    for _ in range(limits.ROUNDS):
        wrong = right * share / (right * share + (1.0 - right) * (1.0 - share))
        share = (float(wrong.sum()) + limits.STALE * limits.STALE_WEIGHT) / (
            len(findings) + limits.STALE_WEIGHT
        )
    judged = list(findings)
    for k, p in zip(told, wrong.tolist(), strict=True):
        judged[k] = replace(findings[k], probability=p)
    return judged
