"""Rest intervals of a recording, against a noise floor that the recording itself shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.calibration import limits
from automap.errors import InputError
from automap.records import FloatArray, IntArray, RawImu


@dataclass(frozen=True)
class Rest:
    """Mean readings over one rest interval, in the log's units.

    Rows ``start`` to ``stop`` (exclusive) of log number ``log``. ``accel``, ``gyro`` [3] are
    means, ``accel_var``, ``gyro_var`` [3] the variances of these means; the ``batch_var`` are
    those that the means of four to ten batches show.
    """

    log: int
    start: int
    stop: int
    middle_s: float
    length_s: float
    accel: FloatArray
    gyro: FloatArray
    accel_var: FloatArray
    gyro_var: FloatArray
    accel_batch_var: FloatArray
    gyro_batch_var: FloatArray


def movement(log: RawImu) -> FloatArray:
    """How much each sample's surroundings move [n]: 1 at rest, more in motion.

    The variance in a sliding window over the noise floor, averaged over the six axes.

    Raises:
        InputError: too few samples, or too low a rate, to tell rest from motion.
    """
    variance, floor = _windowed(log)
    floor = np.where(floor == 0.0, np.inf, floor)  # an axis that never changes says nothing
    return np.asarray((variance / floor).mean(axis=1))


def noise_density(log: RawImu, limit: float) -> FloatArray:
    """Noise [6] of accelerometer and gyro, units/sqrt(Hz), for averages over seconds.

    It is taken from what lies well inside rests (movement below ``limit``); with many of them
    the correlation of the noise counts as well. Without a rest the quietest windows must do,
    which says rather too much.
    """
    moved = movement(log)
    inside = round(limits.WINDOW_S * log.rate_hz)
    rests = []
    for rest in rests_below([log], [moved], limit):
        # a window at the edge of a rest reaches into motion
        start = rest.start + inside * (rest.start > 0)
        stop = rest.stop - inside * (rest.stop < len(log))
        if stop - start >= 20 and float(moved[start:stop].max()) < limit:
            rests.append(_summary(log, rest.log, start, stop))
    seconds = sum(rest.length_s for rest in rests)
    if seconds < limits.LEAST_REST_S:
        return np.asarray(np.sqrt(_windowed(log)[1] / log.rate_hz))
    if seconds > limits.MANY_RESTS_S:
        rests = _with_correlation(rests)
    # the median: a single rest may hold what movement does not show
    power = np.array([np.concatenate([r.accel_var, r.gyro_var]) * r.length_s for r in rests])
    return np.asarray(np.sqrt(np.median(power, axis=0)))


def _windowed(log: RawImu) -> tuple[FloatArray, FloatArray]:
    """Variance in a sliding window [n, 6], accelerometer first, and its floor [6]."""
    from scipy.ndimage import uniform_filter1d

    rate = log.rate_hz
    window = round(limits.WINDOW_S * rate) | 1
    if window < 5:
        raise InputError(
            f"{log.name} has {rate:.3g} samples a second, too few to tell rest from motion; "
            "record at 10 Hz or more, or correct the time column or --rate."
        )
    if len(log) < 4 * window:
        raise InputError(
            f"{log.name} lasts {len(log) / rate:.3g} s; record at least a minute, several poses."
        )
    values = np.hstack([log.accel, log.gyro])
    values = values - values.mean(axis=0)
    mean = uniform_filter1d(values, window, axis=0)
    variance = np.maximum(uniform_filter1d(values**2, window, axis=0) - mean**2, 0.0)
    # the variance about the mean of so few samples is too small by that one
    variance *= window / (window - 1.0)
    floor = np.quantile(variance, limits.FLOOR_QUANTILE, axis=0)
    # where even the quietest windows are smooth motion, second differences show the noise
    rough = uniform_filter1d(np.diff(values, 2, axis=0) ** 2 / 6.0, window, axis=0)
    floor = np.minimum(floor, limits.SMOOTH * np.quantile(rough, limits.FLOOR_QUANTILE, axis=0))
    return variance, np.maximum(floor, quantisation_step(values) ** 2 / 12.0)


def quantisation_step(values: FloatArray) -> FloatArray:
    """The smallest difference between neighbouring samples that occurs, per column [k]."""
    steps = np.abs(np.diff(values, axis=0))
    steps[steps < 1e-9 * np.ptp(values, axis=0)] = np.inf
    least = steps.min(axis=0)
    return np.where(np.isfinite(least), least, 0.0)


def rests_below(logs: list[RawImu], movements: list[FloatArray], limit: float) -> list[Rest]:
    """All intervals of at least LEAST_REST_S in which the movement stays below ``limit``."""
    found: list[Rest] = []
    for number, (log, moved) in enumerate(zip(logs, movements, strict=True)):
        t_s = log.t_s
        step = float(np.median(np.diff(t_s)))
        still = moved < limit
        # some 3 g in readings, whatever their unit; every tenth sample tells it
        span = float(
            np.linalg.norm(np.ptp(np.quantile(log.accel[::10], [0.05, 0.95], axis=0), axis=0))
        )
        # a hole in the recording ends an interval
        still[1:] &= np.diff(t_s) < limits.REST_HOLE_STEPS * step
        for start, stop in _runs(still):
            if t_s[stop - 1] - t_s[start] >= limits.LEAST_REST_S:
                rest = _summary(log, number, start, stop)
                if found and _same_pose(log, found[-1], rest, span):
                    rest = _joined(found.pop(), rest)
                found.append(rest)
    return _with_correlation(found)


def _same_pose(log: RawImu, first: Rest, second: Rest, span: float) -> bool:
    """Whether two rests are one that a bump or a fluctuation of the noise has cut in two."""
    if first.log != second.log:
        return False
    gap_s = float(log.t_ns[second.start] - log.t_ns[first.stop - 1]) * 1e-9
    moved = np.linalg.norm(second.accel - first.accel)
    return bool(gap_s <= 2.0 * limits.WINDOW_S and moved < limits.SAME_POSE * span)


def _joined(first: Rest, second: Rest) -> Rest:
    """One rest of two; what lies between them does not count for the means."""
    length = first.length_s + second.length_s
    a, b = first.length_s / length, second.length_s / length
    return Rest(
        log=first.log,
        start=first.start,
        stop=second.stop,
        middle_s=a * first.middle_s + b * second.middle_s,
        length_s=length,
        accel=a * first.accel + b * second.accel,
        gyro=a * first.gyro + b * second.gyro,
        accel_var=a**2 * first.accel_var + b**2 * second.accel_var,
        gyro_var=a**2 * first.gyro_var + b**2 * second.gyro_var,
        accel_batch_var=a**2 * first.accel_batch_var + b**2 * second.accel_batch_var,
        gyro_batch_var=a**2 * first.gyro_batch_var + b**2 * second.gyro_batch_var,
    )


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    starts: IntArray = np.flatnonzero(edges == 1)
    stops: IntArray = np.flatnonzero(edges == -1)
    return list(zip(starts.tolist(), stops.tolist(), strict=True))


def _summary(log: RawImu, number: int, start: int, stop: int) -> Rest:
    t_s = log.t_s[start:stop]
    accel, gyro = log.accel[start:stop], log.gyro[start:stop]
    batches = int(np.clip((t_s[-1] - t_s[0]) / limits.BATCH_S, *limits.BATCHES))
    accel_var, accel_batch_var = _variance_of_mean(accel, batches)
    gyro_var, gyro_batch_var = _variance_of_mean(gyro, batches)
    return Rest(
        log=number,
        start=start,
        stop=stop,
        middle_s=float(t_s.mean()),
        length_s=float(t_s[-1] - t_s[0]),
        accel=accel.mean(axis=0),
        gyro=gyro.mean(axis=0),
        accel_var=accel_var,
        gyro_var=gyro_var,
        accel_batch_var=accel_batch_var,
        gyro_batch_var=gyro_batch_var,
    )


def _variance_of_mean(values: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Variance [3] of the mean of samples [n, 3]: were they white, and by ``count`` batches."""
    batches = np.array([part.mean(axis=0) for part in np.array_split(values, count)])
    white = values.var(axis=0, ddof=1)
    white = np.maximum(white, quantisation_step(values) ** 2 / 12.0) / len(values)
    return white, batches.var(axis=0, ddof=1) / count


def _with_correlation(rests: list[Rest]) -> list[Rest]:
    """The rests with their variances raised for the correlation of the noise.

    The batches of one rest tell it badly, those of all rests together well: the white
    variances of all are multiplied by the mean ratio of both, never by less than one.
    """
    if not rests:
        return rests
    factors = {
        name: np.maximum(
            np.sum([getattr(r, f"{name}_batch_var") for r in rests], axis=0)
            / (np.sum([getattr(r, f"{name}_var") for r in rests], axis=0) + 1e-300),
            1.0,
        )
        for name in ("accel", "gyro")
    }
    return [
        replace(r, accel_var=r.accel_var * factors["accel"], gyro_var=r.gyro_var * factors["gyro"])
        for r in rests
    ]
