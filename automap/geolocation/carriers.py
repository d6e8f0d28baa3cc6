"""Signs that move along: on the back of a lorry ahead, on a bus or a trailer.

A thing that keeps its place in front of the camera while that goes on, or comes near by a small
part of the way, fits no place on the road: it would have to stand far off, be as large as a house,
and jump in every bend. Both are fitted to all boxes of a detector's track; where the carrier is
more probable by far, the track shows no sign of the road. What comes towards the camera looks like
a small sign that is near, and what is overtaken like a large one that is farther off: signs differ
by as much in size, so that these are not told.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.camera_estimate import first_corrections
from automap.geolocation.fixed_in_picture import driven_m
from automap.geolocation.landmark import SizePrior, boxes_of, fit_landmark
from automap.geolocation.landmark_kernels import solve_landmark
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.view_errors import places_apart
from automap.geolocation.views import Views, build_views, numbered_tracks
from automap.records import BoolArray, Camera, Detections, FloatArray, IntArray, Trajectory
from automap.robust import BY_CAUCHY, BY_HUBER


def carried_views(views: Views, prior: SizePrior) -> BoolArray:
    """Which views [n] belong to a track that moves along; none of those without a track."""
    carried = np.zeros(len(views), np.bool_)
    for rows in numbered_tracks(views):
        carried[rows] = len(rows) >= limits.CARRIER_VIEWS and moves_along(views, rows, prior)
    return carried


def far_carried(
    trajectory: Trajectory, found: Detections, camera: Camera, rules: GeolocationRules
) -> BoolArray:
    """Which boxes [n] of one camera belong to a track that moves along for more than
    ``SEEN_FROM_M`` driven.

    No sign by the road does, so that such boxes say nothing of the camera either. How the camera is
    turned is not known yet: the pairs of all other boxes tell a start of it. A track that
    goes on from one sign to the next lasts for as long; there its box jumps and is smaller, which
    ends it.

    Nor is the focal length of a camera without a calibration. By one that is a tenth off, a sign
    that stands in a bend jumps as what moves along does, so that a track is carried only where it
    is by every focal length that the camera may have.
    """
    far = _far_carried(trajectory, found, camera, rules)
    for scale in _focal_scales(camera):
        if not far.any():
            break
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= scale
        far &= _far_carried(trajectory, found, replace(camera, matrix=matrix), rules)
    return far


def _focal_scales(camera: Camera) -> FloatArray:
    """Focal lengths [k] besides the camera's own, as parts of it, within two sigmas; none of a
    camera that has a calibration."""
    steps = int(np.ceil(2.0 * camera.focal_sd / limits.FOCAL_STEP))
    logs = limits.FOCAL_STEP * np.arange(-steps, steps + 1)
    return np.asarray(np.exp(logs[logs != 0.0]), np.float64)


def _far_carried(
    trajectory: Trajectory, found: Detections, camera: Camera, rules: GeolocationRules
) -> BoolArray:
    """``far_carried`` by the focal length that ``camera`` has."""
    far = np.zeros(len(found), np.bool_)
    if not len(found) or not len(trajectory.t_ns):
        return far
    order = np.lexsort([found.frame, found.track])
    box = np.asarray(found.box, np.float64).reshape(-1, 4)[order]
    sides = np.minimum(box[1:, 2:], box[:-1, 2:]) - np.maximum(box[1:, :2], box[:-1, :2])
    extent = box[:, 3] - box[:, 1]
    apart = ~(sides > 0.0).all(axis=1) & ~(limits.NEXT_SMALLER * extent[1:] > extent[:-1])
    apart |= np.diff(found.track[order]) != 0
    first = np.concatenate([[0], np.flatnonzero(apart) + 1])
    driven = driven_m(trajectory, np.asarray(found.t_ns, np.int64))[order]
    way = np.maximum.reduceat(driven, first) - np.minimum.reduceat(driven, first)
    part = np.concatenate([[0], np.cumsum(apart)])
    long = np.flatnonzero((way > limits.SEEN_FROM_M)[part] & (found.track[order] >= 0))
    if not len(long):
        return far
    rows, cameras = order[long], {found.camera: camera}
    rest = found.at(np.setdiff1d(np.arange(len(found)), rows))
    start = first_corrections(trajectory, [rest], cameras, rules)
    some = replace(found.at(rows), track=part[long])
    views = build_views(trajectory, [some], cameras, rules.noise, start)
    for track in numbered_tracks(views):
        carried = moves_along(views, track, rules.size, limits.FAR_PROBABILITY)
        far[rows[views.row[track]]] = carried
    return far


def moves_along(
    views: Views, rows: IntArray, prior: SizePrior, chance: float = limits.CARRIER_PROBABILITY
) -> bool:
    """Whether a thing of a sign's size that goes about as fast as the camera explains the boxes
    ``rows`` of one track far better than one that stands does. What is in a frame twice is no
    track of one thing.

    From where the vehicle waits both are seen alike, while its path's height wanders by decimetres:
    many frames of that would speak for the one that has no part in the path.
    """
    if len(np.unique(views.frame[rows])) < len(rows):
        return False
    rows = places_apart(views, rows)
    if len(rows) < limits.CARRIER_VIEWS:
        return False
    standing = fit_landmark(views, rows, prior)
    others = rows[standing.weight < limits.MISFIT_WEIGHT]
    if 2 * len(others) > len(rows):
        # it hangs on a few, which may be the false ones
        rows, standing = others, fit_landmark(views, others, prior)
    boxes = boxes_of(views, rows, standing.anchor, prior)
    # it turns with the road, and so with the camera
    boxes = boxes._replace(M=np.ascontiguousarray(np.broadcast_to(np.eye(3), boxes.M.shape)))
    right, down, height = views.measured[standing.anchor]
    first = np.array([right, down, boxes.prior_mean - height, boxes.prior_mean])
    moving = min(
        float(solve_landmark(first, boxes._replace(b=part * boxes.b), BY_HUBER, BY_CAUCHY)[1])
        for part in limits.CARRIER_CLOSING
    )
    # where sigmas were too small both cost too much
    scale = max(1.0, moving / standing.dof)
    return bool(standing.cost - moving > gate(chance, 1) * scale)
