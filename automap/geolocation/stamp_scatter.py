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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, minimize

from automap.effects.camera_kernels import TIME
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.landmark import (
    Landmark,
    SizePrior,
    columns_of,
    fit_landmark,
    relative_views,
)
from automap.geolocation.landmark_kernels import expected_boxes
from automap.geolocation.pass_errors import pass_sd
from automap.geolocation.view_errors import places_apart
from automap.geolocation.views import Views, numbered_tracks
from automap.records import FloatArray, IntArray

_FREEDOM = 4.0
"""Of Student's t, as is usual where tails are not known (Lange, Little and Taylor, 1989)."""
_OF_NORMAL = 0.88
"""Scale of such a t of three components that suits normal errors of sigma one best."""
_TURNS, _SETTLED = 2, 1e-6
"""Of a fit and its weights; and part of the deviance by which the last step of a search fell."""


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


def stamp_scatter(views: Views, groups: Sequence[IntArray], prior: SizePrior) -> float:
    """One-sigma error in s of the frames' stamps, 0 where it is no more than chance makes of it.

    ``views`` as if no stamp erred, ``groups`` the rows of each sign's boxes.
    """
    marks = [fit_landmark(views, rows, prior) for rows in groups]
    signs = [residuals_of(views, mark, prior) for mark in marks if mark.ok]
    bounds = np.log([*[limits.OWN_VARIANCES] * 3, limits.STAMP_SCATTERS_S]).T

    def cost(x: FloatArray) -> float:
        return deviance(signs, np.exp(x[:3]), float(np.exp(x[3:]).sum()))

    right = minimize(cost, np.zeros(3), bounds=Bounds(*bounds[:, :3]), tol=_SETTLED)
    start = np.append(right.x, np.log(limits.USUAL_STAMP_SCATTER_S))
    wrong = minimize(cost, start, bounds=Bounds(*bounds), tol=_SETTLED)
    chance = gate(limits.STAMP_SCATTER_PROBABILITY, 1)
    return float(np.exp(wrong.x[3])) if right.fun - wrong.fun > chance else 0.0


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
    # boxes of a car that waits tell of no stamp, and take their time
    apart = (places_apart(views, rows) for rows in groups)
    often = [rows for rows in apart if len(rows) >= limits.SCATTER_VIEWS]
    return often[:: max(1, -(-len(often) // limits.STAMP_SIGNS))]


def residuals_of(views: Views, mark: Landmark, prior: SizePrior) -> Residuals:
    """The residuals of a sign as it was fitted, in the stated sigmas of its boxes."""
    rows = mark.rows
    common, effects = columns_of(views, rows, mark.anchor, mark.parameters)
    theta = np.tile(mark.parameters, (len(rows), 1))
    expected, by_sign = expected_boxes(theta, *relative_views(views, rows, mark.anchor))
    by_fit = np.concatenate([by_sign, common * pass_sd(views, rows)], axis=2)
    size, sd = prior.of(views.class_name[rows].tolist()), views.sd[rows]
    return Residuals(
        (views.measured[rows] - expected) / sd,
        effects[:, :, TIME] / sd,
        by_fit / sd[:, :, None],
        np.concatenate([[0.0, 0.0, 0.0, size.log_sd**-2], np.ones(common.shape[2])]),
    )


def deviance(signs: Sequence[Residuals], own: FloatArray, stamp_sd: float) -> float:
    """Minus twice the restricted log likelihood of all signs' residuals, if boxes have errors of
    their own with the variances ``own`` [3] and stamps err by ``stamp_sd`` s."""
    total = 0.0
    for sign in signs:
        moved = _OF_NORMAL * stamp_sd * sign.by_stamp
        covariance = np.diag(own) + moved[:, :, None] * moved[:, None, :]
        information = np.asarray(np.linalg.inv(covariance), np.float64)
        by_fit, prior, alone = information @ sign.by_fit, np.diag(sign.prior), sign.value
        turned = np.einsum("nki,nkj->nij", by_fit, sign.by_fit)
        for _ in range(_TURNS):
            weight = (_FREEDOM + 3.0) / (_FREEDOM + _squares(alone, information))
            N = np.einsum("n,nij->ij", weight, turned) + prior
            x = np.linalg.solve(N, np.einsum("n,nki,nk->i", weight, by_fit, sign.value))
            alone = sign.value - sign.by_fit @ x
        total += (_FREEDOM + 3.0) * np.log1p(_squares(alone, information) / _FREEDOM).sum()
        total += x @ (sign.prior * x) - np.linalg.slogdet(information)[1].sum()
        # a stray box that weighs less is no information less, else strays would pay
        total += np.linalg.slogdet(turned.sum(axis=0) + prior)[1]
    return float(total)


def _squares(value: FloatArray, information: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ni,nij,nj->n", value, information, value), np.float64)
