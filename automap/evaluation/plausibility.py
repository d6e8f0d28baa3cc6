"""What recordings look like when a unit, a sign or an axis is wrong.

Every test compares the recording with physics that no drive escapes: gravity is 9.8 m/s^2
and no car turns once around in a second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.evaluation import limits
from automap.fusion.limits import MOST_RATE
from automap.fusion.stuck_readings import clipped_axes, frozen_axes
from automap.records import FloatArray, ImuData, IntArray

Severity = Literal["ok", "info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One thing that was seen: ``text`` says what, ``advice`` what to do (may be empty), ``code``
    names it for programs and for ``accept`` in the manifest (may be empty)."""

    severity: Severity
    text: str
    advice: str = ""
    code: str = ""

    def sentence(self) -> str:
        """Both as one sentence."""
        return f"{self.text}; {self.advice}" if self.advice else self.text


def accel_unit(accel: FloatArray, rate_hz: float) -> Finding:
    """Whether specific force [n, 3], taken as m/s^2, has the size of gravity."""
    size = float(np.median(np.linalg.norm(accel, axis=1)))
    if abs(size / STANDARD_GRAVITY - 1.0) < limits.GRAVITY_TOLERANCE:
        return Finding("ok", f"specific force is {size:.2f} m/s^2 in the median, as gravity is")
    shown = f"specific force is {size:.4g} m/s^2 in the median where gravity is 9.81"
    steady = float(np.linalg.norm(np.median(accel, axis=0)))
    if steady < limits.STEADY_PART * size:
        return Finding(
            "error",
            f"{shown}, and has no steady direction",
            "gravity was taken out or the sensor turned freely: record the raw specific force "
            "of a sensor fixed to the car",
            "accel_unit",
        )
    guesses = (
        (1.0, 'the file is in g: write accel_unit = "g" in [imu]'),
        (1e3, 'the file is in milli-g: divide by 1000 and write accel_unit = "g"'),
        (STANDARD_GRAVITY**2, 'the file is in m/s^2: write accel_unit = "m/s^2" in [imu]'),
        (1e3 * STANDARD_GRAVITY, "the file is in milli-g: divide by 1000"),
        (
            STANDARD_GRAVITY / rate_hz,
            "these are velocity increments: divide by the sampling step to get m/s^2",
        ),
    )
    for expected, advice in guesses:
        if abs(size / expected - 1.0) < limits.GRAVITY_TOLERANCE:
            return Finding("error", shown, advice, "accel_unit")
    advice = "correct accel_unit, the sensor file or the calibration"
    return Finding("error", shown, advice, "accel_unit")


def stamp_unit(rate_hz: float) -> Finding | None:
    """An error for stamps that cannot be nanoseconds by the rate they give, else None."""
    if rate_hz < limits.FASTEST_HZ:
        return None
    shown = f"the stamps give {rate_hz:.3g} readings a second"
    for scale, unit, name in ((1e3, "microseconds", "us"), (1e6, "milliseconds", "ms")):
        if limits.SLOWEST_HZ < rate_hz / scale < limits.FASTEST_HZ:
            advice = (
                f"t_ns is in nanoseconds, these look like {unit}: write "
                f'time_format = "{name}" in [imu]'
            )
            return Finding("error", shown, advice, "stamp_unit")
    advice = "t_ns is in nanoseconds of one clock; correct the column"
    return Finding("error", shown, advice, "stamp_unit")


def gyro_size(gyro: FloatArray) -> Finding:
    """Whether rotation rates [n, 3], taken as rad/s, are a vehicle's."""
    rate = np.abs(gyro - np.median(gyro, axis=0))
    largest = float(np.quantile(rate.max(axis=1), limits.STRONGEST_RATES))
    if largest > MOST_RATE:
        return Finding(
            "warning",
            f"rotation rates reach {largest:.3g} rad/s, more than a car's",
            "check gyro_unit; deg/s taken as rad/s looks like that",
            "gyro_unit",
        )
    return Finding("ok", f"rotation rates reach {largest:.3g} rad/s")


def stuck_readings(imu: ImuData) -> list[Finding]:
    """Axes that never change, and that end at their range."""
    findings = [
        Finding(
            "error" if axis.column[0] == "a" else "warning",
            f"{axis.column} never changes",
            "the sensor or its wiring is broken on this axis",
            "imu_stuck",
        )
        for axis in frozen_axes(imu, np.ones(len(imu), np.bool_))
        if axis.seconds == float(imu.t_ns[-1] - imu.t_ns[0]) * 1e-9
    ]
    return findings + [
        Finding(
            "warning",
            f"{axis.column} sits at its largest value for {axis.seconds:.1f} s",
            "its range is too small; choose a wider one",
            "imu_clipped",
        )
        for axis in clipped_axes(imu)
    ]


def overlap_s(first: IntArray | FloatArray, second: IntArray | FloatArray) -> float:
    """Length of time that two spans share, negative for the gap between them."""
    return float(min(first[-1], second[-1]) - max(first[0], second[0]))
