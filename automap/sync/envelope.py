"""The line that bounds a cloud of delays from below.

A delay is the least delay plus waiting: for the bus, for the operating system, for the
program that reads. Waiting is never negative and often long, so that means and least
squares say nothing about the least delay; the lower edge of the cloud does.

The line a + b x under the points is estimated from the lowest fifth or so of them, for
which the density of the waiting time e near its edge is a power law, p(e) = k e^(k-1) / w^k
on 0..w: k = 1 for exponential or uniform waiting, larger where the edge is soft. The shape
k is estimated along with a and b, so that the uncertainty of a soft edge is larger by
itself, and a small uniform background stands for single points that arrived too early
(wrong tags). Posterior moments come from a grid that is refined about its own mass.

Reference: P. Hall, "On estimating the endpoint of a distribution", Annals of Statistics
10(2), 1982 (inference from the lower order statistics, the power law at the edge).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.records import FloatArray
from automap.sync import limits

_SHAPES = np.geomspace(0.9, 3.5, 9)
_GRID = (33, 27)


@dataclass(frozen=True)
class Envelope:
    """Lower edge ``intercept + slope * (x - x_ref)`` of the points, one-sigma figures.

    ``covariance`` [2, 2] of intercept and slope; ``shape`` the posterior mean of k;
    ``width`` the height above the edge below which points were used; ``points`` how many.
    """

    x_ref: float
    intercept: float
    slope: float
    covariance: FloatArray
    shape: float
    width: float
    points: int

    def at(self, x: FloatArray) -> FloatArray:
        """Height of the edge at ``x`` [n]."""
        return np.asarray(self.intercept + self.slope * (x - self.x_ref))


def quantile_line(x: FloatArray, y: FloatArray, quantile: float) -> tuple[float, float]:
    """The quantile-regression line through points [n], exact for their binned quantiles.

    Returns (height at x = 0, slope). The points are gathered into at most 48 bins of x; the
    line of least asymmetric absolute deviation from the bins passes through two of them, so
    all pairs are tried (R. Koenker, Quantile Regression, 2005, section 2.2).
    """
    bin_x, bin_y = bin_quantiles(x, y, quantile)
    if len(bin_x) == 1:
        return float(bin_y[0]), 0.0
    i, j = np.triu_indices(len(bin_x), 1)
    slopes = (bin_y[j] - bin_y[i]) / (bin_x[j] - bin_x[i])
    starts = bin_y[i] - slopes * bin_x[i]
    over = bin_y[None, :] - (starts[:, None] + slopes[:, None] * bin_x[None, :])
    # the bins are quantiles already: a raised bin is a burst and weighs less than a low one
    raised = limits.RAISED_WEIGHT
    cost = np.where(over > 0.0, raised * over, (raised - 1.0) * over).sum(axis=1)
    best = int(np.argmin(cost))
    return float(starts[best]), float(slopes[best])


def bin_quantiles(
    x: FloatArray, y: FloatArray, quantile: float, most: int = 48
) -> tuple[FloatArray, FloatArray]:
    """Mean x and the ``quantile`` of y in bins of equal count along x, at least 5 a bin."""
    order = np.argsort(x, kind="stable")
    count = max(1, min(most, len(x) // 5))
    parts = np.array_split(order, count)
    bin_x = np.array([x[part].mean() for part in parts])
    bin_y = np.array([np.quantile(y[part], quantile) for part in parts])
    distinct = np.concatenate([[True], np.diff(bin_x) > 0.0])
    return bin_x[distinct], bin_y[distinct]


def lower_envelope(
    x: FloatArray, y: FloatArray, slope_sd: float, resolution: float = 0.0
) -> Envelope:
    """Fit the lower edge of the points ``x, y`` [n], n >= 4, both in seconds (after Hall, 1982).

    ``slope_sd`` is the spread of the slope expected beforehand (a Student t with three
    degrees of freedom of that scale, so that a clock far off is still found).
    ``resolution`` is the step in which y was recorded.
    """
    x_ref = float(np.mean(x))
    u = x - x_ref
    start, slope = quantile_line(u, y, limits.LOWEST_SHARE)
    residual = y - (start + slope * u)
    floor = max(limits.FLOOR_S, resolution / np.sqrt(12.0))
    low = _lowest(residual, floor)
    level = float(residual[low].max())
    ux, r = u[low], residual[low]
    top = max(level, float(r.min()) + 4.0 * floor) + 1e-12

    bottom = float(np.quantile(r, limits.LOWEST_QUANTILE))
    width = top - bottom
    span = max(float(np.ptp(ux)), 1e-9)
    centre = np.array([bottom, 0.0])
    half = np.array([1.5 * width, 3.0 * width / span])
    shape = 1.0
    covariance = np.diag(half**2)
    for _ in range(7):
        mean, covariance, shape = _posterior(ux, r, top, floor, centre, half, slope, slope_sd)
        spread = np.sqrt(np.diag(covariance))
        done = np.all(np.abs(mean - centre) < 1.5 * spread) and np.all(half < 9.0 * spread)
        centre = mean
        half = np.maximum(6.0 * spread, 0.05 * half)
        if done:
            break
    width = top - float(centre[0])
    # the softer the edge, the less a pure power law holds over the whole width
    bend = limits.BEND * max(0.0, 1.0 - 1.0 / shape) * width
    covariance = covariance + np.diag([floor**2 + bend**2, (floor / span) ** 2])
    return Envelope(
        x_ref=x_ref,
        intercept=start + float(centre[0]),
        slope=slope + float(centre[1]),
        covariance=covariance,
        shape=shape,
        width=width,
        points=len(r),
    )


def _lowest(residual: FloatArray, floor: float) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Indices of the points that speak about the edge: the lowest fifth, 12 to 120 of them."""
    least = min(limits.LEAST_POINTS, len(residual))
    count = int(np.clip(limits.LOWEST_SHARE * len(residual), least, limits.MOST_POINTS))
    order = np.argsort(residual, kind="stable")
    return np.asarray(order[:count], np.int64)


def _posterior(
    x: FloatArray,
    r: FloatArray,
    top: float,
    floor: float,
    centre: FloatArray,
    half: FloatArray,
    slope_offset: float,
    slope_sd: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Posterior mean [2], covariance [2, 2] and mean shape on a grid about ``centre``."""
    a = centre[0] + half[0] * np.linspace(-1.0, 1.0, _GRID[0])
    b = centre[1] + half[1] * np.linspace(-1.0, 1.0, _GRID[1])
    edge = a[:, None, None] + b[None, :, None] * x  # [a, b, m]
    above = r - edge
    width = np.maximum(top - edge, floor)
    inside = above > 0.0
    log_e = np.log(np.maximum(above, 0.1 * floor))
    log_w = np.log(width)
    background = limits.BACKGROUND / limits.BACKGROUND_RANGE_S
    log_p = np.empty((len(_SHAPES), *edge.shape[:2]))
    for index, k in enumerate(_SHAPES):
        density = (1.0 - limits.BACKGROUND) * k * np.exp((k - 1.0) * log_e - k * log_w)
        log_p[index] = np.log(np.where(inside, density, 0.0) + background).sum(axis=2)
        log_p[index] -= 0.5 * (np.log(k) / limits.SHAPE_SPREAD) ** 2
    rate = (slope_offset + b) / slope_sd
    log_p -= 2.0 * np.log1p(rate**2 / 3.0)[None, None, :]
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    pa, pb = p.sum(axis=(0, 2)), p.sum(axis=(0, 1))
    mean = np.array([pa @ a, pb @ b])
    da, db = a - mean[0], b - mean[1]
    cross = float(da @ p.sum(axis=0) @ db)
    step = (2.0 * half / (np.array(_GRID) - 1.0)) ** 2 / 12.0  # of the grid itself
    covariance = np.array(
        [[pa @ da**2 + step[0], cross], [cross, pb @ db**2 + step[1]]], dtype=np.float64
    )
    return mean, covariance, float(p.sum(axis=(1, 2)) @ _SHAPES)
