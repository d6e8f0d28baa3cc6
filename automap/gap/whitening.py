"""From innovations to rows that are white, of size one, and not ruled by outliers.

A filter whose noise model is not quite right leaves innovations that resemble their
neighbours and have long tails; a score computed from them would be too sure. Each channel is
scaled by its robust spread, its remaining autocorrelation is taken out by a short
autoregression (generalised least squares after Cochrane and Orcutt, 1949), and large values
count less (Huber's psi). Sensitivities pass through the same steps, so nothing is biased.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.fusion.layout import CH_NHC, MAX_SCALARS
from automap.gates import sd_by_median
from automap.records import FloatArray, IntArray

AR_ORDER = 3
HUBER = 2.0
MIN_ROWS = 30
MAX_COEFFICIENT_SUM = 0.9
MIN_SPREAD = (0.7,) * CH_NHC + (0.7,) * 2 + (1.0,) * 6 + (0.7,)
"""No channel counts for much more than its noise model says; pseudo-measurements at rest for
no more at all."""


@dataclass(frozen=True)
class Whitener:
    """Per channel: spread, autoregression [p], and Huber's factor E[psi']^2 / E[psi^2]."""

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
        ar[c] = autoregression(clipped)
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
    """``w`` [s] Huberised, ``phi`` [s, c] scaled to match, so that phi' w is a score and phi' phi
    its information; ``t`` [s] s, ``channel`` [s]."""

    w: FloatArray
    phi: FloatArray
    t: FloatArray
    channel: IntArray


def white_rows(
    whitener: Whitener, whitened: FloatArray, phi: FloatArray, t: FloatArray, channel: IntArray
) -> WhiteRows:
    """Apply a whitener to innovations [s] and sensitivities [s, c]."""
    parts = []
    for c, spread in whitener.spread.items():
        rows = np.flatnonzero(channel == c)
        u = filtered(whitened[rows, None], whitener.ar[c])[:, 0] / spread
        f = filtered(phi[rows], whitener.ar[c]) / spread
        psi = np.clip(u, -HUBER, HUBER)
        inside = max(float((np.abs(u) < HUBER).mean()), 0.3)
        size = float(np.mean(psi**2))
        # score inside / size per unit, information inside^2 / size
        root = inside / np.sqrt(max(size, 1e-6))
        parts.append((rows, psi / np.sqrt(max(size, 1e-6)), f * root))
    rows = np.concatenate([p[0] for p in parts]) if parts else np.zeros(0, np.int64)
    order = np.argsort(rows, kind="stable")
    rows = rows[order]
    w = np.concatenate([p[1] for p in parts])[order] if parts else np.zeros(0)
    f = np.concatenate([p[2] for p in parts])[order] if parts else np.zeros((0, phi.shape[1]))
    return WhiteRows(w, f, t[rows], channel[rows])
