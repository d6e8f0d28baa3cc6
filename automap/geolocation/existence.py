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

import numpy as np
from scipy.special import betaln, logit

from automap.geolocation import limits
from automap.geolocation.due_frames import Pattern
from automap.mapping.looks import Looks, mean_odds, probability, share_of, sign_nats
from automap.records import BoolArray, FloatArray

_ROUNDS = 20
"""Of the expectation maximisation."""


def existence_of(passes: Sequence[Sequence[float]]) -> float:
    """Probability of a sign by its passes, each with the odds that it is one against boxes that
    meet by chance, and against what stands there and is none: that every pass is chance is the less
    likely the more there are, but what looks like a sign does so in all of them."""
    by_chance, alike = np.array(passes).T
    together = np.expm1(min(float(np.log1p(by_chance).sum()), 700.0))
    odds = float(mean_odds(alike, np.zeros(len(alike), np.int64), 1)[0])
    return float(1.0 / (1.0 + 1.0 / together + 1.0 / odds))


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
