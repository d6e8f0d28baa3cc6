"""From innovations to rows that are white, of size one, and not ruled by outliers.

A filter whose noise model is not quite right leaves innovations that resemble their
neighbours and have long tails; a score computed from them would be too sure. Each channel is
scaled by its robust spread, its remaining autocorrelation is taken out by a short
autoregression (generalised least squares after Cochrane and Orcutt, 1949), and large values
count less (Huber's psi). Sensitivities pass through the same steps, so nothing is biased.

What counts as large is judged by what is left over once everything that may be missing has been
fitted: an innovation that a missing effect makes large is no wild value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.fusion.layout import CH_NHC, CH_ODOMETER, MAX_SCALARS
from automap.gates import sd_by_median
from automap.records import FloatArray, IntArray

AR_ORDER = 3
HUBER = 2.0
CLIPPED_SIZE = 0.9205
"""Mean square of a standard normal value clipped at ``HUBER``: 1 - 2 (a phi(a) - (a^2 - 1) Q(a)).
Channels that are quieter, as a loose vehicle constraint is, are not scaled up to it."""
MIN_ROWS = 30
MAX_COEFFICIENT_SUM = 0.9
MIN_SPREAD = (0.7,) * CH_NHC + (1.0,) * (CH_ODOMETER - CH_NHC) + (0.7,)
"""No channel counts for much more than its noise model says; pseudo-measurements for no more at
all."""
LOOSE = (CH_NHC, CH_NHC + 1)
"""Channels of the vehicle constraint: how a vehicle sways is no noise whose memory to take out, it
is what the constraint's own sigma stands for."""


@dataclass(frozen=True)
class Whitener:
    """Per channel: spread and autoregression [p]."""

    spread: dict[int, float]
    ar: dict[int, FloatArray]


def fit_whitener(whitened: FloatArray, channel: IntArray) -> Whitener:
    """Spread and autoregression of each channel's whitened innovations [s]."""
    spread: dict[int, float] = {}
    ar: dict[int, FloatArray] = {}
    for c in range(MAX_SCALARS):
        w = whitened[channel == c]
        if len(w) < MIN_ROWS:
            continue
        scale = max(sd_by_median(w - np.median(w)), 1e-3)
        clipped = np.clip(w / scale, -3.0, 3.0)
        ar[c] = np.zeros(AR_ORDER) if c in LOOSE else autoregression(clipped)
        rest = filtered(w[:, None], ar[c])[:, 0]
        spread[c] = max(sd_by_median(rest), MIN_SPREAD[c])
    return Whitener(spread, ar)


def autoregression(w: FloatArray) -> FloatArray:
    """Yule-Walker coefficients [p], shrunk where they are within their error."""
    n = len(w)
    r = np.array([np.dot(w[k:], w[: n - k]) / n for k in range(AR_ORDER + 1)])
    if r[0] <= 0.0:
        return np.zeros(AR_ORDER)
    from scipy.linalg import solve_toeplitz

    a = np.asarray(solve_toeplitz(r[:-1] + 1e-6 * r[0] * np.eye(1, AR_ORDER)[0], r[1:]))
    a[np.abs(a) < 2.0 / np.sqrt(n)] = 0.0
    total = float(np.abs(a).sum())
    return a * min(1.0, MAX_COEFFICIENT_SUM / total) if total > 0.0 else a


def filtered(rows: FloatArray, a: FloatArray) -> FloatArray:
    """Rows [m, c] less their prediction from the rows before."""
    out = rows.copy()
    for k, value in enumerate(a, start=1):
        if value != 0.0:
            out[k:] -= value * rows[:-k]
    return out


@dataclass(frozen=True)
class WhiteRows:
    """``w`` [s] weighted, ``phi`` [s, c] scaled to match, so that phi' w is a score and phi' phi
    its information; ``t`` [s] s, ``channel`` [s]."""

    w: FloatArray
    phi: FloatArray
    t: FloatArray
    channel: IntArray


def white_rows(
    whitener: Whitener,
    whitened: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    channel: IntArray,
    left: FloatArray,
) -> WhiteRows:
    """Apply a whitener to innovations [s] and sensitivities [s, c]; ``left`` [s] what is left of
    the innovations decides how much each row counts."""
    rows = np.flatnonzero(np.isin(channel, list(whitener.spread)))
    w, f = np.zeros(len(channel)), np.zeros(phi.shape, phi.dtype)
    for c, spread in whitener.spread.items():
        at = np.flatnonzero(channel == c)
        ar = whitener.ar[c]
        u = filtered(left[at, None], ar)[:, 0] / spread
        weight = HUBER / np.maximum(np.abs(u), HUBER)
        size = float(np.mean((weight * u) ** 2))
        # a score of variance size * phi' phi, an information of mean(weight) * phi' phi
        even = float(weight.mean()) / max(size, CLIPPED_SIZE)
        factor = np.sqrt(weight * even)
        w[at] = factor * filtered(whitened[at, None], ar)[:, 0] / spread
        f[at] = (factor / spread)[:, None] * filtered(phi[at], ar)
    return WhiteRows(w[rows], f[rows], t[rows], channel[rows])
