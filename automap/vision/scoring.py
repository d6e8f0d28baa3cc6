"""One probability of a sign from what the networks say of a place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from automap.records import FloatArray
from automap.vision import limits
from automap.vision.boxes import areas, shared_areas
from automap.vision.classifier import Named


def supported(boxes: FloatArray, scores: FloatArray, copies: FloatArray) -> FloatArray:
    """Scores [n] of boxes [n, 4] found in several copies of a picture.

    ``copies`` [n, 2]: the number of the copy that shows a box, and the box's longest side in it,
    px. A box of a reduced copy that another copy shows too gains part of the log-odds that this one
    tells over those of a place that one copy alone takes for a sign.
    """
    if len(boxes) < 2:
        return scores
    area, common = areas(boxes), shared_areas(boxes, boxes)
    same = common > limits.SUPPORT_OVERLAP * (area[:, None] + area - common)
    same &= copies[:, None, 0] != copies[None, :, 0]
    same &= (copies[:, 1] >= limits.LEAST_SUPPORT_PX) | (copies[:, 0] == 0)
    other = np.where(same, scores, 0.0).max(axis=1)
    # two looks add what the worse of them tells to what the better does
    second = np.minimum(other, scores)
    gain = np.maximum(_log_odds(second) - _log_odds(np.array(limits.ALONE)), 0.0)
    gain[(other == 0.0) | (copies[:, 0] == 0)] = 0.0
    return np.asarray(1.0 / (1.0 + np.exp(-_log_odds(scores) - limits.SUPPORT * gain)))


def _log_odds(p: FloatArray) -> FloatArray:
    p = np.clip(p, limits.SURE, 1.0 - limits.SURE)
    return np.asarray(np.log(p / (1.0 - p)))


def sign_score(
    found: float, face: Named, legible: bool, odds: float, weights: Sequence[float]
) -> float:
    """The probability of a sign where the detector says ``found`` and the classifier ``face``.

    A ``legible`` face, large enough to be read, that is a plain rectangle is mostly the front of a
    house, a window or a shop's board. ``odds`` as of ``doubted``.
    """
    score = joint_score(found, face.sign, weights)
    if legible:
        score *= 1.0 - face.board
    return doubted(score, face.known, odds)


def joint_score(found: float, sign: float, weights: Sequence[float]) -> float:
    """One probability of a sign from what the detector and the classifier say.

    Their log-odds are added with ``weights`` after a bias, which were fitted to street images
    that neither was trained on.
    """
    odds = [
        math.log(p / (1.0 - p))
        for p in (min(max(v, limits.SURE), 1 - limits.SURE) for v in (found, sign))
    ]
    total = weights[0] + weights[1] * odds[0] + weights[2] * odds[1]
    return 1.0 / (1.0 + math.exp(-total))


def least_found(score: float, weights: Sequence[float]) -> float:
    """What the detector must say of a place so that some face brings it to ``score``."""
    wanted, surest = _log_odds(np.array([score, 1.0])).tolist()
    log_odds = (wanted - weights[0] - weights[2] * surest) / weights[1]
    return 1.0 / (1.0 + math.exp(-log_odds))


def doubted(score: float, known: float, odds: float) -> float:
    """The probability of a sign whose face is one of the classes with ``known`` only.

    Wheels, lamps and shop boards look like signs to both networks, but seldom like one sign.
    ``odds`` of the country are how many signs of the classes there are for one of none: the
    fewer, the more such faces are signs. Never more than ``score``, and not less than even odds.
    """
    score = min(max(score, limits.SURE), 1.0 - limits.SURE)
    over = math.log(score / (1.0 - score))
    if over <= 0.0:
        return score
    unknown = 1.0 - known
    less = limits.UNKNOWN_DOUBT * over - math.log(limits.ODDS_AT_HOME / odds)
    return 1.0 / (1.0 + math.exp(-over + unknown * max(less, 0.0)))
