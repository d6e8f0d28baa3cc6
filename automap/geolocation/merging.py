"""One sign seen in several passes: which sightings show the backs of others, and their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.geolocation import limits
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.mapping.backs import are_two_sides
from automap.records import FloatArray, IntArray
from automap.signs.backs import fronts_of_backs


def _common_covariance(a: Sighting, b: Sighting, path: float) -> FloatArray:
    """Covariance [3, 3] of one sighting's error with another's: of the trajectory's, which is
    correlated by ``path``, and of the camera's."""
    both = np.diag(path * a.path_sd * b.path_sd)
    if a.camera == b.camera:
        both = both + a.camera_effect @ a.camera_cov @ b.camera_effect.T
    return both


def _alike(a: Sighting, b: Sighting) -> float:
    """Correlation of the trajectory's errors in two passes: of what lasts and of what wanders."""
    wander = float(np.exp(-abs(a.time_s - b.time_s) / limits.PATH_CORRELATION_S))
    return limits.LASTING_ERROR + (1.0 - limits.LASTING_ERROR) * wander


def difference_covariance(a: Sighting, b: Sighting) -> FloatArray:
    """Covariance [3, 3] of the difference of two sightings' positions."""
    both = _common_covariance(a, b, _alike(a, b))
    return np.asarray(a.covariance + b.covariance - both - both.T)


def find_backs(
    views: Views, sightings: Sequence[Sighting], groups: Sequence[Sequence[int]]
) -> IntArray:
    """Of which other group each of the groups [m] of sightings is the back, as ``fronts_of_backs``
    tells: a back is in none of the frames of the face, for a camera sees one side."""
    seen = [sightings[k] for group in groups for k in group]
    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])

    def apart(a: int, b: int) -> float:
        back, front = seen[a], seen[b]
        if np.isin(views.frame[back.landmark.rows], views.frame[front.landmark.rows]).any():
            return np.inf
        difference, cosine = back.position - front.position, float(back.facing @ front.facing)
        two_sides = are_two_sides(difference, difference_covariance(back, front), cosine)
        return float(np.linalg.norm(difference)) if two_sides else np.inf

    place = np.array([sighting.position for sighting in seen]).reshape(-1, 3)
    names = [sighting.class_name for sighting in seen]
    return fronts_of_backs(names, owner, place, limits.BACK_REACH_M, apart)


def combine(sightings: Sequence[Sighting], adjusted: bool = False) -> tuple[FloatArray, FloatArray]:
    """Mean position [3] of one sign's sightings and its total covariance [3, 3].

    Weights are the inverse covariances. The trajectory's error is correlated between passes
    that follow one another closely, the camera's effect between all passes of one camera:
    and what size the sign was taken for is one error of all passes: none of these is averaged down
    as if it were new. After an adjustment of the trajectory by these
    very passes (``adjusted``) what remains of its error is common to them.
    """
    shares = shares_of(sightings)
    mean = np.sum([share @ s.position for share, s in zip(shares, sightings, strict=True)], axis=0)
    covariance = np.zeros((3, 3))
    for share_a, a in zip(shares, sightings, strict=True):
        alone = a.own_cov + a.pass_cov - np.outer(a.size_effect, a.size_effect)
        covariance += share_a @ alone @ share_a.T
        for share_b, b in zip(shares, sightings, strict=True):
            both = _common_covariance(a, b, 1.0 if adjusted else _alike(a, b))
            covariance += share_a @ both @ share_b.T
    by_size = size_effect(sightings)
    covariance += np.outer(by_size, by_size)
    return mean, 0.5 * (covariance + covariance.T)


def shares_of(sightings: Sequence[Sighting]) -> list[FloatArray]:
    """The part [3, 3] that each of one sign's sightings has in their mean."""
    weights = [np.linalg.inv(s.covariance + 1e-6 * np.eye(3)) for s in sightings]
    inverse = np.linalg.inv(np.sum(weights, axis=0))
    return [inverse @ weight for weight in weights]


def size_effect(sightings: Sequence[Sighting]) -> FloatArray:
    """How far a sigma of the size that a sign was taken for moves its mean position [3], m."""
    shares = shares_of(sightings)
    moved = [share @ s.size_effect for share, s in zip(shares, sightings, strict=True)]
    return np.asarray(np.sum(moved, axis=0))
