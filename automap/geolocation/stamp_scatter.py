"""How far frames are from their stamps, each for itself, from how boxes scatter about the signs.

A frame that was taken at another instant than its stamp says shows every sign as the camera saw it
from further on: beside the road it is moved sideways, and it is larger, by the more the nearer it
is. So a stamp's error is one number in all that a box measures, of known direction, and a box's own
errors are one in each of them; the likelihood of both together tells one from the other, whatever
the boxes' own sigmas are. It is the restricted one, since a few near boxes tell most of a stamp
and of the sign's place alike (H. D. Patterson, R. Thompson, Biometrika 58, 1971), with the tails of
Student's t (K. L. Lange, R. J. A. Little, J. M. G. Taylor, Journal of the American Statistical
Association 84, 1989).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.camera import direction_by_point
from automap.effects.camera_kernels import TIME
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.landmark import (
    Landmark,
    SizePrior,
    columns_of,
    direction_residuals,
    fit_landmark,
    position_jacobian,
)
from automap.geolocation.pass_errors import pass_sd
from automap.geolocation.views import Views, numbered_tracks
from automap.records import FloatArray, IntArray

_FREEDOM = 4.0
"""Of Student's t, as is usual where tails are not known (Lange, Little and Taylor, 1989)."""
_OF_NORMAL = 0.88
"""Scale of such a t of three components that suits normal errors of sigma one best."""
_ROUNDS, _LEAST = 10, 1e-6
"""Of the expectation maximisation of the boxes' own scales, and their least variance."""


@dataclass(frozen=True)
class Residuals:
    """What the boxes of one sign are off by, in their stated sigmas, and by what.

    ``value`` [n, 3] right, down and log height less what is expected; their derivatives
    ``by_stamp`` [n, 3] by the stamp (per s) and ``by_fit`` [n, 3, m] by what a fit of the sign
    finds, on which ``prior`` [m] is the information before.
    """

    value: FloatArray
    by_stamp: FloatArray
    by_fit: FloatArray
    prior: FloatArray


def stamp_scatter(
    views_with: Callable[[float], Views], groups: Sequence[IntArray], prior: SizePrior
) -> float:
    """One-sigma error in s of the frames' stamps, 0 where it is no more than chance makes of it.

    ``views_with`` the views if stamps err by so much, ``groups`` the rows of each sign's boxes.
    """
    sd = views_with(0.0).sd
    tried: dict[float, float] = {}

    def likelihood(stamp_sd: float) -> float:
        if stamp_sd not in tried:
            views = views_with(stamp_sd)
            marks = [fit_landmark(views, rows, prior) for rows in groups]
            signs = [residuals_of(views, mark, prior, sd[mark.rows]) for mark in marks if mark.ok]
            tried[stamp_sd] = log_likelihood(signs, _OF_NORMAL * stamp_sd)
        return tried[stamp_sd]

    # it has one top
    best = 0.0
    for stamp_sd in limits.STAMP_SCATTERS_S:
        if likelihood(stamp_sd) <= likelihood(best):
            break
        best = stamp_sd
    for step in (np.sqrt(2.0), 2.0**0.25) if best else ():
        best = max((best / step, best, best * step), key=likelihood)
    gain = 2.0 * (likelihood(best) - likelihood(0.0))
    return float(best) if gain > gate(limits.STAMP_SCATTER_PROBABILITY, 1) else 0.0


def told(stamp_sd: float, stamps: Sequence[IntArray]) -> list[str]:
    """A sentence where the ``stamps`` [n] in ns of each camera's boxes err by more than an instant
    anywhere in a frame's time would (its sigma is that of a uniform distribution)."""
    steps = [np.diff(np.unique(t_ns)) for t_ns in stamps]
    frame_s = max((float(np.median(step)) * 1e-9 for step in steps if len(step)), default=np.inf)
    if not stamp_sd > frame_s / np.sqrt(12.0):
        return []
    return [
        f"Frames are off their stamps by {stamp_sd * 1e3:.0f} ms (one sigma), each for itself, "
        "more than exposing anywhere in a frame's time does. The signs' sigmas hold it; check how "
        "the frames were stamped."
    ]


def tracked_or_linked(views: Views, landmarks: Sequence[Landmark]) -> list[IntArray]:
    """Rows of the boxes of single signs, those seen often: by the detector's own tracks where it
    has them, which ask no stamp, else as they were linked."""
    numbered = (views.track >= 0).sum() > 0.5 * len(views)
    groups = numbered_tracks(views) if numbered else [mark.rows for mark in landmarks if mark.ok]
    often = [rows for rows in groups if len(rows) >= limits.SCATTER_VIEWS]
    return often[:: max(1, -(-len(often) // limits.STAMP_SIGNS))]


def residuals_of(views: Views, mark: Landmark, prior: SizePrior, sd: FloatArray) -> Residuals:
    """The residuals of a sign as it was fitted, in the sigmas ``sd`` [n, 3] of its boxes."""
    rows = mark.rows
    common, effects = columns_of(views, rows, mark.anchor, mark.parameters)
    q = np.einsum("nij,nj->ni", views.C_cam_ref[rows], mark.position - views.centre[rows])
    height = views.measured[rows, 2] - (mark.parameters[3] - np.log(q[:, 0]))
    by_sign = direction_by_point(q) @ views.C_cam_ref[rows] @ position_jacobian(views, mark)
    by_sign[:, 2, 3] = 1.0
    by_fit = np.concatenate([by_sign, common * pass_sd(views, rows)], axis=2)
    size = prior.of(views.class_name[rows].tolist())
    return Residuals(
        np.column_stack([direction_residuals(views, mark), height]) / sd,
        effects[:, :, TIME] / sd,
        by_fit / sd[:, :, None],
        np.concatenate([[0.0, 0.0, 0.0, size.log_sd**-2], np.ones(common.shape[2])]),
    )


def log_likelihood(signs: Sequence[Residuals], stamp_sd: float) -> float:
    """Restricted log likelihood of all signs' residuals if stamps err by ``stamp_sd`` s, at the
    scales of the boxes' own errors that suit it best."""
    count = sum(len(sign.value) for sign in signs)
    if count == 0:
        return 0.0
    own = sum((np.sum(sign.value**2, axis=0) for sign in signs), np.zeros(3)) / count
    weights = [np.ones(len(sign.value)) for sign in signs]
    for _ in range(_ROUNDS):
        squares = np.zeros(3)
        for k, sign in enumerate(signs):
            _, square, told = _fitted(sign, stamp_sd * sign.by_stamp, own, weights[k])
            weights[k] = (_FREEDOM + 3.0) / (_FREEDOM + square)
            squares += told
        own = np.maximum(squares / count, _LEAST)
    return -0.5 * sum(
        _fitted(sign, stamp_sd * sign.by_stamp, own, weight)[0]
        for sign, weight in zip(signs, weights, strict=True)
    )


def _fitted(
    sign: Residuals, moved: FloatArray, own: FloatArray, weight: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Minus twice the restricted log likelihood of a sign; squared distances [n] of its boxes; sums
    [3] of the boxes' own squares, as expected.

    A box's errors have the variance diag(own) + moved moved'.
    """
    information = np.linalg.inv(np.diag(own) + moved[:, :, None] * moved[:, None, :])
    by_fit = information @ sign.by_fit
    prior = np.diag(sign.prior)
    turned = np.einsum("nki,nkj->nij", by_fit, sign.by_fit)
    N = np.linalg.inv(np.einsum("n,nij->ij", weight, turned) + prior)
    x = N @ np.einsum("n,nki,nk->i", weight, by_fit, sign.value)
    alone = sign.value - sign.by_fit @ x
    weighed = (information @ alone[:, :, None])[:, :, 0]
    square = np.sum(alone * weighed, axis=1)
    loss = (_FREEDOM + 3.0) * np.log1p(square / _FREEDOM) - np.linalg.slogdet(information)[1]
    # a stray box that weighs less is no information less, else strays would pay
    determinant = np.linalg.slogdet(turned.sum(axis=0) + prior)[1]
    total = float(loss.sum() + x @ (sign.prior * x) + determinant)
    # the boxes' own errors: mean, and variance less what is known of them
    mean = own * weighed
    known = np.diagonal(information, axis1=1, axis2=2)
    known = known - weight[:, None] * np.einsum("nki,ij,nkj->nk", by_fit, N, by_fit)
    return total, square, np.sum(weight[:, None] * mean**2 + own - own**2 * known, axis=0)
