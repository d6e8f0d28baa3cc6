"""Faults of the IMU's readings and stamps."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from tests.benchmarks.faults.fault import (
    ACCEL,
    GYRO,
    TIME,
    DoesNotApplyError,
    Fault,
    Put,
    Stretch,
    driving,
    readings_in,
    whole,
)
from tests.benchmarks.faults.log import Mask
from tests.benchmarks.faults.recording import NS, Recording

CLIP = np.radians(20.0)
CLIP_G = 9.80665
"""A range of 1 g: gravity and a slope are at its end."""


def _spike(column: str, value: float, count: int = 1) -> Put:
    """``count`` readings in a row of ``value``, in rad/s or m/s^2."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        begin, _end = driving(recording, 20.0)
        first = int(np.flatnonzero(readings_in(recording, (begin, begin + 1.0)))[0])
        rows = np.zeros(len(recording.imu.lines), bool)
        rows[first : first + count] = True
        recording.imu.put(column, rows, value)
        # what a wild reading leaves behind is judged with it
        return begin - 1.0, begin + 10.0

    return put


def _frozen(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = driving(recording, 20.0)
    recording.imu.hold(readings_in(recording, stretch))
    return stretch


def _gap(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = driving(recording, 5.0)
    recording.imu.keep(~readings_in(recording, stretch))
    return stretch


def _fast_clock(recording: Recording, _: np.random.Generator) -> Stretch:
    begin, end = whole(recording)
    middle = 0.5 * (begin + end)
    start, t_ns = recording.stamp(middle), recording.imu.t_ns
    later = t_ns > start
    gained = np.rint((t_ns - start) * 0.01).astype(np.int64)
    recording.imu.put_stamps(later, t_ns + gained)
    return middle, end


def _clock(rate: float = 0.0, jump_s: float = 0.0) -> Put:
    """Stamps that gain ``rate`` from the first fix on and ``jump_s`` at the drive's middle."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        begin, end = whole(recording)
        middle, t_ns = recording.stamp(0.5 * (begin + end)), recording.imu.t_ns
        gained = np.rint((t_ns - recording.stamp(begin)) * rate).astype(np.int64)
        gained += np.where(t_ns > middle, round(jump_s * NS), 0)
        recording.imu.put_stamps(_all(recording), t_ns + gained)
        return (0.5 * (begin + end) if jump_s else begin), end

    return put


def _axis_frozen(recording: Recording, _: np.random.Generator) -> Stretch:
    stretch = driving(recording, 20.0)
    rows = readings_in(recording, stretch)
    values = recording.imu.values("gz")
    recording.imu.put("gz", rows, float(values[rows][0]))
    return stretch


def _clipped(triad: str, most: float, unit: str) -> Put:
    """Each axis of a triad ends at ``most`` to both sides."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        any_row = np.zeros(len(recording.imu.lines), bool)
        for name in (f"{triad}x", f"{triad}y", f"{triad}z"):
            values = recording.imu.values(name)
            over = np.abs(values) > most
            recording.imu.put(name, over, np.clip(values, -most, most))
            any_row |= over
        if not any_row.any():
            raise DoesNotApplyError(f"no reading is beyond {unit}")
        return whole(recording)

    return put


def _low_passed(tau_s: float) -> Put:
    """All axes of the gyro behind a filter of first order."""

    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        spacing = float(np.median(np.diff(recording.imu.t_ns))) / NS
        kept = float(np.exp(-spacing / tau_s))
        for name in ("gx", "gy", "gz"):
            values = recording.imu.values(name)
            start = [kept * values[0]]
            slow = lfilter([1.0 - kept], [1.0, -kept], values, zi=start)[0]
            recording.imu.put(name, _all(recording), slow)
        return whole(recording)

    return put


def _times(column: str, factor: float) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        recording.imu.put(column, _all(recording), factor * recording.imu.values(column))
        return whole(recording)

    return put


def _all(recording: Recording) -> Mask:
    return np.ones(len(recording.imu.lines), bool)


FAULTS = [
    Fault("accel-1e5", "one accelerometer reading of 1e5 m/s^2", _spike("ax", 1e5), ACCEL),
    Fault("accel-1e3", "one accelerometer reading of 1e3 m/s^2", _spike("ax", 1e3), ACCEL),
    Fault(
        "accel-burst",
        "ten accelerometer readings in a row of 1e3 m/s^2",
        _spike("ax", 1e3, 10),
        ACCEL,
    ),
    Fault("gyro-spike", "one gyro reading of 2000 deg/s", _spike("gz", np.radians(2000.0)), GYRO),
    Fault(
        "imu-frozen",
        "the IMU's readings stay for 20 s",
        _frozen,
        (*ACCEL, "gyro", "reading", "frozen", "stuck"),
    ),
    Fault("imu-gap", "the IMU is silent for 5 s", _gap, ("imu", "gap", "reading")),
    Fault(
        "imu-clock",
        "the IMU's clock is 1 % fast from the middle on",
        _fast_clock,
        (*TIME, "imu", "inertial", "drift"),
    ),
    Fault(
        "imu-clock-all",
        "the IMU's clock is 1 % fast all the way",
        _clock(rate=0.01),
        (*TIME, "imu", "inertial", "drift"),
    ),
    *(
        Fault(
            f"imu-jump-{name}",
            f"the IMU's stamps jump by {jump:g} s in the middle",
            _clock(jump_s=jump),
            (*TIME, "imu", "inertial", "jump"),
        )
        for name, jump in (("0.3", 0.3), ("1", 1.0))
    ),
    Fault(
        "gyro-axis-frozen",
        "the gyro's z axis keeps its reading for 20 s of driving",
        _axis_frozen,
        (*GYRO, "reading", "frozen", "stuck"),
    ),
    Fault(
        "gyro-clipped",
        "the gyro clips at 20 deg/s",
        _clipped("g", CLIP, "20 deg/s"),
        (*GYRO, "clip", "satur"),
    ),
    Fault(
        "gyro-low-pass",
        "the gyro is behind a low-pass of 0.5 s",
        _low_passed(0.5),
        (*GYRO, *TIME),
    ),
    Fault(
        "accel-clipped",
        "the accelerometer clips at 1 g",
        _clipped("a", CLIP_G, "1 g"),
        (*ACCEL, "clip", "satur"),
    ),
    Fault(
        "gyro-scale",
        "the gyro's z axis reads twice the rate",
        _times("gz", 2.0),
        (*GYRO, "heading", "nhc"),
    ),
    Fault(
        "accel-sign",
        "the accelerometer's y axis has the wrong sign",
        _times("ay", -1.0),
        (*ACCEL, "axes", "sign", "nhc"),
    ),
]
