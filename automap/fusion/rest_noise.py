"""The noise of the inertial sensor at rest, and what it shows of vibration that folds down."""

from __future__ import annotations

import numpy as np

from automap.fusion import limits
from automap.fusion.options import FusionOptions
from automap.records import FloatArray, ImuData


def least_levels(
    imu: ImuData, t: FloatArray, standstill: list[tuple[float, float]], options: FusionOptions
) -> dict[str, float]:
    """Least factors on the levels "accel" and "gyro", none without a standstill.

    ``t`` [n] s of the readings, ``standstill`` intervals of it. Beside a receiver's errors that
    last for seconds the noise of the accelerometer cannot be told: both change the velocity within
    seconds. At rest nothing but the sensor and an idling engine does.
    """
    out = {}
    for level, readings, stated in (
        ("accel", imu.accel, options.accel_noise),
        ("gyro", imu.gyro, options.gyro_noise),
    ):
        density = rest_density(t, readings, standstill)
        if density is not None:
            out[level] = density / stated
    return out


def shaken_levels(imu: ImuData, options: FusionOptions) -> dict[str, float]:
    """Factors on the levels "accel" and "gyro" that readings show by how much they differ from one
    to the next.

    What shakes a sensor faster than it is read folds down to white noise of that density (an axis,
    the mean square of second differences is six times the variance).
    """
    dt = float(np.median(np.diff(imu.t_ns))) * 1e-9
    out = {}
    for level, readings, stated in (
        ("accel", imu.accel, options.accel_noise),
        ("gyro", imu.gyro, options.gyro_noise),
    ):
        # an axis at a time: of ten hours three are a hundred megabytes
        square = np.mean([np.mean(np.diff(readings[:, axis], 2) ** 2) for axis in range(3)])
        out[level] = float(np.sqrt(square / 6.0 * dt)) / stated
    return out


def rest_density(
    t: FloatArray, readings: FloatArray, standstill: list[tuple[float, float]]
) -> float | None:
    """White noise density of ``readings`` [n, 3] at rest, their unit a root hertz.

    The Allan deviation at one averaging time (IEEE Std 952, annex C), with the median for the mean:
    somebody who gets in moves the car.
    """
    squares = []
    for first, last in standstill:
        a, b = np.searchsorted(t, [first, last])
        edges = np.searchsorted(t[a:b], np.arange(first, last, limits.REST_MEAN_S)) + a
        counts = np.diff(edges)
        if len(counts) < 2 or not (counts > 0).all():
            continue
        sums = np.add.reduceat(readings[: edges[-1]], edges[:-1], axis=0)
        means = sums / counts[:, None]
        squares.append(np.square(np.diff(means, axis=0)).ravel())
    every = np.concatenate(squares) if squares else np.zeros(0)
    if len(every) < limits.REST_PAIRS:
        return None
    # half of all squares of a normal variable of variance one lie below 0.455
    variance = float(np.median(every)) / 0.4549
    return float(np.sqrt(0.5 * variance * limits.REST_MEAN_S))
