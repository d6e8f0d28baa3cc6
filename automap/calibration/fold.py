"""What a dynamic calibration found, folded into the static calibration it was made on."""

from __future__ import annotations

import math

import numpy as np

from automap.records import FloatArray, ImuCalibration, TriadCalibration


def corrected(before: ImuCalibration, errors: FloatArray) -> ImuCalibration:
    """The calibration with the dynamic errors [12] folded in, in the same form.

    D T (s r + b) + beta = (D T D^-1) (D s r + D b + (D T D^-1)^-1 beta), D = 1 + scale.
    """

    def fold(triad: TriadCalibration, bias: FloatArray, scale: FloatArray) -> TriadCalibration:
        d = 1.0 + scale
        matrix = triad.matrix * d[:, None] / d
        return TriadCalibration(
            d * triad.scale, d * triad.bias + np.linalg.solve(matrix, bias), matrix
        )

    accel = fold(before.accel, errors[:3], errors[6:9])
    gyro = fold(before.gyro, errors[3:6], errors[9:])
    # true = D (M r - G f) + beta, and f is itself corrected by far less than matters here
    g = before.g_sensitivity * (1.0 + errors[9:])[:, None]
    return ImuCalibration(accel, gyro, g_sensitivity=g)


def folded_covariance(
    before: TriadCalibration, errors: FloatArray, at: tuple[int, int], size: int
) -> FloatArray:
    """Covariance [size, size] of scale and bias after folding in errors of covariance [12, 12].

    ``at`` are the places of bias and scale in the errors. The matrix is that of ``before``:
    its rows have the angles' own sigma, or are zero where nobody measured them.
    """
    rows = np.r_[at[1] : at[1] + 3, at[0] : at[0] + 3]
    J = np.eye(6)
    J[:3, :3] = np.diag(before.scale)
    J[3:, :3] = np.diag(before.bias)
    covariance = np.zeros((size, size))
    covariance[:6, :6] = J @ errors[np.ix_(rows, rows)] @ J.T
    if math.isfinite(before.angles_sd):
        covariance[6:size, 6:size] = before.angles_sd**2 * np.eye(size - 6)
    return covariance


def angles(T: FloatArray) -> FloatArray:
    """m0, m1, m2 of T = [[1, -m0, m1], [0, 1, -m2], [0, 0, 1]]."""
    return np.array([-T[0, 1], T[0, 2], -T[1, 2]])
