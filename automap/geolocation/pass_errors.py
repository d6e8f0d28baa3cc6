"""Errors that all views of a sign in one pass share, solved with the sign.

While a car passes a sign, the trajectory's attitude and velocity are off by nearly constant
amounts, and the boxes of the sign are loose or tight alike. Such errors do not average out over
the views: each is a parameter of its own with the sigma that the trajectory reports, solved
together with the sign and eliminated (Schur complement). The views are weighted as they
deserve: a trajectory of sure attitude relies on directions, a poor one on the growth of boxes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.geolocation import limits
from automap.geolocation.landmark import (
    Landmark,
    SizePrior,
    boxes_of,
    columns_of,
    place,
    sign_equations,
)
from automap.geolocation.landmark_kernels import MARGIN, N_COMMON, VELOCITY
from automap.geolocation.view_errors import by_expected_heights
from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray
from automap.robust import BY_CAUCHY

_STEPS, _SETTLED = 5, 1e-3
"""Gauss-Newton steps at most, and what the last one is below: sigmas, and part of the distance."""


def pass_sd(views: Views, rows: IntArray, attitude: bool = True) -> FloatArray:
    """One-sigma errors [13] of one pass of one sign, in the order of ``N_COMMON``.

    The lever arm's shows in bends only and then differently in each (on the straight it is one
    with the place of the sign). ``attitude`` whether the trajectory's attitude error is among
    them. A box that is loose on one side is off
    its sign's centre by half as much as it is too tall.
    """
    sd = np.zeros(N_COMMON)
    if attitude:
        sd[:3] = np.sqrt(np.mean(views.attitude_sd[rows] ** 2, axis=0))
    margin = float(views.margin_sd[rows].mean())
    sd[1:3] = np.hypot(sd[1:3], 0.5 * margin)
    sd[3] = limits.STAMP_SD_S
    sd[5:8] = views.lever_arm_sd[rows].mean()
    sd[MARGIN] = margin
    sd[VELOCITY:] = np.sqrt(np.mean(views.velocity_sd[rows] ** 2, axis=0))
    return sd


def equations(
    views: Views, landmark: Landmark, parameters: FloatArray, bias: FloatArray, prior: SizePrior
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float, float]:
    """``normal_equations`` of a landmark's views at other parameters [4] and biases [13]."""
    rows, anchor = landmark.rows, landmark.anchor
    columns, _ = columns_of(views, rows, anchor, parameters)
    boxes = by_expected_heights(boxes_of(views, rows, anchor, prior), parameters)
    return sign_equations(parameters, boxes, columns, bias, BY_CAUCHY)


def solve_with_pass_errors(views: Views, landmark: Landmark, prior: SizePrior) -> Landmark:
    """The landmark solved together with the errors of its pass.

    Gauss-Newton from the landmark's own solution; where that leads nowhere (a sign passing
    behind a camera) the landmark comes back with the errors' effect on its covariance only.
    """
    if not landmark.ok:
        return landmark
    sd = pass_sd(views, landmark.rows)
    parameters, z = landmark.parameters.copy(), np.zeros(N_COMMON)
    identity = np.eye(N_COMMON)
    for _ in range(_STEPS):
        N, A, shared, *_ = equations(views, landmark, parameters, sd * z, prior)
        S, s, g = shared[:N_COMMON, :N_COMMON], shared[:N_COMMON, -1], shared[N_COMMON:, -1]
        AW, M = A * sd, identity + sd[:, None] * S * sd
        whole = np.block([[N, AW], [AW.T, M]])
        try:
            step = np.linalg.solve(whole, np.concatenate([g, sd * s - z]))
        except np.linalg.LinAlgError:
            # it went so far that no view tells anything any more
            parameters, z = landmark.parameters, np.zeros(N_COMMON)
            break
        limit = min(1.0, 0.5 / max(abs(float(step[2])), 1e-12))
        parameters, z = parameters + limit * step[:4], z + limit * step[4:]
        if np.abs(step[4:]).max() < _SETTLED and abs(float(step[2])) < _SETTLED:
            break
    found = equations(views, landmark, parameters, sd * z, prior)
    if not np.isfinite(found[-1]):
        parameters, z = landmark.parameters, np.zeros(N_COMMON)
        found = equations(views, landmark, parameters, z, prior)
    N, A, shared, residual, weight, chi2, cost = found
    S = shared[:N_COMMON, :N_COMMON]
    M = identity + sd[:, None] * S * sd
    absorbed = np.linalg.solve(M, sd[:, None] * np.hstack([A.T, S]))
    alone = np.linalg.inv(N)
    total = np.linalg.inv(N - (A * sd) @ absorbed[:, :4])
    remaining = np.linalg.inv(M - (A * sd).T @ alone @ (A * sd))
    return replace(
        landmark,
        parameters=parameters,
        covariance=np.asarray(alone * max(1.0, chi2 / landmark.dof)),
        pass_covariance=np.asarray(total - alone),
        common=np.asarray(-total @ (A - (A * sd) @ absorbed[:, 4:])),
        pass_bias=sd * z,
        pass_bias_variance=sd**2 * np.diag(remaining),
        position=place(views, landmark.anchor, parameters),
        residual=residual,
        weight=weight,
        cost=cost + float(z @ z),
        chi2=chi2,
    )
