"""Which listed signs stand no more: in view of drives, and seen by none of them.

A listed sign is gone, and no drive sees it, or it stands, and each drive that had it in view sees
it at a rate that differs from sign to sign (a tree, a parked van): the counts of those that stand
are beta-binomial (J. G. Skellam, Journal of the Royal Statistical Society B 10, 1948). The share of
gone ones, rate and spread come from the counts of all by expectation maximisation (Dempster, Laird,
Rubin, Journal of the Royal Statistical Society B 39, 1977). With one drive share and rate cannot be
told apart, and priors decide; with several, one that each of them missed is gone, or something
that stays there hides it from all of them: the counts do not tell the one from the other. Nor do
they tell a sign that is gone from one of a kind that a detector was never taught.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaln

from automap.inventory import limits
from automap.mapping.limits import SPREAD, SPREAD_LOG_SD, SPREADS
from automap.mapping.visibility import Opportunities
from automap.records import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Standing:
    """``gone`` [m] the probability that a listed sign stands no more (NaN where no drive had it in
    view); ``rate`` at which a drive finds a sign that stands, over all; ``more_drives`` [m] that
    would have to look there and see nothing until it is surely gone, 0 where none would tell."""

    gone: FloatArray
    rate: float
    more_drives: IntArray


def standing(
    tries: IntArray,
    hits: IntArray,
    group: IntArray,
    priors: Sequence[tuple[float, float]] = (),
    hidden: Sequence[float] = (0.0,),
    screened: FloatArray | float = 1.0,
) -> Standing:
    """Listed signs [m] that ``tries`` drives had in view and ``hits`` of them saw; ``hidden``
    shares, each as probable, of those that stand that no drive can see, of each sign the part
    ``screened`` [m] of it.

    Each ``group`` [m] has a rate of its own, with its beta parameters of ``priors`` (default: the
    usual ones): signs of unknown facing may look away from every drive. How alike the signs of a
    group are is not decided but averaged over, by how likely the counts are with it. A face that is
    taken from beside one that stays is other work than a post that is taken away: either has a
    share of gone ones of its own.
    """
    n = int(group.max(initial=0)) + 1
    prior = np.array([*priors, *[limits.DETECTION_PRIOR] * (n - len(priors))], np.float64)
    seen = tries > 0
    # of signs that one drive had in view the spread tells nothing
    spreads = SPREADS if (tries > 1).any() else (SPREAD,)
    misses = np.maximum(tries - hits, 0)
    screened = np.broadcast_to(screened, tries.shape)
    beside = (screened < 1.0).astype(np.int64)
    fits = [
        _fitted(hits, misses, group, seen, prior, spread, share * screened, beside)
        for spread in spreads
        for share in hidden
    ]
    likely = np.array([log_likely for _, _, log_likely in fits])
    weight = np.exp(likely - likely.max())
    weight /= weight.sum()
    by_more = np.zeros((limits.MOST_DRIVES + 2, len(tries)))
    overall = 0.0
    for w, (with_more, rate, _) in zip(weight.tolist(), fits, strict=True):
        by_more += w * with_more
        overall += w * rate
    gone = by_more[0]
    sure = by_more >= limits.SURE
    more = np.where(sure[:-1].any(axis=0), np.argmax(sure, axis=0), limits.MOST_DRIVES)
    # what no drive can see any number of them does not tell from what is gone
    more = np.where(sure[-1], more, 0)
    return Standing(np.where(seen, gone, np.nan), overall, np.where(seen & (hits == 0), more, 0))


def _fitted(
    hits: IntArray, misses: IntArray, group: IntArray, seen: BoolArray, prior: FloatArray,
    spread: float, hidden: FloatArray, kind: IntArray,
) -> tuple[FloatArray, float, float]:  # fmt: skip
    """Shares of gone signs by ``kind`` [m], and the groups' rates, ``prior`` [g, 2], by expectation
    maximisation: how probably each is gone after so many more drives, and after any number,
    [2 + more drives, m], the rate of all, and how likely the counts are."""
    rate = prior[:, 0] / prior.sum(axis=1)
    share = np.full(len(hits), limits.STALE)
    total = np.bincount(kind, seen, 2)
    none = (hits == 0) & seen
    for _ in range(limits.ROUNDS):
        open_ = (1.0 - hidden) * np.exp(_log_counts(hits, misses, rate[group], spread))
        unseen = np.where(none, hidden + open_, 1.0)
        gone = np.where(none, share / (share + (1.0 - share) * unseen), 0.0)
        # what no drive can see tells nothing of rates
        stands = np.where(seen, (1.0 - gone) * np.where(none, open_ / unseen, 1.0), 0.0)
        right = np.bincount(group, stands * hits, len(rate)) + prior[:, 0]
        tried = np.bincount(group, stands * (hits + misses), len(rate)) + prior.sum(axis=1)
        rate = np.minimum(right / tried, limits.HIGHEST_RATE)
        stale = np.bincount(kind, gone, 2) + limits.STALE * limits.STALE_WEIGHT
        share = (stale / (total + limits.STALE_WEIGHT))[kind]
    further = misses + np.arange(limits.MOST_DRIVES + 1)[:, None]
    overlooked = np.exp(_log_counts(hits, further, rate[group], spread))
    unseen = hidden + (1.0 - hidden) * np.vstack([overlooked, np.zeros(len(hits))])
    by_more = np.where(none, share / (share + (1.0 - share) * unseen), 0.0)
    likely = (1.0 - share) * np.where(none, hidden + open_, open_) + np.where(none, share, 0.0)
    log_likely = float(np.log(likely[seen]).sum())
    log_likely -= 0.5 * (np.log(spread / SPREAD) / SPREAD_LOG_SD) ** 2
    usual = sum(limits.DETECTION_PRIOR)
    overall = float((stands * hits).sum()) + limits.DETECTION_PRIOR[0]
    overall /= float((stands * (hits + misses)).sum()) + usual
    return by_more, overall, log_likely


def _log_counts(hits: IntArray, misses: IntArray, rate: FloatArray, spread: float) -> FloatArray:
    """Beta-binomial log likelihood [m] of hits and misses of signs that stand."""
    a, b = spread * rate, spread * (1.0 - rate)
    return np.asarray(betaln(a + hits, b + misses) - betaln(a, b), np.float64)


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
