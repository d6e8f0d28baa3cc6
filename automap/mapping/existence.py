"""Whether a sign is there: seen, and not seen although it should have been.

A drive that saw something tells how probable it is that it exists (``geolocation/existence.py``):
posterior odds over those of any sighting are the likelihood ratio of what it saw, and those of a
sign's sightings are averaged, as of the passes of one drive.

How many saw it comes on top, by the same estimator as frames: the rate at which a real sign is seen
has a beta distribution, whose mean comes from the data, and where no sign changes the chances of a
series of drives are beta-binomial (J. G. Skellam, Journal of the Royal Statistical Society B 10,
1948). A real sign can be put up or taken down between two drives, at a small rate. What is no sign
is seen by hardly any other drive, or, where a thing that stays looks like one (a gable), as a sign
is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betaln

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.looks import Looks, mean_odds, probability, share_of, sign_nats
from automap.mapping.sureness import SUREST
from automap.mapping.visibility import Opportunities, alike, head_on
from automap.records import BoolArray, FloatArray, IntArray

_ROUNDS, _TURNS = 12, 3
"""Of the expectation maximisation, from one spread to the next, and of spreads."""
_SIGNS = 1 << 16
"""Whose histories are weighed at once: of ten million pairs every array takes 80 MB."""
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
    sign: IntArray,
    drive: IntArray,
    views: Opportunities,
    facing: FloatArray,
    told: FloatArray | None = None,
) -> Chances:
    """Put together what was seen, by sightings' ``sign``, ``drive`` and ``told`` existence [n], and
    what should have been: in view, and approached as by a drive that saw it. What was seen from
    further off or at the edge of the picture only, others should have seen that came straight at
    its face, of signs' ``facing`` [m]."""
    width = int(max(drive.max(initial=-1), views.drive.max(initial=-1))) + 1
    seen_key = np.unique(sign * width + drive)
    seen = np.isin(views.sign * width + views.drive, seen_key)
    approached = np.isin(views.sign, views.sign[seen])
    views = views.at(np.where(approached, alike(views, seen), head_on(views, facing)))
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
    rates = DetectionRates(
        usual, np.full(max(n_drives, 1), usual), share_of(0.0, 0.0, limits.REAL_PRIOR)
    )
    telling = np.bincount(pairs.sign, minlength=n_signs) >= limits.TELLING_DRIVES
    seen = np.bincount(pairs.sign[pairs.seen], minlength=n_signs).astype(np.float64)
    evidence = np.log(mean_odds(_ratios(pairs), pairs.sign, n_signs))
    for turn in range(_ROUNDS * _TURNS):
        belief = _mixture(pairs, rates, evidence)
        if turn % _ROUNDS == _ROUNDS - 1:
            rates = _with_spread(pairs, rates, belief)
        real_there = belief * telling
        hits, misses = _sums(
            *(pairs.drive, pairs.sign, pairs.seen, real_there, real_there, len(rates.drive))
        )
        tries = hits + misses
        overall = (hits.sum() + limits.RATE_PRIOR[0]) / (tries.sum() + sum(limits.RATE_PRIOR))
        overall = float(np.clip(overall, *limits.OVERALL_LIMITS))
        by_drive = (hits + limits.DRIVE_FREEDOM * overall) / (tries + limits.DRIVE_FREEDOM)
        real = share_of(float((belief * seen).sum()), float(seen.sum()), limits.REAL_PRIOR)
        rates = DetectionRates(
            overall, np.clip(by_drive, *limits.DRIVE_LIMITS), min(real, SUREST), rates.spread
        )
    return rates


def _ratios(pairs: Chances) -> FloatArray:
    """Likelihood ratio [p] of what a drive saw, NaN where not told: its odds over those of any
    sighting, of which the mean tells, as calibrated probabilities average to what is right."""
    if pairs.told is None:
        return np.full(len(pairs), np.nan)
    told = np.clip(np.where(pairs.seen, pairs.told, np.nan), 1.0 - SUREST, SUREST)
    known = np.isfinite(told)
    before = share_of(float(told[known].sum()), float(known.sum()), limits.REAL_PRIOR)
    return np.asarray(told / (1.0 - told) * (1.0 - before) / before)


def _counts(pairs: Chances, rates: DetectionRates, n_signs: int) -> tuple[FloatArray, FloatArray]:
    """How often each sign was seen, and missed, [m] each."""
    missed = rates.miss_weight(np.arange(len(rates.drive)))
    return _sums(pairs.sign, pairs.drive, pairs.seen, np.ones(len(missed)), missed, n_signs)


@kernel
def _sums(
    of: IntArray, by: IntArray, seen: BoolArray, found: FloatArray, missed: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Sums [count] over the pairs ``of`` each sign (drive), those that were seen and those that
    were not, of what they weigh ``by`` their drives (signs), when ``found`` and when ``missed``:
    of ten million pairs no array but these."""
    hits, misses = np.zeros(count), np.zeros(count)
    for k in range(len(of)):
        if seen[k]:
            hits[of[k]] += found[by[k]]
        else:
            misses[of[k]] += missed[by[k]]
    return hits, misses


def _mixture(pairs: Chances, rates: DetectionRates, evidence: FloatArray) -> FloatArray:
    """Probability [m] that each sign is real, if signs never changed; ``evidence`` [m] nats of
    what the drives saw."""
    hits, misses = _counts(pairs, rates, len(evidence))
    a, b = rates.beta
    nats = betaln(a + hits, b + misses) - betaln(a, b)
    return _real(nats, hits, misses, rates, evidence)


def _real(
    nats: FloatArray, hits: FloatArray, misses: FloatArray, rates: DetectionRates,
    evidence: FloatArray,
) -> FloatArray:  # fmt: skip
    """Probability [m] of signs whose ``hits`` and ``misses`` [m] are as likely as ``nats`` [m]
    say. That one drive saw it is why anything is known at all, sign or not."""
    c, d = limits.FALSE_BETA
    fleeting = betaln(c + hits - 1.0, d + misses) - betaln(c, d) + math.log(rates.overall)
    false = np.logaddexp(math.log(limits.LASTING) + nats, math.log1p(-limits.LASTING) + fleeting)
    return probability(evidence + math.log(rates.real / (1.0 - rates.real)) + nats - false)


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

    Over all histories in which it stood for one of the drives at least. ``drive_gps_s`` [d] are the
    drives' times.
    """
    ratio = _ratios(pairs)
    edges = np.flatnonzero(np.diff(pairs.sign, prepend=-1, append=-1)).astype(np.int64)
    signs = pairs.sign[edges[:-1]]
    told = np.zeros((2, len(signs)))
    for k in range(0, len(signs), _SIGNS):
        first = edges[k : k + _SIGNS + 1]
        looks = _looks(pairs, slice(first[0], first[-1]), ratio, rates, drive_gps_s)
        looks = looks._replace(first=first - first[0])
        told[:, k : k + _SIGNS] = sign_nats(looks, *rates.beta)
    hits, misses = (count[signs] for count in _counts(pairs, rates, n_signs))
    evidence = np.log(mean_odds(ratio, pairs.sign, n_signs))[signs]
    result = np.full(n_signs, rates.real)
    result[signs] = told[1] * _real(told[0], hits, misses, rates, evidence)
    return result


def _looks(
    pairs: Chances, rows: slice, ratio: FloatArray, rates: DetectionRates, drive_gps_s: FloatArray
) -> Looks:
    """Some of the pairs as looks at one thing, whose likelihood ratios are ``ratio`` [p]."""
    seen, drive = pairs.seen[rows], pairs.drive[rows]
    weight = np.where(seen, 1.0, rates.miss_weight(drive))
    # a stray sighting is of what is no sign, and looks like that
    stray = np.minimum(limits.STRAY / np.nan_to_num(ratio[rows], nan=1.0), 1.0)
    without = np.where(seen, stray, (1.0 - limits.STRAY) ** weight)
    elapsed = np.nan_to_num(np.diff(drive_gps_s[drive], prepend=np.nan))
    change = -np.expm1(-limits.CHANGE_PER_YEAR * np.maximum(elapsed, 0.0) / _YEAR_S)
    change = np.maximum(change, limits.LEAST_CHANGE)
    return Looks(np.array([0, len(seen)]), seen, weight, without, change, change, (1.0, 1.0))


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
