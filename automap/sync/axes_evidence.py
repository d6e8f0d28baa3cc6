"""What a drive shows of the axes of its IMU: which readings go with which motion.

The receiver sees turns and changes of speed; gravity is felt by the accelerometer, and as the
vehicle pitches and rolls it wanders through the accelerometer's axes as the gyro says it must.
Everything is kept as moments, of which correlations in any axes follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.gates import sd_by_median
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.sync import limits
from automap.sync.motion import GnssMotion, position_motion, velocity_motion
from automap.sync.motion_clock import in_imu_time

_ACCEL, _GYRO = slice(0, 3), slice(3, 6)


@dataclass(frozen=True)
class Followed:
    """A quantity of the receiver beside three channels of the IMU at the lag ``lag_s`` where they
    resemble it most: moments ``xy`` [3], ``xx`` [3, 3], ``yy``; ``share`` of it that the three
    together explain; ``count`` of independent samples among ``rows``, of which each has ``noise``,
    one sigma, as far as it changes faster than vehicles do."""

    count: float
    rows: int
    noise: float
    xy: FloatArray
    xx: FloatArray
    yy: float
    share: float
    lag_s: float


@dataclass(frozen=True)
class Tilts:
    """Changes of specific force ``a`` beside turns ``w`` over the same time: moments ``aa``,
    ``aw``, ``ww`` [3, 3]; ``count`` [3] of independent samples by axis."""

    count: FloatArray
    aa: FloatArray
    aw: FloatArray
    ww: FloatArray


@dataclass(frozen=True)
class AxesEvidence:
    """``up`` [3] direction of the median specific force; ``turn`` (course, by the gyro),
    ``lateral`` (force across, by the accelerometer), ``surge`` (speed, by the accelerometer), where
    the receiver shows enough of them; ``tilts`` over a second, of the IMU alone, and over some
    after what the receiver says of the motion was taken off."""

    up: FloatArray
    turn: Followed | None = None
    lateral: Followed | None = None
    surge: Followed | None = None
    tilts: tuple[Tilts, ...] = ()


def axes_evidence(imu: ImuData, fixes: Fixes | None, clock: ClockModel | None) -> AxesEvidence:
    """Evidence of readings in whatever axes, with ``fixes`` under a ``clock`` good to a second;
    without them what the IMU shows of itself."""
    median = np.median(imu.accel, axis=0)
    up = median / max(float(np.linalg.norm(median)), 1e-12)
    sums = RunningSums(imu)
    still = _fast_tilts(sums)
    tilts = () if still is None else (still,)
    motion = None if fixes is None or clock is None else receiver_motion(fixes, clock, imu)
    if motion is None:
        return AxesEvidence(up, tilts=tilts)
    one = np.ones(len(motion.start))
    turn = _follow(sums, motion, motion.turn, _GYRO, motion.speed)
    lateral = _follow(sums, motion, motion.turn, _ACCEL, one)
    surge = _follow(sums, motion, motion.surge, _ACCEL, one)
    if surge is not None and lateral is not None:
        slow = _slow_tilts(sums, motion, surge.lag_s, lateral.lag_s)
        tilts = tilts if slow is None else (*tilts, slow)
    return AxesEvidence(up, turn, lateral, surge, tilts)


def together(parts: Sequence[AxesEvidence]) -> AxesEvidence:
    """The evidence of several parts of a drive, of which each has its biases and its lags."""
    up = np.sum([part.up for part in parts], axis=0)
    tilts = []
    for length in range(max((len(part.tilts) for part in parts), default=0)):
        same = [part.tilts[length] for part in parts if length < len(part.tilts)]
        sums = (sum(getattr(item, name) for item in same) for name in ("count", "aa", "aw", "ww"))
        tilts.append(Tilts(*(np.asarray(value) for value in sums)))
    return AxesEvidence(
        up / max(float(np.linalg.norm(up)), 1e-12),
        _joined([part.turn for part in parts]),
        _joined([part.lateral for part in parts]),
        _joined([part.surge for part in parts]),
        tuple(tilts),
    )


def _joined(parts: Sequence[Followed | None]) -> Followed | None:
    """What several parts show, as if it were one; None where none does."""
    told = [part for part in parts if part is not None]
    if not told:
        return None
    xx, xy = np.sum([part.xx for part in told], axis=0), np.sum([part.xy for part in told], axis=0)
    yy, rows = sum(part.yy for part in told), sum(part.rows for part in told)
    explained = float(xy @ np.linalg.pinv(xx) @ xy)
    noise = float(np.sqrt(sum(part.rows * part.noise**2 for part in told) / rows))
    lag = float(np.average([part.lag_s for part in told], weights=[part.yy for part in told]))
    count = sum(part.count for part in told)
    return Followed(count, rows, noise, xy, xx, yy, explained / yy, lag)


class RunningSums:
    """Running integrals of specific force and rate, wild readings cut off."""

    def __init__(self, imu: ImuData) -> None:
        self.t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
        dt = np.diff(self.t)
        gap = dt > max(limits.IMU_GAP_S, limits.IMU_GAP_STEPS * float(np.median(dt)))
        # an axis after the other: of a long drive each is large
        self.total = np.zeros((7, len(self.t)))
        for total, readings in zip(self.total, (*imu.accel.T, *imu.gyro.T), strict=False):
            kept = np.clip(readings, *np.quantile(readings, limits.WILD_QUANTILES))
            np.cumsum(0.5 * (kept[1:] + kept[:-1]) * dt, out=total[1:])
        np.cumsum(np.where(gap, dt, 0.0), out=self.total[6, 1:])
        self.rate_bias = np.median(imu.gyro, axis=0)

    def between(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Increments [m, 6] over intervals [m]; NaN outside the recording and across gaps."""
        steps = np.column_stack(
            [np.interp(end, self.t, c) - np.interp(start, self.t, c) for c in self.total]
        )
        steps[(start < self.t[0]) | (end > self.t[-1]) | (steps[:, 6] > 1e-9)] = np.nan
        return np.asarray(steps[:, :6])


def receiver_motion(fixes: Fixes, clock: ClockModel, imu: ImuData) -> GnssMotion | None:
    """The receiver's motion in seconds of the IMU, by velocities where it tells them."""
    motion = velocity_motion(fixes, limits.AXES_WINDOW_S)
    if len(motion.start) < limits.LEAST_INTERVALS:
        motion = position_motion(fixes, limits.AXES_WINDOW_S)
    if len(motion.start) < limits.LEAST_INTERVALS:
        return None
    return in_imu_time(motion, clock, imu)


def _follow(
    sums: RunningSums, motion: GnssMotion, seen: FloatArray, triad: slice, factor: FloatArray
) -> Followed | None:
    """``seen`` [m] beside the increments of a triad times ``factor`` [m], biases taken off."""
    span = (motion.end - motion.start) * factor
    best = None
    reach = limits.AXES_LAG_S
    for lag in np.arange(-reach, reach + 1e-9, limits.AXES_LAG_STEP_S).tolist():
        x = sums.between(motion.start + lag, motion.end + lag)[:, triad] * factor[:, None]
        use = np.isfinite(seen) & np.isfinite(x).all(axis=1)
        if np.count_nonzero(use) < limits.LEAST_INTERVALS:
            continue
        y = np.clip(seen[use], *np.percentile(seen[use], limits.USUAL_CHANGES))
        free = np.column_stack([span[use], np.ones(np.count_nonzero(use))])
        y, x = _without(free, y), _without(free, x[use])
        yy = float(y @ y)
        if yy <= 0.0:
            continue
        rest = _without(x, y)
        share = 1.0 - float(rest @ rest) / yy
        if best is None or share > best.share:
            noise = _fast_noise(motion.start[use], y)
            best = Followed(effective_count(y), len(y), noise, x.T @ y, x.T @ x, yy, share, lag)
    return best


def _fast_noise(start: FloatArray, y: FloatArray) -> float:
    """White noise of changes [n] over windows from ``start`` [n] s, by how neighbours differ: the
    noise of four velocities does not average out, where that of each change is of two. 0 where
    neighbours are so far apart that a vehicle's own motion differs."""
    step = np.diff(start)
    near = step < limits.NEIGHBOUR_S
    return float(np.sqrt(0.5 * np.mean(np.diff(y)[near] ** 2))) if near.any() else 0.0


def _slow_tilts(
    sums: RunningSums, motion: GnssMotion, surge_lag: float, turn_lag: float
) -> Tilts | None:
    """Tilts over some seconds, after the receiver's speed and course explained what they can."""
    length = motion.end - motion.start
    middle = 0.5 * (motion.start + motion.end)
    known = np.isfinite(motion.turn)
    later = middle + (surge_lag - turn_lag)
    across = np.interp(later, middle[known], motion.turn[known])
    across[np.interp(later, middle, known.astype(float)) < 1.0] = np.nan
    felt = sums.between(motion.start + surge_lag, motion.end + surge_lag)[:, _ACCEL]
    means = np.column_stack([felt, motion.surge, across]) / length[:, None]
    return _tilts(sums, middle + surge_lag, means, limits.TILT_STEP_S)


def _fast_tilts(sums: RunningSums) -> Tilts | None:
    """Tilts over a second: springs and road, with no receiver.

    Springs let a vehicle dive as it brakes and lean out of a bend, both so that the force of the
    motion adds to that of gravity.
    """
    length = limits.FAST_WINDOW_S
    start = np.arange(0.0, float(sums.t[-1]) - length, limits.FAST_GRID_S)
    felt = sums.between(start, start + length)[:, _ACCEL]
    return _tilts(sums, start + 0.5 * length, felt / length, limits.FAST_STEP_S)


def _tilts(sums: RunningSums, at: FloatArray, means: FloatArray, step_s: float) -> Tilts | None:
    """Changes over ``step_s`` of the first three ``means`` [m, 3 + k] at times ``at`` [m], after
    the others, beside the turns meanwhile."""
    if len(at) < limits.LEAST_INTERVALS:
        return None
    stride = max(1, round(step_s / float(np.median(np.diff(at)))))
    if len(at) <= stride:
        return None
    span = at[stride:] - at[:-stride]
    change = means[stride:] - means[:-stride]
    turns = sums.between(at[:-stride], at[stride:])[:, _GYRO]
    angle = np.linalg.norm(turns - sums.rate_bias * span[:, None], axis=1)
    # gravity moves in proportion to the turn only while the turn is small
    use = np.isfinite(change).all(axis=1) & np.isfinite(turns).all(axis=1)
    use = use & (span < limits.LONG_WINDOW * step_s) & (angle < limits.TILT_TURN_RAD)
    if np.count_nonzero(use) < limits.LEAST_INTERVALS:
        return None
    free = np.column_stack([span[use], change[use, 3:]])
    a, w = _without(free, change[use, :3]), _without(free, turns[use])
    for column in a.T:
        reach = limits.SHOCK_SIGMAS * sd_by_median(column - np.median(column))
        np.clip(column, -reach, reach, out=column)
    counts = np.array([effective_count(column) for column in a.T])
    return Tilts(counts, a.T @ a, a.T @ w, w.T @ w)


def _without(free: FloatArray, values: FloatArray) -> FloatArray:
    """Values [n] or [n, k] without what the columns ``free`` [n, j] explain of them."""
    found, *_ = np.linalg.lstsq(free, values, rcond=None)
    return np.asarray(values - free @ found)


def effective_count(values: npt.NDArray[np.float64]) -> float:
    """How many independent normal samples a correlated series [n] is worth in a correlation.

    n over 1 + 2 sum of squared autocorrelations (M. S. Bartlett, Journal of the Royal Statistical
    Society 98(3), 1935), and fewer where few samples tower above the rest: by the kurtosis.
    """
    centred = values - values.mean()
    n, power = len(centred), float(np.mean(centred**2))
    if power <= 0.0:
        return 0.0
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    alike = np.fft.irfft(spectrum)[1 : max(n // 2, 2)] / (n * power)
    ends = np.flatnonzero(alike <= 0.0)
    alike = alike[: ends[0]] if len(ends) else alike
    kurtosis = float(np.mean(centred**4)) / power**2
    return float(n / (1.0 + 2.0 * (alike**2).sum()) * min(1.0, 3.0 / kurtosis))
