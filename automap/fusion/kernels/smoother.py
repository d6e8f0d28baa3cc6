"""The modified Bryson-Frazier smoother (Bierman 1973) over the nodes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from automap.fusion.kernels.arrays import ForwardStore
from automap.fusion.layout import N_NAV
from automap.records import FloatArray


@njit(cache=True)
def _undo_scalar(
    lam: FloatArray,
    big: FloatArray,
    h: FloatArray,
    gain: FloatArray,
    nu: float,
    var: float,
    work: FloatArray,
) -> None:
    """Carry the adjoint ``lam`` [n] and its covariance ``big`` [n, n] back over an update."""
    n = lam.shape[0]
    inv = 1.0 / var
    kl = 0.0
    klk = 0.0
    for i in range(n):
        kl += gain[i] * lam[i]
        s = 0.0
        for j in range(n):
            s += big[i, j] * gain[j]
        work[i] = s
        klk += s * gain[i]
    g = kl + nu * inv
    w = klk + inv
    for i in range(n):
        hi = h[i]
        wi = work[i]
        if hi != 0.0:
            lam[i] -= hi * g
            for j in range(n):
                big[i, j] += h[j] * (hi * w - wi) - hi * work[j]
        else:
            for j in range(n):
                big[i, j] -= wi * h[j]


@njit(cache=True)
def _undo_interval(
    lam: FloatArray,
    big: FloatArray,
    phi: FloatArray,
    decay: FloatArray,
    u: FloatArray,
    work: FloatArray,
) -> None:
    """Carry the adjoint back over an interval: lam := F' lam, big := F' big F."""
    n = lam.shape[0]
    for j in range(n):
        s = decay[j] * lam[j] if j >= N_NAV else 0.0
        for m in range(N_NAV):
            s += phi[m, j] * lam[m]
        work[j] = s
    for j in range(n):
        lam[j] = work[j]
    for i in range(n):
        for j in range(N_NAV):
            u[i, j] = 0.0
        for j in range(N_NAV, n):
            u[i, j] = big[i, j] * decay[j]
        for m in range(N_NAV):
            a = big[i, m]
            for j in range(n):
                u[i, j] += a * phi[m, j]
    for i in range(n):
        for j in range(n):
            big[i, j] = decay[i] * u[i, j] if i >= N_NAV else 0.0
        for m in range(N_NAV):
            a = phi[m, i]
            if a != 0.0:
                for j in range(n):
                    big[i, j] += a * u[m, j]
    # rounding must not make it unsymmetric
    for i in range(n):
        for j in range(i):
            v = 0.5 * (big[i, j] + big[j, i])
            big[i, j] = v
            big[j, i] = v


@njit(cache=True)
def _smoothed_covariance(cov: FloatArray, big: FloatArray, u: FloatArray, out: FloatArray) -> None:
    """out := cov - cov big cov, symmetric."""
    n = cov.shape[0]
    for i in range(n):
        for j in range(n):
            u[i, j] = 0.0
        for m in range(n):
            a = cov[i, m]
            if a != 0.0:
                for j in range(n):
                    u[i, j] += a * big[m, j]
    for i in range(n):
        for j in range(i, n):
            s = cov[i, j]
            for m in range(n):
                s -= u[i, m] * cov[j, m]
            out[i, j] = s
            out[j, i] = s


@njit(cache=True)
def run_smoother(
    node_t: FloatArray, tau: FloatArray, store: ForwardStore, dx: FloatArray, p_s: FloatArray
) -> None:
    """Corrections ``dx`` [k, n] to the forward estimates, covariances ``p_s`` [k, n, n].

    They refer to the state after the update of each node.
    """
    n_nodes, n = dx.shape
    lam = np.zeros(n)
    big = np.zeros((n, n))
    u = np.zeros((n, n))
    work = np.zeros(n)
    decay = np.ones(n)
    for k in range(n_nodes - 1, -1, -1):
        cov = store.cov[k]
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += cov[i, j] * lam[j]
            dx[k, i] = -s
        _smoothed_covariance(cov, big, u, p_s[k])
        first = store.scalars[k - 1] if k > 0 else 0
        for r in range(store.scalars[k] - 1, first - 1, -1):
            _undo_scalar(lam, big, store.h[r], store.gain[r], store.nu[r], store.var[r], work)
        if k > 0:
            span = node_t[k] - node_t[k - 1]
            for j in range(N_NAV, n):
                decay[j] = math.exp(-span / tau[j]) if tau[j] > 0.0 else 1.0
            _undo_interval(lam, big, store.trans[k], decay, u, work)
