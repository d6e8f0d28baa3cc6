"""Scale and zero point that all depths of one estimator share, from crossing bearings.

Depths estimated from single pictures are wrong in common: too short by a constant, or by a
factor. Objects seen from several places have a distance from the bearings alone; against it
stands what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.geolocation import limits
from automap.records import FloatArray
from automap.robust import huber_weight

_STEPS = 10
"""Of Gauss-Newton at most."""


@dataclass(frozen=True)
class DepthScale:
    """true depth = ``offset_m`` + ``scale`` * measured."""

    offset_m: float = 0.0
    scale: float = 1.0

    def apply(self, measured: FloatArray) -> FloatArray:
        """Corrected depths; NaN stays NaN."""
        with np.errstate(invalid="ignore"):
            return np.asarray(
                np.maximum(self.offset_m + self.scale * measured, limits.NEAREST_OBJECT_M)
            )


def fit_depth_scale(
    measured: FloatArray,
    distance: FloatArray,
    log_sd: FloatArray,
    offset_sd_m: float,
    scale_log_sd: float,
) -> DepthScale:
    """Offset and scale from measured depths [n] and the distances [n] that bearings give.

    ``log_sd`` [n] of both together, as the logarithm; the priors are one sigma about no
    correction. Gauss-Newton with Huber's weights.
    """
    x = np.zeros(2)
    prior = np.array([offset_sd_m, scale_log_sd]) ** -2.0
    for _ in range(_STEPS):
        scale = np.exp(x[1])
        corrected = np.maximum(x[0] + scale * measured, limits.NEAREST_OBJECT_M)
        residual = np.log(distance) - np.log(corrected)
        J = np.column_stack([1.0 / corrected, scale * measured / corrected])
        weight = huber_weight((residual / log_sd) ** 2) / log_sd**2
        N = (J * weight[:, None]).T @ J + np.diag(prior)
        step = np.linalg.solve(N, (J * weight[:, None]).T @ residual - prior * x)
        x = x + step
        if np.abs(step).max() < 1e-4:
            break
    return DepthScale(float(x[0]), float(np.exp(x[1])))
