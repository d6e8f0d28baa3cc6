"""Faults of the IMU's axes, signs and units."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.faults.fault import Fault, Put, Stretch, whole
from tests.benchmarks.faults.recording import Recording

REASONS = ("axes", "sign", "imu", "inertial", "gyro", "acceleromet", "specific force")
READ = ("ax", "ay", "az", "gx", "gy", "gz")

Columns = dict[str, tuple[float, str]]
"""By column what stands in it instead: a factor times a column."""

CHANGES: dict[str, tuple[str, Columns]] = {
    "accel-negated": (
        "the accelerometer reads minus the specific force",
        {name: (-1.0, name) for name in READ[:3]},
    ),
    "turned-180": (
        "the IMU is turned by 180 deg about its z axis",
        {name: (-1.0, name) for name in ("ax", "ay", "gx", "gy")},
    ),
    "x-y-swapped": (
        "the columns of x and y are swapped",
        {"ax": (1.0, "ay"), "ay": (1.0, "ax"), "gx": (1.0, "gy"), "gy": (1.0, "gx")},
    ),
    "gx-sign": ("the gyro's x axis has the wrong sign", {"gx": (-1.0, "gx")}),
    "gy-sign": ("the gyro's y axis has the wrong sign", {"gy": (-1.0, "gy")}),
    "gz-sign": ("the gyro's z axis has the wrong sign", {"gz": (-1.0, "gz")}),
    "az-sign": ("the accelerometer's z axis has the wrong sign", {"az": (-1.0, "az")}),
    "triads-mirrored": (
        "both triads have the y axis on the wrong side",
        {"ay": (-1.0, "ay"), "gy": (-1.0, "gy")},
    ),
    "gyro-order": (
        "the gyro's columns are y, z, x",
        {"gx": (1.0, "gy"), "gy": (1.0, "gz"), "gz": (1.0, "gx")},
    ),
    "gyro-deg": (
        "the gyro is in deg/s where rad/s is stated",
        {name: (180.0 / np.pi, name) for name in READ[3:]},
    ),
    "gyro-rad": (
        "the gyro's readings are 57 times too small, as rad/s where deg/s is stated",
        {name: (np.pi / 180.0, name) for name in READ[3:]},
    ),
    "accel-in-g": (
        "the accelerometer is in g where m/s^2 is stated",
        {name: (1.0 / 9.80665, name) for name in READ[:3]},
    ),
}


def _put(columns: Columns) -> Put:
    def put(recording: Recording, _: np.random.Generator) -> Stretch:
        rows = np.ones(len(recording.imu.lines), bool)
        read = {name: recording.imu.values(name) for name in READ}
        for name, (factor, other) in columns.items():
            recording.imu.put(name, rows, factor * read[other])
        return whole(recording)

    return put


FAULTS = [Fault(name, what, _put(columns), REASONS) for name, (what, columns) in CHANGES.items()]
