"""What looks at a thing say of it: seen, and not seen when it should have been.

The frames of a pass are looks, and the drives of a map: a sign is found by most that should show
it, each sign at a rate of its own about the usual one, unless it is not there to be seen.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import roots_jacobi

from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray

_NODES = 32
"""Of the quadrature over rates: exact for up to 63 looks; of a thousand frames, as a car has that
waits in sight of a sign, it tells to half a nat of hundreds."""


class Looks(NamedTuple):
    """Looks [n] at some things [m], in the order of things and time: ``first`` [m + 1] of each;
    which ``seen`` it, what a miss ``counts`` (1: as the usual look's), and how likely what was seen
    is where no sign is to be seen, ``without`` [n]. From the look before to this a sign is hidden
    or taken down with the probability ``goes`` [n] and comes into view with ``comes`` [n];
    ``start`` weights of one that at first is, and that is not yet to be seen."""

    first: IntArray
    seen: BoolArray
    counts: FloatArray
    without: FloatArray
    goes: FloatArray
    comes: FloatArray
    start: tuple[float, float]


def sign_nats(looks: Looks, a: float, b: float) -> tuple[FloatArray, FloatArray]:
    """Log likelihood [m] of what was seen of signs whose own rates have a beta distribution of
    parameters ``a`` and ``b``, and the probability [m] that each is to be seen at last."""
    return _history(*looks, *_rates(a, b))


@lru_cache(maxsize=64)
def _rates(a: float, b: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and logarithms of weights [n] of the beta distribution of rates (Gauss-Jacobi)."""
    x, weight = roots_jacobi(_NODES, b - 1.0, a - 1.0)
    return 0.5 * (1.0 + x), np.log(weight / weight.sum())


@kernel
def _history(
    first: IntArray,
    seen: BoolArray,
    counts: FloatArray,
    without: FloatArray,
    goes: FloatArray,
    comes: FloatArray,
    start: tuple[float, float],
    rates: FloatArray,
    log_weights: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Forward algorithm over three states: not yet, now, and no longer to be seen. One that never
    was is no sign of what was seen."""
    nats, now = np.zeros(len(first) - 1), np.zeros(len(first) - 1)
    told, share = np.zeros(len(rates)), np.zeros(len(rates))
    for thing in range(len(first) - 1):
        for node in range(len(rates)):
            open_, before = start
            after, total = 0.0, 0.0
            miss = math.log(1.0 - rates[node])
            for k in range(first[thing], first[thing + 1]):
                if k > first[thing]:
                    shown = (before + after) * comes[k]
                    after = after * (1.0 - comes[k]) + open_ * goes[k]
                    before *= 1.0 - comes[k]
                    open_ = open_ * (1.0 - goes[k]) + shown
                open_ *= rates[node] if seen[k] else math.exp(counts[k] * miss)
                before *= without[k]
                after *= without[k]
                scale = before + open_ + after
                total += math.log(scale)
                before, open_, after = before / scale, open_ / scale, after / scale
            told[node] = total + math.log(max(open_ + after, 1e-300)) + log_weights[node]
            share[node] = open_ / max(open_ + after, 1e-300)
        most = told.max()
        weight = np.exp(told - most)
        nats[thing] = most + math.log(weight.sum())
        now[thing] = (weight * share).sum() / weight.sum()
    return nats, now


def probability(log_odds: FloatArray) -> FloatArray:
    """Probabilities [n] that have these log odds."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))


def mean_odds(odds: FloatArray, sign: IntArray, m: int) -> FloatArray:
    """Odds [m] of signs by those [n] of what shows the ``sign`` [n], whether each is right: such
    sightings err alike, and their mean never says too much however they depend on one another
    (V. Vovk, R. Wang, E-values, Annals of Statistics 49, 2021); 1 where none tells (NaN)."""
    known = np.isfinite(odds)
    count = np.bincount(sign[known], minlength=m)
    return np.where(count > 0, np.bincount(sign[known], odds[known], m) / np.maximum(count, 1), 1.0)


def share_of(right: float, count: float, imagined: tuple[float, float]) -> float:
    """Share of ``count`` things of which ``right`` are expected to be right, with some ``imagined``
    that are and are not: parameters of its beta distribution beforehand."""
    return (right + imagined[0]) / (count + sum(imagined))
