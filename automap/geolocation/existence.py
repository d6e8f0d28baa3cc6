"""Whether what was seen is a sign: seen, and not seen when it should have been.

One estimator serves the frames of a pass and the drives of a map. There are three things that
something seen may be. A sign is found by most looks that should show it, each sign at a rate of its
own about the usual one, unless it is not there to be seen: something hides it for a while, or it
was put up or taken down between two drives (a hidden Markov model). False boxes fit one place by
chance, the less likely the more of them there are. And a thing that stays (a lamp, an advert) is
taken for a sign now and then, or always. Bayes' rule with these gives the probability of a sign
(existence in the sense of Musicki and Evans, Joint Integrated Probabilistic Data Association, IEEE
T-AES 40, 2004). How often each occurs comes from the data, by expectation maximisation (Dempster,
Laird, Rubin, Journal of the Royal Statistical Society B 39, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import betaln, logit, roots_jacobi

from automap.geolocation import limits
from automap.geolocation.due_frames import Pattern
from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray

_ROUNDS = 20
"""Of the expectation maximisation."""
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


def existence_of(passes: Sequence[Sequence[float]]) -> float:
    """Probability of a sign by its passes, each with the odds that it is one against boxes that
    meet by chance, and against what stands there and is none: that every pass is chance is the less
    likely the more there are, but what looks like a sign does so in all of them."""
    by_chance, alike = np.array(passes).T
    together = np.expm1(min(float(np.log1p(by_chance).sum()), 700.0))
    odds = float(mean_odds(alike, np.zeros(len(alike), np.int64), 1)[0])
    return float(1.0 / (1.0 + 1.0 / together + 1.0 / odds))


def share_of(right: float, count: float, imagined: tuple[float, float]) -> float:
    """Share of ``count`` things of which ``right`` are expected to be right, with some ``imagined``
    that are and are not: parameters of its beta distribution beforehand."""
    return (right + imagined[0]) / (count + sum(imagined))


def expected_log_odds(
    log_odds: FloatArray, weight: FloatArray, imagined: tuple[float, float]
) -> float:
    """What is added to the ``log_odds`` [n] of things, each counted ``weight`` [n] times, for how
    many of them are right: the share that these themselves tell."""
    shift = 0.0
    for _ in range(_ROUNDS):
        right = float(weight @ probability(log_odds + shift))
        shift = float(logit(share_of(right, float(weight.sum()), imagined)))
    return shift


def existence_odds(
    patterns: Sequence[Pattern], scores: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Odds [m] that the boxes of each thing show a sign, against boxes that meet by chance, and
    against a thing that stands there and looks like one; by the ``patterns`` of frames that show
    it or should and the ``scores`` of its boxes.

    The rate of finding a sign is taken from those with many boxes, the share of signs among things
    seen once, and how many look like one, from all. Where most single boxes of a drive were clearly
    not confirmed, the others, seen at the edge of the picture or last before a gap, are hardly
    signs either.
    """
    boxes = np.array([len(own) for own in scores], np.int64)
    often = [k for k, n in enumerate(boxes.tolist()) if n >= limits.RATE_VIEWS]
    rate = _found_rate([p for p in patterns if p.seen.sum() >= limits.RATE_VIEWS])
    correlation = _correlation([scores[k] for k in often])
    as_sign = pattern_nats(patterns, rate)
    best = np.array([own.max() for own in scores], np.float64)
    there = _logits(best) + limits.FITTING_BOX_NATS * (boxes - 1) + as_sign
    single = boxes == 1
    one = np.ones(int(single.sum()))
    there[single] += expected_log_odds(there[single], one, (limits.IMAGINARY, limits.IMAGINARY))
    thing = np.array([thing_nats(p.seen) for p in patterns]) - as_sign
    thing -= [_by_scores(own, correlation) for own in scores]
    thing += math.log(limits.STANDING / limits.THINGS_A_SIGN)
    # one such thing is imagined
    stands = probability(there)
    thing += expected_log_odds(thing, stands, (1.0, 1.0 / limits.THINGS_A_SIGN))
    return np.exp(np.clip(there, -50.0, 50.0)), np.exp(np.clip(-thing, -50.0, 50.0))


def _logits(scores: FloatArray) -> FloatArray:
    return np.asarray(logit(np.clip(scores, *limits.BOX_LIMITS)), np.float64)


def _by_scores(scores: FloatArray, correlation: float) -> float:
    """Log odds that boxes with these ``scores`` [k] show a sign: the mean of theirs, as often as
    there are independent ones among boxes of one thing (L. Kish, Survey Sampling, 1965). The best
    of many scores is high of anything."""
    k = len(scores)
    told = float(_logits(scores).mean()) * k / (1.0 + (k - 1) * correlation)
    low, high = _logits(np.array(limits.BOX_LIMITS))
    return float(np.clip(told, low, high))


def _correlation(scores: Sequence[FloatArray]) -> float:
    """How alike the log odds of one thing's boxes are, of all their variance (intraclass
    correlation, by analysis of variance); 1 where too few things tell."""
    if len(scores) < 2:
        return 1.0
    parts = [_logits(part) for part in scores]
    n = np.array([len(part) for part in parts])
    within = float(sum(part.var(ddof=1) for part in parts)) / len(parts)
    between = float(np.var([part.mean() for part in parts], ddof=1)) - within * float(
        np.mean(1.0 / n)
    )
    share = between / (between + within) if within > 0.0 else 1.0
    return float(np.clip(share, limits.SCORE_CORRELATION, 1.0))


def _found_rate(patterns: Sequence[Pattern]) -> float:
    """Share of the frames that should show signs, between the first and the last that does, that
    do; neither of these counts, which are why the others do."""
    seen = possible = 0
    for pattern in patterns:
        first, last = np.flatnonzero(pattern.seen)[[0, -1]].tolist()
        due = pattern.due[first + 1 : last]
        seen += int(pattern.seen[first + 1 : last][due].sum())
        possible += int(due.sum())
    return float(np.clip(seen / possible if possible else 0.5, *limits.RATE_LIMITS))


def thing_nats(seen: BoolArray) -> float:
    """Log of how often a thing that is no sign is ``seen`` [k] so, against one false box a frame:
    the integral of q^h (1 - q)^m / q over the rate q."""
    hits = int(seen.sum())
    return float(betaln(hits, len(seen) - hits + 1))


def pattern_nats(patterns: Sequence[Pattern], rate: float) -> FloatArray:
    """Log likelihood [m] of what was seen of signs in a drive that finds signs at a ``rate``."""
    first = np.concatenate([[0], np.cumsum([len(p.seen) for p in patterns], dtype=np.int64)])
    seen = np.concatenate([np.zeros(0, np.bool_), *(p.seen for p in patterns)])
    step = np.concatenate([np.zeros(0), *(np.diff(p.t_s, prepend=p.t_s[:1]) for p in patterns)])
    without = np.where(seen, limits.STRAY_FRAME, 1.0 - limits.STRAY_FRAME)
    anew = -np.expm1(-step / limits.HIDDEN_S)
    moves = anew * limits.HIDDEN, anew * (1.0 - limits.HIDDEN)
    start = 1.0 - limits.HIDDEN, limits.HIDDEN
    looks = Looks(first, seen, np.ones(len(seen)), without, *moves, start)
    return sign_nats(looks, limits.RATE_SPREAD * rate, limits.RATE_SPREAD * (1.0 - rate))[0]
