"""How much each view of a sign errs."""

from __future__ import annotations

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark_kernels import Boxes
from automap.geolocation.limits import SAME_PLACE_M
from automap.geolocation.views import Views
from automap.jit import kernel
from automap.records import FloatArray, IntArray

_MOST_OFF = float(np.log(2.0))
"""A box of more than twice its sign's height, or less than half, is no noise."""


def crowd(views: Views, rows: IntArray) -> FloatArray:
    """How many views [n] of one sign are from one place, each, as at a standstill."""
    order, place = _places(views, rows)
    result = np.empty(len(rows))
    result[order] = np.bincount(place)[place]
    return result


def places_apart(views: Views, rows: IntArray) -> IntArray:
    """Of views of one sign the first from each place, in the order of time."""
    order, place = _places(views, rows)
    return rows[order[np.flatnonzero(np.diff(place, prepend=-1))]]


def _places(views: Views, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Views [n] in the order of time, and the number of the place that each of these is from."""
    order = np.argsort(views.t_ns[rows], kind="stable")
    return order, _along(views.centre, rows[order])


@kernel
def _along(centre: FloatArray, rows: IntArray) -> IntArray:
    """Numbers [n], from nought on, of the places on the way through the centres of ``rows``."""
    place = np.zeros(len(rows), np.int64)
    way, cell = 0.0, 0.0
    for i in range(1, len(rows)):
        step = centre[rows[i]] - centre[rows[i - 1]]
        way += np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        now = np.floor(way / SAME_PLACE_M)
        place[i] = place[i - 1] + (1 if now != cell else 0)
        cell = now
    return place


def view_sd(views: Views, rows: IntArray) -> FloatArray:
    """One-sigma errors [n, 3] of views of one sign. Those from one place repeat one another's
    errors: n of them count as one."""
    return np.asarray(views.sd[rows] * np.sqrt(crowd(views, rows))[:, None])


def expected_heights(M: FloatArray, b: FloatArray, parameters: FloatArray) -> FloatArray:
    """Logarithms [n] of the heights, over the focal length, that a sign with ``parameters`` [4]
    lets expect in views with ``M`` [n, 3, 3] and ``b`` [n, 3]."""
    forward = np.exp(parameters[2]) * (M[:, 0] @ [1.0, *parameters[:2]]) + b[:, 0]
    return np.asarray(parameters[3] - np.log(np.maximum(forward, limits.MIN_FORWARD_M)))


def by_expected_heights(boxes: Boxes, parameters: FloatArray) -> Boxes:
    """The same boxes with the errors of log heights that the heights have which a sign with
    ``parameters`` [4] lets expect.

    ``boxes`` state those of their own heights. A box that came out too tall states the smaller
    error of a taller one: with weights by its own height signs seem taller, and boxes tighter,
    than they are.
    """
    off = boxes.measured[:, 2] - expected_heights(boxes.M, boxes.b, parameters)
    off = np.clip(off, -_MOST_OFF, _MOST_OFF)
    return boxes._replace(sd=boxes.sd * np.exp(off[:, None] * [0.0, 0.0, 1.0]))


def view_drift(views: Views, rows: IntArray, anchor: int) -> FloatArray:
    """One-sigma error [n] in metres of each camera centre relative to the anchor's."""
    elapsed = np.abs(views.t_ns[rows] - views.t_ns[anchor]) * 1e-9
    return np.asarray(views.speed_sd[rows] * elapsed, np.float64)
