"""How noisy a detector's boxes are, from how they scatter about the signs.

Hand-drawn boxes scatter by half a pixel, a poor detector's by three. Every sign seen often says
what its boxes scatter by; neighbouring frames may err alike (a tracker smooths, a hand copies
the last box), so that many boxes say less than their number. Both are measured over all signs
of a drive, sideways, up and down (where a car nods) and for heights apart, and pulled towards
what the settings say when there are few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.gates import sd_by_median
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.landmark_kernels import MARGIN
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.views import MeasurementNoise, Views
from automap.records import FloatArray

MIN_VIEWS = 6
_MOST_SIGNS = 300
_PRIOR_FREEDOM = 20.0
_SCALE_LIMITS = (0.3, 3.0)
_MOST_ALIKE = 0.8
_OUTLIER = 3.5
_MARGIN_SIGNS = 60
_MARGIN_FREEDOM = 4.0
_MARGIN_ROUNDS = 4
_MARGIN_LIMITS = (0.15, 2.0)
"""Of the sigma of margins in the settings."""
_ABSORBED = 1.5
"""Of each component of a sign's boxes, what its place, size and pass errors absorb."""


def measured_noise(
    views: Views,
    landmarks: Sequence[Landmark],
    prior: SizePrior,
    noise: MeasurementNoise,
    lever_arm_sd_m: float,
) -> MeasurementNoise:
    """``noise`` with the scales that the residuals of ``landmarks`` (made with it) show."""
    often = [mark for mark in landmarks if mark.ok and len(mark.rows) >= MIN_VIEWS]
    step = max(1, -(-len(often) // _MOST_SIGNS))
    settled = [solve_with_pass_errors(views, mark, prior, lever_arm_sd_m) for mark in often[::step]]
    right, down, height = (
        noise.scales[k] * scatter([mark.residual[:, k] for mark in settled]) for k in range(3)
    )
    measured = replace(noise, scales=(right, down, height))
    step = max(1, -(-len(often) // _MARGIN_SIGNS))
    finer = replace(views, sd=views.sd * (np.array(measured.scales) / np.array(noise.scales)))
    share = margin_scatter(finer, often[::step], prior, lever_arm_sd_m)
    return replace(measured, margin_sd_px=noise.margin_sd_px * share)


def margin_scatter(
    views: Views, landmarks: Sequence[Landmark], prior: SizePrior, lever_arm_sd_m: float
) -> float:
    """Factor on the one-sigma margin of a sign's boxes, from how margins differ between signs.

    Expectation maximisation: what every sign tells of its own margin, with the variance that
    remains, about the mean of all (which the camera's own margin is for).
    """
    share = 1.0
    if len(landmarks) < 2 or not (views.margin_sd > 0.0).all():
        return share
    stated = np.array([views.margin_sd[mark.rows].mean() for mark in landmarks])
    for _ in range(_MARGIN_ROUNDS):
        scaled = replace(views, margin_sd=views.margin_sd * share)
        settled = [
            solve_with_pass_errors(scaled, mark, prior, lever_arm_sd_m) for mark in landmarks
        ]
        margin = np.array([mark.pass_bias[MARGIN] for mark in settled]) / stated
        variance = np.array([mark.pass_bias_variance[MARGIN] for mark in settled]) / stated**2
        square = float(np.sum((margin - margin.mean()) ** 2 + variance))
        share = float(np.sqrt((_MARGIN_FREEDOM + square) / (_MARGIN_FREEDOM + len(settled) - 1)))
        share = float(np.clip(share, *_MARGIN_LIMITS))
    return share


def scatter(residuals: Sequence[FloatArray]) -> float:
    """Factor on the one-sigma errors from residuals [n] in sigmas, one array a sign, n >= 2.

    Root mean square without outliers, regarding the degrees of freedom that the fits took,
    times the inflation sqrt((1 + r) / (1 - r)) by the correlation r of neighbouring frames.
    """
    if not residuals:
        return 1.0
    joined = np.concatenate(residuals)
    limit = _OUTLIER * sd_by_median(joined)
    kept = [np.where(np.abs(values) <= limit, values, 0.0) for values in residuals]
    count = float(np.sum(np.abs(joined) <= limit))
    freedom = max(count - _ABSORBED * len(residuals), 1.0)
    square = float(sum(np.sum(values**2) for values in kept))
    variance = (square + _PRIOR_FREEDOM) / (freedom + _PRIOR_FREEDOM)
    pairs = float(sum(len(values) - 1 for values in kept))
    neighbours = float(sum(np.sum(values[1:] * values[:-1]) for values in kept))
    # what the fits took makes the residuals look less alike than the errors are
    alike = neighbours / pairs / max(square / count, 1e-12) + (1.0 - freedom / count)
    alike = float(np.clip(alike * pairs / (pairs + _PRIOR_FREEDOM), 0.0, _MOST_ALIKE))
    inflation = (1.0 + alike) / (1.0 - alike)
    return float(np.clip(np.sqrt(variance * inflation), *_SCALE_LIMITS))
