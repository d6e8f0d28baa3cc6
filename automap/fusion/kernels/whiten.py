"""What the constant-velocity filter of one axis makes of any errors of its fixes."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.kernels.axis import N, predict, start, step
from automap.jit import kernel
from automap.records import BoolArray, FloatArray


@kernel
def whiten_axis(
    t: FloatArray,
    z: FloatArray,
    used: BoolArray,
    var: FloatArray,
    lasting: FloatArray,
    psd: float,
    tau: tuple[float, float],
    nis_limit: float,
    out: FloatArray,
) -> None:
    """Innovations over their sigmas ``out`` [n, 2, c] of columns ``z`` [n, 2, c], the rest as in
    ``smooth_axis``: by the gains that the first column has, the others are errors that are added.

    The filter is linear once its gains are known, so that innovations of a sum are the sum of
    innovations, and least squares on them is generalised least squares on the fixes.
    """
    n, c = t.shape[0], z.shape[2]
    x = np.zeros((N, c))
    p = np.zeros((N, N))
    f = np.zeros((N, N))
    work = np.zeros((N, N))
    ph = np.zeros(N)
    start(p)
    for k in range(n):
        dt = t[k] - t[k - 1] if k else 0.0
        step(f, dt, tau)
        predict(p, f, dt, psd, work)
        for j in range(c):
            x[0, j] += dt * x[1, j]
            x[2, j] *= f[2, 2]
            x[3, j] *= f[3, 3]
        for m in range(2):
            if not used[k, m]:
                continue
            share = lasting[k, m]
            for i in range(N):
                ph[i] = p[i, m] + share * p[i, 2 + m]
            s = var[k, m] + ph[m] + share * ph[2 + m]
            first = z[k, m, 0] - x[m, 0] - share * x[2 + m, 0]
            s = max(s, first * first / nis_limit)
            sd = math.sqrt(s)
            for j in range(c):
                nu = z[k, m, j] - x[m, j] - share * x[2 + m, j]
                out[k, m, j] = nu / sd
                for i in range(N):
                    x[i, j] += ph[i] * nu / s
            for i in range(N):
                for j in range(N):
                    p[i, j] -= ph[i] * ph[j] / s
