"""The lag between IMU stamps and receiver epochs, by comparing the motions they saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.gates import sd_by_median
from automap.records import FloatArray
from automap.sync import limits
from automap.sync.motion import GnssMotion, ImuMotion


@dataclass(frozen=True)
class Lag:
    """IMU stamps read ``lag_s`` more than the GPS time of the same motion, one sigma ``sd_s``.

    ``gain_nats`` is how much better the best lag explains the motion than none of the lags
    searched would on average; ``intervals`` how many were compared.
    """

    lag_s: float
    sd_s: float
    gain_nats: float
    intervals: int


def refine_lag(imu: ImuMotion, gnss: GnssMotion, offset_s: float, half_s: float) -> Lag | None:
    """The lag about ``offset_s`` (IMU seconds = GPS seconds + lag) within ``half_s``.

    For every lag searched the receiver's turn and surge increments are regressed on the
    IMU's increments of heading and horizontal specific force; azimuth, scale and bias of the
    IMU are free, so the mounting need not be known. The lag of least residual is an
    M-estimate; its sd is the sandwich form with the residuals' own correlation (Newey and
    West, Econometrica 55(3), 1987) and 10 ms for what springs and tyres add. How far the
    antenna is ahead of the rear axle, which shifts the course in time by that distance over
    the speed, and the slip of the tyres are estimated along from the varying speed. None when
    there is too little common motion or the best lag lies at the end of the search.
    """
    if len(imu.t_s) < 2 or len(gnss.start) < 2:
        return None
    lags = offset_s + np.arange(-half_s, half_s + 0.5 * limits.COARSE_S, limits.COARSE_S)
    channels = channels_between(imu, gnss, float(lags[0]), float(lags[-1]))
    if not channels:
        return None
    for _ in range(2):
        scores = np.sum([channel.scores(lags) for channel in channels], axis=0)
        best = int(np.argmin(scores))
        for channel in channels:
            channel.reweight(float(lags[best]))
    scores = np.sum([channel.scores(lags) for channel in channels], axis=0)
    best = int(np.argmin(scores))
    if best in (0, len(lags) - 1):
        return None
    gain = 0.5 * float(np.median(scores) - scores[best])

    lags = lags[best] + limits.FINE_S * np.arange(-5, 6)
    scores = np.sum([channel.scores(lags) for channel in channels], axis=0)
    curve = np.polyfit(lags - lags[5], scores, 2)
    if curve[0] <= 0.0:
        return None
    reach = 5.0 * limits.FINE_S
    lag = float(lags[5]) + float(np.clip(-curve[1] / (2.0 * curve[0]), -reach, reach))
    information, variance = np.sum(
        [channel.sandwich(lag, limits.FINE_S) for channel in channels], axis=0
    )
    if information <= 0.0:
        return None
    sd = float(np.hypot(np.sqrt(variance) / information, limits.MODEL_SD_S))
    return Lag(lag, sd, gain, int(sum(len(channel.target) for channel in channels)))


def channels_between(imu: ImuMotion, gnss: GnssMotion, first: float, last: float) -> list[Channel]:
    """The receiver's quantities over intervals that the IMU covers at all lags searched."""
    covered = np.isfinite(imu.between(gnss.start + first, gnss.end + last)[:, 0])
    channels = []
    for is_turn in (True, False):
        target = gnss.turn if is_turn else gnss.surge
        usable = np.isfinite(target) & (is_turn | (gnss.speed > 0.3))
        rows = np.flatnonzero(covered & usable)
        if len(rows) >= limits.LEAST_INTERVALS:
            rows = rows[:: -(-len(rows) // limits.MOST_INTERVALS)]
            window = (gnss.start[rows], gnss.end[rows])
            channels.append(Channel(imu, *window, gnss.speed[rows], target[rows], is_turn))
    return channels


class Channel:
    """One receiver quantity, explained by the IMU's increments at a lag."""

    def __init__(
        self,
        imu: ImuMotion,
        start: FloatArray,
        end: FloatArray,
        speed: FloatArray,
        target: FloatArray,
        is_turn: bool,
    ) -> None:
        self.imu = imu
        self.start, self.end, self.speed, self.target = start, end, speed, target
        self.is_turn = is_turn
        self.weight = np.ones(len(start))
        self._known: tuple[bytes, FloatArray] = (b"", np.zeros(0))
        self.noise = 0.1  # m/s of the target, better known after the first pass

    def scores(self, lags: FloatArray) -> FloatArray:
        """-2 log likelihood [lags] up to a constant."""
        if self._known[0] != lags.tobytes():
            self._known = lags.tobytes(), self._designs(lags)
        designs = self._known[1]
        left = self.target - (designs @ self._solve(designs, self.target)[..., None])[..., 0]
        squares = [float(self.weight @ each**2) for each in left]
        return float(self.weight.sum()) * np.log(np.maximum(squares, 1e-12))

    def reweight(self, lag: float) -> None:
        """Huber weights from the residuals at ``lag``: a fix that jumped must not decide."""
        residual = np.abs(self.fit(lag)[0])
        scale = sd_by_median(residual) + 1e-9
        self.noise = scale
        self.weight = np.minimum(1.0, limits.HUBER_SD * scale / np.maximum(residual, 1e-12))

    def sandwich(self, lag: float, step: float) -> tuple[float, float]:
        """Information about the lag and the variance of the score, both in 1/s^2."""
        residual, design, beta = self.fit(lag)
        ahead, behind = self._design(lag + step) @ beta, self._design(lag - step) @ beta
        slope = (ahead - behind) / (2.0 * step)
        # only what azimuth, scale and bias cannot imitate tells the lag
        free = slope - design @ self._solve(design, slope)
        variance = float(self.weight @ residual**2) / max(float(self.weight.sum()), 1.0)
        if variance <= 0.0:
            return 0.0, 0.0
        score = self.weight * free * residual
        reach = self._reach()
        total = float(score @ score)
        for shift in range(1, min(reach, len(score) - 1)):
            overlap = float(score[:-shift] @ score[shift:])
            total += 2.0 * (1.0 - shift / reach) * overlap
        information = float((self.weight * slope) @ free) / variance
        # negative sums come from few intervals; never claim more than white residuals would
        return information, max(total / variance**2, information)

    def _reach(self) -> int:
        """Intervals over which residuals may be correlated: ten seconds' worth."""
        spacing = float(np.median(np.diff(self.start))) if len(self.start) > 1 else 1.0
        return int(np.clip(limits.CORRELATED_S / max(spacing, 1e-3), 2, 400))

    def fit(self, lag: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What is left of the target [n] at a lag, the regressors [n, k] and what each counts."""
        design = self._design(lag)
        beta = self._solve(design, self.target)
        return self.target - design @ beta, design, beta

    def _design(self, lag: float) -> FloatArray:
        """Regressors [n, k] at a lag."""
        return np.asarray(self._designs(np.array([lag]))[0])

    def _designs(self, lags: FloatArray) -> FloatArray:
        """Regressors [l, n, k] at lags [l]."""
        start, end = self.start + lags[:, None], self.end + lags[:, None]
        seen = np.nan_to_num(self.imu.between(start, end))
        level, ones = (seen[..., 1], seen[..., 2]), np.ones(start.shape)
        if self.is_turn:
            turned = self.speed * seen[..., 0]
            # the course leads the heading by arm * rate / speed ahead of the rear axle, and
            # trails it by the slip of the tyres, in proportion to rate * speed
            swing = self.imu.rate(end) - self.imu.rate(start)
            slip = self.speed**2 * swing
            speed = np.broadcast_to(self.speed, start.shape)
            return np.stack([swing, slip, turned, speed, *level, ones], axis=-1)
        return np.stack([*level, ones], axis=-1)

    def _solve(self, design: FloatArray, target: FloatArray) -> FloatArray:
        """Coefficients [..., k] of designs [..., n, k] that fit a target [n] best."""
        weighted = design * self.weight[:, None]
        normal = np.swapaxes(design, -1, -2) @ weighted
        at = np.arange(normal.shape[-1])
        normal[..., at, at] *= 1.0 + 1e-9
        normal[..., at, at] += 1e-9
        if self.is_turn:
            normal[..., 0, 0] += (self.noise / limits.ARM_SD_M) ** 2
            normal[..., 1, 1] += (self.noise / limits.SLIP_SD) ** 2
        right = np.swapaxes(weighted, -1, -2) @ target
        return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])
