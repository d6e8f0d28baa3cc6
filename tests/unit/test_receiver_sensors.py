"""A receiver's own inertial sensors: rates, units, clocks and holes."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from receiver_messages import GPS, pvt, ubx

from automap.io.esf import ReceiverImu
from automap.io.receiver import ReceiverLog, read_receiver_bytes

GYRO, ACCEL = (14, 13, 5), (16, 17, 18)


def word(kind: int, value: int) -> int:
    return kind << 24 | value & 0xFFFFFF


def meas(
    tag: int, readings: list[tuple[int, int]], calibrated: bool = False, counted: bool = True
) -> bytes:
    """``counted``: the message says how many readings it has, as old firmware does not."""
    flags = (len(readings) if counted else 0) << 11 | calibrated << 3
    words = [word(kind, value) for kind, value in readings]
    payload = struct.pack("<IHH", tag & 0xFFFFFFFF, flags, 0)
    payload += b"".join(struct.pack("<I", w) for w in words)
    return ubx(0x1002, payload + (struct.pack("<I", tag & 0xFFFFFFFF) if calibrated else b""))


def raw(header: int, samples: list[tuple[int, list[tuple[int, int]]]]) -> bytes:
    payload = struct.pack("<I", header & 0xFFFFFFFF)
    for tag, readings in samples:
        for kind, value in readings:
            payload += struct.pack("<II", word(kind, value), tag & 0xFFFFFFFF)
    return ubx(0x1003, payload)


def imu_of(log: ReceiverLog) -> ReceiverImu:
    assert log.imu is not None
    return log.imu


def test_units_axes_and_temperature() -> None:
    parts = [pvt(GPS)]
    for k in range(5):
        gyro = [(14, 4096), (13, -8192), (5, 12288), (12, 2550)]
        parts.append(meas(1000 + 10 * k, gyro, calibrated=True))
        parts.append(meas(1000 + 10 * k, [(16, 1024), (17, -2048), (18, 10240)]))
    imu = imu_of(read_receiver_bytes(b"".join(parts), "x"))
    assert imu.source == "ESF-MEAS"
    assert np.allclose(imu.tag_s, 1.0 + 0.01 * np.arange(5))
    assert np.allclose(imu.gyro, np.radians([1.0, -2.0, 3.0]))
    assert np.allclose(imu.accel, [1.0, -2.0, 10.0])
    assert imu.temp_c is not None
    assert np.allclose(imu.temp_c, 25.5)


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("calibrated", [True, False])
def test_a_calibrated_time_tag_is_no_reading(counted: bool, calibrated: bool) -> None:
    """Also where it looks like one: the upper byte of a tag is then a kind of data."""
    parts = [pvt(GPS)]
    # tags like the head of a gyro reading about x, of some value
    tags = [(14 << 24) + 100_000 + 10 * k for k in range(8)]
    for tag in tags:
        gyro = [(13, -8192), (5, 12288), (14, 4096)]
        force = [(16, 1024), (17, -2048), (18, 10240)]
        parts.append(meas(tag, gyro + force, calibrated, counted))
    imu = imu_of(read_receiver_bytes(b"".join(parts), "x"))
    assert len(imu) == len(tags)
    assert np.allclose(imu.gyro, np.radians([1.0, -2.0, 3.0]))
    from automap.io.ubx import decode_ubx

    assert len(decode_ubx(b"".join(parts))["ESF-MEAS"]) == 6 * len(tags)


def test_accelerometer_between_gyro_readings_is_interpolated() -> None:
    parts = [pvt(GPS)]
    for k in range(20):
        parts.append(meas(10 * k + 5, [(kind, 1024 * (10 * k + 5)) for kind in ACCEL]))
        parts.append(meas(10 * k, [(kind, 10 * k) for kind in GYRO]))
    log = read_receiver_bytes(b"".join(parts), "x")
    imu = imu_of(log)
    assert len(imu) == 19  # the first has nothing before it
    assert np.allclose(imu.accel[:, 0], imu.tag_s * 1e3)
    assert any("1 readings without" in w for w in log.warnings)


def test_a_hole_in_one_sensor_leaves_no_invented_readings() -> None:
    parts = [pvt(GPS)]
    for k in range(40):
        parts.append(meas(10 * k, [(kind, 1) for kind in GYRO]))
        if not 10 <= k < 25:
            parts.append(meas(10 * k, [(kind, 1024) for kind in ACCEL]))
    imu = imu_of(read_receiver_bytes(b"".join(parts), "x"))
    assert len(imu) == 25
    assert not np.any((imu.tag_s > 0.095) & (imu.tag_s < 0.245))


@pytest.mark.parametrize("ticks", [25_600.0, 1_000_000.0])
def test_raw_readings_get_their_clock_from_the_messages(ticks: float) -> None:
    parts = []
    start = 0xFFFFFFFF - 5000  # the tag rolls over
    for k in range(30):
        samples = []
        for j in range(10):
            tag = start + round((0.1 * k + 0.01 * j) * ticks)
            samples.append((tag, [(kind, 100 * k) for kind in (*GYRO, *ACCEL)]))
        parts.append(raw(7_000 + 100 * k, samples))
        if k % 10 == 9:
            parts.append(pvt(GPS + (k + 1) // 10))
    imu = imu_of(read_receiver_bytes(b"".join(parts), "x"))
    assert imu.source == "ESF-RAW"
    assert len(imu) == 300
    assert np.allclose(np.diff(imu.tag_s), 0.01, rtol=0.01)
    assert imu.gps_s is not None
    assert np.allclose(imu.gps_s[[99, 199, 299]], GPS + np.arange(1, 4), atol=0.02)


def test_an_incomplete_set_of_sensors_is_no_imu_but_said() -> None:
    log = read_receiver_bytes(pvt(GPS) + meas(1, [(14, 1), (16, 2)]), "x")
    assert log.imu is None
    assert any("not a full set" in w for w in log.warnings)


def test_sensors_without_any_fix() -> None:
    parts = [meas(10 * k, [(kind, 1024) for kind in (*GYRO, *ACCEL)]) for k in range(10)]
    log = read_receiver_bytes(b"".join(parts), "x")
    assert len(log.fixes) == 0
    assert imu_of(log).gps_s is None
