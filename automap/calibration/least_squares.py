"""Weighted least squares whose noise floor is estimated along with the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automap.gates import OUTSIDE_95, sigmas
from automap.records import FloatArray

KNOWN = -1
"""The group of rows whose variance is known, and that have no floor."""

Model = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Parameters [p] to residuals [m] and their Jacobian [m, p]."""


@dataclass(frozen=True)
class Fit:
    """Parameters [p] with covariance [p, p], residuals [m] and their one-sigma [m].

    ``floor`` is the part of the residuals' one-sigma that the known variances do not explain,
    one value per group; ``known`` [m] are the rows that have none. ``dof`` are degrees of freedom
    of the residuals' variance: more, the less of it had to be estimated as floor (Satterthwaite).
    """

    parameters: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    sd: FloatArray
    jacobian: FloatArray
    floor: FloatArray
    dof: float
    known: np.ndarray

    def stated_covariance(self) -> FloatArray:
        """Covariance [p, p] whose 1.96 sigmas hold the parameters with 95 %.

        ``covariance`` takes the floor for known; what rests on it is widened as Student's
        distribution is wider than the normal one, what rests on rows of known variance is not.
        """
        from scipy.stats import t

        student = float(t.ppf(1.0 - 0.5 * OUTSIDE_95, max(self.dof, 1.0))) / sigmas(OUTSIDE_95)
        A = np.where(self.known[:, None], 0.0, self.jacobian / self.sd[:, None])
        part = A @ self.covariance
        return np.asarray(self.covariance + (student**2 - 1.0) * (part.T @ part))

    def half_width(self) -> FloatArray:
        """Half widths [p] of the 95 % intervals."""
        return half_widths(self.stated_covariance())


def half_widths(covariance: FloatArray) -> FloatArray:
    """Half widths [p] of the 95 % intervals of a stated covariance [p, p]."""
    return np.asarray(sigmas(OUTSIDE_95) * np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def gauss_newton(
    model: Model, start: FloatArray, sd: FloatArray, iterations: int = 60
) -> FloatArray:
    """Parameters that minimise the sum of (residual / sd)^2, by Levenberg and Marquardt (Journal
    of the Society for Industrial and Applied Mathematics 11, 1963)."""
    x = start.copy()
    r, J = model(x)
    cost = float(np.sum((r / sd) ** 2))
    damping = 1e-6
    for _ in range(iterations):
        A = J / sd[:, None]
        size = np.sqrt(np.sum(A * A, axis=0)) + 1e-300
        A = A / size
        normal = A.T @ A
        step = np.linalg.solve(normal + damping * np.eye(len(x)), -A.T @ (r / sd)) / size
        r_new, J_new = model(x + step)
        cost_new = float(np.sum((r_new / sd) ** 2))
        if np.isfinite(cost_new) and cost_new <= cost * (1.0 + 1e-12):
            x, r, J = x + step, r_new, J_new
            done = cost - cost_new <= 1e-10 * cost_new
            cost, damping = cost_new, max(damping * 0.1, 1e-12)
            if done:
                break
        else:
            damping *= 10.0
            if damping > 1e8:
                break
    return x


def fit_with_floor(
    model: Model, start: FloatArray, variance: FloatArray, group: np.ndarray, dof_share: FloatArray
) -> Fit:
    """Fit with the variance of each residual = ``variance`` [m] + floor of its ``group`` [m],
    but for those of the group KNOWN.

    The floor of a group is that with which its weighted squares sum to what is expected of
    them: the trace of I - A (A^T A)^-1 A^T over the group's rows, A the weighted Jacobian
    (variance components after Helmert and Foerstner). ``dof_share`` [m] is the part of a
    degree of freedom that a row brings: 2/3 for the three components of a unit vector.
    """
    groups = int(group.max()) + 1
    # the last, which KNOWN takes, stays zero
    floor = np.zeros(groups + 1)
    x = start
    r, J = model(x)
    for g in range(groups):
        floor[g] = max(float(np.mean(r[group == g] ** 2)), 0.0)
    for _ in range(25):
        sd = np.sqrt(variance + floor[group])
        x = gauss_newton(model, x, sd, iterations=20)
        r, J = model(x)
        before = floor.copy()
        for g in range(groups):
            rows = group == g
            expected = _redundancy(J / sd[:, None], rows, dof_share)
            floor[g] = _floor(r[rows], variance[rows], expected, dof_share[rows])
        if np.all(np.abs(floor - before) <= 1e-3 * (before + 1e-30)):
            break
    sd = np.sqrt(variance + floor[group])
    A = J / sd[:, None]
    known = group == KNOWN
    estimated = float(np.mean((floor[group] / sd**2)[~known]))
    return Fit(
        parameters=x,
        covariance=_inverse(A.T @ A),
        residuals=r,
        sd=sd,
        jacobian=J,
        floor=np.sqrt(floor[:groups]),
        dof=float(dof_share.sum() - len(x)) / max(estimated, 0.03) ** 2,
        known=known,
    )


def _redundancy(A: FloatArray, rows: np.ndarray, dof_share: FloatArray) -> float:
    """Degrees of freedom that the residuals of these rows keep."""
    part = A[rows]
    used = float(np.sum(_inverse(A.T @ A) * (part.T @ part)))
    return max(float(dof_share[rows].sum()) - used, 1e-3)


def _inverse(normal: FloatArray) -> FloatArray:
    """Inverse of a normal matrix [p, p], scaled against parameters of very different size."""
    size = np.sqrt(np.diag(normal)) + 1e-300
    return np.asarray(np.linalg.pinv(normal / np.outer(size, size), hermitian=True)) / np.outer(
        size, size
    )


def _floor(r: FloatArray, variance: FloatArray, expected: float, share: FloatArray) -> float:
    """The addition to ``variance`` with which sum r^2 / (variance + floor) is ``expected``."""

    def excess(floor: float) -> float:
        return float(np.sum(r**2 / (variance + floor))) - expected

    if np.all(variance > 0) and excess(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, float(np.sum(r**2)) / expected + 1e-300
    for _ in range(60):
        middle = 0.5 * (low + high)
        if excess(middle) > 0.0:
            low = middle
        else:
            high = middle
    return high
