"""What neighbouring signs of a map are off in common against a list, taken off each of them.

A path's errors wander over minutes, so signs that a drive passed one after another are off by
nearly the same. What the others about a sign are off tells its own part of that: a Gaussian
process over the places of signs (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for
Machine Learning, 2006), smooth as a path is whose velocity has no steps (Matern 3/2). How much of
the errors is in common, and how far it reaches, is what predicts each sign best from the others
(their section 5.4.2); that nothing is in common is among what is tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from automap.earth import ecef
from automap.records import FloatArray, IntArray, Sign
from automap.records.sign_lists import numbers_of

SHARES = (0.3, 0.5, 0.7, 0.85, 0.95)
"""Of the variance of pairs in place that neighbours may have in common; 0 is tried besides."""
REACHES_M = (15.0, 30.0, 60.0, 120.0, 240.0, 480.0)
"""A GPS error wanders for some ten to a hundred seconds; at 10 m/s and of a half of it."""
_NEIGHBOURS = 16
"""That tell a sign's part; further ones are screened by these."""
_MOST_TRIED = 1000
"""Signs by which share and reach are told: that many tell them to some percent."""
_FREEDOM = 4.0
"""Of Student's t; the usual choice for errors with outliers (K. L. Lange and others, Journal of the
American Statistical Association 84, 1989)."""
_TAILS = 0.5 * (_FREEDOM + 2.0)
_EXCLUDED = 1e9
"""A variance in m^2 that tells nothing."""
_AT_ONCE = 4096
"""Pairs: some 50 MB."""


@dataclass(frozen=True)
class Anchors:
    """Pairs [n] that are one sign in place: the map's ``sign`` and the ``listed`` one, their
    ``residual`` [n, 2] in m and its ``variance`` [n] per axis, in m^2."""

    sign: IntArray
    listed: IntArray
    residual: FloatArray
    variance: FloatArray


def common_errors(
    signs: Sequence[Sign], anchors: Anchors, sign: IntArray, listed: IntArray
) -> tuple[FloatArray, FloatArray]:
    """What each pair [k] of ``sign`` and ``listed`` is off in common with others, [k, 2] in m, and
    the variance of that per axis; the pair's own sign and listed one do not count."""
    none = np.zeros((len(sign), 2)), np.zeros(len(sign))
    n = len(anchors.sign)
    if n < 2 or not len(sign):
        return none
    lat, lon, facing = numbers_of(signs, "lat_rad", "lon_rad", "facing_rad")
    place = ecef(lat, lon, np.zeros(len(signs)))
    # a direction that is not known agrees half with each
    look = np.where(np.isfinite(facing), np.exp(1j * np.nan_to_num(facing)), 0.0)
    level = float(np.mean(anchors.variance))
    tried = np.unique(np.linspace(0, n - 1, min(n, _MOST_TRIED)).astype(np.int64))
    around = _around(place, anchors, anchors.sign[tried], anchors.listed[tried])
    best, chosen = np.inf, None
    for share in (0.0, *SHARES):
        for reach in REACHES_M if share else REACHES_M[:1]:
            mean, variance = _predicted(
                place, look, anchors, anchors.sign[tried], around, share, reach, level
            )
            variance += (1.0 - share) * anchors.variance[tried]
            square = ((anchors.residual[tried] - mean) ** 2).sum(axis=1)
            # Student's t in a plane: some pairs are none
            loss = float(
                (np.log(variance) + _TAILS * np.log1p(square / (_FREEDOM * variance))).sum()
            )
            if loss < best:
                best, chosen = loss, (share, reach)
    if chosen is None or chosen[0] == 0.0:
        return none
    parts = []
    for start in range(0, len(sign), _AT_ONCE):
        one = slice(start, start + _AT_ONCE)
        around = _around(place, anchors, sign[one], listed[one])
        parts.append(_predicted(place, look, anchors, sign[one], around, *chosen, level))
    mean, variance = (np.concatenate([part[k] for part in parts]) for k in range(2))
    return mean, variance


def _around(
    place: FloatArray, anchors: Anchors, sign: IntArray, listed: IntArray
) -> tuple[IntArray, FloatArray]:
    """The anchors [k, m] nearest to each ``sign``, and noise that those of the pair itself get."""
    m = min(_NEIGHBOURS + 2, len(anchors.sign))
    tree = cKDTree(place[anchors.sign])
    near = tree.query(place[sign], m)[1].reshape(len(sign), m)
    own = anchors.sign[near] == sign[:, None]
    own |= anchors.listed[near] == listed[:, None]
    return near, np.where(own, _EXCLUDED, 0.0)


def _predicted(
    place: FloatArray,
    look: FloatArray,
    anchors: Anchors,
    sign: IntArray,
    around: tuple[IntArray, FloatArray],
    share: float,
    reach_m: float,
    level: float,
) -> tuple[FloatArray, FloatArray]:
    """Mean [k, 2] and variance [k] of the common part at each ``sign``."""
    near, noise = around
    there = anchors.sign[near]
    among = _alike(place[there][:, :, None], place[there][:, None], reach_m)
    # passes that look the other way have other errors
    among *= 0.5 + 0.5 * np.real(look[there][:, :, None] * np.conj(look[there])[:, None])
    own = np.arange(near.shape[1])
    among[:, own, own] = 1.0
    among *= share * level
    among[:, own, own] += (1.0 - share) * anchors.variance[near] + noise
    towards = _alike(place[there], place[sign][:, None], reach_m)
    towards *= 0.5 + 0.5 * np.real(look[there] * np.conj(look[sign])[:, None])
    towards *= share * level
    weight = np.linalg.solve(among, towards[:, :, None])[:, :, 0]
    mean = np.einsum("km,kmi->ki", weight, anchors.residual[near])
    left = share * level - np.einsum("km,km->k", weight, towards)
    return mean, np.maximum(left, 0.0)


def _alike(a: FloatArray, b: FloatArray, reach_m: float) -> FloatArray:
    """Correlation of the errors at places, by how far they lie apart."""
    far = np.sqrt(3.0) * np.linalg.norm(a - b, axis=-1) / reach_m
    return np.asarray((1.0 + far) * np.exp(-far))
