"""What chance does to right measurements, asked by a probability and not by a decimal.

Squares of independent normal errors over their variances add up to chi-square (Bar-Shalom, Li,
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

OUTSIDE_95 = 0.05
"""What an interval, circle or ellipse of 95 % leaves out: the usual statement of an uncertainty."""


@cache
def gate(probability: float, dof: int) -> float:
    """Squared distance in sigmas that a right measurement of ``dof`` rows exceeds with
    ``probability``."""
    from scipy.special import chdtri

    return float(chdtri(dof, probability))


def gate_in_plane(probability: float) -> float:
    """``gate`` of two rows, in closed form: for constants of kernels."""
    return -2.0 * math.log(probability)


def sigmas(probability: float) -> float:
    """How many sigmas off, to either side, a right number lies with ``probability``."""
    return float(np.sqrt(gate(probability, 1)))


def exceeds(square: float, dof: int) -> float:
    """Probability with which chance exceeds a squared distance in sigmas: ``gate``'s inverse."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, square))


def exceeds_ratio(ratio: float, dof: int, other: float) -> float:
    """Probability with which chance exceeds a quotient of two mean squares, of ``dof`` and
    ``other`` normal errors of one size (Fisher's distribution)."""
    from scipy.special import fdtrc

    return float(fdtrc(dof, other, ratio))


def mean_square_limits(dof: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Where the mean of ``dof`` [...] squared normal errors lies with 95 % probability, low and
    high."""
    from scipy.special import chdtri

    n = np.asarray(dof, np.float64)
    low, high = (chdtri(n, tail) / n for tail in (1.0 - 0.5 * OUTSIDE_95, 0.5 * OUTSIDE_95))
    return np.asarray(low), np.asarray(high)


def sd_by_median(residual: FloatArray) -> float:
    """One sigma of normal residuals [n] by the median of their sizes, whatever outliers do.

    Over 0.6745, the 75 % point of the normal distribution (Huber and Ronchetti, Robust
    Statistics, 2009, section 5.1).
    """
    return 1.4826 * float(np.median(np.abs(residual)))
