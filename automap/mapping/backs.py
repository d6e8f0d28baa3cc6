"""Signs that are the backs of others, which passes or drives the other way saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from automap.gates import gate
from automap.mapping import limits
from automap.records import FloatArray, IntArray
from automap.signs.backs import fronts_of_backs


def with_backs(n_back_views: IntArray, n_views: IntArray, fronts: IntArray) -> IntArray:
    """Views [n] of the backs of signs, with those of the signs that are the backs of others."""
    total = np.array(n_back_views, np.int64)
    rows = np.flatnonzero(fronts >= 0)
    np.add.at(total, fronts[rows], np.asarray(n_views, np.int64)[rows])
    return total


def backs(
    names: Sequence[str],
    place: FloatArray,
    covariance: FloatArray,
    facing: FloatArray,
    beside: Callable[[int, int], bool] = lambda a, b: False,
) -> IntArray:
    """Of which of the signs [n] each is the back, as ``fronts_of_backs`` tells: of class ``names``
    at ``place`` [n, 2] m of ``covariance`` [n, 2, 2], facing rad. None that was seen ``beside``
    another is the back of that."""

    def apart(a: int, b: int) -> float:
        offset, total = place[a] - place[b], covariance[a] + covariance[b]
        square = offset @ np.linalg.solve(total + limits.THICKNESS_M**2 * np.eye(2), offset)
        away = np.cos(facing[a] - facing[b]) < limits.AWAY_COSINE
        two_sides = away and square < gate(limits.BACK_PROBABILITY, 2) and not beside(a, b)
        return float(np.hypot(*offset)) if two_sides else np.inf

    return fronts_of_backs(names, place, limits.BACK_REACH_M, apart)
