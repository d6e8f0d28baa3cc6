"""Kalman updates by scalars, and how far to trust a surprising block."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray

EXACT = 1e-9
"""How near to its threshold a surprising block is brought, in shares of it: else the likelihood
has a step wherever a block begins to surprise, and nobody climbs over those."""


@kernel
def pack(p: FloatArray, out: FloatArray) -> None:
    """Upper triangle of a symmetric matrix [n, n] as a row [n (n + 1) / 2]."""
    n = p.shape[0]
    m = 0
    # loops from zero on, and offsets that cannot be negative: else the compiler looks at every
    # index for one that counts from the end, and takes six times as long
    for i in range(n):
        for j in range(n - i):
            out[m + j] = p[i, i + j]
        m += max(n - i, 0)


@kernel
def unpack(row: FloatArray, p: FloatArray) -> None:
    """The symmetric matrix [n, n] of its packed upper triangle."""
    n = p.shape[0]
    m = 0
    for i in range(n):
        for j in range(n - i):
            p[i, i + j] = row[m + j]
        m += max(n - i, 0)
    for i in range(n):
        for j in range(i):
            p[i, j] = p[j, i]


@kernel
def inflate(
    p: FloatArray,
    h: FloatArray,
    z: FloatArray,
    var: FloatArray,
    rows: int,
    threshold: float,
    limit: float,
) -> float:
    """Factor on ``var`` that brings the block's NIS to ``threshold``.

    The first answer to a surprising measurement is to trust it less; nothing is thrown away,
    so a wrong state cannot lock the truth out, and an outlier's pull falls with its size. G. Chang,
    "Robust Kalman filtering based on Mahalanobis distance as outlier judging criterion", Journal of
    Geodesy 88, 2014.
    """
    n = p.shape[0]
    hph = np.zeros((rows, rows))
    tmp = np.zeros(n)
    for i in range(rows):
        for j in range(n):
            tmp[j] = 0.0
        for k in range(n):
            a = h[i, k]
            if a != 0.0:
                for j in range(n):
                    tmp[j] += a * p[k, j]
        for i2 in range(rows):
            s = 0.0
            for j in range(n):
                s += tmp[j] * h[i2, j]
            hph[i, i2] = s
    factor = 1.0
    while factor < limit:
        nis, fall = _quadratic(hph, z, var, rows, factor)
        if nis <= threshold * (1.0 + EXACT):
            break
        # along the tangent of 1 / NIS, which is concave: from below, and exact for one row
        factor += nis * (nis - threshold) / (threshold * fall)
    return min(factor, limit)


@kernel
def _quadratic(
    hph: FloatArray, z: FloatArray, var: FloatArray, rows: int, factor: float
) -> tuple[float, float]:
    """z' S^-1 z of S = hph + factor diag(var), by Cholesky on the first ``rows``, and how fast it
    falls with ``factor``, z' S^-1 diag(var) S^-1 z."""
    low = np.zeros((rows, rows))
    y = np.zeros(rows)
    total = 0.0
    for i in range(rows):
        for j in range(i + 1):
            s = hph[i, j]
            if i == j:
                s += factor * var[i]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                low[i, i] = math.sqrt(max(s, 1e-300))
            else:
                low[i, j] = s / low[j, j]
        s = z[i]
        for k in range(i):
            s -= low[i, k] * y[k]
        y[i] = s / low[i, i]
        total += y[i] * y[i]
    fall = 0.0
    for i in range(rows - 1, -1, -1):
        for k in range(i + 1, rows):
            y[i] -= low[k, i] * y[k]
        y[i] /= low[i, i]
        fall += var[i] * y[i] * y[i]
    return total, fall


@kernel
def block_gains(
    p: FloatArray,
    h: FloatArray,
    z: FloatArray,
    var: FloatArray,
    dx: FloatArray,
    unit: FloatArray,
    gain: FloatArray,
    nu: FloatArray,
    s: FloatArray,
) -> float:
    """Gains of a block's scalars taken one after the other; returns their NIS.

    Rows ``h`` [m, n], ``z`` [m] the residuals against the nominal state, ``var`` [m], ``dx`` [n]
    the correction so far. Each scalar takes u u' from ``p`` [n, n], which stays as it is, so that
    the next one's h P is corrected by those before: ``unit`` [m, n] receives u, ``gain`` [m, n] the
    gains u / sqrt(s), ``nu`` and ``s`` [m] innovations and their variances. Scalars one after the
    other: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977.
    """
    rows, n = h.shape
    np.dot(h, p, unit)
    nis = 0.0
    for a in range(rows):
        left = z[a]
        for j in range(n):
            left -= h[a, j] * dx[j]
        for b in range(a):
            c = 0.0
            for j in range(n):
                c += h[a, j] * unit[b, j]
            for j in range(n):
                unit[a, j] -= c * unit[b, j]
            left -= c * nu[b] / math.sqrt(s[b])
        spread = var[a]
        for j in range(n):
            spread += h[a, j] * unit[a, j]
        root = 1.0 / math.sqrt(spread)
        for j in range(n):
            unit[a, j] *= root
            gain[a, j] = unit[a, j] * root
        nu[a], s[a] = left, spread
        nis += left * left / spread
    return nis


@kernel
def update_block(
    p: FloatArray, dx: FloatArray, unit: FloatArray, gain: FloatArray, nu: FloatArray
) -> None:
    """Take a block's scalars into ``p`` [n, n] and ``dx`` [n]; see ``block_gains``."""
    rows, n = unit.shape
    for a in range(rows):
        for j in range(n):
            dx[j] += gain[a, j] * nu[a]
    # whole rows: twice the work of a triangle, yet faster
    if rows == 3:
        for i in range(n):
            x, y, w = unit[0, i], unit[1, i], unit[2, i]
            for j in range(n):
                p[i, j] -= x * unit[0, j] + y * unit[1, j] + w * unit[2, j]
        return
    for a in range(rows):
        for i in range(n):
            x = unit[a, i]
            for j in range(n):
                p[i, j] -= x * unit[a, j]
