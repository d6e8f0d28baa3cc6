"""Corrected rates and forces at samples and between them."""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import Samples
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def raw_at(samples: Samples, i: int, t: float, out: FloatArray) -> None:
    """Raw reading [6] at time ``t`` between samples i and i + 1."""
    span = samples.t[i + 1] - samples.t[i]
    s = (t - samples.t[i]) / span
    for k in range(6):
        out[k] = samples.raw[i, k] + s * (samples.raw[i + 1, k] - samples.raw[i, k])


@kernel
def correction_of(
    terms: IntArray, theta: FloatArray, extra: FloatArray, matrix: FloatArray, shift: FloatArray
) -> None:
    """Write the inverse error model: true = matrix reading - shift, [6, 6] and [6].

    reading = true + sum theta phi(true). Constant terms and those on the rates and forces
    themselves form an affine map that is inverted exactly; ``extra`` [e] are the other basis
    signals at one sample (see ``shift_of``).
    """
    a = np.zeros((6, 6))
    for i in range(6):
        a[i, i] = 1.0
    for m in range(terms.shape[0]):
        b = terms[m, 2]
        if 0 < b < 7:
            a[terms[m, 1] + (3 if terms[m, 0] == 1 else 0), b - 1] += theta[terms[m, 3]]
    inverse = np.zeros((6, 6))
    for i in range(6):
        inverse[i, i] = 1.0
    # near identity: elimination without pivoting
    for i in range(6):
        d = 1.0 / a[i, i]
        for j in range(6):
            a[i, j] *= d
            inverse[i, j] *= d
        for r in range(6):
            if r != i and a[r, i] != 0.0:
                f = a[r, i]
                for j in range(6):
                    a[r, j] -= f * a[i, j]
                    inverse[r, j] -= f * inverse[i, j]
    matrix[:, :] = inverse
    shift_of(terms, theta, extra, matrix, shift)


@kernel
def shift_of(
    terms: IntArray, theta: FloatArray, extra: FloatArray, matrix: FloatArray, shift: FloatArray
) -> None:
    """The ``shift`` [6] of ``correction_of`` alone, for the extra signals of another sample."""
    raw = np.zeros(6)
    for m in range(terms.shape[0]):
        b = terms[m, 2]
        if 0 < b < 7:
            continue
        first = 3 if terms[m, 0] == 1 else 0
        if b == 0:
            raw[first + terms[m, 1]] += theta[terms[m, 3]]
        else:
            raw[first + terms[m, 1]] += theta[terms[m, 3]] * extra[b - 7]
    for i in range(6):
        s = 0.0
        for j in range(6):
            s += matrix[i, j] * raw[j]
        shift[i] = s


@kernel
def correct(raw: FloatArray, matrix: FloatArray, shift: FloatArray, out: FloatArray) -> None:
    """out [6] := matrix raw - shift."""
    for i in range(6):
        s = -shift[i]
        for j in range(6):
            s += matrix[i, j] * raw[j]
        out[i] = s


@kernel
def take_noise_out(samples: Samples, i: int, t: float, n: int, out: FloatArray) -> None:
    """Take the noise of a single reading out of the first ``n`` of a corrected reading [6] at ``t``
    between samples i, i + 1."""
    s = (t - samples.t[i]) / (samples.t[i + 1] - samples.t[i])
    s = min(max(s, 0.0), 1.0)
    d = samples.calm
    for a in range(n):
        out[a] += d[i, a] + s * (d[i + 1, a] - d[i, a])


@kernel
def acceleration(
    samples: Samples,
    i: int,
    t: float,
    gravity: float,
    c: FloatArray,
    force: FloatArray,
    out: FloatArray,
) -> None:
    """Acceleration over ground NED [3] at ``t`` between samples i and i + 1, to first order:
    of the corrected ``force`` [3] there, without the noise of a single reading."""
    s = (t - samples.t[i]) / (samples.t[i + 1] - samples.t[i])
    s = min(max(s, 0.0), 1.0)
    d = samples.calm
    out[0], out[1], out[2] = 0.0, 0.0, gravity
    for b in range(3):
        steady = force[b] + d[i, 3 + b] + s * (d[i + 1, 3 + b] - d[i, 3 + b])
        for a in range(3):
            out[a] += c[a, b] * steady
