"""Readings that come in steps, and the dead zone that they are taken for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from automap.gap import base_model
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.reading_steps import coarse, cut_off, step_of
from automap.records import FloatArray
from tests.unit.test_gap import simulated

STEP = 0.00182


@pytest.fixture(scope="module")
def truncated() -> Fit:
    drive = simulated({})
    gyro = np.trunc(drive.imu.gyro / STEP) * STEP
    model = base_model()
    return fit_drive(
        open_drive(replace(drive, imu=replace(drive.imu, gyro=gyro)), model.options), model
    )


@pytest.mark.parametrize("digits", [6, 9])
def test_the_step_of_readings_is_found_in_what_a_log_leaves_of_them(digits: int) -> None:
    rng = np.random.default_rng(4)
    readings = np.trunc(rng.normal(0.0, 0.05, 5000) / STEP) * STEP
    assert step_of(np.round(readings, digits)) == pytest.approx(STEP, rel=1e-3)
    assert step_of(rng.normal(0.0, 0.05, 5000)) == 0.0
    assert step_of(np.zeros(5000)) == 0.0


def test_a_dead_zone_of_a_steps_size_may_be_what_is_cut_off(truncated: Fit) -> None:
    found = {"x": (0.0017, 2e-4), "y": (0.0, 2e-3), "z": (0.0008, 3e-4)}
    assert "in the steps of 0.00182" in cut_off((truncated,), "gyro_dead_zone", found)
    # forces come in finer ones, and a zone of three steps is one
    assert cut_off((truncated,), "accel_dead_zone", {"x": (0.02, 1e-3)}) == ""
    assert cut_off((truncated,), "gyro_dead_zone", {"x": (3.0 * STEP, 2e-4)}) == ""
    # nor is one that is known poorly what finer steps, or none, cut off
    assert cut_off((truncated,), "gyro_dead_zone", {"x": (3.0 * STEP, 2.0 * STEP)}) == ""
    assert cut_off((truncated,), "accel_dead_zone", {"x": (1e-3, 1e-3)}) == ""
    assert cut_off((truncated,), "gyro_scale", {"x": (0.5 * STEP, 1e-4)}) == ""


def _read(gyro_z: FloatArray) -> str:
    drive = simulated({})
    gyro = drive.imu.gyro.copy()
    gyro[:, 2] = gyro_z
    model = base_model()
    opened = open_drive(replace(drive, imu=replace(drive.imu, gyro=gyro)), model.options)
    fit = SimpleNamespace(opened=opened, model=model)
    return coarse([fit], "gyro")  # type: ignore[list-item]


def test_readings_that_are_held_or_rounded_are_told() -> None:
    fine = simulated({}).imu.gyro[:, 2]
    assert _read(fine) == ""
    # as of a range of 250 degrees a second in 16 bits
    assert _read(1.3e-4 * np.rint(fine / 1.3e-4)) == ""
    assert "its z axis comes in steps of 0.05 rad/s" in _read(0.05 * np.rint(fine / 0.05))
    held, at = fine.copy(), fine[0]
    for i, value in enumerate(fine):
        at = value if abs(value - at) > 0.03 else at
        held[i] = at
    assert "is told anew only when it has changed by 0.03" in _read(held)
