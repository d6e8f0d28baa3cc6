"""Loops of the landmark estimate: expected boxes, robust least squares, normal equations.

Parameters of a sign, seen from its anchor view: right / forward, down / forward, logarithm of
the distance along the forward axis, logarithm of the size. ``M`` and ``b`` relate a view to
the anchor: q_view = M q_anchor + b.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from automap.effects.camera_kernels import (
    FOCAL,
    LENS,
    LEVER_ARM,
    N_COLUMNS,
    TIME,
    TURN,
    by_point,
    effect_columns,
)
from automap.geolocation.limits import MIN_FORWARD_M
from automap.jit import kernel
from automap.records import FloatArray
from automap.robust import loss

N_COMMON = 13
"""Common to the views of a sign: turn (3), time offset, log focal length, lever arm (3), box margin
and radial distortion k1, which its camera shares with other signs, and the trajectory's velocity
error (3)."""

FOCAL_LOG, MARGIN, RADIAL, VELOCITY = 4, 8, 9, 10
"""Places of the focal length, the box margin, k1 and the velocity error among them."""
_LEAST_INFO = 1e-300
"""Of a parameter that no box tells no more is left than rounding."""


class Boxes(NamedTuple):
    """Boxes [n] of a sign: ``M`` [n, 3, 3] and ``b`` [n, 3] m of their views, ``measured`` and
    ``sd`` [n, 3], one-sigma error ``drift`` [n] m of each centre against the anchor's; logarithm of
    the sign's usual size and sigma of it."""

    M: FloatArray
    b: FloatArray
    measured: FloatArray
    sd: FloatArray
    drift: FloatArray
    prior_mean: float
    prior_sd: float


@kernel
def expected_boxes(
    parameters: FloatArray, M: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Boxes [t, 3] of one view that signs of ``parameters`` [t, 4] let expect, infinite where a
    sign is not in front of the camera, and their derivatives [t, 3, 4]; ``M`` [t, 3, 3] and ``b``
    [t, 3] of the view with each one's anchor."""
    boxes, by_sign = np.full((len(M), 3), np.inf), np.zeros((len(M), 3, 4))
    h, J, q, d = _room()
    for t in range(len(M)):
        if _measure(parameters[t], M[t], b[t], h, J, q, d):
            boxes[t], by_sign[t] = h, J
    return boxes, by_sign


@kernel
def _room():  # type: ignore[no-untyped-def]
    """What ``_measure`` fills, and room for a derivative [3]."""
    return np.zeros(3), np.zeros((3, 4)), np.zeros(3), np.zeros(3)


@kernel
def _measure(theta, M, b, h, J, q, d):  # type: ignore[no-untyped-def]
    """Fill the expected measurement h [3], its derivative J [3, 4] and the point q [3]."""
    depth = np.exp(theta[2])
    y, z = theta[0], theta[1]
    for i in range(3):
        q[i] = depth * (M[i, 0] + M[i, 1] * y + M[i, 2] * z) + b[i]
    if not q[0] > MIN_FORWARD_M:
        return False
    h[0] = q[1] / q[0]
    h[1] = q[2] / q[0]
    h[2] = theta[3] - np.log(q[0])
    # derivative of q by direction right, direction down, log depth
    for k in range(2):
        for i in range(3):
            d[i] = depth * M[i, 1 + k]
        by_point(h, q, d, J, k)
    for i in range(3):
        d[i] = q[i] - b[i]
    by_point(h, q, d, J, 2)
    J[0, 3] = 0.0
    J[1, 3] = 0.0
    J[2, 3] = 1.0
    return True


@kernel
def solve_landmark(start, boxes, first, last):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt from ``start``; parameters and cost (infinite when impossible). Losses
    after Zhang, Image and Vision Computing 15, 1997: of the kinds ``first`` to ``last``."""
    theta, cost = start.copy(), np.inf
    alone, nothing = np.zeros((len(boxes.sd), 3, 0)), np.zeros(0)
    for kind in range(first, last + 1):
        N, _, right, _, _, _, cost = normal_equations(theta, boxes, alone, nothing, kind)
        if not np.isfinite(cost):
            return theta, np.inf
        damping = 1e-3
        for _ in range(30):
            if np.diag(N).min() <= _LEAST_INFO:
                # boxes without a height tell no distance from one place
                break
            change = 0.0
            for _ in range(8):
                step = np.linalg.solve(N + damping * np.diag(np.diag(N)), right[:, 0])
                # a step of more than a factor e in distance leaves the linear range
                trial = theta + min(1.0, 1.0 / max(abs(step[2]), 1e-12)) * step
                there = normal_equations(trial, boxes, alone, nothing, kind)
                if there[6] < cost:
                    change = cost - there[6]
                    theta, N, right, cost = trial, there[0], there[2], there[6]
                    break
                damping *= 8.0
            damping = max(damping * 0.2, 1e-9)
            if change < 1e-9 * (1.0 + cost):
                break
    return theta, cost


@kernel
def common_columns(  # type: ignore[no-untyped-def]
    theta, M, b, log_height, share, rate, velocity, C_cam_body, lens, elapsed
):
    """Derivatives [n, 3, N_COMMON] of the expected boxes of a sign at ``theta`` by what is common
    to its views, and those [n, 3, 11] by the errors of the camera (``camera_kernels``).

    ``log_height`` [n] of the boxes, ``C_cam_body`` [n, 3, 3] vehicle to camera axes, ``lens``
    [n, 21], ``elapsed`` [n] seconds over which a velocity error of the trajectory acts.
    """
    n = len(log_height)
    h, J, q, d = _room()
    effects = np.zeros((n, 3, N_COLUMNS))
    common = np.zeros((n, 3, N_COMMON))
    for i in range(n):
        if not _measure(theta, M[i], b[i], h, J, q, d):
            continue
        E, B = effects[i], common[i]
        height = np.exp(log_height[i])
        effect_columns(h, q, height, share[i], rate[i], velocity[i], C_cam_body[i], lens[i], E)
        for r in range(3):
            for k in range(3):
                B[r, k] = E[r, TURN + k]
                B[r, 5 + k] = E[r, LEVER_ARM + k]
                # a velocity error has moved the camera as a longer lever arm would
                B[r, VELOCITY + k] = E[r, LEVER_ARM + k] * elapsed[i]
            B[r, 3] = E[r, TIME]
            B[r, FOCAL_LOG] = E[r, FOCAL]
            B[r, RADIAL] = E[r, LENS]
        # boxes with a margin are taller than their signs by the same number of pixels
        B[2, MARGIN] = 1.0 / height
    return common, effects


@kernel
def normal_equations(theta, boxes, columns, bias, kind):  # type: ignore[no-untyped-def]
    """What a sign contributes at ``theta`` and at the values ``bias`` [m] of what is common.

    ``columns`` [n, 3, m] are the derivatives of the expected boxes by what is common to them.
    Information [4, 4] of the sign's parameters, cross term [4, m] with what is common, the common
    block and right-hand sides as a [m + 4, m + 1] array (first m rows: the common information
    [m, m] and its right-hand side; last four: zero but for the sign's own right-hand side),
    residuals [n, 3] in sigmas, direction weights [n], weighted chi-square, and the sum of losses of
    ``kind`` (``automap.robust``), infinite where the sign is not in front of a view.
    """
    M, b, measured, sd, drift, prior_mean, prior_sd = boxes
    n, common = len(sd), columns.shape[2]
    h, J, q, d = _room()
    w3 = np.zeros(3)
    r3 = np.zeros(3)
    N = np.zeros((4, 4))
    A = np.zeros((4, common))
    shared = np.zeros((common + 4, common + 1))
    residual = np.zeros((n, 3))
    weight = np.zeros(n)
    r = (theta[3] - prior_mean) / prior_sd
    # sizes come in steps: a sign of another size than expected is no rarity
    cost, factor = loss(r * r, kind)
    N[3, 3] = factor / (prior_sd * prior_sd)
    shared[common + 3, common] = -factor * r / prior_sd
    chi2 = factor * r * r
    for i in range(n):
        if not _measure(theta, M[i], b[i], h, J, q, d):
            residual[i, :] = cost = np.inf
            continue
        B = columns[i]
        slack = drift[i] / q[0]
        square = 0.0
        for k in range(3):
            variance = sd[i, k] * sd[i, k] + (slack * slack if k < 2 else 0.0)
            r3[k] = measured[i, k] - h[k]
            for m in range(common):
                r3[k] -= B[k, m] * bias[m]
            w3[k] = 1.0 / variance
            residual[i, k] = r3[k] / np.sqrt(variance)
            if k < 2:
                square += residual[i, k] ** 2
        (aside, weight[i]), (tall, factor) = loss(square, kind), loss(residual[i, 2] ** 2, kind)
        cost += aside + tall
        w3[:2] *= weight[i]
        w3[2] *= factor
        for k in range(3):
            chi2 += w3[k] * r3[k] * r3[k]
            for m in range(4):
                shared[common + m, common] += J[k, m] * w3[k] * r3[k]
                for p in range(4):
                    N[m, p] += J[k, m] * w3[k] * J[k, p]
                for p in range(common):
                    A[m, p] += J[k, m] * w3[k] * B[k, p]
            for m in range(common):
                shared[m, common] += B[k, m] * w3[k] * r3[k]
                for p in range(common):
                    shared[m, p] += B[k, m] * w3[k] * B[k, p]
    return N, A, shared, residual, weight, chi2, cost
