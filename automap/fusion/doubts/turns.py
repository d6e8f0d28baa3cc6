"""What the IMU feels of turns and changes of speed against what the receiver sees of them.

Regression of the changes of the receiver's course and speed on the integrated readings: the slope
is one for a right IMU, whatever a filter makes of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import (
    DOUBT_PROBABILITY,
    DRIVING_SPEED,
    LEAST_JUDGED,
    MAX_DELAY_S,
    MOST_SPACING_S,
)
from automap.gates import sigmas
from automap.records import BoolArray, FloatArray, ImuData
from automap.robust import cauchy_weight


@dataclass(frozen=True)
class Slope:
    """How much the receiver shows for one felt, its sigma, and the lag in s of the receiver."""

    value: float
    sd: float
    lag_s: float
    correlation: float


def turn_doubts(
    imu: ImuData, turn: FloatArray, t: FloatArray, velocity: FloatArray
) -> Iterator[Reason]:
    """Whether gyro and accelerometer, ``turn`` [3, 3] to vehicle axes, feel the motion that the
    receiver's ``velocity`` [m, 3] m/s at ``t`` [m] s from the first sample shows."""
    if len(t) < LEAST_JUDGED:
        return
    stamps = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9)
    gyro, accel = imu.gyro @ turn.T, imu.accel @ turn.T
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    driving = speed > DRIVING_SPEED
    beyond = sigmas(DOUBT_PROBABILITY)
    turning = slope_of(stamps, gyro[:, 2], t, course, driving)
    if turning is not None and abs(turning.value - 1.0) > limits.SLOPE_OFF + beyond * turning.sd:
        yield Reason(
            "imu_against_course",
            f"the receiver shows {turning.value:.2f} times the turns that the IMU's gyro feels "
            f"(sigma {turning.sd:.2f}): check the IMU's axes, signs and units",
            inertial=True,
        )
    # hills push, too: of the size of a slope they leave the sign alone
    pushing = slope_of(stamps, accel[:, 0], t, speed, speed >= 0.0)
    if pushing is not None and pushing.value < -beyond * pushing.sd:
        yield Reason(
            "imu_against_speed",
            "the receiver gains speed where the IMU's accelerometer feels braking (slope "
            f"{pushing.value:.2f}, sigma {pushing.sd:.2f}): check the IMU's axes and signs",
            inertial=True,
        )


def slope_of(
    stamps: FloatArray, felt: FloatArray, t: FloatArray, seen: FloatArray, use: BoolArray
) -> Slope | None:
    """Slope of the changes of ``seen`` [m] at ``t`` over some seconds on the integral of ``felt``
    [n] at ``stamps``, at the lag where they resemble each other most; None without enough of
    them, or where one shows nothing of the other."""
    step = np.diff(stamps, prepend=stamps[0])
    total = np.cumsum(felt * np.minimum(step, MOST_SPACING_S))
    stop = np.searchsorted(t, t + limits.CHANGE_S, side="left")
    first = np.flatnonzero(stop < len(t))
    stop = stop[first]
    span = t[stop] - t[first]
    good = (span < limits.CHANGE_S * 1.5) & use[first] & use[stop]
    first, stop, span = first[good], stop[good], span[good]
    if len(first) < LEAST_JUDGED:
        return None
    y = seen[stop] - seen[first]
    lags = np.arange(-MAX_DELAY_S, MAX_DELAY_S + 1e-9, limits.LAG_STEP_S)
    changes = [
        np.interp(t[stop] - lag, stamps, total) - np.interp(t[first] - lag, stamps, total)
        for lag in lags
    ]
    # a jump of the course says nothing of a lag
    quiet = np.clip(y - np.median(y), *np.percentile(y - np.median(y), limits.USUAL_CHANGES))
    alike = [abs(float(np.dot(x - x.mean(), quiet))) / (float(x.std()) + 1e-12) for x in changes]
    best = int(np.argmax(alike))
    between = float(t[-1] - t[0]) / len(t)
    found = _fit(changes[best], y, span, between, float(lags[best]))
    return found if abs(found.correlation) > limits.SLOPE_CORRELATION else None


def _fit(x: FloatArray, y: FloatArray, span: FloatArray, step: float, lag: float) -> Slope:
    """Robust line of ``y`` [k] on ``x`` [k] with a bias per second of ``span`` [k]; ``step`` s from
    one to the next."""
    weight = np.ones(len(x))
    design = np.column_stack([x, span])
    slope, rest = 0.0, y
    normal: FloatArray = np.eye(2)
    for _ in range(limits.SLOPE_ROUNDS):
        normal = np.asarray(np.linalg.pinv((design * weight[:, None]).T @ design))
        found = normal @ (design * weight[:, None]).T @ y
        slope, rest = float(found[0]), y - design @ found
        scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-9
        weight = cauchy_weight((rest / scale) ** 2)
    x0, y0 = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
    power = float((weight * x0**2).sum() * (weight * y0**2).sum())
    correlation = float((weight * x0 * y0).sum()) / np.sqrt(power) if power > 0.0 else 0.0
    # changes that begin with every fix overlap: there are fewer independent ones
    overlap = max(float(np.median(span)) / step, 1.0)
    sd = float(np.sqrt(normal[0, 0] * overlap * (weight * rest**2).sum() / weight.sum()))
    return Slope(slope, sd, lag, correlation)
