"""The error-state filter of the dynamic calibration as a numba kernel.

States: velocity (3, NED), attitude (3, rotation of the navigation side), accelerometer bias,
gyro bias, accelerometer scale, gyro scale (3 each), in correction form, equations (10), (11):
a = (1 + S_a) abar + beta_a, omega = (1 + S_g) omegabar + beta_g; and position (3), because the
hand not only moves about zero velocity but stays in one place. The measurements are the
pseudo-velocity, equations (26) to (28), and a pseudo-position. The error-state form is to first
order the filter of (12) to (28) without the trouble of a quaternion's covariance.
"""

from __future__ import annotations

import numpy as np

from automap.fusion.mechanisation import quat_to_dcm, rotate_left, rotate_right
from automap.jit import kernel
from automap.records import FloatArray

VEL, PHI, BA, BG, SA, SG, POS = 0, 3, 6, 9, 12, 15, 18
N_STATES = 21
N_ERRORS = 12


@kernel
def run_filter(
    dt: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    gravity: float,
    quat: FloatArray,
    errors: FloatArray,
    P: FloatArray,
    q: FloatArray,
    every: int,
    variance: FloatArray,
    walk: FloatArray,
    out: FloatArray,
    innov: FloatArray,
    response: FloatArray,
) -> int:
    """Filter conditioned readings [n, 3], equations (10) to (28); returns the number of
    measurements.

    ``dt`` [n - 1] s; ``quat`` [4] initial attitude, ``errors`` [12] (biases, then scales,
    accelerometer first) and ``P`` [21, 21] are changed in place. ``q`` [2] white noise
    densities squared of accelerometer and gyro, ``walk`` [12] those of the errors. A
    pseudo-velocity and a pseudo-position with the columns of ``variance`` [n, 2] are taken every
    ``every`` samples. ``out`` [n, 28]
    receives quaternion, errors and the errors' one-sigma; ``innov`` [n, 10] per measurement
    the row, the innovations of velocity, their one-sigma, and those of position.
    ``response`` [m, 21, 27], unless it is empty, receives per measurement how the state after
    it follows from the state after the one before (21 columns) and from what was measured:
    velocity and position of north, of east, of down.
    """
    n = gyro.shape[0]
    v = np.zeros(3)
    place = np.zeros(3)
    c = np.empty((3, 3))
    f = np.empty(3)
    w = np.empty(3)
    F = np.empty((6, N_STATES))
    FP = np.empty((6, N_STATES))
    T = np.empty((N_STATES, N_STATES + 6))
    followed = response.shape[0] > 0
    _identity(T)
    count = 0
    quat_to_dcm(quat, c)
    _store(0, quat, errors, P, out)
    for k in range(1, n):
        h = dt[k - 1]
        for i in range(3):
            fa = 0.5 * (accel[k - 1, i] + accel[k, i])
            wa = 0.5 * (gyro[k - 1, i] + gyro[k, i])
            f[i] = (1.0 + errors[6 + i]) * fa + errors[i]
            w[i] = (1.0 + errors[9 + i]) * wa + errors[3 + i]
        _propagate_covariance(P, c, f, accel, gyro, k, h, F, FP)
        if followed:
            _propagate_response(T, F, h)
        for i in range(3):
            place[i] += 0.5 * v[i] * h
        _propagate(v, quat, c, f, w, h, gravity)
        for i in range(3):
            place[i] += 0.5 * v[i] * h
        for i in range(3):
            P[VEL + i, VEL + i] += q[0] * h
            P[PHI + i, PHI + i] += q[1] * h
        for i in range(N_ERRORS):
            P[BA + i, BA + i] += walk[i] * h
        if k % every == 0:
            innov[count, 0] = k
            for axis in range(3):
                s = P[axis, axis] + variance[k, 0]
                innov[count, 1 + axis] = -v[axis]
                innov[count, 4 + axis] = np.sqrt(s)
                innov[count, 7 + axis] = -place[axis]
                if followed:
                    _update_response(T, P, axis, s, N_STATES + 2 * axis)
                _update(axis, -v[axis], s, v, place, quat, errors, P)
                s = P[POS + axis, POS + axis] + variance[k, 1]
                if followed:
                    _update_response(T, P, POS + axis, s, N_STATES + 2 * axis + 1)
                _update(POS + axis, -place[axis], s, v, place, quat, errors, P)
            quat_to_dcm(quat, c)
            if followed:
                response[count] = T
                _identity(T)
            count += 1
        _store(k, quat, errors, P, out)
    return count


@kernel
def _propagate(
    v: FloatArray,
    quat: FloatArray,
    c: FloatArray,
    f: FloatArray,
    w: FloatArray,
    h: float,
    gravity: float,
) -> None:
    """Velocity and attitude over a step of ``h`` seconds at mean force and rate."""
    x, y, z = w[0] * h, w[1] * h, w[2] * h
    # the increment seen from the start of the step: the body turns by half of it on average
    a = (f[0] + 0.5 * (y * f[2] - z * f[1])) * h
    b = (f[1] + 0.5 * (z * f[0] - x * f[2])) * h
    d = (f[2] + 0.5 * (x * f[1] - y * f[0])) * h
    for i in range(3):
        v[i] += c[i, 0] * a + c[i, 1] * b + c[i, 2] * d
    v[2] += gravity * h
    rotate_right(quat, x, y, z)
    quat_to_dcm(quat, c)


@kernel
def _propagate_covariance(
    P: FloatArray,
    c: FloatArray,
    f: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    k: int,
    h: float,
    F: FloatArray,
    FP: FloatArray,
) -> None:
    """P := (1 + F h) P (1 + F h)^T; only the first six rows of F are not zero."""
    fn0 = c[0, 0] * f[0] + c[0, 1] * f[1] + c[0, 2] * f[2]
    fn1 = c[1, 0] * f[0] + c[1, 1] * f[1] + c[1, 2] * f[2]
    fn2 = c[2, 0] * f[0] + c[2, 1] * f[1] + c[2, 2] * f[2]
    for i in range(6):
        for j in range(N_STATES):
            F[i, j] = 0.0
    # d(C f) for a turn phi of the navigation side is phi x (C f)
    F[0, 4], F[0, 5] = fn2 * h, -fn1 * h
    F[1, 3], F[1, 5] = -fn2 * h, fn0 * h
    F[2, 3], F[2, 4] = fn1 * h, -fn0 * h
    for i in range(3):
        for j in range(3):
            fa = 0.5 * (accel[k - 1, j] + accel[k, j])
            wa = 0.5 * (gyro[k - 1, j] + gyro[k, j])
            F[VEL + i, BA + j] = c[i, j] * h
            F[VEL + i, SA + j] = c[i, j] * fa * h
            F[PHI + i, BG + j] = c[i, j] * h
            F[PHI + i, SG + j] = c[i, j] * wa * h
    # position first, with the velocity of the step's start
    for i in range(3):
        for j in range(N_STATES):
            P[POS + i, j] += h * P[VEL + i, j]
    for i in range(3):
        for j in range(N_STATES):
            P[j, POS + i] += h * P[j, VEL + i]
    for i in range(6):
        for j in range(N_STATES):
            s = 0.0
            for m in range(PHI, POS):
                s += F[i, m] * P[m, j]
            FP[i, j] = s
    for i in range(6):
        for j in range(N_STATES):
            P[i, j] += FP[i, j]
    # now P holds (1 + F) P; the right factor acts on its columns
    for j in range(N_STATES):
        for i in range(6):
            s = 0.0
            for m in range(PHI, POS):
                s += F[i, m] * P[j, m]
            FP[i, j] = s
    for i in range(6):
        for j in range(N_STATES):
            P[j, i] += FP[i, j]


@kernel
def _update(
    state: int,
    y: float,
    s: float,
    v: FloatArray,
    place: FloatArray,
    quat: FloatArray,
    errors: FloatArray,
    P: FloatArray,
) -> None:
    """One component of velocity or position, innovation ``y`` = 0 - state, variance ``s``."""
    gain = np.empty(N_STATES)
    row = np.empty(N_STATES)
    for j in range(N_STATES):
        gain[j] = P[j, state] / s
        row[j] = P[state, j]
    for i in range(3):
        v[i] += gain[i] * y
        place[i] += gain[POS + i] * y
    rotate_left(quat, gain[PHI] * y, gain[PHI + 1] * y, gain[PHI + 2] * y)
    norm = np.sqrt(quat[0] ** 2 + quat[1] ** 2 + quat[2] ** 2 + quat[3] ** 2)
    for i in range(4):
        quat[i] /= norm
    for i in range(N_ERRORS):
        errors[i] += gain[BA + i] * y
    for i in range(N_STATES):
        for j in range(N_STATES):
            P[i, j] -= gain[i] * row[j]
    for i in range(N_STATES):
        for j in range(i):
            m = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = m
            P[j, i] = m


@kernel
def _identity(T: FloatArray) -> None:
    for i in range(T.shape[0]):
        for j in range(T.shape[1]):
            T[i, j] = 0.0
        T[i, i] = 1.0


@kernel
def _propagate_response(T: FloatArray, F: FloatArray, h: float) -> None:
    """T := (1 + F h) T with the ``F`` of _propagate_covariance, position first."""
    row = np.empty(6)
    for j in range(T.shape[1]):
        for i in range(3):
            T[POS + i, j] += h * T[VEL + i, j]
        for i in range(6):
            s = 0.0
            for m in range(PHI, POS):
                s += F[i, m] * T[m, j]
            row[i] = s
        for i in range(6):
            T[i, j] += row[i]


@kernel
def _update_response(T: FloatArray, P: FloatArray, state: int, s: float, column: int) -> None:
    """T := (1 - K H) T, and what is measured enters by K; ``P`` is that before the update."""
    for j in range(T.shape[1]):
        left = T[state, j] / s
        for i in range(T.shape[0]):
            T[i, j] -= P[i, state] * left
    for i in range(T.shape[0]):
        T[i, column] += P[i, state] / s


@kernel
def _store(k: int, quat: FloatArray, errors: FloatArray, P: FloatArray, out: FloatArray) -> None:
    for i in range(4):
        out[k, i] = quat[i]
    for i in range(N_ERRORS):
        out[k, 4 + i] = errors[i]
        out[k, 16 + i] = np.sqrt(max(P[BA + i, BA + i], 0.0))
