"""Sums of the joint adjustment of one tile.

The sightings of one drive are one observation of its signs, with the covariance
Sigma = own + shared, where shared[i, j] = sd_i sd_j exp(-|t_i - t_j| / tau) per axis. So the
offsets need no unknowns of their own: the normal matrix of the signs is the sum over drives
of P' Sigma^-1 P, with P picking the drive's signs.
"""

from __future__ import annotations

import numpy as np

from automap.jit import kernel_with
from automap.records import FloatArray, IntArray


@kernel_with(nogil=True)
def covariance_of_drive(
    lo: int,
    hi: int,
    axes: int,
    time_s: FloatArray,
    own: FloatArray,
    shared_sd: FloatArray,
    tau_s: float,
) -> FloatArray:
    """Covariance [axes * n, axes * n] of rows lo to hi of one drive, axis after axis per row.

    ``own`` [n, 3] is (ee, en, nn) for two axes and (uu, -, -) for one; ``shared_sd`` [n, 2].
    """
    n = hi - lo
    total = np.zeros((axes * n, axes * n))
    for i in range(n):
        for j in range(i + 1):
            keep = np.exp(-abs(time_s[lo + i] - time_s[lo + j]) / tau_s)
            for axis in range(axes):
                value = keep * shared_sd[lo + i, axis] * shared_sd[lo + j, axis]
                total[axes * i + axis, axes * j + axis] = value
                total[axes * j + axis, axes * i + axis] = value
        total[axes * i, axes * i] += own[lo + i, 0]
        if axes == 2:
            total[2 * i, 2 * i + 1] += own[lo + i, 1]
            total[2 * i + 1, 2 * i] += own[lo + i, 1]
            total[2 * i + 1, 2 * i + 1] += own[lo + i, 2]
    return total


@kernel_with(nogil=True)
def invert(matrix: FloatArray) -> float:
    """Replace a positive definite matrix [n, n] by its inverse; returns log det of it.

    Cholesky factor, its inverse, and the product of that with itself; every inner loop adds one row
    to another, so that it runs in vector registers with each sum in its own order. NaN where
    the matrix is not positive definite.
    """
    n = len(matrix)
    log_det = 0.0
    # the factor's columns lie in the rows of the upper triangle
    for j in range(n):
        pivot = np.sqrt(matrix[j, j])
        log_det += 2.0 * np.log(pivot)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            matrix[j, i] /= pivot
        for k in range(j + 1, n):
            value = matrix[j, k]
            for i in range(k, n):
                matrix[k, i] -= value * matrix[j, i]
    inverse = np.zeros((n, n))
    for i in range(n):
        inverse[i, i] = 1.0
        for k in range(i):
            value = matrix[k, i]
            for j in range(k + 1):
                inverse[i, j] -= value * inverse[k, j]
        pivot = matrix[i, i]
        for j in range(i + 1):
            inverse[i, j] /= pivot
    matrix[:] = 0.0
    for k in range(n):
        for i in range(k + 1):
            value = inverse[k, i]
            for j in range(i + 1):
                matrix[i, j] += value * inverse[k, j]
    for i in range(n):
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return log_det


@kernel_with(nogil=True)
def add_drives(
    first: IntArray,
    sign: IntArray,
    axes: int,
    time_s: FloatArray,
    measured: FloatArray,
    own: FloatArray,
    shared_sd: FloatArray,
    tau_s: float,
    normal: FloatArray,
    right: FloatArray,
    weights: FloatArray,
) -> float:
    """Add all drives of a tile to ``normal`` [axes m, axes m] and ``right`` [axes m].

    Drive d has rows first[d] to first[d + 1]; ``sign`` [n] is the place of each row's sign
    in the tile, ``measured`` [n, 2] m. ``weights`` gets the drives' Sigma^-1 one after another.
    Returns the drives' part of twice the negative log likelihood: sum of log det Sigma and
    z' Sigma^-1 z.
    """
    total = 0.0
    filled = 0
    for d in range(len(first) - 1):
        lo, hi = first[d], first[d + 1]
        n = hi - lo
        weight = covariance_of_drive(lo, hi, axes, time_s, own, shared_sd, tau_s)
        total += invert(weight)
        weights[filled : filled + weight.size] = weight.ravel()
        filled += weight.size
        for i in range(n):
            for a in range(axes):
                row = axes * sign[lo + i] + a
                value = 0.0
                for j in range(n):
                    for b in range(axes):
                        w = weight[axes * i + a, axes * j + b]
                        normal[row, axes * sign[lo + j] + b] += w
                        value += w * measured[lo + j, b]
                right[row] += value
                total += measured[lo + i, a] * value
    return total


@kernel_with(nogil=True)
def drive_offsets(
    first: IntArray,
    sign: IntArray,
    axes: int,
    time_s: FloatArray,
    measured: FloatArray,
    shared_sd: FloatArray,
    tau_s: float,
    weights: FloatArray,
    place: FloatArray,
    covariance: FloatArray,
    offset: FloatArray,
    mean: FloatArray,
    mean_var: FloatArray,
) -> None:
    """Offsets of every drive, given the signs' ``place`` [m, 2] and ``covariance``.

    ``weights`` as ``add_drives`` left them. Fills ``offset`` [n, 2] at each sighting, and per
    drive its ``mean`` [d, 2] over the tile with the variance ``mean_var`` [d, 2], the
    uncertainty of the signs' places included.
    """
    filled = 0
    for d in range(len(first) - 1):
        lo, hi = first[d], first[d + 1]
        n = hi - lo
        size = axes * n * axes * n
        weight = weights[filled : filled + size].reshape((axes * n, axes * n))
        filled += size
        pull = np.zeros(axes * n)
        for i in range(axes * n):
            for j in range(n):
                for b in range(axes):
                    pull[i] += weight[i, axes * j + b] * (
                        measured[lo + j, b] - place[sign[lo + j], b]
                    )
        for a in range(axes):
            share = np.zeros(n)
            prior = 0.0
            for i in range(n):
                value = 0.0
                for j in range(n):
                    keep = np.exp(-abs(time_s[lo + i] - time_s[lo + j]) / tau_s)
                    k = keep * shared_sd[lo + i, a] * shared_sd[lo + j, a]
                    value += k * pull[axes * j + a]
                    share[i] += k / n
                    prior += k / (n * n)
                offset[lo + i, a] = value
                mean[d, a] += value / n
            gain = np.zeros(axes * n)
            known = 0.0
            for i in range(axes * n):
                for j in range(n):
                    gain[i] += weight[i, axes * j + a] * share[j]
            for j in range(n):
                known += share[j] * gain[axes * j + a]
            unsure = 0.0
            for i in range(n):
                for p in range(axes):
                    for j in range(n):
                        for q in range(axes):
                            unsure += (
                                gain[axes * i + p]
                                * covariance[axes * sign[lo + i] + p, axes * sign[lo + j] + q]
                                * gain[axes * j + q]
                            )
            mean_var[d, a] = max(prior - known + unsure, 0.0)
