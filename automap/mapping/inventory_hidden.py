"""How many of the signs that stand one drive does not see, and so how many it misses are gone.

Nobody sees what hides a sign altogether, but what hides one for part of its approach leaves gaps:
frames that should show the sign and do not. What stands in the line of sight for a stretch of the
path that begins anywhere leaves the same chance to every part of an approach to be hidden, and
beyond those it hides some approaches wholly: how many depends on how long such stretches are, of
which the drive says nothing; the ratio is left open. So where found signs have no gaps, few can be
hidden, and a sign that was not seen is gone; where every second has, it may well stand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.mapping.inventory_limits import STALE, STALE_WEIGHT
from automap.records import FloatArray, IntArray

_GRID = (np.arange(40) + 0.5) / 40.0
_HIDDEN = _GRID**2
"""Parts of the signs that are hidden for a part of their approach: closer where they are few."""
_RATES = np.array([0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.96, 0.98, 0.99])
"""Of a detector, in frames in which nothing hides a sign."""
WHOLLY = (2.0, 4.0)
"""Beta parameters of the share, of signs that something hides, that it hides for all of their
approach. What hides a sign over S m of the path, and the sign is in view over D, hides it wholly
along S - D of the places where it may stand and for a part along twice the lesser. With lengths of
which each is as likely, in logarithms, from a half to twice an approach that is a share of 0.11,
from an eighth to eight times 0.45."""
LEAST_BOXES = 2
"""Fewer boxes make no sign of a map, as a rule."""


@dataclass(frozen=True)
class Gaps:
    """``share`` [40] how probable it is that a part of ``_HIDDEN`` of the signs that are seen at
    all is hidden for a part of its approach, and ``lost`` [40, 2] of signs that nothing hides, and
    of those hidden for a part, the share that leaves too few boxes."""

    share: FloatArray
    lost: FloatArray


def gaps(n_seen: IntArray, n_looked: IntArray) -> Gaps:
    """From the frames that should have shown the found signs [n], and those that did.

    Counts of a sign that nothing hides are binomial; of one that is visible for a part of its
    approach, every part being as likely, the binomial's mean over that part. What is hidden from
    none to all of the signs, and what rate the detector has, is as likely beforehand.
    """
    from scipy.stats import binom

    known = (n_looked >= LEAST_BOXES) & (n_seen >= LEAST_BOXES)
    seen, looked = n_seen[known], n_looked[known]
    usual = int(np.median(looked)) if len(looked) else 10
    told = np.zeros((len(_GRID), len(_RATES)))
    lost = np.zeros((len(_RATES), 2))
    for k, rate in enumerate(_RATES.tolist()):
        parts = rate * _GRID[:, None]
        lost[k] = (
            binom.cdf(LEAST_BOXES - 1, usual, rate),
            binom.cdf(LEAST_BOXES - 1, usual, parts).mean(),
        )
        # the found ones are those of which boxes are left
        open_ = binom.pmf(seen, looked, rate) / binom.sf(LEAST_BOXES - 1, looked, rate)
        part = np.mean(binom.pmf(seen, looked, parts), axis=0)
        part /= np.mean(binom.sf(LEAST_BOXES - 1, looked, parts), axis=0)
        mixed = (1.0 - _HIDDEN[:, None]) * open_ + _HIDDEN[:, None] * part
        told[:, k] = np.log(np.maximum(mixed, 1e-300)).sum(axis=1)
    # the grid's steps grow as its values' roots
    weight = np.exp(told - told.max()) * _GRID[:, None]
    share = weight.sum(axis=1)
    return Gaps(share / share.sum(), (weight @ lost) / share[:, None])


def gone_by_gaps(found: Gaps, n_in_view: int, n_unseen: int) -> float:
    """Probability that a listed sign which the drive had in view, and did not see, is gone: the
    share of ``n_unseen`` of ``n_in_view`` is that of the gone ones and of those that stand unseen.
    """
    from scipy.stats import beta, binom

    stale = np.linspace(0.0, 0.5, 101)[1:]
    prior = beta.pdf(stale, STALE * STALE_WEIGHT, (1.0 - STALE) * STALE_WEIGHT)
    # signs hidden wholly, to those hidden for a part
    wholly = _GRID / (1.0 - _GRID)
    ratio = beta.pdf(_GRID, *WHOLLY)
    q = _HIDDEN[:, None]
    partly_lost, open_lost = found.lost[:, 1:], found.lost[:, :1]
    # found ones are those left: as many more are hidden as are lost
    weights = np.stack(np.broadcast_arrays(
        (1.0 - q) / (1.0 - open_lost), q / (1.0 - partly_lost), q * wholly / (1.0 - partly_lost)
    ))  # fmt: skip
    lost = weights[0] * open_lost + weights[1] * partly_lost + weights[2]
    unseen = lost / weights.sum(axis=0)
    chance = stale[:, None, None] + (1.0 - stale[:, None, None]) * unseen
    likely = (
        binom.pmf(n_unseen, n_in_view, chance) * prior[:, None, None] * found.share[:, None] * ratio
    )
    return float((likely * stale[:, None, None] / chance).sum() / likely.sum())
