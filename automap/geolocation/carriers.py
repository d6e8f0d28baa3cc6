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
from automap.geolocation.landmark import SizePrior, boxes_of, fit_landmark
from automap.geolocation.landmark_kernels import solve_landmark
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
    boxes = boxes_of(views, rows, standing.anchor, prior)
    # it turns with the road, and so with the camera
    boxes = boxes._replace(M=np.ascontiguousarray(np.broadcast_to(np.eye(3), boxes.M.shape)))
    right, down, height = views.measured[standing.anchor]
    first = np.array([right, down, boxes.prior_mean - height, boxes.prior_mean])
    moving = min(
        float(solve_landmark(first, boxes._replace(b=part * boxes.b), True)[1])
        for part in limits.CARRIER_CLOSING
    )
    # where sigmas were too small both cost too much
    scale = max(1.0, moving / standing.dof)
    return bool(standing.cost - moving > gate(limits.CARRIER_PROBABILITY, 1) * scale)
