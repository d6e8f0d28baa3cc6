"""The modified Bryson-Frazier smoother (Bierman 1973) over the nodes.

Products of small matrices go through BLAS: on matrices of this size it takes half the time of
loops. All else runs along rows.
"""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import ForwardStore
from automap.fusion.kernels.transition import outlasting, reach
from automap.fusion.kernels.update import unpack
from automap.fusion.layout import MAX_SCALARS, N_NAV
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def undo_scalars(
    lam: FloatArray,
    big: FloatArray,
    h: FloatArray,
    gain: FloatArray,
    nu: FloatArray,
    var: FloatArray,
    error: FloatArray,
    spread: FloatArray,
) -> None:
    """Carry the adjoint ``lam`` [n] and its covariance ``big`` [n, n] back over a node's scalars.

    Rows ``h``, ``gain`` K' [s, n], ``nu``, ``var`` [s] in the order of the updates; the last is
    undone first. Over one of them, with w = big K,

        lam := lam - h' e                e = K' lam + nu / var
        big := (I - K h)' big (I - K h) + h' h / var = big - h' v' - v h
                                         v = w - s h' / 2,  s = K' w + 1 / var

    so that an earlier scalar needs no more of the new ``big`` than its own product with it,
    w_i := w_i - h' (v' K_i) - v (h K_i), and ``big`` is gone through twice for all scalars.
    ``error`` [s] receives e, the smoothed measurement error over its variance, ``spread`` [s] the
    variance s of that.
    """
    scalars, n = h.shape
    if scalars == 0:
        return
    w = np.dot(gain, big)
    hk = np.dot(h, gain.T)
    for q in range(scalars - 1, -1, -1):
        inverse = 1.0 / var[q]
        e, s = nu[q] * inverse, inverse
        for j in range(n):
            e += gain[q, j] * lam[j]
            s += gain[q, j] * w[q, j]
        error[q], spread[q] = e, s
        half = 0.5 * s
        for j in range(n):
            lam[j] -= e * h[q, j]
            # from here on v
            w[q, j] -= half * h[q, j]
        for i in range(q):
            vk = 0.0
            for j in range(n):
                vk += w[q, j] * gain[i, j]
            for j in range(n):
                w[i, j] -= hk[q, i] * w[q, j] + vk * h[q, j]
    hv = np.dot(h.T, w)
    for i in range(n):
        for j in range(i + 1):
            big[i, j] -= hv[i, j] + hv[j, i]
    for i in range(n):
        for j in range(i):
            big[j, i] = big[i, j]


@kernel
def undo_interval(lam: FloatArray, big: FloatArray, phi: FloatArray, decay: FloatArray) -> None:
    """Carry the adjoint back over an interval: lam := F' lam, big := F' big F.

    F = [phi; 0 D] with the navigation's rows ``phi`` [9, n] and D the diagonal of ``decay`` [n]
    from the tenth on. Of the columns of ``phi`` only the first r are not zero: with

        M = B_nn phi / 2 + [0 B_np D]  [9, n],  F' big F = phi' M + M' phi + [0 0; 0 D B_pp D]

    the products are those of 9 rows with r columns instead of n with n.
    """
    n = lam.shape[0]
    r = reach(phi)
    shown = np.empty((N_NAV, r))
    half = np.empty((N_NAV, N_NAV))
    for a in range(N_NAV):
        for j in range(r):
            shown[a, j] = phi[a, j]
        for b in range(N_NAV):
            half[a, b] = 0.5 * big[a, b]
    for j in range(N_NAV, n):
        lam[j] *= decay[j]
    carried = np.dot(lam[:N_NAV], shown)
    for j in range(N_NAV):
        lam[j] = carried[j]
    for j in range(N_NAV, r):
        lam[j] += carried[j]
    square = np.dot(half, shown)
    m = np.zeros((N_NAV, n))
    for a in range(N_NAV):
        for j in range(N_NAV, n):
            m[a, j] = big[a, j] * decay[j]
        for j in range(r):
            m[a, j] += square[a, j]
    moved = np.dot(shown.T, m)
    for i in range(N_NAV):
        for j in range(n):
            big[i, j] = moved[i, j]
    for i in range(N_NAV, n):
        for j in range(n):
            big[i, j] *= decay[i] * decay[j]
    for i in range(N_NAV, r):
        for j in range(n):
            big[i, j] += moved[i, j]
    for i in range(r):
        for j in range(r):
            big[i, j] += moved[j, i]
    for i in range(n):
        for j in range(i):
            big[i, j] = big[j, i]


@kernel
def _smoothed_rows(cov: FloatArray, big: FloatArray, rows: IntArray, out: FloatArray) -> None:
    """out := rows and columns ``rows`` of cov - cov big cov, symmetric."""
    n = cov.shape[0]
    some = np.empty((rows.shape[0], n))
    for r in range(rows.shape[0]):
        for j in range(n):
            some[r, j] = cov[rows[r], j]
    less = np.dot(np.dot(some, big), some.T)
    for r in range(rows.shape[0]):
        for c in range(r + 1):
            v = some[r, rows[c]] - less[r, c]
            out[r, c] = v
            out[c, r] = v


@kernel
def _smoothed_variances(cov: FloatArray, big: FloatArray, out: FloatArray) -> None:
    """out [n - 9] := the parameters' part of the diagonal of cov - cov big cov."""
    n = cov.shape[0]
    product = np.dot(cov[N_NAV:], big)
    for i in range(N_NAV, n):
        s = 0.0
        for m in range(n):
            s += product[i - N_NAV, m] * cov[i, m]
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

    ``keep`` [k, 6] and ``kept`` [n] as in the forward pass. They refer to the state after the
    update of each node. ``cov_rows`` [k, r, r] receives the
    covariance of the states ``rows`` [r], or is empty; ``variances`` [k, n - 9] those of the
    parameters, at least every ``every_s`` seconds (NaN between).
    """
    n_nodes, n = dx.shape
    cov = np.zeros((n, n))
    error, spread = np.zeros(MAX_SCALARS), np.zeros(MAX_SCALARS)
    decay = np.ones(n)
    noted = np.inf
    for k in range(n_nodes - 1, -1, -1):
        unpack(store.cov[k], cov)
        dx[k, :] = -np.dot(cov, lam)
        if cov_rows.shape[0] > 0:
            _smoothed_rows(cov, big, rows, cov_rows[k])
        if k == 0 or noted - node_t[k] >= every_s:
            _smoothed_variances(cov, big, variances[k])
            noted = node_t[k]
        else:
            variances[k, :] = np.nan
        a, b = store.scalars[k - 1] if k > 0 else 0, store.scalars[k]
        undo_scalars(
            lam, big, store.h[a:b], store.gain[a:b], store.nu[a:b], store.var[a:b], error, spread
        )
        if k > 0:
            span = node_t[k] - node_t[k - 1]
            outlasting(span, tau, kept, keep[k], decay)
            undo_interval(lam, big, store.trans[k], decay)
