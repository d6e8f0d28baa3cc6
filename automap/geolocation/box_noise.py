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

from automap.gates import sd_by_median, sigmas
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.landmark_kernels import MARGIN
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.view_errors import crowd
from automap.geolocation.views import MeasurementNoise, Views
from automap.records import FloatArray

_MARGIN_ROUNDS = 4
"""Of the expectation maximisation."""


def measured_noise(
    views: Views,
    landmarks: Sequence[Landmark],
    prior: SizePrior,
    noise: MeasurementNoise,
) -> MeasurementNoise:
    """``noise`` with the scales that the residuals of ``landmarks`` (made with it) show."""
    often = [mark for mark in landmarks if mark.ok and len(mark.rows) >= limits.SCATTER_VIEWS]
    step = max(1, -(-len(often) // limits.SCATTER_SIGNS))
    settled = [solve_with_pass_errors(views, mark, prior) for mark in often[::step]]
    crowds = [crowd(views, mark.rows) for mark in settled]
    right, down, height = (
        noise.scales[k] * scatter([mark.residual[:, k] for mark in settled], crowds)
        for k in range(3)
    )
    measured = replace(noise, scales=(right, down, height))
    step = max(1, -(-len(often) // limits.MARGIN_SIGNS))
    finer = replace(views, sd=views.sd * (np.array(measured.scales) / np.array(noise.scales)))
    share = margin_scatter(finer, often[::step], prior)
    return replace(measured, margin_sd_px=noise.margin_sd_px * share)


def margin_scatter(views: Views, landmarks: Sequence[Landmark], prior: SizePrior) -> float:
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
        settled = [solve_with_pass_errors(scaled, mark, prior) for mark in landmarks]
        margin = np.array([mark.pass_bias[MARGIN] for mark in settled]) / stated
        variance = np.array([mark.pass_bias_variance[MARGIN] for mark in settled]) / stated**2
        square = float(np.sum((margin - margin.mean()) ** 2 + variance))
        share = float(
            np.sqrt((limits.MARGIN_FREEDOM + square) / (limits.MARGIN_FREEDOM + len(settled) - 1))
        )
        share = float(np.clip(share, *limits.MARGIN_LIMITS))
    return share


def scatter(
    residuals: Sequence[FloatArray],
    crowds: Sequence[FloatArray],
    absorbed: float = limits.ABSORBED,
) -> float:
    """Factor on the one-sigma errors from residuals [n] in sigmas, one array a sign, n >= 2, and
    how many views [n] from one place each is among, whose sigmas have grown by the root of that;
    ``absorbed`` degrees of freedom that the fit of a sign took.

    Root mean square without outliers, regarding the degrees of freedom that the fits took,
    times the inflation sqrt((1 + r) / (1 - r)) by the correlation r of neighbouring frames.
    """
    if not residuals:
        return 1.0
    joined, number = np.concatenate(residuals), np.concatenate(crowds)
    alone = np.abs(joined) * np.sqrt(number)
    limit = sigmas(limits.STRAY_PROBABILITY) * sd_by_median(alone)
    kept = [
        np.where(np.abs(values) * np.sqrt(of) <= limit, values, 0.0)
        for values, of in zip(residuals, crowds, strict=True)
    ]
    count = float(np.sum((1.0 / number)[alone <= limit]))
    freedom = max(count - absorbed * len(residuals), 1.0)
    square = float(sum(np.sum(values**2) for values in kept))
    variance = (square + limits.SCATTER_FREEDOM) / (freedom + limits.SCATTER_FREEDOM)
    pairs = float(sum(np.sum(1.0 / np.sqrt(of[1:] * of[:-1])) for of in crowds))
    neighbours = float(sum(np.sum(values[1:] * values[:-1]) for values in kept))
    # what the fits took makes the residuals look less alike than the errors are
    alike = neighbours / pairs / max(square / count, 1e-12) + (1.0 - freedom / count)
    alike = float(np.clip(alike * pairs / (pairs + limits.SCATTER_FREEDOM), 0.0, limits.MOST_ALIKE))
    inflation = (1.0 + alike) / (1.0 - alike)
    return float(np.clip(np.sqrt(variance * inflation), *limits.SCATTER_LIMITS))
