"""Backs of signs: a grey face where a sign stands that faces the other way is no new sign.

A detector that takes the back of a sign for a sign finds no colours on it, and names it by a class
of its own ("...--back") or after a colourless shape. From the other side, in another pass or by
another drive, the same sign shows its face.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from automap.records import FloatArray, IntArray
from automap.signs.vocabulary import load_vocabulary

COLOURLESS = ("white-square", "white-diamond", "white-circle", "black-square", "other")
"""Groups of shape and colour that a back may be taken for."""


def is_back(class_name: str) -> bool:
    """Whether a class is that of backs and of nothing else."""
    return class_name.lower().replace("_", "-").split("-")[-1] in ("back", "backside")


def may_be_back(class_name: str) -> bool:
    """Whether a detector gives such a class to a back: its own, or a face without colours that
    could not be read."""
    groups = load_vocabulary().groups
    return is_back(class_name) or class_name in {groups[g] for g in COLOURLESS if g in groups}


NO_BACK, BACK_OF_NONE = -1, -2


def fronts_of_backs(
    names: Sequence[str],
    place: FloatArray,
    reach_m: float,
    apart: Callable[[int, int], float],
) -> IntArray:
    """Of which sign each of the signs [n] of class ``names`` [n] at ``place`` [n, 2] m is the back:
    ``NO_BACK``, ``BACK_OF_NONE`` where nobody saw the front.

    One whose class is that of backs is one; so is one without a readable face where a sign
    with one stands within ``reach_m``: ``apart(a, b)`` tells of two how far they are
    apart, infinitely where the first cannot be the back of the second's face. The nearest is it.
    """
    from scipy.spatial import cKDTree

    # a map has very many signs of few classes
    kinds = {name: (is_back(name), may_be_back(name)) for name in dict.fromkeys(names)}
    always, maybe = np.array([kinds[name] for name in names], np.bool_).reshape(-1, 2).T
    result = np.where(always, BACK_OF_NONE, NO_BACK).astype(np.int64)
    fronts, unsure = np.flatnonzero(~maybe), np.flatnonzero(maybe)
    if len(fronts) and len(unsure):
        near = cKDTree(place[fronts]).query_ball_point(place[unsure], reach_m)
        for a, found in zip(unsure.tolist(), near, strict=True):
            distance, nearest = min(((apart(a, b), b) for b in fronts[found]), default=(np.inf, -1))
            if distance < np.inf:
                result[a] = nearest
    return result
