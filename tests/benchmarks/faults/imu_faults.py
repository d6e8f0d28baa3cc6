"""Faults of the IMU's readings and stamps."""

from __future__ import annotations

import numpy as np

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
from tests.benchmarks.faults.recording import Recording

CLIP = np.radians(20.0)


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


def _clipped(recording: Recording, _: np.random.Generator) -> Stretch:
    any_row = np.zeros(len(recording.imu.lines), bool)
    for name in ("gx", "gy", "gz"):
        values = recording.imu.values(name)
        over = np.abs(values) > CLIP
        recording.imu.put(name, over, np.clip(values, -CLIP, CLIP))
        any_row |= over
    if not any_row.any():
        raise DoesNotApplyError("it never turns faster than 20 deg/s")
    return whole(recording)


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
    Fault("gyro-clipped", "the gyro clips at 20 deg/s", _clipped, (*GYRO, "clip", "satur")),
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
