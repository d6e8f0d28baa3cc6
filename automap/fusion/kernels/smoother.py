"""The modified Bryson-Frazier smoother (Bierman 1973) over the nodes."""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import ForwardStore
from automap.fusion.kernels.transition import outlasting
from automap.fusion.kernels.update import unpack
from automap.fusion.layout import N_NAV
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def undo_scalar(
    lam: FloatArray,
    big: FloatArray,
    h: FloatArray,
    gain: FloatArray,
    nu: float,
    var: float,
    work: FloatArray,
    where: IntArray,
) -> None:
    """Carry the adjoint ``lam`` [n] and its covariance ``big`` [n, n] back over an update.

    big := (I - K h)' big (I - K h) + h' h / var; a row ``h`` is mostly zero.
    """
    n = lam.shape[0]
    inv = 1.0 / var
    kl = 0.0
    klk = 0.0
    used = 0
    for i in range(n):
        kl += gain[i] * lam[i]
        s = 0.0
        for j in range(n):
            s += big[i, j] * gain[j]
        work[i] = s
        klk += s * gain[i]
        if h[i] != 0.0:
            where[used] = i
            used += 1
    g = kl + nu * inv
    w = klk + inv
    for m in range(used):
        i = where[m]
        hi = h[i]
        lam[i] -= hi * g
        for j in range(n):
            big[i, j] -= hi * work[j]
            big[j, i] -= hi * work[j]
    for m in range(used):
        i = where[m]
        for r in range(used):
            j = where[r]
            big[i, j] += h[i] * h[j] * w


@kernel
def undo_interval(
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
        work[j] = decay[j] * lam[j] if j >= N_NAV else 0.0
    for m in range(N_NAV):
        for j in range(n):
            work[j] += phi[m, j] * lam[m]
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
        d = decay[i] if i >= N_NAV else 0.0
        for j in range(i, n):
            big[i, j] = d * u[i, j]
        for m in range(N_NAV):
            a = phi[m, i]
            if a != 0.0:
                for j in range(i, n):
                    big[i, j] += a * u[m, j]
    for i in range(n):
        for j in range(i):
            big[i, j] = big[j, i]


@kernel
def _smoothed_rows(
    cov: FloatArray, big: FloatArray, rows: IntArray, u: FloatArray, out: FloatArray
) -> None:
    """out := rows and columns ``rows`` of cov - cov big cov, symmetric."""
    n = cov.shape[0]
    for r in range(rows.shape[0]):
        for j in range(n):
            u[r, j] = 0.0
        for m in range(n):
            a = cov[rows[r], m]
            for j in range(n):
                u[r, j] += a * big[m, j]
    for r in range(rows.shape[0]):
        for c in range(r, rows.shape[0]):
            s = 0.0
            for m in range(n):
                s += u[r, m] * cov[rows[c], m]
            v = cov[rows[r], rows[c]] - s
            out[r, c] = v
            out[c, r] = v


@kernel
def _smoothed_variances(cov: FloatArray, big: FloatArray, out: FloatArray) -> None:
    """out [n - 9] := the parameters' part of the diagonal of cov - cov big cov."""
    n = cov.shape[0]
    for i in range(N_NAV, n):
        s = 0.0
        for m in range(n):
            t = 0.0
            for j in range(n):
                t += big[m, j] * cov[i, j]
            s += t * cov[i, m]
        out[i - N_NAV] = cov[i, i] - s


@kernel
def run_smoother(
    node_t: FloatArray,
    keep: FloatArray,
    kept: IntArray,
    tau: FloatArray,
    store: ForwardStore,
    rows: IntArray,
    every_s: float,
    lam: FloatArray,
    big: FloatArray,
    dx: FloatArray,
    cov_rows: FloatArray,
    variances: FloatArray,
) -> None:
    """Corrections ``dx`` [k, n] to the forward estimates, with their covariances.

    ``lam`` [n] and ``big`` [n, n] the adjoint after the last node, zero at the end of a drive;
    they are left as they are before the first. G. J. Bierman, "Fixed interval smoothing with
    discrete measurements", International Journal of Control 18, 1973.

    ``keep`` [k, 3] and ``kept`` [n] as in the forward pass. They refer to the state after the
    update of each node. ``cov_rows`` [k, r, r] receives the
    covariance of the states ``rows`` [r], or is empty; ``variances`` [k, n - 9] those of the
    parameters, at least every ``every_s`` seconds (NaN between).
    """
    n_nodes, n = dx.shape
    u = np.zeros((n, n))
    cov = np.zeros((n, n))
    work = np.zeros(n)
    where = np.zeros(n, dtype=np.int64)
    decay = np.ones(n)
    noted = np.inf
    for k in range(n_nodes - 1, -1, -1):
        unpack(store.cov[k], cov)
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += cov[i, j] * lam[j]
            dx[k, i] = -s
        if cov_rows.shape[0] > 0:
            _smoothed_rows(cov, big, rows, u, cov_rows[k])
        if k == 0 or noted - node_t[k] >= every_s:
            _smoothed_variances(cov, big, variances[k])
            noted = node_t[k]
        else:
            variances[k, :] = np.nan
        first = store.scalars[k - 1] if k > 0 else 0
        for r in range(store.scalars[k] - 1, first - 1, -1):
            undo_scalar(lam, big, store.h[r], store.gain[r], store.nu[r], store.var[r], work, where)
        if k > 0:
            span = node_t[k] - node_t[k - 1]
            outlasting(span, tau, kept, keep[k], decay)
            undo_interval(lam, big, store.trans[k], decay, u, work)
