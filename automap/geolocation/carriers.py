"""Signs that move along: on the back of a lorry ahead, on a bus or a trailer.

A thing that keeps its place in front of the camera while that goes on, or comes near by a small
part of the way, fits no place on the road: it would have to stand far off, be as large as a house,
and jump in every bend. Both are fitted to all boxes of a detector's track; where the carrier is
more probable by far, the track shows no sign of the road. What comes towards the camera looks like
a small sign that is near, and what is overtaken like a large one that is farther off: signs differ
by as much in size, so that these are not told.
"""

from __future__ import annotations

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.landmark import (
    SizePrior,
    fit_landmark,
    relative_views,
)
from automap.geolocation.landmark_kernels import solve_landmark
from automap.geolocation.view_errors import view_drift, view_sd
from automap.geolocation.views import Views, numbered_tracks
from automap.records import BoolArray, IntArray


def carried_views(views: Views, prior: SizePrior) -> BoolArray:
    """Which views [n] belong to a track that moves along; none of those without a track."""
    carried = np.zeros(len(views), np.bool_)
    for rows in numbered_tracks(views):
        carried[rows] = len(rows) >= limits.CARRIER_VIEWS and moves_along(views, rows, prior)
    return carried


def moves_along(views: Views, rows: IntArray, prior: SizePrior) -> bool:
    """Whether a thing of a sign's size that goes about as fast as the camera explains the boxes
    ``rows`` of one track far better than one that stands does."""
    standing = fit_landmark(views, rows, prior)
    anchor = standing.anchor
    _, b = relative_views(views, rows, anchor)
    # it turns with the road, and so with the camera
    ahead = np.ascontiguousarray(np.broadcast_to(np.eye(3), (len(rows), 3, 3)))
    measured, sd = views.measured[rows], view_sd(views, rows)
    drift = view_drift(views, rows, anchor)
    prior = prior.of(views.class_name[rows].tolist())
    usual = float(np.log(prior.size_m))
    first = np.array([*measured[rows == anchor][0, :2], 0.0, usual])
    first[2] = usual - views.measured[anchor, 2]
    moving = min(
        float(
            solve_landmark(first, ahead, part * b, measured, sd, drift, usual, prior.log_sd, True)[
                1
            ]
        )
        for part in limits.CARRIER_CLOSING
    )
    # where sigmas were too small both cost too much
    scale = max(1.0, moving / standing.dof)
    return bool(standing.cost - moving > gate(limits.CARRIER_PROBABILITY, 1) * scale)
