"""Scale and zero point that all depths of one estimator share, from crossing bearings.

Depths estimated from single pictures are wrong in common: too short by a constant, or by a
factor. Objects seen from several places have a distance from the bearings alone; against it
stands what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from automap.geolocation import limits
from automap.geolocation.bearing_rays import BearingRules
from automap.records import FloatArray
from automap.robust import HUBER


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
    measured: FloatArray, distance: FloatArray, log_sd: FloatArray, rules: BearingRules
) -> DepthScale:
    """Offset and scale from measured depths [n] and the distances [n] that bearings give.

    ``log_sd`` [n] of both together, as the logarithm; the priors of the ``rules`` are about no
    correction. Least squares with Huber's loss.
    """
    prior_sd = [rules.depth_offset_sd_m, rules.depth_scale_log_sd]

    def off(x: FloatArray) -> FloatArray:
        corrected = np.maximum(x[0] + np.exp(x[1]) * measured, limits.NEAREST_OBJECT_M)
        return np.append(np.log(distance / corrected) / log_sd, x / prior_sd)

    found = least_squares(off, np.zeros(2), loss="huber", f_scale=HUBER).x
    return DepthScale(float(found[0]), float(np.exp(found[1])))
