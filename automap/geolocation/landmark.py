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

from dataclasses import dataclass

import numpy as np
from numba import njit

from automap.geolocation.views import Views
from automap.records import FloatArray, IntArray

MIN_FORWARD_M = 1.0
"""A sign nearer to the image plane than this cannot be seen as a box."""

_HUBER = 1.5
_CAUCHY = 2.5
_MIN_PIVOT = 1e-300


@dataclass(frozen=True)
class SizePrior:
    """Physical height of a sign: log-normal with median ``size_m`` and spread ``log_sd``."""

    size_m: float = 0.7
    log_sd: float = 0.4


@dataclass(frozen=True)
class Landmark:
    """Estimate of one sign from ``rows`` (of the Views).

    ``anchor`` the row whose camera the parameters [4] refer to; ``covariance`` [4, 4] of
    them from the measurements alone, ``common`` [4, 4] their derivative by the camera's turn
    (rad) and time offset (s). ``position`` [3] in the local frame; ``residual`` [n, 3] in
    sigmas, ``weight`` [n] of the direction (1 = fully used). ``chi2`` weighted sum of squares
    over ``dof``. ``ok`` is False when no place in front of all cameras was found.
    """

    rows: IntArray
    anchor: int
    parameters: FloatArray
    covariance: FloatArray
    common: FloatArray
    position: FloatArray
    residual: FloatArray
    weight: FloatArray
    cost: float
    chi2: float
    dof: int
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
        return float(np.sqrt(self.covariance[2, 2]))


def fit_landmark(views: Views, rows: IntArray, prior: SizePrior, robust: bool = True) -> Landmark:
    """Estimate one sign from the views ``rows`` [n], n >= 1.

    The anchor is the view with the largest box, the nearest one as a rule. Several start
    distances are tried: the one from the size, half and double of it, and the linear
    intersection of the rays.
    """
    rows = np.asarray(rows, np.int64)
    anchor = int(rows[np.argmax(views.measured[rows, 2])])
    M, b = relative_views(views, rows, anchor)
    drift = view_drift(views, rows, anchor)
    measured, sd = views.measured[rows], views.sd[rows]
    prior_mean, prior_sd = float(np.log(prior.size_m)), prior.log_sd
    by_size = prior_mean - views.measured[anchor, 2]
    starts = [by_size, by_size + np.log(2.0), by_size - np.log(2.0)]
    crossing = _crossing_depth(views, rows, anchor)
    if crossing > MIN_FORWARD_M:
        starts.append(float(np.log(crossing)))
    best: tuple[FloatArray, float] | None = None
    for start in starts:
        first = np.array([*views.measured[anchor, :2], start, start + views.measured[anchor, 2]])
        found, cost = _solve(first, M, b, measured, sd, drift, prior_mean, prior_sd, robust)
        if np.isfinite(cost) and (best is None or cost < best[1]):
            best = (found, cost)
    parameters, cost = best if best is not None else (first, np.inf)
    rate, velocity = views.rate[rows], views.velocity[rows]
    information, A, _, residual, weight, chi2 = normal_equations(
        parameters, M, b, measured, sd, drift, rate, velocity, prior_mean, prior_sd, robust
    )
    covariance = np.linalg.inv(information)
    # the residuals, the size prior's among them, say whether the sigmas were too small
    dof = max(3 * len(rows) + 1 - 4, 1)
    covariance *= max(1.0, chi2 / dof)
    return Landmark(
        rows=rows,
        anchor=anchor,
        parameters=parameters,
        covariance=covariance,
        common=-covariance / max(1.0, chi2 / dof) @ A,
        position=_position(views, anchor, parameters),
        residual=residual,
        weight=weight,
        cost=float(cost),
        chi2=float(chi2),
        dof=dof,
        ok=bool(np.isfinite(cost)),
    )


def view_drift(views: Views, rows: IntArray, anchor: int) -> FloatArray:
    """One-sigma error [n] in metres of each camera centre relative to the anchor's."""
    elapsed = np.abs(views.t_ns[rows] - views.t_ns[anchor]) * 1e-9
    return np.asarray(views.speed_sd[rows] * elapsed, np.float64)


def relative_views(views: Views, rows: IntArray, anchor: int) -> tuple[FloatArray, FloatArray]:
    """``M`` [n, 3, 3] and ``b`` [n, 3] with q_view = M q_anchor + b for any point."""
    C_anchor = views.C_cam_ref[anchor]
    M = views.C_cam_ref[rows] @ C_anchor.T
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


def _position(views: Views, anchor: int, parameters: FloatArray) -> FloatArray:
    direction = np.array([1.0, parameters[0], parameters[1]]) * np.exp(parameters[2])
    return np.asarray(views.centre[anchor] + views.C_cam_ref[anchor].T @ direction)


def _crossing_depth(views: Views, rows: IntArray, anchor: int) -> float:
    """Forward distance of the point nearest to all rays in the sense of least squares.

    Zero when the rays are too parallel to say.
    """
    if len(rows) < 2:
        return 0.0
    rays = np.column_stack([np.ones(len(rows)), views.measured[rows, :2]])
    rays = np.einsum("nji,nj->ni", views.C_cam_ref[rows], rays)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.eigvalsh(normal)[0] < 1e-6 * len(rows):
        return 0.0
    point = np.linalg.solve(normal, np.einsum("nij,nj->i", across, views.centre[rows]))
    return float((views.C_cam_ref[anchor] @ (point - views.centre[anchor]))[0])


@njit(cache=True)
def predict(
    parameters: FloatArray, covariance: FloatArray, M: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray, bool]:
    """Expected measurement [3] and its covariance [3, 3] in a view with relation M, b.

    The flag is False where the sign would lie behind the camera or beside its image plane.
    """
    h = np.zeros(3)
    S = np.zeros((3, 3))
    J = np.zeros((3, 4))
    q = np.zeros(3)
    if not _measure(parameters, M, b, h, J, q):
        return h, S, False
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(4):
                for m in range(4):
                    total += J[i, k] * covariance[k, m] * J[j, m]
            S[i, j] = total
    return h, S, True


@njit(cache=True)
def _measure(theta, M, b, h, J, q):  # type: ignore[no-untyped-def]
    """Fill the expected measurement h [3], its derivative J [3, 4] and the point q [3]."""
    depth = np.exp(theta[2])
    y, z = theta[0], theta[1]
    for i in range(3):
        q[i] = depth * (M[i, 0] + M[i, 1] * y + M[i, 2] * z) + b[i]
    if not q[0] > MIN_FORWARD_M:
        return False
    inverse = 1.0 / q[0]
    h[0] = q[1] * inverse
    h[1] = q[2] * inverse
    h[2] = theta[3] - np.log(q[0])
    for k in range(3):
        # derivative of q by direction right, direction down, log depth
        if k == 0:
            d0, d1, d2 = depth * M[0, 1], depth * M[1, 1], depth * M[2, 1]
        elif k == 1:
            d0, d1, d2 = depth * M[0, 2], depth * M[1, 2], depth * M[2, 2]
        else:
            d0, d1, d2 = q[0] - b[0], q[1] - b[1], q[2] - b[2]
        J[0, k] = (d1 - h[0] * d0) * inverse
        J[1, k] = (d2 - h[1] * d0) * inverse
        J[2, k] = -d0 * inverse
    J[0, 3] = 0.0
    J[1, 3] = 0.0
    J[2, 3] = 1.0
    return True


@njit(cache=True)
def _loss(square, kind):  # type: ignore[no-untyped-def]
    """Loss and weight of a squared residual in sigmas; kind 0 plain, 1 Huber, 2 Cauchy."""
    if kind == 1:
        size = np.sqrt(square)
        if size <= _HUBER:
            return square, 1.0
        return 2.0 * _HUBER * size - _HUBER * _HUBER, _HUBER / size
    if kind == 2:
        ratio = square / (_CAUCHY * _CAUCHY)
        return _CAUCHY * _CAUCHY * np.log(1.0 + ratio), 1.0 / (1.0 + ratio)
    return square, 1.0


@njit(cache=True)
def _cost(theta, M, b, measured, sd, drift, prior_mean, prior_sd, kind):  # type: ignore[no-untyped-def]
    h = np.zeros(3)
    J = np.zeros((3, 4))
    q = np.zeros(3)
    r = (theta[3] - prior_mean) / prior_sd
    total = r * r
    for i in range(len(sd)):
        if not _measure(theta, M[i], b[i], h, J, q):
            return np.inf
        slack = drift[i] / q[0]
        square = 0.0
        for k in range(2):
            r = measured[i, k] - h[k]
            square += r * r / (sd[i, k] * sd[i, k] + slack * slack)
        total += _loss(square, kind)[0]
        r = (measured[i, 2] - h[2]) / sd[i, 2]
        total += _loss(r * r, kind)[0]
    return total


@njit(cache=True)
def _accumulate(theta, M, b, measured, sd, drift, prior_mean, prior_sd, kind, N, g):  # type: ignore[no-untyped-def]
    """Normal matrix N [4, 4] and right-hand side g [4] with the weights at theta."""
    h = np.zeros(3)
    J = np.zeros((3, 4))
    q = np.zeros(3)
    r3 = np.zeros(3)
    w3 = np.zeros(3)
    N[:] = 0.0
    g[:] = 0.0
    N[3, 3] = 1.0 / (prior_sd * prior_sd)
    g[3] = (prior_mean - theta[3]) / (prior_sd * prior_sd)
    for i in range(len(sd)):
        _measure(theta, M[i], b[i], h, J, q)
        slack = drift[i] / q[0]
        square = 0.0
        for k in range(3):
            variance = sd[i, k] * sd[i, k] + (slack * slack if k < 2 else 0.0)
            r3[k] = measured[i, k] - h[k]
            w3[k] = 1.0 / variance
            if k < 2:
                square += r3[k] * r3[k] / variance
        factor = _loss(square, kind)[1]
        w3[0] *= factor
        w3[1] *= factor
        w3[2] *= _loss(r3[2] * r3[2] * w3[2], kind)[1]
        for k in range(3):
            for m in range(4):
                g[m] += J[k, m] * w3[k] * r3[k]
                for n in range(4):
                    N[m, n] += J[k, m] * w3[k] * J[k, n]


@njit(cache=True)
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


@njit(cache=True)
def _solve(start, M, b, measured, sd, drift, prior_mean, prior_sd, robust):  # type: ignore[no-untyped-def]
    """Levenberg-Marquardt from ``start``; parameters and cost (infinite when impossible)."""
    theta = start.copy()
    trial = np.zeros(4)
    step = np.zeros(4)
    N = np.zeros((4, 4))
    g = np.zeros(4)
    cost = np.inf
    first, last = (1, 2) if robust else (0, 0)
    for kind in range(first, last + 1):
        cost = _cost(theta, M, b, measured, sd, drift, prior_mean, prior_sd, kind)
        if not np.isfinite(cost):
            return theta, np.inf
        damping = 1e-3
        for _ in range(30):
            _accumulate(theta, M, b, measured, sd, drift, prior_mean, prior_sd, kind, N, g)
            improved = False
            for _ in range(8):
                if _solve4(N, g, damping, step):
                    # a step of more than a factor e in distance leaves the linear range
                    limit = min(1.0, 1.0 / max(abs(step[2]), 1e-12))
                    for k in range(4):
                        trial[k] = theta[k] + limit * step[k]
                    value = _cost(trial, M, b, measured, sd, drift, prior_mean, prior_sd, kind)
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


@njit(cache=True)
def normal_equations(  # type: ignore[no-untyped-def]
    theta, M, b, measured, sd, drift, rate, velocity, prior_mean, prior_sd, robust
):
    """What a sign contributes at ``theta``.

    Information [4, 4] of its parameters, cross term [4, 4] with the camera's turn and time
    offset, the common block and right-hand sides as a [8, 5] array (first four rows: the
    common information [4, 4] and its right-hand side; last four: zero but for the sign's own
    right-hand side), residuals [n, 3] in sigmas, direction weights [n], weighted chi-square.
    """
    n = len(sd)
    kind = 2 if robust else 0
    h = np.zeros(3)
    J = np.zeros((3, 4))
    B = np.zeros((3, 4))
    D = np.zeros((3, 4))
    q = np.zeros(3)
    w3 = np.zeros(3)
    r3 = np.zeros(3)
    N = np.zeros((4, 4))
    A = np.zeros((4, 4))
    shared = np.zeros((8, 5))
    residual = np.zeros((n, 3))
    weight = np.zeros(n)
    N[3, 3] = 1.0 / (prior_sd * prior_sd)
    r = (theta[3] - prior_mean) / prior_sd
    shared[7, 4] = -r / prior_sd
    chi2 = r * r
    for i in range(n):
        if not _measure(theta, M[i], b[i], h, J, q):
            residual[i, :] = np.inf
            continue
        slack = drift[i] / q[0]
        square = 0.0
        for k in range(3):
            variance = sd[i, k] * sd[i, k] + (slack * slack if k < 2 else 0.0)
            r3[k] = measured[i, k] - h[k]
            w3[k] = 1.0 / variance
            residual[i, k] = r3[k] / np.sqrt(variance)
            if k < 2:
                square += residual[i, k] ** 2
        factor = _loss(square, kind)[1]
        weight[i] = factor
        w3[0] *= factor
        w3[1] *= factor
        w3[2] *= _loss(residual[i, 2] ** 2, kind)[1]
        # derivative of q by the turn: [q x]; by the time offset: -rate x q - velocity
        D[0, 1], D[0, 2] = -q[2], q[1]
        D[1, 0], D[1, 2] = q[2], -q[0]
        D[2, 0], D[2, 1] = -q[1], q[0]
        D[0, 3] = -(rate[i, 1] * q[2] - rate[i, 2] * q[1]) - velocity[i, 0]
        D[1, 3] = -(rate[i, 2] * q[0] - rate[i, 0] * q[2]) - velocity[i, 1]
        D[2, 3] = -(rate[i, 0] * q[1] - rate[i, 1] * q[0]) - velocity[i, 2]
        for m in range(4):
            B[0, m] = (D[1, m] - h[0] * D[0, m]) / q[0]
            B[1, m] = (D[2, m] - h[1] * D[0, m]) / q[0]
            B[2, m] = -D[0, m] / q[0]
        for k in range(3):
            chi2 += w3[k] * r3[k] * r3[k]
            for m in range(4):
                shared[m, 4] += B[k, m] * w3[k] * r3[k]
                shared[4 + m, 4] += J[k, m] * w3[k] * r3[k]
                for p in range(4):
                    N[m, p] += J[k, m] * w3[k] * J[k, p]
                    A[m, p] += J[k, m] * w3[k] * B[k, p]
                    shared[m, p] += B[k, m] * w3[k] * B[k, p]
    return N, A, shared, residual, weight, chi2
