"""The limit between rest and motion, chosen by what the calibration gains from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.accelerometer import N_SIX, AccelFit, fit_accelerometer
from automap.calibration.poses import LEAST_SINGULAR, determination
from automap.calibration.rest import THRESHOLDS, Rest, movement, rests_below
from automap.records import FloatArray, RawImu


@dataclass(frozen=True)
class RestSearch:
    """The rests found at the best limit, ``tried`` (limit, number of rests, log of the mean
    half width) for each limit, and ``outliers``, rests left out because their norm contradicts
    all others."""

    rests: list[Rest]
    limit: float
    tried: tuple[tuple[float, int, float], ...]
    outliers: tuple[Rest, ...] = ()


def find_rests(logs: list[RawImu], gravity: float, n_parameters: int) -> RestSearch:
    """Rest intervals at the limit that leaves the calibration's intervals narrowest.

    A low limit loses poses, a high one lets motion in, and either widens the confidence
    intervals of the accelerometer's parameters and of the gyro's bias. So no threshold needs
    tuning: the limit with the least mean logarithm of the half widths is taken. The idea of
    scanning is IMU-TK's (Tedaldi, Pretto and Menegatti, ICRA 2014), which takes the least
    residual.
    """
    movements = [movement(log) for log in logs]
    best: list[Rest] | None = None
    best_score, best_limit = np.inf, THRESHOLDS[0]
    most: list[Rest] = []
    tried = []
    for limit in THRESHOLDS:
        rests = rests_below(logs, movements, limit)
        if len(rests) > len(most):
            most = rests
        score = _score(rests, gravity, n_parameters)
        tried.append((limit, len(rests), score))
        if score < best_score:
            best, best_score, best_limit = rests, score, limit
    if best is None:
        return RestSearch(most, best_limit, tuple(tried))
    kept, outliers = _without_outliers(best, gravity, n_parameters)
    return RestSearch(kept, best_limit, tuple(tried), tuple(outliers))


def pose_means(rests: list[Rest]) -> tuple[FloatArray, FloatArray]:
    """Mean accelerometer readings [k, 3] of the rests and their variances [k, 3]."""
    return (
        np.array([r.accel for r in rests]).reshape(-1, 3),
        np.array([r.accel_var for r in rests]).reshape(-1, 3),
    )


def directions_of(fit: AccelFit, means: FloatArray) -> FloatArray:
    """Unit vectors [k, 3] of the specific force in sensor axes."""
    force = fit.apply(means)
    return np.asarray(force / np.linalg.norm(force, axis=1)[:, None])


def _score(rests: list[Rest], gravity: float, n_parameters: int) -> float:
    if len(rests) <= n_parameters:
        return np.inf
    means, variances = pose_means(rests)
    fit = fit_accelerometer(means, variances, gravity, n_parameters)
    if determination(directions_of(fit, means), n_parameters) < LEAST_SINGULAR:
        return np.inf
    width = fit.half_width[:n_parameters] * np.concatenate(
        [1.0 / np.abs(fit.scale), np.ones(n_parameters - 3)]
    )
    # the offsets' own intervals at the zero of the readings mean little; scale and angles do
    kept = np.concatenate([width[:3], width[N_SIX:]])
    gyro = np.array([r.gyro for r in rests])
    bias = gyro.std(axis=0) / np.sqrt(len(rests))
    return float(np.mean(np.log(np.concatenate([kept, bias]) + 1e-300)))


def _without_outliers(
    rests: list[Rest], gravity: float, n_parameters: int
) -> tuple[list[Rest], list[Rest]]:
    """Leave out rests whose deleted residual is beyond Student's 0.1 % limit for so many."""
    from scipy.stats import t

    kept, outliers = list(rests), []
    while len(kept) > n_parameters + 2:
        means, variances = pose_means(kept)
        fit = fit_accelerometer(means, variances, gravity, n_parameters)
        A = fit.design / fit.residual_sd[:, None]
        leverage = np.einsum("ij,jk,ik->i", A, np.linalg.pinv(A.T @ A), A)
        standard = fit.residuals / fit.residual_sd / np.sqrt(np.maximum(1.0 - leverage, 1e-9))
        dof = len(kept) - n_parameters
        size = np.minimum(np.abs(standard), np.sqrt(dof) * (1.0 - 1e-9))
        deleted = size * np.sqrt((dof - 1) / (dof - size**2))
        worst = int(deleted.argmax())
        if deleted[worst] < t.ppf(1.0 - 0.0005 / len(kept), dof - 1):
            break
        outliers.append(kept.pop(worst))
    return kept, outliers
