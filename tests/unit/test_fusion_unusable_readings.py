"""Readings that cannot be are bridged, and nothing else is touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.standstill import unmoved
from automap.fusion.unusable_readings import bridge_noise, bridge_unusable
from automap.records import ImuData
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import Motion, city_drive
from tests.unit.fusion_receiver import Receiver, receive


@pytest.fixture(scope="module")
def motion() -> Motion:
    return city_drive(120.0, 7)


@pytest.fixture(scope="module")
def imu(motion: Motion) -> ImuData:
    return record(motion, Sensor(), 4)


def test_a_sound_recording_stays_as_it_is(imu: ImuData) -> None:
    bridged = bridge_unusable(imu)
    assert bridged.imu is imu
    assert not bridged.stretch_s.any()


def test_potholes_are_no_wild_readings(imu: ImuData) -> None:
    """Shocks whose sizes have the tail 1/x^3, ten in a minute of a smooth road."""
    rng = np.random.default_rng(3)
    accel = imu.accel.copy()
    rows = rng.choice(len(imu), 20, replace=False)
    accel[rows, 2] += 3.0 * rng.standard_t(3, 20)
    assert len(bridge_unusable(replace(imu, accel=accel)).wild_s) == 0


@pytest.mark.parametrize(("size", "count"), [(1e5, 1), (1e3, 1), (1e3, 10)])
def test_wild_readings_are_found_and_bridged(imu: ImuData, size: float, count: int) -> None:
    accel = imu.accel.copy()
    accel[5000 : 5000 + count, 1] = size
    bridged = bridge_unusable(replace(imu, accel=accel))
    assert len(bridged.wild_s) == count
    assert np.abs(bridged.imu.accel - imu.accel).max() < 5.0
    same = np.r_[0:5000, 5000 + count : len(imu)]
    assert np.array_equal(bridged.imu.accel[same], imu.accel[same])
    # across the bridge the force is as unknown as in a gap of that length
    step = 1e-9 * float(np.median(np.diff(imu.t_ns)))
    assert bridged.stretch_s[5000] == pytest.approx((count + 1) * step, rel=1e-3)
    psd = bridge_noise(bridged.stretch_s, 2.0, 0.1)
    assert psd[5000, 0] == pytest.approx(4.0 * (count + 1) * step, rel=1e-3)
    assert psd[4000, 0] == 0.0


def test_readings_that_do_not_change_are_a_gap(imu: ImuData) -> None:
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    gyro[3000:5000], accel[3000:5000] = gyro[3000], accel[3000]
    bridged = bridge_unusable(replace(imu, gyro=gyro, accel=accel))
    (frozen,) = bridged.frozen
    assert frozen == pytest.approx((30.0, 50.0), abs=0.05)
    assert bridged.stretch_s[4000] == pytest.approx(20.0, abs=0.05)


def test_readings_on_lines_across_a_gap_were_not_read(imu: ImuData) -> None:
    readings = np.concatenate([imu.gyro, imu.accel], axis=1)
    t, put = imu.t_ns * 1e-9, np.zeros(len(imu), np.bool_)
    put[3000:3150] = True
    lines = np.stack([np.interp(t, t[~put], c[~put]) for c in readings.T], axis=1)
    written = np.where(put[:, None], np.round(lines, 7), readings)
    filled = replace(imu, gyro=written[:, :3], accel=written[:, 3:])
    (found,) = bridge_unusable(filled).frozen
    assert found == pytest.approx((30.0, 31.5), abs=0.05)
    # a slow sensor in a quick log, with lines between its readings
    slow = np.stack([np.interp(t, t[::10], c[::10]) for c in readings.T], axis=1)
    assert bridge_unusable(replace(imu, gyro=slow[:, :3], accel=slow[:, 3:])).frozen == []


def test_no_standstill_where_positions_move(motion: Motion) -> None:
    fixes = receive(motion, Receiver(), 5)
    t = fixes.gps_s - fixes.gps_s[0]
    model = model_fixes(fixes, t, FusionOptions())
    speed = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    moving = float(t[int(np.argmax(speed))])
    assert unmoved([(moving - 5.0, moving + 5.0)], model) == []
    still = float(t[int(np.argmin(speed[5:-5])) + 5])
    assert unmoved([(still - 0.6, still + 0.6)], model) == [(still - 0.6, still + 0.6)]


@pytest.mark.parametrize("rate", [10.0, 35.0])
def test_a_wild_rate_is_found_and_no_turn_with_it(imu: ImuData, rate: float) -> None:
    gyro = imu.gyro.copy()
    gyro[5000, 2] = rate
    bridged = bridge_unusable(replace(imu, gyro=gyro))
    assert bridged.wild_s == pytest.approx([50.0], abs=0.02)
    assert np.abs(bridged.imu.gyro - imu.gyro).max() < 0.3
