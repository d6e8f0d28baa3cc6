"""Each reason to doubt an inertial unit is given where it holds, and by a car's readings none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.doubts.readings import reading_doubts
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.turns import turn_doubts
from automap.fusion.unusable_readings import Bridged, bridge_unusable
from automap.records import FloatArray, ImuData


def readings(seconds: float = 300.0, rate: float = 100.0, seed: int = 5) -> ImuData:
    """A car's readings: bends, bumps, noise, rounded as a cheap sensor does."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    gyro = 0.02 * rng.standard_normal((len(t), 3))
    gyro[:, 2] += 0.3 * np.sin(2.0 * np.pi * t / 37.0) ** 5
    accel = 0.4 * rng.standard_normal((len(t), 3)) - np.array([0.0, 0.0, 9.8])
    accel[:, 0] += np.sin(2.0 * np.pi * t / 23.0)
    accel[:: int(17 * rate), 2] -= 30.0
    return ImuData(
        np.rint(t * 1e9).astype(np.int64), np.round(gyro, 3), np.round(accel / 0.01) * 0.01
    )


def doubts(imu: ImuData, speed: float = 10.0) -> list[Reason]:
    return reading_doubts(imu, bridge_unusable(imu), np.full(len(imu), speed))


@pytest.mark.parametrize(("row", "told"), [(29, 0), (30, 1), (32, 1), (33, 0)])
def test_frozen_readings_are_told_where_the_vehicle_moved(row: int, told: int) -> None:
    rng = np.random.default_rng(1)
    imu = ImuData(20_000_000 * np.arange(80), rng.normal(size=(80, 3)), rng.normal(size=(80, 3)))
    # from reading 30 to 32, counted from the first; it moves at one reading only
    bridged = Bridged(imu, np.zeros(80), np.zeros(0), [(0.599, 0.641)])
    found = reading_doubts(imu, bridged, np.where(np.arange(80) == row, 10.0, 0.0))
    assert len([r for r in found if r.code == "imu_frozen"]) == told


def codes(imu: ImuData, speed: float = 10.0) -> list[str]:
    return [reason.code for reason in doubts(imu, speed)]


def test_a_cars_readings_are_readings() -> None:
    imu = readings()
    assert codes(imu) == []
    still = replace(imu, gyro=np.zeros_like(imu.gyro), accel=np.zeros_like(imu.accel))
    assert codes(still, speed=0.0) == []
    # a slow sensor in a quick log repeats its readings
    slow = np.arange(len(imu)) // 10 * 10
    assert codes(replace(imu, gyro=imu.gyro[slow], accel=imu.accel[slow])) == []


def test_frozen_readings_are_told_with_their_stretch() -> None:
    imu = readings()
    gyro, accel = imu.gyro.copy(), imu.accel.copy()
    gyro[5000:7000], accel[5000:7000] = gyro[5000], accel[5000]
    (reason,) = doubts(replace(imu, gyro=gyro, accel=accel))
    assert reason.code == "imu_frozen"
    assert "coarse" not in reason.text
    assert reason.spans[0] == pytest.approx((50.0, 69.99), abs=0.02)
    gyro = imu.gyro.copy()
    gyro[:, 1] = 0.0
    (reason,) = doubts(replace(imu, gyro=gyro))
    assert reason.code == "imu_frozen"
    assert "or its steps are coarser than its noise" in reason.text


def test_a_range_that_is_too_small_is_told() -> None:
    imu = readings()
    (reason,) = doubts(replace(imu, gyro=np.clip(imu.gyro, -0.2, 0.2)))
    assert reason.code == "imu_clipped"
    assert "gyro's axis z stays at 0.2 rad/s" in reason.text


@pytest.mark.parametrize(("name", "value"), [("accel", 1e3), ("gyro", -35.0)])
def test_a_wild_reading_is_told(name: str, value: float) -> None:
    imu = readings()
    values = getattr(imu, name).copy()
    values[20000, 0] = value
    (reason,) = doubts(replace(imu, **{name: values}))
    assert reason.code == "imu_wild"
    assert reason.handled
    assert reason.spans[0][0] < 200.0 < reason.spans[0][1]
    # all of them are another unit, and no wild readings
    assert "imu_wild" not in codes(replace(imu, **{name: getattr(imu, name) * 1e4 + 1e4}))


def drive_of(imu: ImuData, lag_s: float = 0.3) -> tuple[FloatArray, FloatArray]:
    """Times and velocities of a receiver on the drive of ``readings``, late and noisy."""
    t = imu.t_ns * 1e-9
    clean = 0.3 * np.sin(2.0 * np.pi * t / 37.0) ** 5
    course = np.cumsum(clean) * 0.01
    speed = 12.0 + np.cumsum(np.sin(2.0 * np.pi * t / 23.0)) * 0.01
    rng = np.random.default_rng(8)
    at = np.arange(2.0, t[-1] - 1.0, 1.0)
    course, speed = (np.interp(at - lag_s, t, x) for x in (course, speed))
    velocity = np.stack([speed * np.cos(course), speed * np.sin(course), 0.0 * at], axis=1)
    return at, velocity + 0.2 * rng.standard_normal(velocity.shape)


def doubted(imu: ImuData, seen: ImuData | None = None) -> list[str]:
    at, velocity = drive_of(seen or imu)
    return [reason.code for reason in turn_doubts(imu, np.eye(3), at, velocity)]


@pytest.mark.parametrize(("factor", "told"), [(1.0, 0), (1.1, 0), (2.0, 1), (-1.0, 1), (0.5, 1)])
def test_turns_that_a_gyro_feels_are_those_that_the_receiver_sees(factor: float, told: int) -> None:
    imu = readings()
    wrong = replace(imu, gyro=imu.gyro * np.array([1.0, 1.0, factor]) + 0.01)
    assert doubted(wrong) == ["imu_against_course"] * told


def test_an_accelerometer_that_feels_braking_where_speed_grows_is_told() -> None:
    imu = readings()
    assert doubted(replace(imu, accel=imu.accel * np.array([-1.0, 1.0, 1.0]))) == [
        "imu_against_speed"
    ]


def test_where_nothing_resembles_nothing_is_told() -> None:
    imu = readings()
    noise = replace(imu, gyro=np.random.default_rng(3).standard_normal(imu.gyro.shape))
    assert doubted(noise, imu) == []


def test_axes_are_turned_into_the_vehicles_first() -> None:
    imu = readings()
    turn = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    at, velocity = drive_of(imu)
    upside_down = replace(imu, gyro=imu.gyro @ turn, accel=imu.accel @ turn)
    assert list(turn_doubts(upside_down, turn, at, velocity)) == []
    assert list(turn_doubts(upside_down, np.eye(3), at, velocity)) != []
