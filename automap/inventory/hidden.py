"""How many of the signs that stand one drive does not see, and so how many it misses are gone.

Nobody sees what hides a sign altogether, but what hides one for part of its approach leaves gaps:
frames that should show the sign and do not. What stands in the line of sight for a stretch of the
path that begins anywhere leaves the same chance to every part of an approach to be hidden, and
beyond those it hides some approaches wholly: how many depends on how long such stretches are, of
which the drive says nothing; the ratio is left open. So where found signs have no gaps, few can be
hidden, and a sign that was not seen is gone; where every second has, it may well stand. What stays
where it is (a tree) hides a sign in every drive, what moves in one of them: of several drives that
found a sign, the first leaves few frames in all of them together, the second in one part of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.inventory.limits import HIGHEST_RATE, STALE, STALE_WEIGHT
from automap.records import FloatArray, IntArray

_GRID = (np.arange(40) + 0.5) / 40.0
_HIDDEN = _GRID**2
"""Parts of the signs that are hidden for a part of their approach: closer where they are few."""
_VISIBLE = np.append(_GRID, 1.0)
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
_MOST_DRIVES = 8
"""More drives of one sign count as so many: what hides it in one of them is an eighth by then."""


@dataclass(frozen=True)
class Gaps:
    """``share`` [40] how probable it is that a part of ``_HIDDEN`` of the signs, of those that are
    not hidden altogether, is hidden for a part of its approach, in every drive, and ``lost``
    [40, 2] of signs that nothing hides, and of those hidden for a part, the share that leaves too
    few boxes."""

    share: FloatArray
    lost: FloatArray


def gaps(n_seen: IntArray, n_looked: IntArray, n_drives: IntArray) -> Gaps:
    """From the frames that should have shown the found signs [n], and those that did, of all the
    drives that found each.

    Counts of a sign that nothing hides are binomial; of one that is visible for a part of its
    approach, every part being as likely, the binomial's mean over that part. What is hidden from
    none to all of the signs, likewise in single drives, and what rate the detector has, is as
    likely beforehand. Of one drive nothing tells what stays from what moves: both count.
    """
    from scipy.stats import binom

    known = (n_looked >= LEAST_BOXES) & (n_seen >= LEAST_BOXES)
    counts = np.column_stack([n_seen, n_looked, np.clip(n_drives, 1, _MOST_DRIVES)])[known]
    kinds, often = np.unique(counts, axis=0, return_counts=True)
    seen, looked, drives = (column[:, None] for column in kinds.T)
    usual = int(np.median(counts[:, 1] / counts[:, 2])) if len(counts) else 10
    passing = _HIDDEN[2::5] if (drives > 1).any() else np.zeros(1)
    told = np.zeros((len(_GRID), len(_RATES), len(passing)))
    lost = np.zeros((len(_RATES), 2))
    for k, rate in enumerate(_RATES.tolist()):
        found = binom.sf(LEAST_BOXES - 1, usual, rate * _VISIBLE)
        lost[k] = 1.0 - found[-1], 1.0 - found[:-1].mean()
        chance = binom.pmf(seen, looked, rate * _VISIBLE)
        chance /= np.maximum(binom.sf(LEAST_BOXES * drives - 1, looked, rate * _VISIBLE), 1e-12)
        for m, share in enumerate(passing.tolist()):
            parts = np.array([_seen_parts(d + 1, share, found) for d in range(_MOST_DRIVES)])
            open_, part = parts[drives[:, 0] - 1].transpose(1, 0, 2)
            told[:, k, m] = _log_mixed(open_, part, chance) @ often
    # the grid's steps grow as its values' roots
    weight = np.exp(told - told.max()).sum(axis=2) * _GRID[:, None]
    share = weight.sum(axis=1)
    return Gaps(share / share.sum(), (weight @ lost) / np.maximum(share, 1e-300)[:, None])


def _log_mixed(open_: FloatArray, part: FloatArray, chance: FloatArray) -> FloatArray:
    """Log likelihoods [40, n] of counts that have the ``chance`` [n, 41] by what is visible, of
    found signs that nothing hides in every drive, and of those hidden for a part, [n, 41]."""
    q = _HIDDEN[:, None]
    likely = (1.0 - q) * (open_ * chance).sum(axis=1) + q * (part * chance).sum(axis=1)
    total = (1.0 - q) * open_.sum(axis=1) + q * part.sum(axis=1)
    return np.asarray(np.log(np.maximum(likely, 1e-300) / total))


def _seen_parts(drives: int, share: float, found: FloatArray) -> FloatArray:
    """How probable it is that so many drives find a sign, and that each part of ``_VISIBLE`` of
    their approaches is visible [2, 41]: of one that nothing hides in every drive, and of one
    hidden for a part. In each drive something that moves hides a part with the probability
    ``share``; a drive finds a sign of which a part is visible by ``found`` [41]."""
    one = np.zeros(2 * len(_GRID) + 1)
    one[1::2], one[-1] = share / len(_GRID) * found[:-1], (1.0 - share) * found[-1]
    total = one
    for _ in range(drives - 1):
        total = np.convolve(total, one)
    place = np.arange(len(total) - 1) * len(_GRID) // (len(total) - 1)
    open_ = np.append(np.bincount(place, total[:-1], len(_GRID)), total[-1])
    weight = open_[:, None] * found[:-1] ** drives / len(_GRID)
    left = np.minimum((_VISIBLE[:, None] * _GRID * len(_GRID)).astype(np.int64), len(_GRID) - 1)
    return np.array([open_, np.bincount(left.ravel(), weight.ravel(), len(_VISIBLE))])


def hidden_for_good(found: Gaps, nodes: int) -> FloatArray:
    """Quantiles [nodes] of the share of standing signs that something hides wholly from every
    drive."""
    from scipy.stats import beta

    odds = _HIDDEN[:, None] * _GRID / (1.0 - _GRID)
    weight = found.share[:, None] * beta.pdf(_GRID, *WHOLLY)
    order = np.argsort(odds, axis=None)
    total = np.cumsum(weight.ravel()[order])
    at = (np.arange(nodes) + 0.5) / nodes * total[-1]
    share = (odds / (1.0 + odds)).ravel()[order]
    return np.asarray(share[np.searchsorted(total, at)])


def gone_by_gaps(
    found: Gaps, n_in_view: int, n_unseen: int, screened: FloatArray | float = 1.0
) -> FloatArray:
    """Probability [k] that listed signs which the drive had in view, and did not see, are gone: the
    share of ``n_unseen`` of ``n_in_view`` is that of the gone ones and of those that stand unseen.
    Of each sign the part ``screened`` [k] of what may hide it is still possible.
    """
    from scipy.stats import beta, binom

    stale = np.linspace(0.0, 0.5, 101)[1:, None, None]
    prior = beta.pdf(stale, STALE * STALE_WEIGHT, (1.0 - STALE) * STALE_WEIGHT)
    # signs hidden wholly, to those hidden for a part
    wholly = _GRID / (1.0 - _GRID)
    q = _HIDDEN[:, None]
    open_lost, partly_lost = found.lost[:, :1], found.lost[:, 1:]

    def gone(part: float) -> FloatArray:
        hidden = part * q
        unseen = (1.0 - hidden) * open_lost + hidden * (partly_lost + wholly)
        # a face that nothing hides may be overlooked all the same
        unseen = np.maximum(unseen / (1.0 + hidden * wholly), 1.0 - HIGHEST_RATE)
        return np.asarray(stale / (stale + (1.0 - stale) * unseen))

    likely = prior * found.share[:, None] * beta.pdf(_GRID, *WHOLLY)
    likely = likely * binom.pmf(n_unseen, n_in_view, stale / gone(1.0))
    told = [(likely * gone(s)).sum() / likely.sum() for s in np.ravel(screened).tolist()]
    return np.array(told, np.float64)
