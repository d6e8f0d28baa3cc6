"""Constant-velocity smoother of one axis: position, velocity, and what of the receiver's errors of
either lasts."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import BoolArray, FloatArray

# position, velocity, lasting error of position, of velocity, both in units of their size
N = 4


@kernel
def smooth_axis(
    t: FloatArray,
    z: FloatArray,
    used: BoolArray,
    var: FloatArray,
    lasting: FloatArray,
    psd: float,
    tau: tuple[float, float],
    nis_limit: float,
    out: FloatArray,
) -> float:
    """Filter and smooth the fixes of one axis; returns the likelihood of the innovations in nats,
    but for a constant.

    ``t`` [n] s, ``z`` [n, 2] position m and velocity m/s, ``used`` [n, 2] which of them are
    there, ``var`` [n, 2] white variances, ``lasting`` [n, 2] sigmas of the errors that last for
    ``tau`` s, ``psd`` of the white acceleration; a squared innovation beyond ``nis_limit``
    variances is trusted less. ``out`` [n, 4] receives position, velocity and their sd, or is empty.
    White acceleration: Bar-Shalom, Li, Kirubarajan, 6.2.2; backwards modified Bryson-Frazier
    (Bierman 1973).
    """
    n = t.shape[0]
    x = np.zeros(N)
    for k in range(n):
        if used[k, 0]:
            x[0] = z[k, 0]
            break
    p = np.zeros((N, N))
    start(p)
    f = np.zeros((N, N))
    work = np.zeros((N, N))
    states = np.zeros((n, N))
    covs = np.zeros((n, N, N))
    gains = np.zeros((n, 2, N))
    nus = np.zeros((n, 2))
    variances = np.zeros((n, 2))
    ph = np.zeros(N)
    score = 0.0
    for k in range(n):
        dt = t[k] - t[k - 1] if k else 0.0
        step(f, dt, tau)
        x[0] += dt * x[1]
        x[2] *= f[2, 2]
        x[3] *= f[3, 3]
        predict(p, f, dt, psd, work)
        for m in range(2):
            if not used[k, m]:
                continue
            # a row of the observation: the state itself and its lasting error
            share = lasting[k, m]
            nu = z[k, m] - x[m] - share * x[2 + m]
            for i in range(N):
                ph[i] = p[i, m] + share * p[i, 2 + m]
            s = var[k, m] + ph[m] + share * ph[2 + m]
            s = max(s, nu * nu / nis_limit)
            for i in range(N):
                x[i] += ph[i] * nu / s
                gains[k, m, i] = ph[i] / s
                for j in range(N):
                    p[i, j] -= ph[i] * ph[j] / s
            score -= 0.5 * (math.log(s) + nu * nu / s)
            nus[k, m] = nu
            variances[k, m] = s
        states[k] = x
        covs[k] = p
    if len(out):
        _backward(t, used, lasting, tau, states, covs, gains, nus, variances, out)
    return score


@kernel
def start(p: FloatArray) -> None:
    """Covariance of a state that nothing is known of but the sizes of lasting errors."""
    p[0, 0], p[1, 1], p[2, 2], p[3, 3] = 100.0**2, 30.0**2, 1.0, 1.0


@kernel
def step(f: FloatArray, dt: float, tau: tuple[float, float]) -> None:
    """Transition over ``dt`` s."""
    f[:, :] = 0.0
    f[0, 0] = f[1, 1] = 1.0
    f[0, 1] = dt
    f[2, 2] = math.exp(-dt / tau[0])
    f[3, 3] = math.exp(-dt / tau[1])


@kernel
def predict(p: FloatArray, f: FloatArray, dt: float, psd: float, work: FloatArray) -> None:
    """Covariance ``p`` after ``dt`` s by the transition ``f``."""
    for i in range(N):
        for j in range(N):
            work[i, j] = f[i, i] * p[i, j]
    for j in range(N):
        work[0, j] += dt * p[1, j]
    for i in range(N):
        for j in range(N):
            p[i, j] = work[i, j] * f[j, j]
        p[i, 0] += dt * work[i, 1]
    p[0, 0] += psd * dt**3 / 3.0
    p[0, 1] += psd * dt * dt / 2.0
    p[1, 0] += psd * dt * dt / 2.0
    p[1, 1] += psd * dt
    p[2, 2] += 1.0 - f[2, 2] * f[2, 2]
    p[3, 3] += 1.0 - f[3, 3] * f[3, 3]


@kernel
def _backward(
    t: FloatArray,
    used: BoolArray,
    lasting: FloatArray,
    tau: tuple[float, float],
    states: FloatArray,
    covs: FloatArray,
    gains: FloatArray,
    nus: FloatArray,
    variances: FloatArray,
    out: FloatArray,
) -> None:
    n = t.shape[0]
    lam = np.zeros(N)
    big = np.zeros((N, N))
    a = np.zeros((N, N))
    work = np.zeros((N, N))
    held = np.zeros(N)
    h = np.zeros(N)
    for k in range(n - 1, -1, -1):
        cov = covs[k]
        for i in range(2):
            shift = 0.0
            spread = 0.0
            for j in range(N):
                shift += cov[i, j] * lam[j]
                for m in range(N):
                    spread += cov[i, j] * big[j, m] * cov[m, i]
            out[k, i] = states[k, i] - shift
            out[k, 2 + i] = math.sqrt(max(cov[i, i] - spread, 0.0))
        for m in range(1, -1, -1):
            if not used[k, m]:
                continue
            h[:] = 0.0
            h[m] = 1.0
            h[2 + m] = lasting[k, m]
            inv = 1.0 / variances[k, m]
            # a := I - K h
            for i in range(N):
                for j in range(N):
                    a[i, j] = (1.0 if i == j else 0.0) - gains[k, m, i] * h[j]
            _sandwich(a, big, lam, work, held)
            for i in range(N):
                lam[i] -= h[i] * nus[k, m] * inv
                for j in range(N):
                    big[i, j] += h[i] * h[j] * inv
        if k > 0:
            step(a, t[k] - t[k - 1], tau)
            _sandwich(a, big, lam, work, held)


@kernel
def _sandwich(
    a: FloatArray, m: FloatArray, v: FloatArray, work: FloatArray, held: FloatArray
) -> None:
    """m := a' m a and v := a' v."""
    for i in range(N):
        held[i] = v[i]
        for j in range(N):
            work[i, j] = 0.0
            for k in range(N):
                work[i, j] += m[i, k] * a[k, j]
    for i in range(N):
        v[i] = 0.0
        for k in range(N):
            v[i] += a[k, i] * held[k]
        for j in range(N):
            m[i, j] = 0.0
            for k in range(N):
                m[i, j] += a[k, i] * work[k, j]
