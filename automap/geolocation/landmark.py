"""Position and size of one sign from its views: robust nonlinear least squares.

The unknowns of a sign are, seen from one of its views (the anchor), the direction
(right / forward, down / forward), the logarithm of the distance along the forward axis and
the logarithm of the size: with a prior on the size alone the problem is solvable from a
single view, and stays well conditioned without parallax (inverse-depth idea of Civera,
Davison and Montiel, IEEE T-RO 24, 2008). Every view measures its own direction and the
logarithm of the apparent height. Residuals are weighted with Huber's and then, from there,
with Cauchy's weights (Zhang, Image and Vision Computing 15, 1997), the direction and the
height of a box each for itself.

What all views of a sign have in common (camera mounting, time offset) cannot be averaged
away: its effect is carried as considered parameters (Tapley, Schutz and Born, Statistical
Orbit Determination, 2004, chapter 6).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark_kernels import (
    N_COMMON,
    Boxes,
    common_columns,
    expected_boxes,
    normal_equations,
    solve_landmark,
)
from automap.geolocation.view_errors import (
    by_expected_heights,
    crowd,
    expected_heights,
    view_drift,
    view_sd,
)
from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray
from automap.robust import BY_CAUCHY, BY_HUBER, PLAIN, cauchy_weight
from automap.signs.class_shares import commonest

_REWEIGHTINGS = 2
"""Of log heights, by what is expected of them: on simulated signs the first moves parameters by up
to a tenth of a sigma, the second by less than a thousandth."""


@dataclass(frozen=True)
class SizePrior:
    """Physical height of a sign: log-normal with median ``size_m`` and spread ``log_sd``;
    ``by_class`` what is known of single classes besides."""

    size_m: float = limits.USUAL_SIZE_M
    log_sd: float = 0.4
    by_class: Mapping[str, SizePrior] = field(default_factory=dict)

    def of(self, names: Iterable[str]) -> SizePrior:
        """The prior of a sign whose boxes have these class names: the commonest decides."""
        return self.by_class.get(commonest(names), self) if self.by_class else self

    def weight(self, mark: Landmark) -> float:
        """What the fit of a landmark with this prior gave it (Cauchy)."""
        off = (mark.parameters[3] - np.log(self.size_m)) / self.log_sd
        return float(cauchy_weight(off**2))


@dataclass(frozen=True)
class Landmark:
    """Estimate of one sign from ``rows`` (of the Views).

    ``anchor`` the row whose camera the parameters [4] refer to; ``covariance`` [4, 4] of them from
    the measurements alone. Zero until ``solve_with_pass_errors``: ``common`` [4, 13] their
    derivative by what is common to the views: turn (rad), time offset (s), log focal length, lever
    arm (m), box margin (rad), k1, velocity error (m/s); ``pass_covariance`` [4, 4] what the errors
    of the pass add, ``pass_bias`` [13] what these were found to be and ``pass_bias_variance`` [13].
    ``position`` [3] in the local frame; ``residual`` [n, 3] in sigmas, ``weight`` [n] of the
    direction (1 = fully used). ``cost`` robust sum of squares of all that was estimated; ``chi2``
    weighted sum of squares over ``dof``. ``ok`` is False when no place in front of all cameras was
    found.
    """

    rows: IntArray
    anchor: int
    parameters: FloatArray
    covariance: FloatArray
    pass_covariance: FloatArray
    common: FloatArray
    pass_bias: FloatArray
    pass_bias_variance: FloatArray
    position: FloatArray
    residual: FloatArray
    weight: FloatArray
    cost: float
    chi2: float
    dof: float
    ok: bool

    @property
    def depth_m(self) -> float:
        """Distance along the anchor camera's forward axis."""
        return float(np.exp(self.parameters[2]))

    @property
    def size_m(self) -> float:
        """Height of the sign."""
        return float(np.exp(self.parameters[3]))

    @property
    def depth_log_sd(self) -> float:
        """Relative one-sigma error of the distance."""
        return float(np.sqrt(self.covariance[2, 2] + self.pass_covariance[2, 2]))


def fit_landmark(
    views: Views,
    rows: IntArray,
    prior: SizePrior,
    robust: bool = True,
    near: Landmark | None = None,
) -> Landmark:
    """Estimate one sign from the views ``rows`` [n], n >= 1.

    The anchor is the view with the largest box, the nearest one as a rule. Several start
    distances are tried: the one from the size, half and double of it; with an estimate ``near``,
    of nearly the same views, that alone.
    """
    rows = np.asarray(rows, np.int64)
    anchor = int(rows[np.argmax(views.measured[rows, 2])])
    boxes = stated = boxes_of(views, rows, anchor, prior)
    # a box so large that its class's usual size would be at the lens is of something larger
    nearest = float(np.log(2.0 * limits.MIN_FORWARD_M))
    start = max(boxes.prior_mean - views.measured[anchor, 2], nearest)
    starts = [
        np.array(
            [*views.measured[anchor, :2], start + far, start + far + views.measured[anchor, 2]]
        )
        for far in ((0.0, np.log(2.0), -np.log(2.0)) if len(rows) > 1 else (0.0,))
    ]
    kinds = (BY_HUBER, BY_CAUCHY) if robust else (PLAIN, PLAIN)
    if near is not None and near.ok:
        there = seen_from(views, anchor, near.position, near.parameters[3])
        if there is not None:
            starts, kinds = [there], (kinds[1], kinds[1])
            boxes = by_expected_heights(boxes, there)
    best: tuple[FloatArray, float] | None = None
    for first in starts:
        found, cost = solve_landmark(first, boxes, *kinds)
        if np.isfinite(cost) and (best is None or cost < best[1]):
            best = (found, cost)
    parameters, cost = best if best is not None else (first, np.inf)
    # the first start's heights are those of an estimate near by already
    for _ in range(_REWEIGHTINGS - (boxes is not stated) if best is not None else 0):
        boxes = by_expected_heights(stated, parameters)
        found, again = solve_landmark(parameters, boxes, *kinds)
        if np.isfinite(again):
            parameters, cost = found, again
    alone = np.zeros((len(rows), 3, 0))
    information, _, _, residual, weight, chi2, _ = normal_equations(
        parameters, boxes, alone, np.zeros(0), kinds[1]
    )
    # of what no start explains nothing is known: a radian, a factor of e
    covariance = np.linalg.inv(information if best is not None else np.eye(4))
    # the residuals, the size prior's among them, say whether the sigmas were too small
    dof = max(3.0 * float(np.sum(1.0 / crowd(views, rows))) + 1.0 - 4.0, 1.0)
    covariance *= max(1.0, chi2 / dof)
    return Landmark(
        rows=rows,
        anchor=anchor,
        parameters=parameters,
        covariance=covariance,
        pass_covariance=np.zeros((4, 4)),
        common=np.zeros((4, N_COMMON)),
        pass_bias=np.zeros(N_COMMON),
        pass_bias_variance=np.zeros(N_COMMON),
        position=place(views, anchor, parameters),
        residual=residual,
        weight=weight,
        cost=float(cost),
        chi2=float(chi2),
        dof=dof,
        ok=bool(np.isfinite(cost)),
    )


def boxes_of(views: Views, rows: IntArray, anchor: int, prior: SizePrior) -> Boxes:
    """The boxes of a sign in the views ``rows``, one of them the ``anchor``."""
    prior = prior.of(views.class_name[rows].tolist())
    return Boxes(
        *(*relative_views(views, rows, anchor), views.measured[rows], view_sd(views, rows)),
        *(view_drift(views, rows, anchor), float(np.log(prior.size_m)), prior.log_sd),
    )


def columns_of(
    views: Views, rows: IntArray, anchor: int, parameters: FloatArray, own: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the expected boxes [n, 3] of a sign with ``parameters`` [4] seen from a view:
    [n, 3, 13] by what is common to its views, [n, 3, 11] by the errors of the camera.

    They are at the heights that the sign lets expect (those of noisy boxes go with their noise), or
    at the boxes' ``own``, where models with other expectations are compared.
    """
    M, b = relative_views(views, rows, anchor)
    height = views.measured[rows, 2] if own else expected_heights(M, b, parameters)
    common, effects = common_columns(
        *(parameters, M, b, height),
        *(views.share[rows], views.rate[rows], views.velocity[rows], views.C_cam_body[rows]),
        *(views.lens[views.camera[rows]], elapsed_s(views, rows, anchor)),
    )
    return common, effects


def sign_equations(
    parameters: FloatArray, boxes: Boxes, columns: FloatArray, bias: FloatArray, kind: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float]:
    """``normal_equations`` of a sign's boxes [n] at ``parameters`` [4] seen from a view, with what
    is common to the views, of derivatives ``columns`` [n, 3, m], at ``bias`` [m]; what drifts is
    among that."""
    boxes = boxes._replace(drift=np.zeros(len(boxes.measured)))
    *found, chi2, cost = normal_equations(parameters, boxes, columns, bias, kind)
    return (*found, float(chi2), float(cost))


def elapsed_s(views: Views, rows: IntArray, anchor: int) -> FloatArray:
    """Seconds [n] over which a velocity error of the trajectory moved a camera against the
    anchor's; errors of the velocity last for some seconds, not for a wait at a light."""
    seconds = (views.t_ns[rows] - views.t_ns[anchor]) * 1e-9
    return np.asarray(limits.VELOCITY_ERROR_S * np.tanh(seconds / limits.VELOCITY_ERROR_S))


def relative_views(views: Views, rows: IntArray, anchor: int) -> tuple[FloatArray, FloatArray]:
    """``M`` [n, 3, 3] and ``b`` [n, 3] with q_view = M q_anchor + b for any point."""
    M = views.C_cam_ref[rows] @ views.C_cam_ref[anchor].T
    b = np.einsum("nij,nj->ni", views.C_cam_ref[rows], views.centre[anchor] - views.centre[rows])
    return np.ascontiguousarray(M), np.ascontiguousarray(b)


def direction_residuals(views: Views, landmark: Landmark) -> FloatArray:
    """Measured minus expected direction [n, 2] (right / forward, down / forward) of each view."""
    rows = landmark.rows
    q = np.einsum("nij,nj->ni", views.C_cam_ref[rows], landmark.position - views.centre[rows])
    return np.asarray(views.measured[rows, :2] - q[:, 1:] / q[:, :1])


def position_jacobian(views: Views, landmark: Landmark) -> FloatArray:
    """Derivative [3, 4] of the position in the local frame by the parameters."""
    y, z, log_depth, _ = landmark.parameters
    depth = np.exp(log_depth)
    J = np.zeros((3, 4))
    J[1, 0] = J[2, 1] = depth
    J[:, 2] = depth, depth * y, depth * z
    return np.asarray(views.C_cam_ref[landmark.anchor].T @ J)


def place(views: Views, anchor: int, parameters: FloatArray) -> FloatArray:
    """Position [3] in the local frame of a sign with ``parameters`` [4] seen from a view."""
    direction = np.array([1.0, parameters[0], parameters[1]]) * np.exp(parameters[2])
    return np.asarray(views.centre[anchor] + views.C_cam_ref[anchor].T @ direction)


def seen_from(
    views: Views, anchor: int, position: FloatArray, log_size: float
) -> FloatArray | None:
    """Parameters [4] of a sign at a place [3], the inverse of ``place``; None where it is not in
    front of the view's camera."""
    q = views.C_cam_ref[anchor] @ (position - views.centre[anchor])
    if not q[0] > limits.MIN_FORWARD_M:
        return None
    return np.array([q[1] / q[0], q[2] / q[0], np.log(q[0]), log_size])


def distances_to(
    views: Views, landmarks: Sequence[Landmark], rows: IntArray, slack_rad: float
) -> FloatArray:
    """Squared distances [n, m] in sigmas of boxes ``rows`` [n] from where m landmarks are
    expected; all boxes must be of one frame. Infinite where a landmark is not in front.

    ``slack_rad`` is what the expectation may be off by beyond its covariance.
    """
    if not landmarks:
        return np.zeros((len(rows), 0))
    anchors = np.array([mark.anchor for mark in landmarks], np.int64)
    C_view, offset = views.C_cam_ref[rows[0]], views.centre[anchors] - views.centre[rows[0]]
    expected, J = expected_boxes(
        np.array([mark.parameters for mark in landmarks]),
        C_view @ views.C_cam_ref[anchors].swapaxes(1, 2),
        offset @ C_view.T,
    )
    spread = J @ np.array([mark.covariance for mark in landmarks]) @ J.swapaxes(1, 2)
    own = views.sd[rows] ** 2 + np.array([slack_rad, slack_rad, 0.0]) ** 2
    total = spread + own[:, None, :, None] * np.eye(3)
    off = views.measured[rows][:, None] - expected
    front = np.isfinite(expected[:, 0])
    square = np.full(off.shape[:2], np.inf)
    weighed = np.linalg.solve(total[:, front], off[:, front, :, None])[..., 0]
    square[:, front] = np.sum(off[:, front] * weighed, axis=2)
    return square
