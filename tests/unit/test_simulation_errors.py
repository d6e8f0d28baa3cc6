"""The errors table of a scenario: what is refused, and what it does to the drive folder."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from automap import earth
from automap.effects import CATALOGUE
from automap.errors import ConfigError
from automap.io.drive import load_drive
from automap.io.odometer_csv import read_odometer_csv
from automap.simulation.errors import check_errors
from automap.simulation.scenario import (
    CameraSetup,
    Gnss,
    Leg,
    Odometer,
    Route,
    Scenario,
    SignPlacement,
    Start,
)
from automap.simulation.sensors import SimulatedSensors, random_streams, simulate_sensors
from pipeline.simulate.command import load_scenario
from pipeline.simulate.drive_writer import write_drive

SCENARIOS = Path(__file__).resolve().parents[2] / "configs" / "scenarios"
QUIET = Gnss(sigma_correlated_m=(0, 0, 0), sigma_white_m=(0, 0, 0), sigma_velocity=(0, 0, 0))
NOISY = Gnss(sigma_correlated_m=(0, 0, 0), rate_hz=20.0)


def scenario(errors: dict[str, Any], **parts: Any) -> Scenario:
    start = Start(
        utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC),
        lat_deg=-35.28,
        lon_deg=149.13,
        heading_deg=20.0,
    )
    legs = [
        Leg(length_m=90.0, speed_m_s=12.0),
        Leg(turn_deg=90.0, radius_m=20.0, speed_m_s=8.0),
        Leg(length_m=60.0, speed_m_s=12.0),
    ]
    return Scenario(
        schema="automap.scenario/1",
        name="errors",
        start=start,
        route=Route(legs=legs),
        errors=errors,
        **({"gnss": QUIET} | parts),
    )


def simulated(errors: dict[str, Any], **parts: Any) -> SimulatedSensors:
    return simulate_sensors(scenario(errors, **parts), random_streams(4))


@pytest.fixture(scope="module")
def plain() -> SimulatedSensors:
    return simulated({})


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        ({"gnss_latncy": {"s": 0.1}}, "did you mean 'gnss_latency'"),
        ({"imu_mounting": {"jaw": 0.1}}, "did you mean 'yaw'"),
        ({"earth_rotation": {"x": 1.0}}, "true or false"),
        ({"gnss_latency": True}, "needs values"),
        ({"gnss_outliers": {"fraction": 1.5}}, "between 0 and 1"),
        ({"gnss_velocity_lag": {"tau": -0.1}}, "cannot be negative"),
        ({"gnss_correlated_noise": {"tau": 0.0}}, "above 0 s"),
        ({"accel_bias": {"x": float("nan")}}, "give a number"),
        ({"camera_focal": {"relative": 0.1}}, r"\[camera\]"),
    ],
)
def test_mistakes_are_named(errors: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        check_errors(errors)


@pytest.mark.parametrize("file", sorted(SCENARIOS.glob("*.toml")), ids=lambda f: f.stem)
def test_scenarios_that_come_along_are_sound(file: Path) -> None:
    given = load_scenario(file)
    check_errors(given.errors, given.gnss is not None, given.odometer is not None)
    assert given.errors


def test_errors_need_their_sensor() -> None:
    with pytest.raises(ConfigError, match=r"\[gnss\] section"):
        simulated({"gnss_latency": {"s": 0.1}}, gnss=None)
    with pytest.raises(ConfigError, match=r"\[odometer\] section"):
        simulated({"odometer_scale": {"relative": 0.1}})


@pytest.mark.slow
def test_every_effect_but_the_cameras_changes_the_recording(plain: SimulatedSensors) -> None:
    wheels = simulated({}, odometer=Odometer())
    noise = ("gnss_noise_scale", "gnss_correlated_noise")
    for name, effect in CATALOGUE.items():
        if effect.family == "camera":
            continue
        given: Any = {p.name: 0.3 for p in effect.parameters} or False
        parts: dict[str, Any] = {"gnss": NOISY} if name in noise else {}
        before = simulated({}, **parts) if parts else plain
        if effect.needs_wheels:
            parts, before = {"odometer": Odometer()}, wheels
        after = simulated({name: given}, **parts)
        assert after.fixes is not None
        assert before.fixes is not None
        same = [
            np.array_equal(a, b)
            for a, b in (
                (after.imu.t_ns, before.imu.t_ns),
                (after.imu.gyro, before.imu.gyro),
                (after.imu.accel, before.imu.accel),
                (after.fixes.lat_rad, before.fixes.lat_rad),
                (after.fixes.height_m, before.fixes.height_m),
                (after.fixes.vel_ned, before.fixes.vel_ned),
            )
        ]
        if after.odometer is not None and before.odometer is not None:
            same.append(np.array_equal(after.odometer.speed, before.odometer.speed))
        assert not all(same), name


def test_turning_the_sensor_turns_its_readings(plain: SimulatedSensors) -> None:
    yaw = 0.02
    turned = simulated({"imu_mounting": {"yaw": yaw}})
    along = np.linspace(0, len(plain.imu) - 1, 50).astype(int)
    # a sensor turned to the right sees what is ahead on its left
    expected = plain.imu.accel[along, 1] - yaw * plain.imu.accel[along, 0]
    assert turned.imu.accel[along, 1] == pytest.approx(expected, abs=2e-3)


def test_without_the_earths_rotation_a_gyro_at_rest_reads_nothing(
    plain: SimulatedSensors,
) -> None:
    still = simulated({"earth_rotation": False}).drive.at(np.array([1.0]))
    assert np.abs(still.angular_rate).max() < 1e-12
    turning = plain.drive.at(np.array([1.0]))
    assert np.linalg.norm(turning.angular_rate) == pytest.approx(earth.RATE)


def test_the_noise_is_what_the_receiver_says_times_the_factor() -> None:
    base = simulated({}, gnss=QUIET.model_copy(update={"rate_hz": 20.0})).fixes
    noisy = simulated({"gnss_noise_scale": {"factor": 2.5}}, gnss=NOISY).fixes
    assert base is not None
    assert noisy is not None
    down = base.height_m - noisy.height_m
    assert down.std() == pytest.approx(2.5 * noisy.sd_pos_ned[0, 2], rel=0.15)
    speed = (noisy.vel_ned - base.vel_ned)[:, 0]
    assert speed.std() == pytest.approx(2.5 * noisy.sd_vel_ned[0, 0], rel=0.15)


def test_outliers_leave_the_other_epochs_as_they_were(plain: SimulatedSensors) -> None:
    wild = simulated({"gnss_outliers": {"fraction": 0.2}}).fixes
    assert wild is not None
    assert plain.fixes is not None
    moved = wild.lat_rad != plain.fixes.lat_rad
    assert 0.08 < moved.mean() < 0.35
    assert wild.vel_ned == pytest.approx(plain.fixes.vel_ned)


def test_late_and_fast_stamps_keep_the_truth_on_the_right_clock(tmp_path: Path) -> None:
    errors = {"imu_time_offset": {"s": 0.05}, "imu_clock_skew": {"skew": 1e-3}}
    write_drive(scenario(errors), tmp_path, seed=4)
    right = simulated({})
    imu = np.genfromtxt(tmp_path / "imu.csv", delimiter=",", skip_header=1)
    late = (imu[:, 0] - right.imu.t_ns) * 1e-9
    span = (right.imu.t_ns[-1] - right.imu.t_ns[0]) * 1e-9
    assert late[[0, -1]] == pytest.approx([0.05, 0.05 + 1e-3 * span], abs=1e-6)
    truth = np.genfromtxt(tmp_path / "truth" / "trajectory.csv", delimiter=",", skip_header=1)
    np.testing.assert_array_equal(truth[:, 0], imu[:, 0])
    at_stamp = right.drive.at(right.seconds(imu[:, 0].astype(np.int64)))
    # the time stamps pass through float64 here
    np.testing.assert_allclose(truth[:, 5:8], at_stamp.vel_ned, atol=2e-5)


def test_wheels_and_temperature_are_written_and_read(tmp_path: Path) -> None:
    errors = {"odometer_scale": {"relative": 0.05}, "accel_temperature": {"x": 0.01}}
    setup = Odometer(noise=0.0, resolution=0.01)
    write_drive(scenario(errors, odometer=setup), tmp_path, seed=4)
    drive = load_drive(tmp_path)
    assert not drive.warnings
    assert drive.odometer_file is not None
    found = read_odometer_csv(drive.odometer_file)
    wheels, warnings = found.data, found.warnings
    assert not warnings
    truth = np.genfromtxt(tmp_path / "truth" / "trajectory.csv", delimiter=",", skip_header=1)
    speed = np.interp(wheels.t_ns, truth[:, 0], np.linalg.norm(truth[:, 5:8], axis=1))
    fast = speed > 5.0
    assert wheels.speed[fast] / speed[fast] == pytest.approx(1.05, abs=3e-3)
    assert (wheels.speed[speed < 0.01] == 0.0).all()
    table = np.genfromtxt(tmp_path / "imu.csv", delimiter=",", names=True)
    warm = table["temp_c"]
    assert warm[0] == pytest.approx(20.0, abs=0.1)
    assert (np.diff(warm) >= 0).all()
    base = simulated({}).imu.accel[:, 0]
    drift = table["ax"] - base
    assert drift == pytest.approx(0.01 * (warm - np.median(warm)), abs=1e-4)


def test_a_camera_with_boxes_has_its_effects(tmp_path: Path) -> None:
    camera = CameraSetup(box_sd_px=0.01, frame_jitter_s=0.0, stamp_noise_s=0.0)
    signs = [
        SignPlacement(at_m=60.0, sign="regulatory--stop--g1", offset_m=4.0, height_m=2.5),
        SignPlacement(at_m=90.0, sign="regulatory--stop--g1", offset_m=-4.0, height_m=3.0),
    ]
    with pytest.raises(ConfigError, match="box_sd_px"):
        simulated({"camera_focal": {"relative": 0.1}}, camera=CameraSetup(), signs=signs)
    read = {}
    cases: dict[str, dict[str, Any]] = {
        "plain": {},
        "turned": {"camera_boresight": {"yaw": 0.02}},
        "late": {"camera_time_offset": {"s": 0.05}},
        "slow": {"rolling_shutter": {"s": 0.03}},
    }
    for name, errors in cases.items():
        folder = tmp_path / name
        folder.mkdir()
        write_drive(scenario(errors, camera=camera, signs=signs), folder, seed=4)
        assert not (folder / "video" / "front.mp4").exists()
        read[name] = (
            np.genfromtxt(
                folder / "video" / "front_detections.csv",
                delimiter=",",
                skip_header=1,
                usecols=(0, 2, 3, 4, 5),
            ),
            np.genfromtxt(folder / "video" / "front_frames.csv", delimiter=",", skip_header=1),
        )
    plain, turned = read["plain"][0], read["turned"][0]
    shared = np.intersect1d(plain[:, 0], turned[:, 0])
    assert len(shared) > 20
    # a camera turned to the right has everything further to the left in its picture
    left = [plain[plain[:, 0] == f][0, 1] - turned[turned[:, 0] == f][0, 1] for f in shared[:20]]
    assert np.median(left) == pytest.approx(20.0, abs=3.0)
    # the offset is what must be added to a stamp
    apart = (read["plain"][1][:, 1] - read["late"][1][:, 1]) * 1e-9
    assert apart == pytest.approx(0.05, abs=1e-6)
    assert len(read["slow"][0]) > 20
    assert load_drive(tmp_path / "plain").cameras()["front"].width == camera.width
