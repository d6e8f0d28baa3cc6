"""Which groups of a drive's sightings are backs of signs that its other passes saw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.merging import difference_covariance
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.records import IntArray
from automap.signs.backs import fronts_of_backs


def find_backs(
    views: Views, sightings: Sequence[Sighting], groups: Sequence[Sequence[int]]
) -> IntArray:
    """Of which other group each of the groups [m] of sightings is the back, as ``fronts_of_backs``
    tells: a back is in none of the frames of the face, for a camera sees one side."""
    seen = [sightings[k] for group in groups for k in group]
    owner = np.repeat(np.arange(len(groups)), [len(group) for group in groups])

    def apart(a: int, b: int) -> float:
        if not _is_other_side(views, seen[a], seen[b]):
            return np.inf
        return float(np.linalg.norm(seen[a].position - seen[b].position))

    place = np.array([sighting.position for sighting in seen]).reshape(-1, 3)
    names = [sighting.class_name for sighting in seen]
    # a little more than the reach, which the pair itself is held to
    return fronts_of_backs(names, owner, place, 1.01 * limits.BACK_REACH_M, apart)


def _is_other_side(views: Views, back: Sighting, front: Sighting) -> bool:
    difference = back.position - front.position
    if float(np.linalg.norm(difference)) > limits.BACK_REACH_M:
        return False
    if float(back.facing @ front.facing) > limits.AWAY_COSINE:
        return False
    if np.isin(views.frame[back.landmark.rows], views.frame[front.landmark.rows]).any():
        return False
    slack = np.diag([limits.THICKNESS_M**2, limits.THICKNESS_M**2, limits.HEIGHT_SLACK_M**2])
    covariance = difference_covariance(back, front) + slack
    return float(difference @ np.linalg.solve(covariance, difference)) < gate(
        limits.BACK_PROBABILITY, 3
    )
