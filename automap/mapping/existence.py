"""Whether a sign is there: seen, and not seen although it should have been.

A drive that saw something tells how probable it is that it exists (``geolocation/existence.py``):
posterior odds over those of any sighting are the likelihood ratio of what it saw. Drives err alike
where they look at the same thing, so the ratios of a sign's sightings are averaged: the mean is
never too large a ratio, however they depend on one another (V. Vovk, R. Wang, E-values,
Annals of Statistics 49, 2021).

How many saw it comes on top. Some signs are seen by nearly every drive, some are hidden or faded:
the rate at which a real sign is seen has a beta distribution, whose mean comes from the data, and
the chances of a series of drives are beta-binomial (J. G. Skellam, Journal of the Royal Statistical
Society B 10, 1948). What is no sign is seen by hardly any other drive, or, where a thing that stays
looks like one (a gable), as a sign is. A real sign can also be put up or taken down between two
drives, at a small rate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betaln

from automap.geolocation.existence import probability
from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.sureness import SUREST
from automap.mapping.visibility import Opportunities, alike
from automap.records import BoolArray, FloatArray, IntArray

_ROUNDS, _TURNS = 12, 3
"""Of the expectation maximisation, from one spread to the next, and of spreads."""
_YEAR_S = 365.25 * 86400.0
"""A Julian year."""


@dataclass(frozen=True)
class Chances:
    """Pairs [p] of a sign and a drive that saw it, or should have; ordered by sign, then drive.
    ``seen`` [p]; ``told`` [p] the existence by that drive alone (NaN, None: not told)."""

    sign: IntArray
    drive: IntArray
    seen: BoolArray
    told: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.sign)


@dataclass(frozen=True)
class DetectionRates:
    """``overall`` rate at which real signs in view are seen, by ``drive`` [d], the share ``real``
    of sightings that are of real signs, and ``spread``, how alike their rates are (infinite: all
    the same)."""

    overall: float
    drive: FloatArray
    real: float
    spread: float = limits.SPREAD

    @property
    def beta(self) -> tuple[float, float]:
        """Parameters of a real sign's own rate."""
        return self.spread * self.overall, self.spread * (1.0 - self.overall)

    def miss_weight(self, drive: IntArray) -> FloatArray:
        """What a miss by drives [n] counts: less where a drive sees little (night, rain)."""
        usual = math.log(1.0 - self.overall)
        return np.minimum(np.log(1.0 - np.minimum(self.drive[drive], 0.99)) / usual, 1.0)


def chances(
    sign: IntArray, drive: IntArray, views: Opportunities, told: FloatArray | None = None
) -> Chances:
    """Put together what was seen, by sightings' ``sign``, ``drive`` and ``told`` existence [n], and
    what should have been: in view, and approached as by a drive that saw it."""
    width = int(max(drive.max(initial=-1), views.drive.max(initial=-1))) + 1
    seen_key = np.unique(sign * width + drive)
    views = views.at(alike(views, np.isin(views.sign * width + views.drive, seen_key)))
    keys = np.union1d(seen_key, views.sign * width + views.drive)
    by_pair = np.full(len(keys), np.nan)
    if told is not None:
        # of a drive that saw it twice the surer word
        np.fmax.at(by_pair, np.searchsorted(keys, sign * width + drive), told)
    return Chances(
        (keys // max(width, 1)).astype(np.int64),
        (keys % max(width, 1)).astype(np.int64),
        np.isin(keys, seen_key, assume_unique=True),
        by_pair,
    )


def detection_rates(pairs: Chances, n_signs: int, n_drives: int) -> DetectionRates:
    """Rates by expectation maximisation (Dempster, Laird, Rubin, Journal of the Royal Statistical
    Society B 39, 1977) over real and false signs, with weak priors.

    Signs that fewer than three drives had in view tell nothing about rates: that one of them
    saw it is why it is known at all.
    """
    usual = limits.RATE_PRIOR[0] / sum(limits.RATE_PRIOR)
    rates = DetectionRates(usual, np.full(max(n_drives, 1), usual), _share(0.0, 0.0))
    telling = np.bincount(pairs.sign, minlength=n_signs) >= limits.TELLING_DRIVES
    seen = np.bincount(pairs.sign[pairs.seen], minlength=n_signs).astype(np.float64)
    evidence = np.log(_mean_ratio(pairs, _ratios(pairs), n_signs))
    for turn in range(_ROUNDS * _TURNS):
        belief = _mixture(pairs, rates, evidence)
        if turn % _ROUNDS == _ROUNDS - 1:
            rates = _with_spread(pairs, rates, belief)
        of_drives = pairs.sign, pairs.drive, pairs.seen, belief * telling, len(rates.drive)
        hits, tries = _by_drive(*of_drives)
        overall = (hits.sum() + limits.RATE_PRIOR[0]) / (tries.sum() + sum(limits.RATE_PRIOR))
        overall = float(np.clip(overall, *limits.OVERALL_LIMITS))
        by_drive = (hits + limits.DRIVE_FREEDOM * overall) / (tries + limits.DRIVE_FREEDOM)
        real = _share(float((belief * seen).sum()), float(seen.sum()))
        rates = DetectionRates(
            overall, np.clip(by_drive, *limits.DRIVE_LIMITS), min(real, SUREST), rates.spread
        )
    return rates


def _share(real: float, sightings: float) -> float:
    """Share of sightings that are of real signs, ``real`` of them being expected."""
    return (real + limits.REAL_PRIOR[0]) / (sightings + sum(limits.REAL_PRIOR))


def _ratios(pairs: Chances) -> FloatArray:
    """Likelihood ratio [p] of what a drive saw, NaN where not told: its odds over those of any
    sighting, of which the mean tells, as calibrated probabilities average to what is right."""
    if pairs.told is None:
        return np.full(len(pairs), np.nan)
    told = np.clip(np.where(pairs.seen, pairs.told, np.nan), 1.0 - SUREST, SUREST)
    known = np.isfinite(told)
    before = _share(float(told[known].sum()), float(known.sum()))
    return np.asarray(told / (1.0 - told) * (1.0 - before) / before)


def _mean_ratio(pairs: Chances, ratio: FloatArray, n_signs: int) -> FloatArray:
    """Mean [m] of the ratios of each sign's sightings; 1 where none is told."""
    known = np.isfinite(ratio)
    count = np.bincount(pairs.sign[known], minlength=n_signs)
    total = np.bincount(pairs.sign[known], ratio[known], n_signs)
    return np.where(count > 0, total / np.maximum(count, 1), 1.0)


def _counts(pairs: Chances, rates: DetectionRates, n_signs: int) -> tuple[FloatArray, FloatArray]:
    """How often each sign was seen, and missed, [m] each."""
    weight = rates.miss_weight(np.arange(len(rates.drive)))
    return _by_sign(pairs.sign, pairs.drive, pairs.seen, weight, n_signs)


@kernel
def _by_sign(
    sign: IntArray, drive: IntArray, seen: BoolArray, weight: FloatArray, n_signs: int
) -> tuple[FloatArray, FloatArray]:
    """Of each sign [m] the pairs that saw it, and the ``weight`` [d] of the drives that did not:
    of ten million pairs no array but these."""
    hits, misses = np.zeros(n_signs), np.zeros(n_signs)
    for k in range(len(sign)):
        if seen[k]:
            hits[sign[k]] += 1.0
        else:
            misses[sign[k]] += weight[drive[k]]
    return hits, misses


@kernel
def _by_drive(
    sign: IntArray, drive: IntArray, seen: BoolArray, weight: FloatArray, n_drives: int
) -> tuple[FloatArray, FloatArray]:
    """Of each drive [d] the ``weight`` [m] of the signs that it saw, and of all in its view."""
    hits, tries = np.zeros(n_drives), np.zeros(n_drives)
    for k in range(len(sign)):
        tries[drive[k]] += weight[sign[k]]
        if seen[k]:
            hits[drive[k]] += weight[sign[k]]
    return hits, tries


def _mixture(pairs: Chances, rates: DetectionRates, evidence: FloatArray) -> FloatArray:
    """Probability [m] that each sign is real, if signs never changed; ``evidence`` [m] nats of
    what the drives saw. Of its series of drives the first that saw it is why it is known."""
    hits, misses = _counts(pairs, rates, len(evidence))
    a, b = rates.beta
    real = betaln(a + hits, b + misses) - betaln(a + 1.0, b)
    c, d = limits.FALSE_BETA
    fleeting = betaln(c + hits - 1.0, d + misses) - betaln(c, d)
    false = np.logaddexp(math.log(limits.LASTING) + real, math.log1p(-limits.LASTING) + fleeting)
    return probability(evidence + math.log(rates.real / (1.0 - rates.real)) + real - false)


def _with_spread(pairs: Chances, rates: DetectionRates, belief: FloatArray) -> DetectionRates:
    """The spread that makes the counts of real signs most likely, with a log-normal prior."""
    hits, misses = _counts(pairs, rates, len(belief))
    weight = np.where(hits + misses > limits.TELLING_DRIVES - 1.0, belief, 0.0)
    best, highest = rates, -np.inf
    for spread in limits.SPREADS:
        trial = DetectionRates(rates.overall, rates.drive, rates.real, spread)
        a, b = trial.beta
        score = float((weight * (betaln(a + hits, b + misses) - betaln(a, b))).sum())
        score -= 0.5 * (math.log(spread / limits.SPREAD) / limits.SPREAD_LOG_SD) ** 2
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
    seen = pairs.seen, weight, _ratios(pairs), drive_gps_s[pairs.drive]
    return _histories(pairs.sign, *seen, n_signs, rates.real, a, b)


@kernel
def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


@kernel
def _mean(ratio: FloatArray, start: int, stop: int) -> float:
    """Mean of the known ratios of some sightings; 1 where none is."""
    total, count = 0.0, 0
    for k in range(start, stop):
        if ratio[k] == ratio[k]:
            total += ratio[k]
            count += 1
    return total / count if count > 0 else 1.0


@kernel
def _histories(
    sign: IntArray,
    seen: BoolArray,
    weight: FloatArray,
    ratio: FloatArray,
    gps_s: FloatArray,
    n_signs: int,
    real: float,
    a: float,
    b: float,
) -> FloatArray:
    result = np.full(n_signs, real)
    c, d = limits.FALSE_BETA
    start = 0
    while start < len(sign):
        stop = start
        hits, misses = 0.0, 0.0
        while stop < len(sign) and sign[stop] == sign[start]:
            hits += seen[stop]
            misses += weight[stop]
            stop += 1
        base = _log_beta(a, b)
        throughout = _log_beta(a + hits, b + misses) - base
        # against what any sign that was seen once has
        known = throughout - (_log_beta(a + 1.0, b) - base)
        false = _log_beta(c + hits - 1.0, d + misses) - _log_beta(c, d)
        there, gone = 1.0, 0.0
        early_hits, early_misses = 0.0, 0.0
        for k in range(start, stop - 1):
            early_hits += seen[k]
            early_misses += weight[k]
            late_hits, late_misses = hits - early_hits, misses - early_misses
            change = limits.LEAST_CHANGE
            elapsed = gps_s[k + 1] - gps_s[k]
            if elapsed > 0.0:
                change = max(change, 1.0 - math.exp(-limits.CHANGE_PER_YEAR * elapsed / _YEAR_S))
            down = _log_beta(a + early_hits, b + early_misses) - base
            down += late_hits * math.log(limits.STRAY) + late_misses * math.log(1.0 - limits.STRAY)
            up = _log_beta(a + late_hits, b + late_misses) - base
            up += early_hits * math.log(limits.STRAY) + early_misses * math.log(1.0 - limits.STRAY)
            # strays look like what is no sign
            down -= math.log(_mean(ratio, k + 1, stop))
            up -= math.log(_mean(ratio, start, k + 1))
            gone += change * math.exp(min(down - throughout, 50.0))
            there += change * math.exp(min(up - throughout, 50.0))
        nothing = limits.LASTING + (1.0 - limits.LASTING) * math.exp(min(false - known, 50.0))
        nothing *= (1.0 - real) / _mean(ratio, start, stop)
        result[sign[start]] = real * there / (real * (there + gone) + nothing)
        start = stop
    return result


def still_there(
    sign: IntArray, weight: FloatArray, rates: DetectionRates, belief: FloatArray, hits: FloatArray
) -> FloatArray:
    """Probability [m] that signs of ``belief`` [m], seen by ``hits`` [m] drives before, stand
    after having been in view of further drives, pairs [p] of ``sign`` and the ``weight`` of the
    miss, and seen by none."""
    a, b = rates.beta
    misses = np.bincount(sign, weight, len(belief))
    kept = np.exp(betaln(a + hits, b + misses) - betaln(a + hits, b))
    start = np.clip(belief, 0.5, limits.OLDER_BELIEF)
    return np.asarray(start * kept / (start * kept + 1.0 - start))
