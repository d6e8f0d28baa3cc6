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
from automap.robust import BY_CAUCHY, BY_HUBER, PLAIN, loss

N_COMMON = 12
"""Common to the views of a sign: turn (3), time offset, log focal length, lever arm (3), box
margin, which its camera shares with other signs, and the trajectory's velocity error (3)."""

MARGIN = 8
"""Place of the box margin among them."""

_MIN_PIVOT = 1e-300
"""No more is no pivot but rounding."""


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
def squared_distances(
    parameters: FloatArray,
    covariance: FloatArray,
    M: FloatArray,
    b: FloatArray,
    measured: FloatArray,
    sd: FloatArray,
    slack_rad: float,
) -> FloatArray:
    """Squared distances [b, t] in sigmas of b boxes of one view from t expected signs.

    ``parameters`` [t, 4], ``covariance`` [t, 4, 4]; ``M`` [t, 3, 3] and ``b`` [t, 3] of the view
    with each one's anchor; boxes ``measured`` and ``sd`` [b, 3]. Infinite where a sign is not in
    front of the camera.
    """
    n_boxes, n_signs = len(measured), len(parameters)
    result = np.full((n_boxes, n_signs), np.inf)
    S = np.zeros((3, 3))
    h, J, q, d = _room()
    for t in range(n_signs):
        if not _measure(parameters[t], M[t], b[t], h, J, q, d):
            continue
        S[:] = 0.0
        # faster than matrix products of so few numbers
        for i in range(3):
            for k in range(4):
                for j in range(3):
                    for m in range(4):
                        S[i, j] += J[i, k] * covariance[t, k, m] * J[j, m]
        for box in range(n_boxes):
            a00 = S[0, 0] + sd[box, 0] ** 2 + slack_rad**2
            a11 = S[1, 1] + sd[box, 1] ** 2 + slack_rad**2
            a22 = S[2, 2] + sd[box, 2] ** 2
            # Cholesky of the 3 x 3 sum, forward substitution of the difference
            l00 = np.sqrt(a00)
            l10 = S[1, 0] / l00
            l20 = S[2, 0] / l00
            l11 = np.sqrt(a11 - l10 * l10)
            l21 = (S[2, 1] - l20 * l10) / l11
            l22 = np.sqrt(a22 - l20 * l20 - l21 * l21)
            x0 = (measured[box, 0] - h[0]) / l00
            x1 = (measured[box, 1] - h[1] - l10 * x0) / l11
            x2 = (measured[box, 2] - h[2] - l20 * x0 - l21 * x1) / l22
            result[box, t] = x0 * x0 + x1 * x1 + x2 * x2
    return result


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
def _cost(theta, boxes, kind):  # type: ignore[no-untyped-def]
    M, b, measured, sd, drift, prior_mean, prior_sd = boxes
    h, J, q, d = _room()
    r = (theta[3] - prior_mean) / prior_sd
    total = loss(r * r, kind)[0]
    for i in range(len(sd)):
        if not _measure(theta, M[i], b[i], h, J, q, d):
            return np.inf
        slack = drift[i] / q[0]
        square = 0.0
        for k in range(2):
            r = measured[i, k] - h[k]
            square += r * r / (sd[i, k] * sd[i, k] + slack * slack)
        total += loss(square, kind)[0]
        r = (measured[i, 2] - h[2]) / sd[i, 2]
        total += loss(r * r, kind)[0]
    return total


@kernel
def _solve4(N, g, damping, step):  # type: ignore[no-untyped-def]
    """Solve (N + damping diag N) step = g by Cholesky; False when not positive definite."""
    L = np.zeros((4, 4))
    for i in range(4):
        for j in range(i + 1):
            total = N[i, j]
            if i == j:
                total += damping * N[i, i]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if total <= _MIN_PIVOT:
                    return False
                L[i, i] = np.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    for i in range(4):
        total = g[i]
        for k in range(i):
            total -= L[i, k] * step[k]
        step[i] = total / L[i, i]
    for i in range(3, -1, -1):
        total = step[i]
        for k in range(i + 1, 4):
            total -= L[k, i] * step[k]
        step[i] = total / L[i, i]
    return True


@kernel
def solve_landmark(start, boxes, robust):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt from ``start``; parameters and cost (infinite when impossible). Losses
    after Zhang, Image and Vision Computing 15, 1997."""
    theta = start.copy()
    trial = np.zeros(4)
    step = np.zeros(4)
    alone = np.zeros((len(boxes.sd), 3, 0))
    cost = np.inf
    first, last = (BY_HUBER, BY_CAUCHY) if robust else (PLAIN, PLAIN)
    for kind in range(first, last + 1):
        cost = _cost(theta, boxes, kind)
        if not np.isfinite(cost):
            return theta, np.inf
        damping = 1e-3
        for _ in range(30):
            N, _, right, _, _, _ = normal_equations(theta, boxes, alone, np.zeros(0), kind)
            improved = False
            for _ in range(8):
                if _solve4(N, right[:, 0], damping, step):
                    # a step of more than a factor e in distance leaves the linear range
                    limit = min(1.0, 1.0 / max(abs(step[2]), 1e-12))
                    for k in range(4):
                        trial[k] = theta[k] + limit * step[k]
                    value = _cost(trial, boxes, kind)
                    if value < cost:
                        improved = True
                        break
                damping *= 8.0
            if not improved:
                break
            change = cost - value
            theta[:] = trial
            cost = value
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
                B[r, 9 + k] = E[r, LEVER_ARM + k] * elapsed[i]
            B[r, 3] = E[r, TIME]
            B[r, 4] = E[r, FOCAL]
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
    residuals [n, 3] in sigmas, direction weights [n], weighted chi-square. ``kind`` of the
    loss: that of ``automap.robust``.
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
    factor = loss(r * r, kind)[1]
    N[3, 3] = factor / (prior_sd * prior_sd)
    shared[common + 3, common] = -factor * r / prior_sd
    chi2 = factor * r * r
    for i in range(n):
        if not _measure(theta, M[i], b[i], h, J, q, d):
            residual[i, :] = np.inf
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
        factor = loss(square, kind)[1]
        weight[i] = factor
        w3[0] *= factor
        w3[1] *= factor
        w3[2] *= loss(residual[i, 2] ** 2, kind)[1]
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
    return N, A, shared, residual, weight, chi2
