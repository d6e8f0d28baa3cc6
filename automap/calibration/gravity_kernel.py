"""Gravity carried through a turn by the gyro, with its derivatives, as a numba kernel."""

from __future__ import annotations

import math

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray

N_SIGNALS = 7
"""Basis signals of an angular rate: 1, reading x y z, specific force x y z."""


@kernel
def carry_direction(
    rate: FloatArray,
    signals: FloatArray,
    dt: FloatArray,
    direction: FloatArray,
    end: FloatArray,
    sensitivity: FloatArray,
) -> None:
    """Carry a fixed direction through a turn in body axes.

    ``rate`` [n, 3] rad/s true angular rate, ``signals`` [n, 7] basis signals, ``dt`` [n - 1] s,
    ``direction`` [3] the unit vector in body axes at the first sample. Writes the vector at the
    last sample into ``end`` [3], and into ``sensitivity`` [3, 3, 7] its derivative with respect
    to K in ``rate = K @ signals``, K [3, 7]: sensitivity[i, a, j] = d end_i / d K_aj.

    Between samples the rate is linear; the coning term of that is included (Bortz, IEEE
    Transactions on Aerospace and Electronic Systems 7, 1971). The direction
    obeys du/dt = u x omega, and its variation d(du)/dt = du x omega + u x d(omega).
    """
    for i in range(3):
        end[i] = direction[i]
        for a in range(3):
            for j in range(N_SIGNALS):
                sensitivity[i, a, j] = 0.0
    r = np.empty((3, 3))
    for k in range(rate.shape[0] - 1):
        h = dt[k]
        p, q = rate[k], rate[k + 1]
        c = h * h / 12.0
        x = 0.5 * (p[0] + q[0]) * h + c * (p[1] * q[2] - p[2] * q[1])
        y = 0.5 * (p[1] + q[1]) * h + c * (p[2] * q[0] - p[0] * q[2])
        z = 0.5 * (p[2] + q[2]) * h + c * (p[0] * q[1] - p[1] * q[0])
        _transposed_rotation(x, y, z, r)
        # half of the step's variation acts before the step's rotation, half after it
        _add_variation(end, signals[k], 0.5 * h, sensitivity)
        u, v, w = end[0], end[1], end[2]
        for i in range(3):
            end[i] = r[i, 0] * u + r[i, 1] * v + r[i, 2] * w
        for a in range(3):
            for j in range(N_SIGNALS):
                u = sensitivity[0, a, j]
                v = sensitivity[1, a, j]
                w = sensitivity[2, a, j]
                for i in range(3):
                    sensitivity[i, a, j] = r[i, 0] * u + r[i, 1] * v + r[i, 2] * w
        _add_variation(end, signals[k + 1], 0.5 * h, sensitivity)


@kernel
def _transposed_rotation(x: float, y: float, z: float, r: FloatArray) -> None:
    """Write exp(-[(x, y, z) x]) into ``r`` [3, 3]."""
    n2 = x * x + y * y + z * z
    s = 1.0 - n2 / 6.0
    c = 0.5 - n2 / 24.0
    if n2 > 1e-4:
        n = math.sqrt(n2)
        s = math.sin(n) / n
        c = (1.0 - math.cos(n)) / n2
    r[0, 0] = 1.0 - c * (y * y + z * z)
    r[1, 1] = 1.0 - c * (x * x + z * z)
    r[2, 2] = 1.0 - c * (x * x + y * y)
    r[0, 1] = c * x * y + s * z
    r[1, 0] = c * x * y - s * z
    r[0, 2] = c * x * z - s * y
    r[2, 0] = c * x * z + s * y
    r[1, 2] = c * y * z + s * x
    r[2, 1] = c * y * z - s * x


@kernel
def _add_variation(u: FloatArray, signal: FloatArray, h: float, sensitivity: FloatArray) -> None:
    """Add u x (e_a signal_j) h to ``sensitivity`` [3, 3, 7]."""
    for j in range(N_SIGNALS):
        s = signal[j] * h
        sensitivity[1, 0, j] += u[2] * s
        sensitivity[2, 0, j] -= u[1] * s
        sensitivity[0, 1, j] -= u[2] * s
        sensitivity[2, 1, j] += u[0] * s
        sensitivity[0, 2, j] += u[1] * s
        sensitivity[1, 2, j] -= u[0] * s
