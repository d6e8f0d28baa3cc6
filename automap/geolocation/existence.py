"""Whether what boxes show is a sign: seen, and not seen when it should have been.

There are three things that it may be. A sign is found in most frames that should show it, each
sign at a rate of its own about that of the drive, unless something hides it for a while: frames in
a row without it speak together (a hidden Markov model of two states). Single false boxes fit one
place by chance, the less likely the more of them there are. And a thing that stays (a lamp, an
advert) is taken for a sign now and then: of false boxes each rate at which a thing is found is as
likely, so that of things that are found at a rate q there are 1 / q as many. Bayes' rule with these
gives the probability of a sign (existence in the sense of Musicki and Evans, Joint Integrated
Probabilistic Data Association, IEEE T-AES 40, 2004).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from scipy.special import betaln, logit

from automap.geolocation import limits
from automap.geolocation.due_frames import (
    Pattern,
    in_motion_s,
    pattern_of,
    searched_frames,
    usual_heights,
)
from automap.geolocation.landmark import Landmark
from automap.geolocation.views import Views
from automap.jit import kernel
from automap.records import BoolArray, Camera, Detections, FloatArray, Trajectory

_BASE_RATE_ROUNDS = 20
"""Of the expectation maximisation."""
_NODES = 32
"""Of the quadrature over rates: a car that waits in sight of a sign finds it in thousands of
frames, of which nodes that are exact for few say nothing."""


def existence_probabilities(
    views: Views,
    landmarks: Sequence[Landmark],
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
) -> tuple[FloatArray, FloatArray]:
    """Probabilities [m] that the boxes of each landmark show one thing that stands there, and that
    such a thing is a sign.

    ``cameras`` are as they were found to be. The detector's rate of finding a sign, and from which
    height on, is taken from the landmarks with many views, the share of signs among things seen
    once from all of these.
    """
    searched = {d.camera: searched_frames(d, cameras[d.camera], assumed=True) for d in detections}
    frame = np.concatenate([d.frame for d in detections] or [np.zeros(0, np.int64)])[views.row]
    often = [mark for mark in landmarks if len(mark.rows) >= limits.RATE_VIEWS]
    usual = usual_heights(views, often or landmarks)
    moved = in_motion_s(trajectory)
    patterns = [
        pattern_of(views, mark, frame, trajectory, searched, cameras, usual, moved)
        for mark in landmarks
    ]
    rate = _found_rate([p for p in patterns if p.seen.sum() >= limits.RATE_VIEWS])
    correlation = _correlation([views.score[mark.rows] for mark in often])
    there, alike = np.zeros(len(landmarks)), np.zeros(len(landmarks))
    for k, (mark, pattern) in enumerate(zip(landmarks, patterns, strict=True)):
        scores = views.score[mark.rows]
        as_sign, as_thing = sign_nats(pattern, rate), thing_nats(pattern.seen)
        further = limits.FITTING_BOX_NATS * (len(mark.rows) - 1)
        there[k] = _log_odds(float(scores.max()), limits.SCORE_LIMITS) + further + as_sign
        alike[k] = math.log(limits.STANDING) - _by_scores(scores, correlation)
        alike[k] += as_thing - as_sign
    single = np.array([len(mark.rows) == 1 for mark in landmarks], np.bool_)
    there[single] += _base_rate(there[single])
    stands = probability(there)
    return stands, probability(-alike - _things_rate(stands, alike))


def probability(log_odds: FloatArray) -> FloatArray:
    """Probabilities [n] that have these log odds."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))


def _log_odds(score: float, within: tuple[float, float]) -> float:
    score = float(np.clip(score, *within))
    return math.log(score / (1.0 - score))


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


def _base_rate(log_odds: FloatArray) -> float:
    """Shift of the log odds [n] of things seen once, by how many such things are signs.

    Where most single boxes of a drive were clearly not confirmed, the others, seen at the edge
    of the picture or last before a gap, are hardly signs either: the share of signs among them
    is found from their own odds (expectation maximisation), held at one half by a few
    imaginary ones.
    """
    share = 0.5
    for _ in range(_BASE_RATE_ROUNDS):
        shift = np.log(share / (1.0 - share))
        likely = float(probability(log_odds + shift).sum())
        share = (0.5 * limits.IMAGINARY + likely) / (limits.IMAGINARY + len(log_odds))
    return float(np.log(share / (1.0 - share)))


def _things_rate(stands: FloatArray, log_odds: FloatArray) -> float:
    """Logarithm of how many things that look like signs there are, against what is expected of
    any street: by those of the landmarks that ``stands`` [n] and ``log_odds`` [n] of being no sign
    tell (expectation maximisation), with a gamma prior that counts as one such thing.
    """
    rate = 1.0
    for _ in range(_BASE_RATE_ROUNDS):
        things = probability(log_odds + math.log(rate))
        expected = limits.THINGS_A_SIGN * float(stands @ (1.0 - things))
        rate = (1.0 + float(stands @ things)) / (1.0 + expected)
    return math.log(rate)


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


def sign_nats(pattern: Pattern, rate: float) -> float:
    """Log likelihood of what was seen of a sign in a drive that finds signs at a ``rate``."""
    rates, weights = _rates(rate)
    told = _pattern_nats(
        pattern.t_s, pattern.seen, rates, limits.HIDDEN, limits.HIDDEN_S, limits.STRAY_FRAME
    )
    return float(np.logaddexp.reduce(told + np.log(weights)))


@lru_cache(maxsize=64)
def _rates(rate: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights [n] of the beta distribution of signs' own rates about ``rate``: even in
    the power of the rate of misses that has a finite density at none."""
    a, b = limits.RATE_SPREAD * rate, limits.RATE_SPREAD * (1.0 - rate)
    x, weight = np.polynomial.legendre.leggauss(_NODES)
    power = min(b, 1.0)
    missed = (0.5 * (1.0 + x)) ** (1.0 / power)
    weight = weight * missed ** (b - power) * (1.0 - missed) ** (a - 1.0)
    return 1.0 - missed, weight / weight.sum()


@kernel
def _pattern_nats(
    t_s: FloatArray,
    seen: BoolArray,
    rates: FloatArray,
    hidden: float,
    hidden_s: float,
    stray: float,
) -> FloatArray:
    """Log likelihood [r] of what was ``seen`` at ``t_s`` [k] of a sign that is found at each of
    the ``rates`` [r] where nothing hides it, and in a share ``stray`` of frames where something
    does; that hides it ``hidden`` of the time, for ``hidden_s`` as a rule (forward algorithm)."""
    told = np.zeros(len(rates))
    for node in range(len(rates)):
        open_, behind = 1.0 - hidden, hidden
        for k in range(len(t_s)):
            if k > 0:
                stay = math.exp(-(t_s[k] - t_s[k - 1]) * (1.0 / hidden_s))
                both = (1.0 - stay) * (open_ + behind)
                open_ = stay * open_ + both * (1.0 - hidden)
                behind = stay * behind + both * hidden
            if seen[k]:
                open_ *= rates[node]
                behind *= stray
            else:
                open_ *= 1.0 - rates[node]
                behind *= 1.0 - stray
            total = open_ + behind
            told[node] += math.log(total)
            open_, behind = open_ / total, behind / total
    return told
