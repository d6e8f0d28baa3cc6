"""What a horizontal covariance means on the map: 95 % circle and 95 % ellipse."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np

from automap.gates import OUTSIDE_95, gate
from automap.records import FloatArray

SIGMA_CLASSES = 5
"""Colours in which a map shows the uncertainty of a path."""

_ANGLES = 256
_KNOTS = 2049


def principal_axes(
    cov_ee: FloatArray, cov_en: FloatArray, cov_nn: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Standard deviations along the principal axes of 2x2 covariances.

    Takes three arrays [n] in m^2. Returns ``major`` and ``minor`` [n] in m and the azimuth of
    the major axis [n] in radians, clockwise from north, in [0, pi). Rounding below zero is
    taken as zero; NaN stays NaN, and what is infinite becomes it.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        mean = 0.5 * (cov_ee + cov_nn)
        half = 0.5 * (cov_nn - cov_ee)
        radius = np.hypot(half, cov_en)
        major = np.sqrt(np.maximum(mean + radius, 0.0))
        minor = np.sqrt(np.maximum(mean - radius, 0.0))
    azimuth = np.mod(0.5 * np.arctan2(cov_en, half), np.pi)
    return major, minor, azimuth


def ce95(cov_ee: FloatArray, cov_en: FloatArray, cov_nn: FloatArray) -> FloatArray:
    """Radius [n] in m of the circle that holds a Gaussian position with 95 % probability.

    In polar form the probability of radius r is the mean over the angle t of
    1 - exp(-r^2 / (2 (a^2 cos^2 t + b^2 sin^2 t))), a and b the principal standard
    deviations (the Hoyt distribution). Its 95 % point over a depends on b/a only; a table of
    2049 values of (b/a)^2 is solved once by Newton's method and interpolated, relative error
    below 1e-6. From 1.960 a (a line) to 2.448 a (a circle).
    """
    major, minor, _ = principal_axes(cov_ee, cov_en, cov_nn)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(major > 0, minor / major, 0.0)
    squares, factors = _circle_factors()
    return np.asarray(major * np.interp(ratio**2, squares, factors), np.float64)


@lru_cache(maxsize=1)
def _circle_factors() -> tuple[FloatArray, FloatArray]:
    squares = np.linspace(0.0, 1.0, _KNOTS)
    # midpoints of one quadrant: the integrand is smooth and periodic, so this converges fast
    angle = (np.arange(_ANGLES) + 0.5) * (0.5 * np.pi / _ANGLES)
    variance = np.cos(angle) ** 2 + squares[:, None] * np.sin(angle) ** 2
    factor = np.sqrt(np.linspace(gate(OUTSIDE_95, 1), gate(OUTSIDE_95, 2), _KNOTS))
    for _ in range(8):
        tail = np.exp(-0.5 * factor[:, None] ** 2 / variance)
        excess = tail.mean(axis=1) - OUTSIDE_95
        slope = (tail / variance).mean(axis=1) * factor
        factor = factor + excess / slope
    return squares, factor


def ellipse_outlines(
    cov_ee: FloatArray, cov_en: FloatArray, cov_nn: FloatArray, points: int = 36
) -> FloatArray:
    """Closed outlines [n, points + 1, 2] of the 95 % ellipses, east and north in m."""
    major, minor, azimuth = principal_axes(cov_ee, cov_en, cov_nn)
    scale = np.sqrt(gate(OUTSIDE_95, 2))
    angle = np.linspace(0.0, 2.0 * np.pi, points + 1)
    along = scale * major[:, None] * np.cos(angle)
    across = scale * minor[:, None] * np.sin(angle)
    sin, cos = np.sin(azimuth)[:, None], np.cos(azimuth)[:, None]
    # counter-clockwise seen from above, as RFC 7946 and simple features want outer rings
    outline = np.stack([along * sin - across * cos, along * cos + across * sin], axis=2)
    outline[:, -1] = outline[:, 0]
    return outline


def sigma_limits(sigma: FloatArray) -> list[float]:
    """Limits between the colour classes of sigmas [n]: round numbers, none where all are alike.

    They lie between the 2nd and the 98th percentile.
    """
    known = sigma[np.isfinite(sigma)]
    if len(known) == 0:
        return []
    low, high = np.percentile(known, [2, 98])
    if high <= 1.15 * low:
        return []
    limits = np.geomspace(max(low, high / 1e3), high, SIGMA_CLASSES + 1)[1:-1]
    return sorted({float(f"{limit:.2g}") for limit in limits.tolist()})


def sigma_classes(sigma: FloatArray) -> tuple[np.ndarray, list[str]]:
    """Number of the colour class [n] of each sigma (-1 unknown) and the labels of the classes."""
    known = np.isfinite(sigma)
    classes = np.full(len(sigma), -1, np.int64)
    if not known.any():
        return classes, []
    limits = sigma_limits(sigma)
    classes[known] = np.searchsorted(limits, sigma[known], "right")
    if not limits:
        return classes, [f"about {_metre_text(float(np.median(sigma[known])))} m"]
    texts = [_metre_text(limit) for limit in limits]
    inner = [f"{a} to {b} m" for a, b in itertools.pairwise(texts)]
    return classes, [f"below {texts[0]} m", *inner, f"above {texts[-1]} m"]


def _metre_text(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
