"""Backs of signs: a grey face where a sign stands that faces the other way is no new sign.

A detector that takes the back of a sign for a sign finds no colours on it, and names it by a class
of its own ("...--back") or after a colourless shape. From the other side, in another pass, the same
sign shows its face.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.merging import difference_covariance
from automap.geolocation.sightings import Sighting
from automap.geolocation.views import Views
from automap.signs.backs import is_back, may_be_back


def find_backs(
    views: Views, sightings: Sequence[Sighting], groups: Sequence[Sequence[int]]
) -> dict[int, int | None]:
    """Which groups of sightings are backs of signs, and of which other group (None: of none that
    was seen from in front).

    One whose class is that of backs always is; one without a readable face is where a sign with
    one stands, faces the other way, and is in none of its frames (a camera sees one side).
    """
    from scipy.spatial import cKDTree

    maybe = [all(may_be_back(sightings[k].class_name) for k in group) for group in groups]
    backs: dict[int, int | None] = {
        number: None
        for number, group in enumerate(groups)
        if all(is_back(sightings[k].class_name) for k in group)
    }
    fronts = [
        (b, number)
        for number, (group, back) in enumerate(zip(groups, maybe, strict=True))
        if not back
        for b in group
    ]
    if not fronts or not any(maybe):
        return backs
    tree = cKDTree(np.array([sightings[b].position for b, _ in fronts]))
    for number in np.flatnonzero(maybe).tolist():
        for a in groups[number]:
            # a little more than the reach, which the pair itself is held to
            near = tree.query_ball_point(sightings[a].position, 1.01 * limits.BACK_REACH_M)
            own = [k for k in near if _is_other_side(views, sightings[a], sightings[fronts[k][0]])]
            if own:
                place = sightings[a].position
                distance = [np.linalg.norm(sightings[fronts[k][0]].position - place) for k in own]
                backs[number] = fronts[own[int(np.argmin(distance))]][1]
                break
    return backs


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
