"""Whether a sign is there: seen, and not seen although it should have been.

Two kinds of map signs are told apart by how often the drives that had them in view saw them:
real ones, at the detection rate, and false ones, at a low rate. The rates come from the data.
A real sign can also be put up or taken down, at a small rate per year.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from automap.mapping.visibility import LATERAL_EDGES_M, Opportunities
from automap.records import BoolArray, FloatArray, IntArray

CHANGE_PER_YEAR = 0.03
"""Rate at which a sign is taken down, and at which one is put up where none was."""

_ELSEWHERE = len(LATERAL_EDGES_M) + 1
_DETECTION_PRIOR = (6.0, 1.5)
_FALSE_PRIOR = (2.0, 18.0)
_REAL_PRIOR = (9.0, 1.0)
_DRIVE_PRIOR = 20.0
_ROUNDS = 40
_YEAR_S = 365.25 * 86400.0


@dataclass(frozen=True)
class Chances:
    """Pairs [p] of a sign and a drive, ordered by sign, then drive: ``seen`` or missed, with
    the class ``lateral`` of the distance across the road (the last one: seen from farther off
    than the visibility asks)."""

    sign: IntArray
    drive: IntArray
    lateral: IntArray
    seen: BoolArray

    def __len__(self) -> int:
        return len(self.sign)


@dataclass(frozen=True)
class DetectionRates:
    """``detection`` [d, classes] of a real sign by drive and lateral class, ``overall`` its
    mean over all opportunities, ``false_rate`` of a sign that is none, ``real_share`` of the
    map signs before any drive is counted."""

    detection: FloatArray
    overall: float
    false_rate: float
    real_share: float


def chances(sign: IntArray, drive: IntArray, views: Opportunities) -> Chances:
    """Put together what was seen, by sightings' ``sign`` and ``drive`` [n], and what could
    have been."""
    width = int(max(drive.max(initial=-1), views.drive.max(initial=-1))) + 1
    seen_key = np.unique(sign * width + drive)
    view_key = views.sign * width + views.drive
    order = np.argsort(view_key)
    view_key, lateral = view_key[order], views.lateral[order]
    keys = np.union1d(seen_key, view_key)
    result = np.full(len(keys), _ELSEWHERE, np.int64)
    result[np.searchsorted(keys, view_key)] = lateral
    return Chances(
        (keys // max(width, 1)).astype(np.int64),
        (keys % max(width, 1)).astype(np.int64),
        result,
        np.isin(keys, seen_key, assume_unique=True),
    )


def detection_rates(pairs: Chances, n_signs: int, n_drives: int) -> DetectionRates:
    """Rates by expectation maximisation over real and false signs (a latent class each).

    Weak priors decide where the data are few. A drive's own rate (night, dirt on the lens) is
    drawn towards that of its lateral class.
    """
    classes = _ELSEWHERE + 1
    table = np.tile(
        np.full(classes, _DETECTION_PRIOR[0] / sum(_DETECTION_PRIOR)), (max(n_drives, 1), 1)
    )
    table[:, _ELSEWHERE] = 0.5
    false_rate = _FALSE_PRIOR[0] / sum(_FALSE_PRIOR)
    real = _REAL_PRIOR[0] / sum(_REAL_PRIOR)
    inside = pairs.lateral < _ELSEWHERE
    seen = pairs.seen.astype(np.float64)
    belief = np.full(n_signs, real)
    for _ in range(_ROUNDS):
        rate = table[pairs.drive, pairs.lateral]
        told = np.where(
            pairs.seen, np.log(rate / false_rate), np.log((1.0 - rate) / (1.0 - false_rate))
        )
        odds = np.log(real / (1.0 - real)) + np.bincount(pairs.sign, told, n_signs)
        belief = 1.0 / (1.0 + np.exp(-np.clip(odds, -60.0, 60.0)))
        weight = belief[pairs.sign] * inside
        by_class = _rates(pairs.lateral, seen, weight, classes, _DETECTION_PRIOR)
        expected = by_class[pairs.lateral]
        by_drive = (np.bincount(pairs.drive, weight * seen, len(table)) + _DRIVE_PRIOR * 0.8) / (
            np.bincount(pairs.drive, weight * expected, len(table)) + _DRIVE_PRIOR * 0.8
        )
        table = np.clip(by_drive[:, None] * by_class, 0.02, 0.98)
        table[:, _ELSEWHERE] = 0.5
        wrong = 1.0 - belief[pairs.sign]
        false_rate = (np.sum(wrong * seen) + _FALSE_PRIOR[0]) / (np.sum(wrong) + sum(_FALSE_PRIOR))
        false_rate = min(false_rate, 0.3)
        real = (belief.sum() + _REAL_PRIOR[0]) / (n_signs + sum(_REAL_PRIOR))
    weight = belief[pairs.sign] * inside
    prior = _DETECTION_PRIOR
    overall = (np.sum(weight * seen) + prior[0]) / (np.sum(weight) + sum(prior))
    return DetectionRates(table, float(overall), float(false_rate), float(real))


def _rates(
    group: IntArray, seen: FloatArray, weight: FloatArray, n: int, prior: tuple[float, float]
) -> FloatArray:
    hits = np.bincount(group, weight * seen, n) + prior[0]
    return np.asarray(hits / (np.bincount(group, weight, n) + sum(prior)))


def existence(
    pairs: Chances, rates: DetectionRates, n_signs: int, drive_gps_s: FloatArray
) -> FloatArray:
    """Probability [m] that each sign stands at the time of the last drive that passed it.

    A two-state chain (there, not there) run forward over the drives in the order of their
    times ``drive_gps_s`` [d]; without times nothing changes in between.
    """
    rate = rates.detection[pairs.drive, pairs.lateral]
    present = np.where(pairs.seen, rate, 1.0 - rate)
    absent = np.where(pairs.seen, rates.false_rate, 1.0 - rates.false_rate)
    start = np.full(n_signs, rates.real_share)
    return _forward(pairs.sign, drive_gps_s[pairs.drive], present, absent, start)


def still_there(
    sign: IntArray, gps_s: FloatArray, rate: FloatArray, false_rate: float, start: FloatArray
) -> FloatArray:
    """Probability [m] that signs of belief ``start`` [m] stand after having been missed.

    ``sign`` [p] (ascending) was in view and not seen at ``gps_s`` with detection ``rate``.
    """
    return _forward(sign, gps_s, 1.0 - rate, np.full(len(sign), 1.0 - false_rate), start)


@njit(cache=True, error_model="numpy")
def _forward(
    sign: IntArray, gps_s: FloatArray, present: FloatArray, absent: FloatArray, start: FloatArray
) -> FloatArray:
    belief = start.copy()
    last = np.full(len(start), np.nan)
    for p in range(len(sign)):
        k = sign[p]
        value = belief[k]
        elapsed = gps_s[p] - last[k]
        if elapsed > 0.0:
            change = 1.0 - np.exp(-CHANGE_PER_YEAR * elapsed / _YEAR_S)
            value = value * (1.0 - change) + (1.0 - value) * change
        last[k] = gps_s[p]
        belief[k] = value * present[p] / (value * present[p] + (1.0 - value) * absent[p])
    return belief
