"""The offset between two clocks that may differ by any amount, from the motions they saw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray
from automap.sync import limits
from automap.sync.motion import GnssMotion, ImuMotion


@dataclass(frozen=True)
class CoarseOffset:
    """IMU seconds = GPS seconds + ``offset_s``, to about ``0.2`` s.

    ``score_nats`` the log likelihood ratio against no relation between the two motions;
    ``runner_up_nats`` that of the best other offset at least five seconds away.
    """

    offset_s: float
    score_nats: float
    runner_up_nats: float

    @property
    def certain(self) -> bool:
        """Whether this offset stands out: odds of a million after all that were tried."""
        lead = self.score_nats - self.runner_up_nats
        return lead > limits.CERTAIN_LEAD_NATS and self.score_nats > limits.CERTAIN_NATS


def find_offset(
    imu: ImuMotion, gnss: GnssMotion, reach_s: float | None = None
) -> CoarseOffset | None:
    """Search all offsets, or those within ``reach_s`` of zero, for the one that fits best.

    The heading increments of both sides and the receiver's change of speed against the two
    horizontal components of specific force are correlated with missing values masked
    (D. Padfield, "Masked object registration in the Fourier domain", IEEE Transactions on
    Image Processing 21(5), 2012, in one dimension). Drives of one log further apart than the IMU's
    recording is long are searched one by one, for days between them would fill the memory. None
    when the recordings share too little motion.
    """
    if len(imu.t_s) < 10:
        return None
    longest = max(limits.GAP_WITHIN_DRIVE_S, float(imu.t_s[-1] - imu.t_s[0]))
    begin = gnss.start[1:][np.diff(gnss.start) > longest].tolist()
    drives = pairwise([-np.inf, *begin, np.inf])
    found = [_find_offset(imu, gnss.part(*drive), reach_s) for drive in drives]
    known = [one for one in found if one is not None]
    if not known:
        return None
    best = max(known, key=lambda one: one.score_nats)
    others = [one.score_nats for one in known if one is not best]
    return replace(best, runner_up_nats=max(best.runner_up_nats, *others, 0.0))


def _find_offset(imu: ImuMotion, gnss: GnssMotion, reach_s: float | None) -> CoarseOffset | None:
    if len(gnss.start) < limits.LEAST_MOTIONS:
        return None
    g_turn, g_surge, g_start = _gnss_series(gnss)
    i_series, i_start = _imu_series(imu)
    if len(i_series) < 10:
        return None
    size = len(g_surge) + len(i_series)
    size = 1 << (size - 1).bit_length()
    turned, _ = _correlation(i_series[:, 0], g_turn, size)
    first, overlap = _correlation(i_series[:, 1], g_surge, size)
    second, _ = _correlation(i_series[:, 2], g_surge, size)
    unexplained = np.clip(1.0 - first**2 - second**2, 0.02, 1.0)
    seconds = overlap * limits.OFFSET_STEP_S
    score = -0.5 * seconds * (np.log(np.clip(1.0 - turned**2, 0.02, 1.0)) + np.log(unexplained))
    # index k of a circular correlation is a shift of k, or of k - size
    shift = np.arange(size)
    shift = np.where(shift >= len(i_series), shift - size, shift)
    offsets = shift * limits.OFFSET_STEP_S + i_start - g_start
    shorter = limits.OFFSET_STEP_S * min(len(g_surge), len(i_series))
    allowed = seconds >= max(limits.LEAST_OVERLAP_S, limits.LEAST_OVERLAP * shorter)
    if reach_s is not None:
        allowed &= np.abs(offsets) <= reach_s
    if not allowed.any():
        return None
    score = np.where(allowed, score, -np.inf)
    best = int(np.argmax(score))
    apart = allowed & (np.abs(offsets - offsets[best]) > limits.APART_S)
    runner_up = float(score[apart].max()) if apart.any() else 0.0
    return CoarseOffset(float(offsets[best]), float(score[best]), max(runner_up, 0.0))


def _gnss_series(gnss: GnssMotion) -> tuple[FloatArray, FloatArray, float]:
    """Heading change and change of speed on a regular grid [n], NaN where unknown."""
    middle = 0.5 * (gnss.start + gnss.end)
    start = float(middle[0])
    grid = np.arange(start, float(middle[-1]) + 1e-9, limits.OFFSET_STEP_S)
    right = np.clip(np.searchsorted(middle, grid), 1, len(middle) - 1)
    spread = middle[right] - middle[right - 1]
    heading = gnss.turn / np.maximum(gnss.speed, 0.1)
    # a turn near 180 degrees in a second is a jump of the course at standstill
    heading = np.where(np.abs(heading) < 1.5, heading, np.nan)
    series = []
    for values in (heading, gnss.surge):
        resampled = np.interp(grid, middle, values)
        resampled[spread > limits.FIX_GAP_S] = np.nan
        limit = 8.0 * float(np.nanmedian(np.abs(values))) + 1e-3 if np.isfinite(values).any() else 1
        series.append(np.clip(resampled, -limit - 3.0, limit + 3.0))
    return series[0], series[1], start


def _imu_series(imu: ImuMotion) -> tuple[FloatArray, float]:
    """One-second increments [n, 3] on a regular grid; the horizontal two decorrelated."""
    start = float(imu.t_s[0]) + 0.5
    grid = np.arange(start, float(imu.t_s[-1]) - 0.5, limits.OFFSET_STEP_S)
    series = imu.between(grid - 0.5, grid + 0.5)
    known = np.isfinite(series).all(axis=1)
    if known.sum() > 3:
        covariance = np.cov(series[known, 1:].T)
        _, axes = np.linalg.eigh(covariance)
        series[:, 1:] = series[:, 1:] @ axes
    return series, start


def _correlation(a: FloatArray, b: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Correlation coefficient [size] of a(t + shift) with b(t), and the common samples."""
    known_a, known_b = np.isfinite(a), np.isfinite(b)
    a0 = np.where(known_a, a - (a[known_a].mean() if known_a.any() else 0.0), 0.0)
    b0 = np.where(known_b, b - (b[known_b].mean() if known_b.any() else 0.0), 0.0)

    def spectrum(values: npt.NDArray[np.generic]) -> npt.NDArray[np.complex128]:
        return np.asarray(np.fft.rfft(values, size))

    fa, fa2, fma = spectrum(a0), spectrum(a0**2), spectrum(known_a)
    fb, fb2, fmb = (np.conj(spectrum(values)) for values in (b0, b0**2, known_b))

    def product(x: npt.NDArray[np.complex128], y: npt.NDArray[np.complex128]) -> FloatArray:
        return np.asarray(np.fft.irfft(x * y, size))

    count = np.rint(product(fma, fmb))
    n = np.maximum(count, 1.0)
    sum_a, sum_b = product(fa, fmb), product(fma, fb)
    covariance = product(fa, fb) - sum_a * sum_b / n
    var_a = product(fa2, fmb) - sum_a**2 / n
    var_b = product(fma, fb2) - sum_b**2 / n
    # where nothing varies rounding is all there is
    floor = 1e-9 * (float(a0 @ a0) * float(b0 @ b0)) + 1e-30
    power = var_a * var_b
    usable = (count >= 25) & (power > floor) & (var_a > 0.0) & (var_b > 0.0)
    r = np.where(usable, covariance / np.sqrt(np.where(usable, power, 1.0)), 0.0)
    return np.clip(r, -1.0, 1.0), count
