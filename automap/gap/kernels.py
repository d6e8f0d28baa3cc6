"""Sensitivity of the filter's innovations to parameters that the filter does not estimate.

The recursion of a consider filter (Bierman, Factorization Methods for Discrete Sequential
Estimation, 1977, section VIII.2) with one column a parameter: between nodes a column moves
with the filter's own transition rows and receives what the parameter adds to the integrated
readings; at a measurement the filter's own gain takes out what it would have corrected. What
is left over, divided by the innovation's sd, is how a unit of the parameter shows.
"""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.kernels.transition import outlasting
from automap.fusion.layout import N_NAV
from automap.jit import kernel
from automap.records import BoolArray, FloatArray, IntArray


@kernel
def propagate_columns(
    t: FloatArray,
    force: FloatArray,
    dcm: FloatArray,
    signals: FloatArray,
    terms: IntArray,
    node_t: FloatArray,
    trans: FloatArray,
    tau: FloatArray,
    keep: FloatArray,
    kept: IntArray,
    scalars: IntArray,
    h: FloatArray,
    gain: FloatArray,
    var: FloatArray,
    direct: FloatArray,
    out: FloatArray,
) -> None:
    """Whitened sensitivities ``out`` [s, c] of the scalars to ``c`` parameters.

    ``t`` [n] s, ``force`` [n, 3] corrected specific force, ``dcm`` [n, 3, 3] body to NED,
    ``signals`` [n, g]. ``terms`` [m, 5]: column, sensor (0 gyro, 1 accelerometer), axis, signal,
    and one that it is multiplied with, or -1. The filter's run: ``node_t`` [k], ``trans``
    [k, 9, n], ``tau`` [n], ``keep`` [k, 6], ``kept`` [n], ``scalars`` [k] running totals, ``h``,
    ``gain`` [s, n], ``var`` [s]. ``direct`` [s, d]: the last ``d`` columns also act on the scalars
    themselves.
    """
    n_nodes, n_col = node_t.shape[0], out.shape[1]
    n = tau.shape[0]
    first_direct = n_col - direct.shape[1]
    e = np.zeros((n, n_col))
    moved = np.zeros((N_NAV, n_col))
    psi = np.zeros((N_NAV, n_col))
    seen = np.zeros(n_col)
    decay = np.ones(n)
    i = 0
    n_t = t.shape[0]
    done = 0
    acting = np.zeros(n_col, dtype=np.bool_)
    # what is nothing until an instant leaves nothing behind until then
    begun = first_direct < n_col
    for k in range(n_nodes):
        if k > 0 and node_t[k] > node_t[k - 1]:
            psi[:, :] = 0.0
            acting[:] = False
            now = node_t[k - 1]
            while i < n_t - 2 and t[i + 1] <= now:
                i += 1
            while now < node_t[k]:
                nxt = min(t[i + 1], node_t[k]) if i < n_t - 2 else node_t[k]
                dt = nxt - now
                s = (0.5 * (now + nxt) - t[i]) / (t[i + 1] - t[i])
                _advance(psi, acting, force, dcm, signals, terms, i, s, dt)
                now = nxt
                if i < n_t - 2 and now >= t[i + 1]:
                    i += 1
            begun = begun or acting.any()
            if begun:
                _carry(e, moved, psi, trans[k])
            span = node_t[k] - node_t[k - 1]
            outlasting(span, tau, kept, keep[k], decay)
            for j in range(N_NAV, n):
                if tau[j] > 0.0:
                    for c in range(n_col):
                        e[j, c] *= decay[j]
        for a in range(done, scalars[k] if begun else done):
            for c in range(first_direct):
                seen[c] = 0.0
            for c in range(first_direct, n_col):
                seen[c] = direct[a, c - first_direct]
            for j in range(n):
                g = h[a, j]
                if g != 0.0:
                    for c in range(n_col):
                        seen[c] += g * e[j, c]
            for j in range(n):
                g = gain[a, j]
                for c in range(n_col):
                    e[j, c] -= g * seen[c]
            inv = 1.0 / math.sqrt(var[a])
            for c in range(n_col):
                out[a, c] = inv * seen[c]
        done = scalars[k]


@kernel
def _advance(
    psi: FloatArray,
    acting: BoolArray,
    force: FloatArray,
    dcm: FloatArray,
    signals: FloatArray,
    terms: IntArray,
    i: int,
    s: float,
    dt: float,
) -> None:
    """Advance what the parameters have added since the last node over one step.

    ``s`` the middle of the step as a share of the way from sample i to i + 1.
    """
    c = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            c[a, b] = dcm[i, a, b] + s * (dcm[i + 1, a, b] - dcm[i, a, b])
    f0 = force[i, 0] + s * (force[i + 1, 0] - force[i, 0])
    f1 = force[i, 1] + s * (force[i + 1, 1] - force[i, 1])
    f2 = force[i, 2] + s * (force[i + 1, 2] - force[i, 2])
    fn = (c[0, 0] * f0 + c[0, 1] * f1 + c[0, 2] * f2) * dt
    fe = (c[1, 0] * f0 + c[1, 1] * f1 + c[1, 2] * f2) * dt
    fd = (c[2, 0] * f0 + c[2, 1] * f1 + c[2, 2] * f2) * dt
    # half of the turn before the forces act, half after
    for half in range(2):
        for m in range(terms.shape[0]):
            j, axis, b, d = terms[m, 0], terms[m, 2], terms[m, 3], terms[m, 4]
            u = (signals[i, b] + s * (signals[i + 1, b] - signals[i, b])) * dt
            if u == 0.0:
                continue
            if d >= 0:
                u *= signals[i, d] + s * (signals[i + 1, d] - signals[i, d])
            acting[j] = True
            if terms[m, 1] == 0:
                psi[6, j] -= 0.5 * c[0, axis] * u
                psi[7, j] -= 0.5 * c[1, axis] * u
                psi[8, j] -= 0.5 * c[2, axis] * u
            elif half == 1:
                psi[0, j] -= 0.5 * c[0, axis] * u * dt
                psi[1, j] -= 0.5 * c[1, axis] * u * dt
                psi[2, j] -= 0.5 * c[2, axis] * u * dt
                psi[3, j] -= c[0, axis] * u
                psi[4, j] -= c[1, axis] * u
                psi[5, j] -= c[2, axis] * u
        if half == 0:
            for j in range(psi.shape[1]):
                if acting[j]:
                    x, y, z = psi[6, j], psi[7, j], psi[8, j]
                    dn = fd * y - fe * z
                    de = fn * z - fd * x
                    dd = fe * x - fn * y
                    psi[0, j] += (psi[3, j] + 0.5 * dn) * dt
                    psi[1, j] += (psi[4, j] + 0.5 * de) * dt
                    psi[2, j] += (psi[5, j] + 0.5 * dd) * dt
                    psi[3, j] += dn
                    psi[4, j] += de
                    psi[5, j] += dd


@kernel
def _carry(e: FloatArray, moved: FloatArray, psi: FloatArray, phi: FloatArray) -> None:
    """Navigation rows of ``e`` := phi e + psi."""
    n, n_col = e.shape
    for a in range(N_NAV):
        for c in range(n_col):
            moved[a, c] = psi[a, c]
        for j in range(n):
            g = phi[a, j]
            if g != 0.0:
                for c in range(n_col):
                    moved[a, c] += g * e[j, c]
    for a in range(N_NAV):
        for c in range(n_col):
            e[a, c] = moved[a, c]


@kernel
def whiten_columns(
    phi: FloatArray, rows: IntArray, before: IntArray, ar: FloatArray, factor: FloatArray
) -> None:
    """Some ``rows`` [r] of ``phi`` [s, c] less their prediction from rows ``before`` [s, p] by
    coefficients ``ar`` [s, p], times a ``factor`` [s]: in place, the first r rows. What was before
    the first, -1, was nothing, and what was before a row stands above it."""
    for j in range(phi.shape[1]):
        for r in range(rows.shape[0] - 1, -1, -1):
            i = rows[r]
            value = float(phi[i, j])
            for k in range(ar.shape[1]):
                if before[i, k] >= 0:
                    value -= ar[i, k] * phi[before[i, k], j]
            phi[i, j] = factor[i] * value
        for r in range(rows.shape[0]):
            phi[r, j] = phi[rows[r], j]
