"""Constant-velocity smoother of one axis: position, velocity, wander of the receiver's error."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import BoolArray, FloatArray


@kernel
def smooth_axis(
    t: FloatArray,
    z: FloatArray,
    used: BoolArray,
    var: FloatArray,
    wander: FloatArray,
    psd: float,
    tau: float,
    nis_limit: float,
    out: FloatArray,
) -> None:
    """Filter and smooth the fixes of one axis.

    ``t`` [n] s, ``z`` [n, 2] position m and velocity m/s, ``used`` [n, 2] which of them are
    there, ``var`` [n, 2] white variances, ``wander`` [n] sigma of the slow error m, ``psd`` of
    the white acceleration, ``tau`` s; a squared innovation beyond ``nis_limit`` variances is
    trusted less. ``out`` [n, 4] receives position, velocity and their sd. White acceleration:
    Bar-Shalom, Li, Kirubarajan, section 6.2.2; backwards modified Bryson-Frazier (Bierman 1973).
    """
    n = t.shape[0]
    x = np.zeros(3)
    for k in range(n):
        if used[k, 0]:
            x[0] = z[k, 0]
            break
    p = np.zeros((3, 3))
    p[0, 0], p[1, 1], p[2, 2] = 100.0**2, 30.0**2, 1.0
    states = np.zeros((n, 3))
    covs = np.zeros((n, 3, 3))
    gains = np.zeros((n, 2, 3))
    nus = np.zeros((n, 2))
    variances = np.zeros((n, 2))
    h = np.zeros(3)
    ph = np.zeros(3)
    for k in range(n):
        dt = t[k] - t[k - 1] if k else 0.0
        _predict(x, p, dt, math.exp(-dt / tau), psd)
        for m in range(2):
            if not used[k, m]:
                continue
            h[:] = 0.0
            h[m] = 1.0
            if m == 0:
                h[2] = wander[k]
            s = var[k, m]
            nu = z[k, m]
            for i in range(3):
                ph[i] = p[i, 0] * h[0] + p[i, 1] * h[1] + p[i, 2] * h[2]
            for i in range(3):
                s += h[i] * ph[i]
                nu -= h[i] * x[i]
            s = max(s, nu * nu / nis_limit)
            for i in range(3):
                x[i] += ph[i] * nu / s
                gains[k, m, i] = ph[i] / s
                for j in range(3):
                    p[i, j] -= ph[i] * ph[j] / s
            nus[k, m] = nu
            variances[k, m] = s
        states[k] = x
        covs[k] = p
    _backward(t, used, wander, tau, states, covs, gains, nus, variances, out)


@kernel
def _predict(x: FloatArray, p: FloatArray, dt: float, d: float, psd: float) -> None:
    x[0] += dt * x[1]
    x[2] *= d
    # rows, then columns, of F P F'
    for j in range(3):
        p[0, j] += dt * p[1, j]
        p[2, j] *= d
    for i in range(3):
        p[i, 0] += dt * p[i, 1]
        p[i, 2] *= d
    p[0, 0] += psd * dt**3 / 3.0
    p[0, 1] += psd * dt * dt / 2.0
    p[1, 0] += psd * dt * dt / 2.0
    p[1, 1] += psd * dt
    p[2, 2] += 1.0 - d * d


@kernel
def _backward(
    t: FloatArray,
    used: BoolArray,
    wander: FloatArray,
    tau: float,
    states: FloatArray,
    covs: FloatArray,
    gains: FloatArray,
    nus: FloatArray,
    variances: FloatArray,
    out: FloatArray,
) -> None:
    n = t.shape[0]
    lam = np.zeros(3)
    big = np.zeros((3, 3))
    a = np.zeros((3, 3))
    b = np.zeros((3, 3))
    h = np.zeros(3)
    for k in range(n - 1, -1, -1):
        cov = covs[k]
        for i in range(2):
            shift = 0.0
            spread = 0.0
            for j in range(3):
                shift += cov[i, j] * lam[j]
                for m in range(3):
                    spread += cov[i, j] * big[j, m] * cov[m, i]
            out[k, i] = states[k, i] - shift
            out[k, 2 + i] = math.sqrt(max(cov[i, i] - spread, 0.0))
        for m in range(1, -1, -1):
            if not used[k, m]:
                continue
            h[:] = 0.0
            h[m] = 1.0
            if m == 0:
                h[2] = wander[k]
            inv = 1.0 / variances[k, m]
            # a := I - K h
            for i in range(3):
                for j in range(3):
                    a[i, j] = (1.0 if i == j else 0.0) - gains[k, m, i] * h[j]
            _sandwich(a, big, b)
            _transposed_times(a, lam)
            for i in range(3):
                lam[i] -= h[i] * nus[k, m] * inv
                for j in range(3):
                    big[i, j] += h[i] * h[j] * inv
        if k > 0:
            dt = t[k] - t[k - 1]
            a[:, :] = 0.0
            a[0, 0] = a[1, 1] = 1.0
            a[0, 1] = dt
            a[2, 2] = math.exp(-dt / tau)
            _sandwich(a, big, b)
            _transposed_times(a, lam)


@kernel
def _sandwich(a: FloatArray, m: FloatArray, work: FloatArray) -> None:
    """m := a' m a."""
    for i in range(3):
        for j in range(3):
            work[i, j] = m[i, 0] * a[0, j] + m[i, 1] * a[1, j] + m[i, 2] * a[2, j]
    for i in range(3):
        for j in range(3):
            m[i, j] = a[0, i] * work[0, j] + a[1, i] * work[1, j] + a[2, i] * work[2, j]


@kernel
def _transposed_times(a: FloatArray, v: FloatArray) -> None:
    """v := a' v."""
    x, y, z = v[0], v[1], v[2]
    for i in range(3):
        v[i] = a[0, i] * x + a[1, i] * y + a[2, i] * z
