"""Losses that outliers cannot pull far, of squared residuals in sigmas.

Z. Zhang, Parameter estimation techniques, Image and Vision Computing 15, 1997.
"""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray

HUBER = 1.5
"""Sigmas up to which a residual counts fully: 96 % as sharp as least squares on normal errors."""
HUBER_SHARE = 0.8663855974622838
"""Mean square of a normal residual as Huber's loss counts it: erf(HUBER / sqrt(2))."""
CAUCHY = 2.5
"""Sigmas at which a residual counts half: 96 % as sharp as well."""

PLAIN, BY_HUBER, BY_CAUCHY = 0, 1, 2


@kernel
def loss(square, kind):  # type: ignore[no-untyped-def]
    """Loss and weight of a squared residual; ``kind`` PLAIN, BY_HUBER or BY_CAUCHY."""
    if kind == BY_HUBER:
        size = np.sqrt(square)
        if size <= HUBER:
            return square, 1.0
        return 2.0 * HUBER * size - HUBER * HUBER, HUBER / size
    if kind == BY_CAUCHY:
        ratio = square / (CAUCHY * CAUCHY)
        return CAUCHY * CAUCHY * np.log(1.0 + ratio), 1.0 / (1.0 + ratio)
    return square, 1.0


def cauchy_loss(square: FloatArray) -> FloatArray:
    """Cauchy's loss [n] of squared residuals [n]."""
    return np.asarray(CAUCHY**2 * np.log1p(square / CAUCHY**2))


def cauchy_weight(square: FloatArray, limit: float = CAUCHY) -> FloatArray:
    """Cauchy's weights [n] of squared residuals [n]; one half at ``limit`` sigmas."""
    return np.asarray(1.0 / (1.0 + square / limit**2))


def huber_loss(square: FloatArray) -> FloatArray:
    """Huber's loss [n] of squared residuals [n] (Annals of Mathematical Statistics 35, 1964)."""
    size = np.sqrt(square)
    return np.where(size <= HUBER, square, 2.0 * HUBER * size - HUBER**2)


def huber_weight(square: FloatArray) -> FloatArray:
    """Huber's weights [n] of squared residuals [n]."""
    return np.minimum(1.0, HUBER / np.maximum(np.sqrt(square), 1e-12))
