"""Bias, scale and non-orthogonality of an accelerometer from its readings at rest.

At rest the specific force has the length of gravity in every pose: equations (5) to (7), with
three angles of non-orthogonality beyond them. true = T (scale * reading + bias),
T = [[1, -m0, m1], [0, 1, -m2], [0, 0, 1]]. After D. Tedaldi, A. Pretto, E. Menegatti, "A
robust and easy to implement method for IMU calibration without external equipments", ICRA 2014.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.least_squares import (
    KNOWN,
    Fit,
    fit_with_floor,
    gauss_newton,
    half_widths,
)
from automap.records import FloatArray

N_SIX, N_NINE = 6, 9


@dataclass(frozen=True)
class AccelFit:
    """Calibration of an accelerometer.

    ``scale`` [3] m/s^2 per reading unit, ``bias`` [3] m/s^2, ``misalignment`` [3] rad (zeros
    with six parameters, near zero where ``angle_sd`` held them), ``covariance`` [9, 9] in that
    order, ``half_width`` [9] of the 95 % intervals, 1.96 sigmas of it.
    ``residuals`` [k] |true| - g per pose in m/s^2 and ``residual_sd`` [k];
    ``floor`` the part of it that the noise of the means does not explain. ``design`` [k, p] is
    the dimensionless design matrix, for the judgement of the poses.
    """

    scale: FloatArray
    bias: FloatArray
    misalignment: FloatArray
    covariance: FloatArray
    half_width: FloatArray
    residuals: FloatArray
    residual_sd: FloatArray
    floor: float
    n_parameters: int
    design: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """T [3, 3]."""
        return misalignment_matrix(self.misalignment)

    @property
    def residual_rms(self) -> float:
        """RMS deviation of the calibrated norm from gravity over the poses, m/s^2."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    def apply(self, reading: FloatArray) -> FloatArray:
        """Specific force [n, 3] in m/s^2 of readings [n, 3]."""
        return np.asarray((reading * self.scale + self.bias) @ self.matrix.T)


def misalignment_matrix(m: FloatArray) -> FloatArray:
    """T [3, 3] of the three angles [3] in rad (Tedaldi, Pretto and Menegatti, ICRA 2014)."""
    return np.array([[1.0, -m[0], m[1]], [0.0, 1.0, -m[2]], [0.0, 0.0, 1.0]])


def fit_accelerometer(
    means: FloatArray, variances: FloatArray, gravity: float, n_parameters: int = N_NINE,
    angle_sd: float | None = None,
) -> AccelFit:  # fmt: skip
    """Fit six or nine parameters to the mean readings [k, 3] of k poses: equations (5) to (7).

    ``variances`` [k, 3] are those of the means, in squared reading units; what the residuals
    show beyond them is estimated as a floor common to all poses and enters the covariance.
    With six parameters the angles are zero, or, with ``angle_sd`` in rad, three observations of
    zero that are so good, as a sensor is: what they may be then stands in the covariance.
    """
    centre, half = _ellipsoid_start(means)
    unit = gravity / half
    y = (means - centre) * unit
    variance = np.sum((y / gravity) ** 2 * variances * unit**2, axis=1)
    fit = _fit(y, variance, gravity, n_parameters, angle_sd)
    second_order = np.zeros((N_SIX, N_SIX)) if angle_sd is None else _second_order(fit, y, gravity)
    return _to_readings(fit, second_order, centre, unit, gravity, n_parameters)


def _start(n_parameters: int) -> FloatArray:
    return np.concatenate([np.ones(3), np.zeros(n_parameters - 3)])


def _fit(
    y: FloatArray, variance: FloatArray, gravity: float, n: int, angle_sd: float | None
) -> Fit:
    held = 3 if n == N_SIX and angle_sd is not None else 0
    prior = np.eye(held, n + held, k=n)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        r, J = _norm_residuals(x, y, gravity)
        return np.concatenate([r, prior @ x]), np.vstack([J, prior])

    variance = np.concatenate([variance, np.full(held, (angle_sd or 0.0) ** 2)])
    group = np.repeat([0, KNOWN], [len(y), held])
    start = gauss_newton(model, _start(n + held), np.where(group == KNOWN, np.sqrt(variance), 1.0))
    return fit_with_floor(model, start, variance, group, np.ones(len(group)))


def _second_order(fit: Fit, y: FloatArray, gravity: float) -> FloatArray:
    """What the angles do to scale and bias beyond first order, as a covariance [6, 6].

    On a face of the sensor an angle m changes the norm by m^2 / 2 alone, so poses there tell
    nothing of it and yet give a scale. With the scale's second differences q_j along the principal
    axes of the angles, normal with their sigmas, it is off by sum q_j / 2 in the mean, with the
    variance sum q_j^2 / 2.
    """
    sd = fit.sd[~fit.known]

    def given(angles: FloatArray) -> FloatArray:
        def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
            r, J = _norm_residuals(np.append(x, angles), y, gravity)
            return r, J[:, :N_SIX]

        return gauss_newton(model, fit.parameters[:N_SIX], sd)

    if len(fit.parameters) == N_SIX or np.sum(~fit.known) < N_SIX:
        return np.zeros((N_SIX, N_SIX))
    angles = fit.parameters[N_SIX:]
    size, axes = np.linalg.eigh(fit.covariance[N_SIX:, N_SIX:])
    middle = given(angles)
    steps = (axes * np.sqrt(np.maximum(size, 0.0))).T
    q = np.array([given(angles + v) + given(angles - v) - 2.0 * middle for v in steps])
    return np.asarray(0.5 * q.T @ q + 0.25 * np.outer(q.sum(axis=0), q.sum(axis=0)))


def _norm_residuals(x: FloatArray, y: FloatArray, gravity: float) -> tuple[FloatArray, FloatArray]:
    """|T (s * y + b)| - g [k] and its Jacobian [k, p] for p = 6 or 9."""
    inner = y * x[:3] + x[3:6]
    m = x[6:] if len(x) == N_NINE else np.zeros(3)
    T = misalignment_matrix(m)
    force = inner @ T.T
    norm = np.sqrt(np.sum(force**2, axis=1)) + 1e-300
    u = force / norm[:, None]
    by_inner = u @ T
    J = np.hstack([by_inner * y, by_inner])
    if len(x) == N_NINE:
        by_angle = np.column_stack(
            [-u[:, 0] * inner[:, 1], u[:, 0] * inner[:, 2], -u[:, 1] * inner[:, 2]]
        )
        J = np.hstack([J, by_angle])
    return norm - gravity, J


def _ellipsoid_start(means: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre [3] and half axes [3], in reading units, of the poses' ellipsoid.

    An ellipsoid along the axes is linear in its coefficients; where the poses do not determine
    it, the middle and half of their span must do.
    """
    low, high = means.min(axis=0), means.max(axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-12)
    y = (means - middle) / half.max()
    if len(means) >= N_SIX:
        design = np.hstack([y**2, y])
        c, _, rank, _ = np.linalg.lstsq(design, np.ones(len(y)), rcond=1e-6)
        if rank == N_SIX and np.all(c[:3] > 0):
            shift = -0.5 * c[3:] / c[:3]
            level = 1.0 + np.sum(c[:3] * shift**2)
            axes = np.sqrt(level / c[:3])
            if np.all(axes < 3.0) and np.all(axes > 0.3):
                return middle + shift * half.max(), axes * half.max()
    return middle, np.full(3, half.max())


def _to_readings(
    fit: Fit, second_order: FloatArray, centre: FloatArray, unit: FloatArray, gravity: float, n: int
) -> AccelFit:
    """Parameters and covariance for readings rather than centred, scaled ones.

    ``second_order`` [6, 6] is added to that of scale and bias.
    """
    p = len(fit.parameters)
    x = np.concatenate([fit.parameters, np.zeros(N_NINE - p)])
    J = np.eye(N_NINE)
    J[:3, :3] = np.diag(unit)
    J[3:6, :3] = -np.diag(unit * centre)
    covariance = np.zeros((N_NINE, N_NINE))
    covariance[:p, :p] = fit.stated_covariance()
    covariance[:N_SIX, :N_SIX] += second_order
    covariance = J @ covariance @ J.T
    scale = x[:3] * unit
    weights = np.concatenate([np.full(3, gravity), np.ones(3), np.full(n - N_SIX, gravity)])
    poses = ~fit.known
    return AccelFit(
        scale=scale,
        bias=x[3:6] - scale * centre,
        misalignment=x[6:],
        covariance=covariance,
        half_width=half_widths(covariance),
        residuals=fit.residuals[poses],
        residual_sd=fit.sd[poses],
        floor=float(fit.floor[0]),
        n_parameters=n,
        design=fit.jacobian[poses, :n] / weights,
    )


def directions_of(fit: AccelFit, means: FloatArray) -> FloatArray:
    """Unit vectors [k, 3] of the specific force in sensor axes."""
    force = fit.apply(means)
    return np.asarray(force / np.linalg.norm(force, axis=1)[:, None])


@dataclass(frozen=True)
class LeftOut:
    """What leaving out one pose after the other does to an accelerometer fit.

    ``residuals`` [k] m/s^2 of each pose under the fit to the others; the largest change of a
    scale (relative), of a misalignment (rad) and of the zero point (m/s^2, at the fit's scale).
    """

    residuals: FloatArray
    scale_change: float
    misalignment_change: float
    bias_change: float

    @property
    def rms(self) -> float:
        """RMS of the left-out residuals, m/s^2."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def leave_one_out(
    means: FloatArray, variances: FloatArray, gravity: float, fit: AccelFit,
    angle_sd: float | None = None,
) -> LeftOut | None:  # fmt: skip
    """Repeat the fit without each pose; None when there are no poses to spare."""
    k = len(means)
    if k <= fit.n_parameters + 1:
        return None
    residuals = np.empty(k)
    change = np.zeros(3)
    zero = fit.bias / fit.scale
    for i in range(k):
        others = np.arange(k) != i
        part = fit_accelerometer(
            means[others], variances[others], gravity, fit.n_parameters, angle_sd
        )
        residuals[i] = float(np.linalg.norm(part.apply(means[i]))) - gravity
        moved = (
            np.abs(part.scale / fit.scale - 1.0).max(),
            np.abs(part.misalignment - fit.misalignment).max(),
            np.abs((part.bias / part.scale - zero) * fit.scale).max(),
        )
        change = np.maximum(change, moved)
    return LeftOut(residuals, float(change[0]), float(change[1]), float(change[2]))
