"""Kalman updates by scalars, and how far to trust a surprising block."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray


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
    while True:
        nis = _quadratic(hph, z, var, rows, factor)
        if nis <= threshold or factor >= limit:
            return factor
        factor *= max(1.3, min(nis / threshold, 10.0))


@kernel
def _quadratic(hph: FloatArray, z: FloatArray, var: FloatArray, rows: int, factor: float) -> float:
    """z' (hph + factor diag(var))^-1 z by Cholesky on the first ``rows``."""
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
    return total


@kernel
def update_scalar(
    p: FloatArray, h: FloatArray, z: float, var: float, dx: FloatArray, k_out: FloatArray
) -> tuple[float, float]:
    """One scalar Kalman update of ``p`` [n, n] and ``dx`` [n]; returns innovation and its variance.

    ``z`` is the residual against the nominal state; ``dx`` the correction so far. The gain is
    left in ``k_out`` [n]. Scalars one after the other: Bierman, Factorization Methods for Discrete
    Sequential Estimation, 1977.
    """
    n = p.shape[0]
    for j in range(n):
        k_out[j] = 0.0
    for i in range(n):
        a = h[i]
        if a != 0.0:
            for j in range(n):
                k_out[j] += a * p[i, j]
    s = var
    nu = z
    for i in range(n):
        a = h[i]
        if a != 0.0:
            s += a * k_out[i]
            nu -= a * dx[i]
    root = 1.0 / math.sqrt(s)
    for j in range(n):
        k_out[j] *= root
    # whole rows: twice the work of a triangle, yet faster, and exactly symmetric
    for i in range(n):
        ki = k_out[i]
        for j in range(n):
            p[i, j] -= ki * k_out[j]
    for j in range(n):
        k_out[j] *= root
        dx[j] += k_out[j] * nu
    return nu, s
