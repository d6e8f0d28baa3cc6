"""One sign seen in several passes: which sightings belong together, which show the backs of others,
and their mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import pdtr

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
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


def _link_cost(a: Sighting, b: Sighting) -> float:
    """Squared distance in sigmas, with what a different class costs; infinite when impossible."""
    difference = a.position - b.position
    if float(a.facing @ b.facing) < limits.LEAST_FACING_COSINE:
        return np.inf  # the other face of a sign is another sign
    # positions of one place agree to no better than the extent of the sign; heights of a
    # trajectory drift between passes, and no two signs of a class hang one above the other
    covariance = difference_covariance(a, b) + np.diag(
        [limits.FACE_SD_M**2, limits.FACE_SD_M**2, limits.HEIGHT_SLACK_M**2]
    )
    cost = float(difference @ np.linalg.solve(covariance, difference))
    return cost + limits.MERGE_OTHER_CLASS * (a.class_name != b.class_name)


def group_sightings(views: Views, sightings: Sequence[Sighting]) -> list[list[int]]:
    """Indices of the sightings of each sign, in the order of first sight.

    Sightings that share frames as two signs would are different signs, and so are any two of their
    groups; the closest pair is joined first, until none is left within the gate.
    """
    groups = {k: [k] for k in range(len(sightings))}
    if len(sightings) > 1:
        tree = cKDTree(np.array([s.position for s in sightings]))
        near = tree.query_pairs(limits.MERGE_REACH_M, output_type="ndarray")
        frames = [np.unique(views.frame[s.landmark.rows]) for s in sightings]
        limit = gate(limits.APART_PROBABILITY, 3)
        costs = sorted(
            (cost, int(i), int(j))
            for i, j in near
            if (cost := _link_cost(sightings[i], sightings[j])) < limit
        )
        owner = list(range(len(sightings)))
        for _, i, j in costs:
            a, b = owner[i], owner[j]
            if a == b or seen_beside(frames[a], frames[b]):
                continue
            # every member must agree with every other, else chains of signs would collapse
            if any(
                not _link_cost(sightings[m], sightings[n]) < limit
                for m in groups[a]
                for n in groups[b]
            ):
                continue
            groups[a] += groups.pop(b)
            frames[a] = np.union1d(frames[a], frames[b])
            for member in groups[a]:
                owner[member] = a
    first = {k: min(int(sightings[m].landmark.rows[0]) for m in g) for k, g in groups.items()}
    return [sorted(groups[k]) for k in sorted(groups, key=first.__getitem__)]


def seen_beside(a: IntArray, b: IntArray) -> bool:
    """Whether two sightings, each in its frames [n] in order, share frames as two signs would.

    Two signs that are found by themselves are together in ``n_a n_b / n`` of the n frames in which
    both are in view. Two tracks that take turns with the boxes of one sign are together only where
    it had two boxes.
    """
    together = len(np.intersect1d(a, b, assume_unique=True))
    if not together:
        return False
    low, high = max(a[0], b[0]), min(a[-1], b[-1])
    n_a, n_b = (np.count_nonzero((each >= low) & (each <= high)) for each in (a, b))
    # Poisson's is wider than the hypergeometric distribution that this is
    return bool(pdtr(together, n_a * n_b / float(high - low + 1)) >= limits.APART_PROBABILITY)


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


def are_two_sides(difference: FloatArray, covariance: FloatArray, cosine: float) -> bool:
    """Whether two faces may be face and back of one sign, by the ``difference`` [a] of their
    places, in plan or with the height, m, its covariance [a, a], and the cosine between them."""
    slack = [limits.THICKNESS_M, limits.THICKNESS_M, limits.HEIGHT_SLACK_M][: len(difference)]
    square = difference @ np.linalg.solve(covariance + np.diag(slack) ** 2, difference)
    return bool(cosine < limits.AWAY_COSINE and square < gate(limits.BACK_PROBABILITY, len(slack)))


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
