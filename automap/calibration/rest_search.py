"""The limit between rest and motion, chosen by what the calibration gains from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.accelerometer import N_SIX, directions_of, fit_accelerometer
from automap.calibration.limits import LEAST_SINGULAR, OUTLIER_PROBABILITY, THRESHOLDS
from automap.calibration.poses import determination
from automap.calibration.rest import Rest, movement, rests_below
from automap.records import FloatArray, RawImu


@dataclass(frozen=True)
class RestSearch:
    """The rests found.

    ``rests`` for the accelerometer, at its best ``limit``; ``gyro_rests`` for the gyro, which
    feels a hand's tremor more, at ``gyro_limit``. ``tried`` is (limit, number of rests) for
    each limit. ``outliers`` are rests left out of the first because their norm contradicts all
    others. ``determined`` is False when no limit gave poses enough; then ``rests`` are
    those of a middle limit. ``moved`` is the movement in the gyro's rests, in the median: some 1
    for a sensor that was put down, a hundred for one in a hand.
    """

    rests: list[Rest]
    gyro_rests: list[Rest]
    limit: float
    gyro_limit: float
    tried: tuple[tuple[float, int], ...]
    outliers: tuple[Rest, ...] = ()
    determined: bool = True
    moved: float = 1.0


def find_rests(logs: list[RawImu], gravity: float, n_parameters: int) -> RestSearch:
    """Rest intervals at the limits that leave the calibration's intervals narrowest.

    A low limit loses poses, a high one lets motion in, and either widens the confidence
    intervals of the parameters. So no threshold needs tuning: the limit with the least mean
    logarithm of the half widths is taken, of scale and angles for the accelerometer, of these
    and the gyro's bias for the gyro. The idea of scanning is IMU-TK's (Tedaldi, Pretto and
    Menegatti, ICRA 2014), which takes the least residual.
    """
    movements = [movement(log) for log in logs]
    found = [rests_below(logs, movements, limit) for limit in THRESHOLDS]
    tried = tuple((limit, len(rests)) for limit, rests in zip(THRESHOLDS, found, strict=True))
    widths = [_log_widths(rests, gravity, n_parameters) for rests in found]
    best = int(np.argmin([np.mean(w) for w in widths]))
    if not np.isfinite(np.mean(widths[best])):
        usual = len(THRESHOLDS) // 2
        rests, limit = found[usual], THRESHOLDS[usual]
        return RestSearch(rests, rests, limit, limit, tried, determined=False)
    both = [np.mean(np.concatenate([w, _log_bias(r)])) for w, r in zip(widths, found, strict=True)]
    gyro = int(np.argmin(both))
    kept, outliers = _without_outliers(found[best], gravity, n_parameters)
    return RestSearch(
        kept, found[gyro], THRESHOLDS[best], THRESHOLDS[gyro], tried, tuple(outliers),
        moved=_moved(movements, found[gyro]),
    )  # fmt: skip


def _moved(movements: list[FloatArray], rests: list[Rest]) -> float:
    """Movement inside rests, in the median."""
    return float(np.median([np.median(movements[r.log][r.start : r.stop]) for r in rests]))


def least_poses(n_parameters: int) -> int:
    """Rest poses needed: six for the paper's model, one to spare for the longer one."""
    return N_SIX if n_parameters == N_SIX else n_parameters + 1


def pose_means(rests: list[Rest]) -> tuple[FloatArray, FloatArray]:
    """Mean accelerometer readings [k, 3] of the rests and their variances [k, 3]."""
    return (
        np.array([r.accel for r in rests]).reshape(-1, 3),
        np.array([r.accel_var for r in rests]).reshape(-1, 3),
    )


def _log_widths(rests: list[Rest], gravity: float, n_parameters: int) -> FloatArray:
    """Logarithms of the relative half widths of scale and angles; infinite when undetermined."""
    if len(rests) < least_poses(n_parameters):
        return np.full(3, np.inf)
    means, variances = pose_means(rests)
    fit = fit_accelerometer(means, variances, gravity, n_parameters)
    if determination(directions_of(fit, means), n_parameters) < LEAST_SINGULAR:
        return np.full(3, np.inf)
    width = np.concatenate([fit.half_width[:3] / np.abs(fit.scale), fit.half_width[N_SIX:]])
    return np.asarray(np.log(width[: n_parameters - 3] + 1e-300))


def _log_bias(rests: list[Rest]) -> FloatArray:
    """Logarithms [3] of the standard error of the gyro's mean over the rests."""
    gyro = np.array([r.gyro for r in rests]).reshape(-1, 3)
    if len(gyro) < 2:
        return np.full(3, np.inf)
    return np.asarray(np.log(gyro.std(axis=0) / np.sqrt(len(gyro)) + 1e-300))


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
        if deleted[worst] < t.ppf(1.0 - 0.5 * OUTLIER_PROBABILITY / len(kept), dof - 1):
            break
        outliers.append(kept.pop(worst))
    return kept, outliers
