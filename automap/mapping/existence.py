"""Whether a sign is there: seen, and not seen although it should have been.

Some signs are seen by nearly every drive, some are hidden or faded: the rate at which a real
sign is seen has a beta distribution, whose mean comes from the data, and the chances of a
series of drives are beta-binomial (J. G. Skellam, Journal of the Royal Statistical Society B 10,
1948). What is no sign is seen by hardly any other drive. A real
sign can also be put up or taken down between two drives, at a small rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from automap.jit import kernel
from automap.mapping.limits import (
    CHANGE_PER_YEAR,
    DRIVE_FREEDOM,
    DRIVE_LIMITS,
    FALSE_BETA,
    LEAST_CHANGE,
    OLDER_BELIEF,
    OVERALL_LIMITS,
    RATE_PRIOR,
    REAL_PRIOR,
    SPREAD,
    SPREAD_LOG_SD,
    SPREADS,
    STRAY,
    TELLING_DRIVES,
)
from automap.mapping.visibility import Opportunities, alike
from automap.records import BoolArray, FloatArray, IntArray

_ROUNDS, _TURNS = 12, 3
"""Of the expectation maximisation, from one spread to the next, and of spreads."""
_YEAR_S = 365.25 * 86400.0
"""A Julian year."""


@dataclass(frozen=True)
class Chances:
    """Pairs [p] of a sign and a drive that saw it, or should have; ordered by sign, then
    drive. ``seen`` [p]."""

    sign: IntArray
    drive: IntArray
    seen: BoolArray

    def __len__(self) -> int:
        return len(self.sign)


@dataclass(frozen=True)
class DetectionRates:
    """``overall`` rate at which real signs in view are seen, by ``drive`` [d], the share
    ``real`` of map signs that are real before any drive is counted, and ``spread``, how alike
    the rates of signs are (infinite: all the same)."""

    overall: float
    drive: FloatArray
    real: float
    spread: float = SPREAD

    @property
    def beta(self) -> tuple[float, float]:
        """Parameters of a real sign's own rate."""
        return self.spread * self.overall, self.spread * (1.0 - self.overall)

    def miss_weight(self, drive: IntArray) -> FloatArray:
        """What a miss by drives [n] counts: less where a drive sees little (night, rain)."""
        usual = math.log(1.0 - self.overall)
        return np.minimum(np.log(1.0 - np.minimum(self.drive[drive], 0.99)) / usual, 1.0)


def chances(sign: IntArray, drive: IntArray, views: Opportunities) -> Chances:
    """Put together what was seen, by sightings' ``sign`` and ``drive`` [n], and what should
    have been: in view, and approached as by a drive that saw it."""
    width = int(max(drive.max(initial=-1), views.drive.max(initial=-1))) + 1
    seen_key = np.unique(sign * width + drive)
    views = views.at(alike(views, np.isin(views.sign * width + views.drive, seen_key)))
    keys = np.union1d(seen_key, views.sign * width + views.drive)
    return Chances(
        (keys // max(width, 1)).astype(np.int64),
        (keys % max(width, 1)).astype(np.int64),
        np.isin(keys, seen_key, assume_unique=True),
    )


def detection_rates(pairs: Chances, n_signs: int, n_drives: int) -> DetectionRates:
    """Rates by expectation maximisation (Dempster, Laird, Rubin, Journal of the Royal Statistical
    Society B 39, 1977) over real and false signs, with weak priors.

    Signs that fewer than three drives had in view tell nothing about rates: that one of them
    saw it is why it is known at all.
    """
    rates = DetectionRates(
        RATE_PRIOR[0] / sum(RATE_PRIOR),
        np.full(max(n_drives, 1), RATE_PRIOR[0] / sum(RATE_PRIOR)),
        REAL_PRIOR[0] / sum(REAL_PRIOR),
    )
    telling = np.bincount(pairs.sign, minlength=n_signs)[pairs.sign] >= TELLING_DRIVES
    seen = pairs.seen.astype(np.float64)
    for turn in range(_ROUNDS * _TURNS):
        if turn % _ROUNDS == _ROUNDS - 1:
            rates = _with_spread(pairs, rates, n_signs)
        belief = _mixture(pairs, rates, n_signs)
        weight = belief[pairs.sign] * telling
        hits = np.bincount(pairs.drive, weight * seen, len(rates.drive))
        tries = np.bincount(pairs.drive, weight, len(rates.drive))
        overall = (hits.sum() + RATE_PRIOR[0]) / (tries.sum() + sum(RATE_PRIOR))
        overall = float(np.clip(overall, *OVERALL_LIMITS))
        by_drive = (hits + DRIVE_FREEDOM * overall) / (tries + DRIVE_FREEDOM)
        real = (belief.sum() + REAL_PRIOR[0]) / (n_signs + sum(REAL_PRIOR))
        rates = DetectionRates(
            overall, np.clip(by_drive, *DRIVE_LIMITS), float(min(real, 0.999)), rates.spread
        )
    return rates


def _counts(pairs: Chances, rates: DetectionRates, n_signs: int) -> tuple[FloatArray, FloatArray]:
    """How often each sign was seen, and missed, [m] each."""
    weight = np.where(pairs.seen, 0.0, rates.miss_weight(pairs.drive))
    hits = np.bincount(pairs.sign, pairs.seen.astype(np.float64), n_signs)
    misses = np.bincount(pairs.sign, weight, n_signs)
    return np.asarray(hits, np.float64), np.asarray(misses, np.float64)


def _log_chances(hits: FloatArray, misses: FloatArray, beta: tuple[float, float]) -> FloatArray:
    """Beta-binomial log likelihood [m] of a series; 0 for a single one, which is why the sign
    is known at all."""
    from scipy.special import betaln

    told = betaln(beta[0] + hits, beta[1] + misses) - betaln(*beta)
    return np.where(hits + misses <= 1.0, 0.0, told)


def _mixture(pairs: Chances, rates: DetectionRates, n_signs: int) -> FloatArray:
    """Probability [m] that each sign is real, if signs never changed."""
    hits, misses = _counts(pairs, rates, n_signs)
    told = _log_chances(hits, misses, rates.beta) - _log_chances(hits, misses, FALSE_BETA)
    odds = told + math.log(rates.real / (1.0 - rates.real))
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(odds, -60.0, 60.0))))


def _with_spread(pairs: Chances, rates: DetectionRates, n_signs: int) -> DetectionRates:
    """The spread that makes the counts most likely, with a log-normal prior."""
    hits, misses = _counts(pairs, rates, n_signs)
    false = _log_chances(hits, misses, FALSE_BETA) + math.log(1.0 - rates.real)
    best, highest = rates, -np.inf
    for spread in SPREADS:
        trial = DetectionRates(rates.overall, rates.drive, rates.real, spread)
        real = _log_chances(hits, misses, trial.beta) + math.log(rates.real)
        score = float(np.logaddexp(real, false).sum())
        score -= 0.5 * (math.log(spread / SPREAD) / SPREAD_LOG_SD) ** 2
        if score > highest:
            best, highest = trial, score
    return best


def existence(
    pairs: Chances, rates: DetectionRates, n_signs: int, drive_gps_s: FloatArray
) -> FloatArray:
    """Probability [m] that each sign stands at the time of the last drive that passed it.

    Weighs all histories with at most one change: false from the start, there throughout, taken
    down after one of the drives, put up before one. ``drive_gps_s`` [d] are the drives' times.
    """
    a, b = rates.beta
    weight = np.where(pairs.seen, 0.0, rates.miss_weight(pairs.drive))
    return _histories(
        pairs.sign, pairs.seen, weight, drive_gps_s[pairs.drive], n_signs, rates.real, a, b
    )


@kernel
def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


@kernel
def _histories(
    sign: IntArray,
    seen: BoolArray,
    weight: FloatArray,
    gps_s: FloatArray,
    n_signs: int,
    real: float,
    a: float,
    b: float,
) -> FloatArray:
    result = np.full(n_signs, real)
    start = 0
    while start < len(sign):
        stop = start
        hits, misses = 0.0, 0.0
        while stop < len(sign) and sign[stop] == sign[start]:
            hits += seen[stop]
            misses += weight[stop]
            stop += 1
        if stop - start == 1:
            start = stop
            continue
        base = _log_beta(a, b)
        throughout = _log_beta(a + hits, b + misses) - base
        false = _log_beta(FALSE_BETA[0] + hits, FALSE_BETA[1] + misses)
        false -= _log_beta(FALSE_BETA[0], FALSE_BETA[1])
        there, gone = 1.0, 0.0
        early_hits, early_misses = 0.0, 0.0
        for k in range(start, stop - 1):
            early_hits += seen[k]
            early_misses += weight[k]
            late_hits, late_misses = hits - early_hits, misses - early_misses
            change = LEAST_CHANGE
            elapsed = gps_s[k + 1] - gps_s[k]
            if elapsed > 0.0:
                change = max(change, 1.0 - math.exp(-CHANGE_PER_YEAR * elapsed / _YEAR_S))
            down = _log_beta(a + early_hits, b + early_misses) - base
            down += late_hits * math.log(STRAY) + late_misses * math.log(1.0 - STRAY)
            up = _log_beta(a + late_hits, b + late_misses) - base
            up += early_hits * math.log(STRAY) + early_misses * math.log(1.0 - STRAY)
            gone += change * math.exp(min(down - throughout, 50.0))
            there += change * math.exp(min(up - throughout, 50.0))
        nothing = (1.0 - real) * math.exp(min(false - throughout, 50.0))
        result[sign[start]] = real * there / (real * (there + gone) + nothing)
        start = stop
    return result


def still_there(
    sign: IntArray, weight: FloatArray, rates: DetectionRates, belief: FloatArray, hits: FloatArray
) -> FloatArray:
    """Probability [m] that signs of ``belief`` [m], seen by ``hits`` [m] drives before, stand
    after having been in view of further drives, pairs [p] of ``sign`` and the ``weight`` of the
    miss, and seen by none."""
    from scipy.special import betaln

    a, b = rates.beta
    misses = np.bincount(sign, weight, len(belief))
    kept = np.exp(betaln(a + hits, b + misses) - betaln(a + hits, b))
    start = np.clip(belief, 0.5, OLDER_BELIEF)
    return np.asarray(start * kept / (start * kept + 1.0 - start))
