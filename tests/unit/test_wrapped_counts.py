"""Counts of 16 bits without their sign, or beyond their range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.imu_csv import ImuFormat, read_imu_csv
from automap.io.imu_log import LogFormat, read_imu_log
from automap.io.sensor_file import find_sensor, read_sensor
from automap.records import FloatArray


def _counts(largest: float = 30000.0, n: int = 400) -> FloatArray:
    """Counts [n, 6] of a sensor at rest but for a swing of its first axis, with noise."""
    rng = np.random.default_rng(5)
    counts = rng.normal(0.0, 20.0, (n, 6))
    counts[:, 0] += largest * np.sin(np.linspace(0.0, 12.0, n))
    counts[:, 5] -= 16384.0
    return np.rint(counts)


def _write(path: Path, counts: FloatArray) -> Path:
    lines = ["t_ns,gx,gy,gz,ax,ay,az"]
    lines += [f"{k * 10_000_000}," + ",".join(f"{v:.0f}" for v in row)
              for k, row in enumerate(counts)]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def _format() -> LogFormat:
    sensor = read_sensor(find_sensor("mpu9150"))
    return LogFormat(gyro_unit="counts", accel_unit="counts", sensor=sensor)


def test_counts_that_lost_their_sign_are_read_with_it(tmp_path: Path) -> None:
    counts = _counts()
    plain = read_imu_log(_write(tmp_path / "plain.csv", counts), _format())
    lost = read_imu_log(_write(tmp_path / "lost.csv", counts % 65536), _format())
    assert np.array_equal(lost.data.gyro, plain.data.gyro)
    assert np.array_equal(lost.data.accel, plain.data.accel)
    assert any("without their sign" in text for text in lost.warnings)
    assert not any("sign" in text for text in plain.warnings)
    drive = read_imu_csv(tmp_path / "lost.csv", ImuFormat(gyro_unit="rad/s", accel_unit="m/s^2"))
    assert any("without their sign" in text for text in drive.notes)
    assert np.array_equal(drive.data.gyro, plain.data.gyro)


def test_counts_about_an_offset_are_left_alone(tmp_path: Path) -> None:
    """A converter's counts have no sign to lose."""
    counts = np.clip(_counts() + 32768.0, 0, 65535)
    read = read_imu_log(_write(tmp_path / "offset.csv", counts), _format())
    assert np.array_equal(read.data.gyro, counts[:, :3])


def test_counts_that_ran_over_are_refused(tmp_path: Path) -> None:
    fast = _counts(36000.0)
    wrapped = (fast + 32768) % 65536 - 32768
    with pytest.raises(InputError, match=r"the gyro.s x axis jumps from 3.* its 16 bits ran over"):
        read_imu_log(_write(tmp_path / "wrapped.csv", wrapped), _format())
    # one that is cut off at both ends is no such thing, and saturation is told elsewhere
    cut = np.clip(_counts(3e5), -32768, 32767)
    cut[200, 0], cut[201, 0] = 32767, -32768
    read_imu_log(_write(tmp_path / "cut.csv", cut), _format())
