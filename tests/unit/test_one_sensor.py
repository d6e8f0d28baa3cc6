"""Readings of two sensors in one table are told as that, by their gravity and noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from automap.evaluation.one_sensor import gyro_unit_from, other_from, two_in_turn
from automap.frames import rpy_to_matrix
from automap.records import BoolArray, FloatArray, ImuData
from pipeline.check.command import check_drive
from tests.unit.checked_drive import errors_told
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.input_drive import write_drive

GRAVITY = 9.80665


@cache
def readings() -> ImuData:
    return record(city_drive(120.0, 10007), Sensor(), 10007, rate=50.0)


def changed(imu: ImuData, rows: BoolArray, turn: FloatArray, force: float, rate: float) -> ImuData:
    """Readings whose ``rows`` [n] are turned by ``turn`` [3, 3], and so many times as large."""
    pick = rows[:, None]
    return replace(
        imu,
        accel=np.where(pick, force * imu.accel @ turn.T, imu.accel),
        gyro=np.where(pick, rate * imu.gyro @ turn.T, imu.gyro),
    )


def turned_by(roll: float, pitch: float, yaw: float) -> FloatArray:
    return np.asarray(rpy_to_matrix(np.radians([[roll, pitch, yaw]]))[0])


def test_one_sensor_is_one() -> None:
    imu = readings()
    assert two_in_turn(imu) is None
    assert other_from(imu) is None
    assert gyro_unit_from(imu) is None


@pytest.mark.parametrize("every", [2, 4])
def test_rows_in_turn_are_told(every: int) -> None:
    """Every second one, or one of four, of a sensor that lies on its back."""
    imu = readings()
    rows = np.arange(len(imu)) % every == 1
    found = two_in_turn(changed(imu, rows, turned_by(180.0, 0.0, 0.0), 1.0, 1.0))
    assert found is not None
    assert (found.severity, found.code) == ("error", "imu_mixed")


def test_vibration_and_steps_are_no_second_sensor() -> None:
    imu, rng = readings(), np.random.default_rng(10008)
    loud = imu.accel + rng.normal(0.0, 3.0, imu.accel.shape)
    coarse = 0.5 * np.rint(imu.accel / 0.5)
    for accel in (loud, coarse):
        assert two_in_turn(replace(imu, accel=accel)) is None


@pytest.mark.parametrize(
    ("turn", "force", "angle"),
    [
        (turned_by(90.0, 0.0, 0.0), 1.0, 90),
        (turned_by(0.0, -40.0, 120.0), 1.0, 40),
        (np.eye(3), 1.0 / GRAVITY, 0),
    ],
)
@pytest.mark.parametrize("share", [0.3, 0.75])
def test_a_sensor_that_changes_is_told_with_when(
    turn: FloatArray, force: float, angle: float, share: float
) -> None:
    imu = readings()
    rows = np.arange(len(imu)) >= share * len(imu)
    found = other_from(changed(imu, rows, turn, force, 1.0))
    assert found is not None
    assert (found.severity, found.code) == ("error", "imu_changed")
    if angle:
        off = float(found.text.split("gravity lies ")[1].split(" deg")[0])
        assert off == pytest.approx(angle, abs=5.0)
    else:
        assert "two units stand in one file" in found.advice
    at = float(found.text.split("(")[1].split(" s")[0])
    assert at == pytest.approx(share * 120.0, abs=3.0)


def test_a_gyro_whose_unit_changes_is_told() -> None:
    imu = readings()
    for begins in (True, False):
        rows = (np.arange(len(imu)) < 0.6 * len(imu)) == begins
        found = gyro_unit_from(changed(imu, rows, np.eye(3), 1.0, 180.0 / np.pi))
        assert found is not None
        assert f"times {'smaller' if begins else 'larger'} beside" in found.text
    assert gyro_unit_from(changed(imu, rows, np.eye(3), 1.0, 10.0)) is None


def test_what_is_held_in_hands_before_the_drive_is_no_change() -> None:
    imu = readings()
    rows = np.arange(len(imu)) < 0.3 * len(imu)
    held = changed(imu, rows, turned_by(90.0, 0.0, 0.0), 1.0, 1.0)
    assert other_from(held) is not None
    assert other_from(held, begin_s=37.0) is None


def test_gravity_that_was_taken_out_is_no_change() -> None:
    """What is left of the motion is now more and now less."""
    imu = readings()
    assert other_from(replace(imu, accel=imu.accel - np.median(imu.accel, axis=0))) is None


def test_check_stops_at_the_cause(tmp_path: Path) -> None:
    """It was told to write another unit, which is wrong in the other half."""
    folder = write_drive(tmp_path / "drive")
    lines = (folder / "imu.csv").read_text().splitlines()
    names = lines[0].split(",")
    force = [names.index(name) for name in ("ax", "ay", "az")]
    for k in range(1 + len(lines) // 2, len(lines)):
        cells = lines[k].split(",")
        for c in force:
            cells[c] = f"{float(cells[c]) / GRAVITY:.6f}"
        lines[k] = ",".join(cells)
    (folder / "imu.csv").write_text("\n".join(lines) + "\n")
    told = errors_told(check_drive(folder))
    assert "two units stand in one file" in told
    assert len(told.splitlines()) == 1
