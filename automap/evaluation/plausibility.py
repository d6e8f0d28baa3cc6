"""What recordings look like when a unit, a sign or an axis is wrong.

Every test compares the recording with physics that no drive escapes: gravity is 9.8 m/s^2
and points down, a car turns as its course turns and accelerates as its speed changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.evaluation import limits
from automap.records import Fixes, FixType, FloatArray, ImuData, IntArray

Severity = Literal["ok", "info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One thing that was seen: ``text`` says what, ``advice`` what to do (may be empty)."""

    severity: Severity
    text: str
    advice: str = ""

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
            return Finding("error", shown, advice)
    return Finding("error", shown, "correct accel_unit, the sensor file or the calibration")


def stamp_unit(rate_hz: float) -> Finding | None:
    """An error for stamps that cannot be nanoseconds by the rate they give, else None."""
    if rate_hz < limits.FASTEST_HZ:
        return None
    shown = f"the stamps give {rate_hz:.3g} readings a second"
    for scale, unit in ((1e3, "microseconds"), (1e6, "milliseconds")):
        if limits.SLOWEST_HZ < rate_hz / scale < limits.FASTEST_HZ:
            advice = f"t_ns is in nanoseconds, these look like {unit}: multiply by {scale:.0f}"
            return Finding("error", shown, advice)
    return Finding("error", shown, "t_ns is in nanoseconds of one clock; correct the column")


def course_turns(fixes: Fixes) -> FloatArray:
    """Turn rates [k] in rad/s of the course between fixes while the vehicle moves."""
    window = _course_windows(fixes)
    return np.asarray(np.abs(window.turn) / window.length)


@dataclass(frozen=True)
class _CourseWindows:
    start: FloatArray
    length: FloatArray
    turn: FloatArray
    speed_change: FloatArray


def _course_windows(fixes: Fixes) -> _CourseWindows:
    """Pieces of about two seconds between fixes with velocity, at speed."""
    vn, ve = fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]
    good = np.isfinite(vn) & np.isfinite(ve) & np.isfinite(fixes.gps_s)
    good &= fixes.fix_type >= FixType.TWO_D
    t, vn, ve = fixes.gps_s[good], vn[good], ve[good]
    if len(t) < 3:
        empty = np.zeros(0)
        return _CourseWindows(empty, empty, empty, empty)
    last = np.searchsorted(t, t + limits.TURN_WINDOW_S - limits.STAMP_SLACK_S)
    first = np.arange(len(t))
    inside = last < len(t)
    first, last = first[inside], last[inside]
    speed, course = np.hypot(vn, ve), np.arctan2(ve, vn)
    length = t[last] - t[first]
    usable = (length > 0) & (length < limits.LONG_WINDOWS * limits.TURN_WINDOW_S)
    usable &= (speed[first] > limits.FAST_M_S) & (speed[last] > limits.FAST_M_S)
    first, last = first[usable], last[usable]
    turn = (course[last] - course[first] + np.pi) % (2.0 * np.pi) - np.pi
    return _CourseWindows(t[first], length[usable], turn, speed[last] - speed[first])


def gyro_unit(imu: ImuData, fixes: Fixes | None) -> Finding:
    """Whether rotation rates, taken as rad/s, have the size of a vehicle's.

    With fixes the strongest turns of both are compared, which needs no common clock.
    """
    rate = np.abs(imu.gyro - np.median(imu.gyro, axis=0))
    largest = float(np.quantile(rate.max(axis=1), limits.STRONGEST_RATES))
    turns = course_turns(fixes) if fixes is not None else np.zeros(0)
    if fixes is not None and len(turns) >= limits.LEAST_TURNS:
        course = float(np.quantile(turns, limits.STRONGEST_TURNS))
        sensor = float(np.quantile(_smooth_rates(imu), limits.STRONGEST_TURNS))
        if course > limits.LEAST_TURN and sensor > 0:
            shown = (
                f"the strongest turns are {sensor:.3g} rad/s in the gyro and {course:.3g} rad/s "
                "in the course of the fixes"
            )
            if sensor > limits.TURN_RATIO * course:
                return Finding("error", shown, 'write gyro_unit = "deg/s" in [imu]')
            if sensor * limits.TURN_RATIO < course:
                advice = (
                    'write gyro_unit = "rad/s" in [imu]; if it is, the rates are angle increments '
                    "or the gyro stands still"
                )
                # readings of another part of the drive may well lack its turns
                span = np.ptp(fixes.gps_s[np.isfinite(fixes.gps_s)])
                whole = _span_s(imu.t_ns) > limits.WHOLE * span
                return Finding("error" if whole else "warning", shown, advice)
            return Finding("ok", shown)
    if largest > limits.LARGEST_RATE:
        return Finding(
            "warning",
            f"rotation rates reach {largest:.3g} rad/s, more than a car's",
            "check gyro_unit; deg/s taken as rad/s looks like that",
        )
    return Finding("ok", f"rotation rates reach {largest:.3g} rad/s")


def _span_s(t_ns: IntArray) -> float:
    return float(t_ns[-1] - t_ns[0]) * 1e-9


def _smooth_rates(imu: ImuData) -> FloatArray:
    """Size of the mean rotation rate [k], rad/s, over windows of two seconds, bias removed."""
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    gyro = imu.gyro - np.median(imu.gyro, axis=0)
    steps = np.diff(t)[:, None]
    angle = np.vstack([np.zeros(3), np.cumsum(0.5 * (gyro[1:] + gyro[:-1]) * steps, axis=0)])
    edges = np.arange(0.0, t[-1], 0.5 * limits.TURN_WINDOW_S)
    at = np.column_stack([np.interp(edges, t, angle[:, axis]) for axis in range(3)])
    if len(at) < 3:
        return np.zeros(1)
    return np.asarray(np.linalg.norm(at[2:] - at[:-2], axis=1) / limits.TURN_WINDOW_S)


def gravity_direction(accel: FloatArray, C_vehicle_sensor: FloatArray) -> Finding:
    """Whether the mean specific force [n, 3] in vehicle axes points up, as gravity makes it."""
    mean = np.median(accel, axis=0)
    up = -mean[2] / np.linalg.norm(mean)
    tilt = float(np.arccos(np.clip(up, -1.0, 1.0)))
    if tilt < limits.TILTED:
        return Finding("ok", f"gravity is on the down axis, to {np.degrees(tilt):.1f} deg")
    sensor = C_vehicle_sensor.T @ mean
    axis = int(np.argmax(np.abs(sensor)))
    letter = "U" if sensor[axis] > 0 else "D"
    measured = (
        f"with the axes given, gravity lies {np.degrees(tilt):.0f} deg off the down axis "
        f"(the sensor's {'xyz'[axis]} reads {sensor[axis]:+.1f} m/s^2)"
    )
    if tilt < limits.STEEP:
        return Finding(
            "warning",
            measured,
            'the sensor is mounted askew: write axes = "unknown" to have its mounting estimated',
        )
    advice = (
        f"its {'xyz'[axis]} points {'up' if letter == 'U' else 'down'}, so axes must have {letter} "
        f"in place {axis + 1} (or the sign of the readings is turned: at rest and level an "
        'accelerometer reads +g along the axis that points up); if unsure write axes = "unknown"'
    )
    return Finding("error", measured, advice)


def driving_axes(imu: ImuData, fixes: Fixes, imu_gps_s: FloatArray) -> list[Finding]:
    """Whether forward force and yaw rate follow the fixes' velocity.

    ``imu_gps_s`` [n] is the GPS time of the readings, good to some 0.3 s.
    """
    window = _course_windows(fixes)
    inside = (window.start > imu_gps_s[0]) & (window.start + window.length < imu_gps_s[-1])
    if np.count_nonzero(inside) < limits.LEAST_WINDOWS:
        return []
    start, end = window.start[inside], (window.start + window.length)[inside]
    steps = np.diff(imu_gps_s)[:, None]
    readings = np.hstack([imu.accel, imu.gyro])
    readings = readings - np.median(readings, axis=0)
    total = np.vstack(
        [np.zeros(6), np.cumsum(0.5 * (readings[1:] + readings[:-1]) * steps, axis=0)]
    )
    change = np.column_stack(
        [
            np.interp(end, imu_gps_s, total[:, i]) - np.interp(start, imu_gps_s, total[:, i])
            for i in range(6)
        ]
    )
    findings = []
    speed_change, turn = window.speed_change[inside], window.turn[inside]
    if np.std(speed_change) > limits.SPEED_CHANGES:
        forward, right = (_correlation(change[:, axis], speed_change) for axis in (0, 1))
        findings.append(_forward_finding(forward, right))
    if np.std(turn) > limits.TURNS:
        findings.append(_yaw_finding(_correlation(change[:, 5], turn)))
    return findings


def _forward_finding(forward: float, right: float) -> Finding:
    seen = f"speed changes go with the forward force to {forward:+.2f} (correlation)"
    weakly = forward > limits.WEAK_CORRELATION and abs(right) < forward
    if forward > limits.CLEAR_CORRELATION or weakly:
        return Finding("ok", seen)
    if forward < -limits.CLEAR_CORRELATION:
        advice = "the sensor's forward axis points back: correct axes in [imu]"
        return Finding("error", seen, advice)
    if abs(right) > limits.CLEAR_CORRELATION:
        side = "right" if right > 0 else "left"
        return Finding(
            "error",
            f"speed changes go with the force to the {side} ({right:+.2f}), not with the forward "
            f"one ({forward:+.2f})",
            'the sensor is turned by a quarter: correct axes in [imu], or write "unknown"',
        )
    return Finding(
        "warning", seen, 'if it is near zero the axes may be wrong: write axes = "unknown"'
    )


def _yaw_finding(yaw: float) -> Finding:
    seen = f"turns of the course go with the rate about the down axis to {yaw:+.2f} (correlation)"
    if yaw > limits.CLEAR_CORRELATION:
        return Finding("ok", seen)
    if yaw < -limits.CLEAR_CORRELATION:
        advice = "the gyro turns the other way: correct axes, or the sign of the gyro columns"
        return Finding("error", seen, advice)
    return Finding("warning", seen, "the gyro's axes differ from the accelerometer's, or time does")


def _correlation(a: FloatArray, b: FloatArray) -> float:
    if np.std(a) == 0 or np.std(b) == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def stuck_readings(imu: ImuData) -> list[Finding]:
    """Axes that never change, and readings that sit at their largest value."""
    findings = []
    for values, triad in ((imu.gyro, "g"), (imu.accel, "a")):
        for axis, letter in enumerate("xyz"):
            column = values[:, axis]
            if np.ptp(column) == 0:
                findings.append(
                    Finding(
                        "error" if triad == "a" else "warning",
                        f"{triad}{letter} never changes",
                        "the sensor or its wiring is broken on this axis",
                    )
                )
                continue
            peak = np.abs(column).max()
            share = np.count_nonzero(np.abs(column) > limits.AT_PEAK * peak)
            most = max(limits.STUCK_COUNT, limits.STUCK_SHARE * len(column))
            if share > most and peak > limits.STUCK_SIGMAS * np.std(column):
                findings.append(
                    Finding(
                        "warning",
                        f"{triad}{letter} sits at its largest value {share} times",
                        "its range is too small; choose a wider one",
                    )
                )
    return findings


def overlap_s(first: IntArray | FloatArray, second: IntArray | FloatArray) -> float:
    """Length of time that two spans share, negative for the gap between them."""
    return float(min(first[-1], second[-1]) - max(first[0], second[0]))
