"""Which listed signs stand no more: in view of drives, and seen by none of them.

A listed sign is gone, and no drive sees it, or it stands, and each drive that had it in view sees
it at a rate that differs from sign to sign (a tree, a parked van): the counts of those that stand
are beta-binomial (J. G. Skellam, Journal of the Royal Statistical Society B 10, 1948). The share of
gone ones, rate and spread come from the counts of all by expectation maximisation (Dempster, Laird,
Rubin, Journal of the Royal Statistical Society B 39, 1977). With one drive share and rate cannot be
told apart, and priors decide; with several, one that each of them missed is nearly surely gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from automap.mapping.inventory_limits import (
    DETECTION_PRIOR,
    HIGHEST_RATE,
    ROUNDS,
    STALE,
    STALE_WEIGHT,
)
from automap.mapping.limits import SPREAD, SPREAD_LOG_SD, SPREADS
from automap.mapping.visibility import Opportunities
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class Standing:
    """``gone`` [m] the probability that a listed sign stands no more (NaN where no drive had it in
    view); ``rate`` at which a drive finds a sign that stands, over all."""

    gone: FloatArray
    rate: float


def standing(tries: IntArray, hits: IntArray, group: IntArray) -> Standing:
    """Listed signs [m] that ``tries`` drives had in view and ``hits`` of them saw.

    Each ``group`` [m] has a rate of its own: signs of unknown facing may look away from every
    drive.
    """
    n = int(group.max(initial=0)) + 1
    seen = tries > 0
    misses = np.maximum(tries - hits, 0)
    rate = np.full(n, DETECTION_PRIOR[0] / sum(DETECTION_PRIOR))
    share, spread = STALE, SPREAD
    for turn in range(ROUNDS):
        told = _log_counts(hits, misses, rate[group], spread)
        gone = np.where((hits == 0) & seen, share, 0.0)
        with np.errstate(divide="ignore"):
            gone = gone / (gone + (1.0 - share) * np.exp(told))
        stands = np.where(seen, 1.0 - gone, 0.0)
        for k in range(n):
            own = stands * (group == k)
            right = float((own * hits).sum()) + DETECTION_PRIOR[0]
            rate[k] = right / (float((own * tries).sum()) + sum(DETECTION_PRIOR))
        rate = np.minimum(rate, HIGHEST_RATE)
        total = float(seen.sum())
        share = float(gone[seen].sum() + STALE * STALE_WEIGHT) / (total + STALE_WEIGHT)
        # of signs that one drive had in view the spread tells nothing
        if turn % 10 == 9 and (tries > 1).any():
            spread = _spread(hits, misses, rate[group], stands)
    overall = float((stands * hits).sum()) + DETECTION_PRIOR[0]
    overall /= float((stands * tries).sum()) + sum(DETECTION_PRIOR)
    return Standing(np.where(seen, gone, np.nan), overall)


def _log_counts(hits: IntArray, misses: IntArray, rate: FloatArray, spread: float) -> FloatArray:
    """Beta-binomial log likelihood [m] of hits and misses of signs that stand."""
    from scipy.special import betaln

    a, b = spread * rate, spread * (1.0 - rate)
    return np.asarray(betaln(a + hits, b + misses) - betaln(a, b), np.float64)


def _spread(hits: IntArray, misses: IntArray, rate: FloatArray, stands: FloatArray) -> float:
    """The spread that makes the counts of signs that stand most likely, with a log-normal prior."""

    def score(spread: float) -> float:
        told = float((stands * _log_counts(hits, misses, rate, spread)).sum())
        return told - 0.5 * (math.log(spread / SPREAD) / SPREAD_LOG_SD) ** 2

    return max(SPREADS, key=score)


def counts(
    views: Opportunities, n: int, seen_by: list[frozenset[int] | None]
) -> tuple[IntArray, IntArray]:
    """How many drives had each of ``n`` listed signs in view, and how many of these saw it.

    ``seen_by`` [n] the drives that saw the sign it was matched with, None without such a one. A
    sign that was matched was seen at least once, in view or not.
    """
    tries, hits = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for sign, drive in zip(views.sign.tolist(), views.drive.tolist(), strict=True):
        own = seen_by[sign]
        tries[sign] += 1
        hits[sign] += own is not None and drive in own
    found = np.array([own is not None for own in seen_by], np.bool_)
    return tries, np.where(found & (tries > 0), np.maximum(hits, 1), hits)
