"""The twin of a recorded drive follows its path and has its errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.effects.vehicle import sensor_to_vehicle
from automap.records import Trajectory
from automap.simulation.sensors import SimulatedSensors, random_streams, simulate_sensors
from automap.simulation.twin import NoiseModel, make_twin, motion_along
from pipeline.cli.root import run_command
from tests.unit.test_gap import scenario_with

QUIET = NoiseModel(
    0.0, 0.0, 60.0, np.zeros(3), np.zeros(3), np.zeros(3), np.full(3, 1.0), np.full(3, 0.1)
)
ERRORS = {
    "gyro_bias": {"x": 0.01, "y": -0.02, "z": 0.03},
    "imu_mounting": {"roll": 3.1, "pitch": 0.1, "yaw": -1.2},
    "gnss_lever_arm": {"x": 0.3, "y": -0.2, "z": -1.0},
    "gnss_velocity_latency": {"s": 0.1},
}


@pytest.fixture(scope="module")
def recorded() -> SimulatedSensors:
    return simulate_sensors(scenario_with({}), random_streams(5))


@pytest.fixture(scope="module")
def trajectory(recorded: SimulatedSensors) -> Trajectory:
    """What a perfect fusion makes of the recording."""
    t = recorded.seconds(recorded.imu.t_ns)
    m = recorded.drive.at(t)
    sd = np.full((len(t), 3), 0.1)
    return Trajectory(
        recorded.imu.t_ns,
        recorded.begin_gps_s + t,
        m.lat_rad,
        m.lon_rad,
        m.height_m,
        m.vel_ned,
        (m.rpy + np.pi) % (2.0 * np.pi) - np.pi,
        sd,
        sd,
        sd,
    )


def test_the_path_is_followed(recorded: SimulatedSensors, trajectory: Trajectory) -> None:
    twin = motion_along(trajectory)
    t = np.arange(2.0, twin.duration_s - 2.0, 0.1)
    ours, theirs = twin.at(t), recorded.drive.at(t + trajectory.gps_s[0] - recorded.begin_gps_s)
    metres = np.array([6.37e6, 5.2e6, 1.0])
    for name, scale in zip(("lat_rad", "lon_rad", "height_m"), metres, strict=True):
        assert np.abs(getattr(ours, name) - getattr(theirs, name)).max() * scale < 0.05
    assert np.abs(ours.vel_ned - theirs.vel_ned).max() < 0.15
    # slow forces are the recorded ones; what the road shakes faster is noise of the model
    force = ours.specific_force - theirs.specific_force
    assert np.sqrt(np.mean(force**2)) < 0.12
    assert np.sqrt(np.mean((ours.angular_rate - theirs.angular_rate) ** 2)) < 0.03


def test_the_sensors_have_the_fitted_errors(
    recorded: SimulatedSensors, trajectory: Trajectory
) -> None:
    assert recorded.fixes is not None
    delay = 0.08
    twin = make_twin(trajectory, recorded.fixes, ERRORS, QUIET, delay, np.random.default_rng(1))
    assert np.array_equal(twin.imu.t_ns, trajectory.t_ns)
    assert twin.lever_arm_m == [0.3, -0.2, -1.0]
    motion = motion_along(trajectory)
    at = np.clip(trajectory.gps_s - trajectory.gps_s[0] - delay, 0.0, motion.duration_s)
    true = motion.at(at).angular_rate @ sensor_to_vehicle(ERRORS)
    bias = [0.01, -0.02, 0.03]
    assert np.abs(twin.imu.gyro - true - bias).max() < 1e-7
    # the antenna stands off the IMU and its velocity comes late
    t = twin.fixes.gps_s - trajectory.gps_s[0]
    inside = (t > 1.0) & (t < motion.duration_s - 1.0)
    m = motion.at(t[inside] - 0.1)
    swing = np.einsum("nij,nj->ni", m.C_n_b, np.cross(m.turn_rate, [0.3, -0.2, -1.0]))
    assert np.abs(twin.fixes.vel_ned[inside] - m.vel_ned - swing).max() < 1e-6


def test_noise_has_the_stated_size(recorded: SimulatedSensors, trajectory: Trajectory) -> None:
    assert recorded.fixes is not None
    loud = replace(QUIET, gyro=1e-3, white=np.full(3, 0.5), velocity=np.ones(3))
    quiet = make_twin(trajectory, recorded.fixes, {}, QUIET, 0.0, np.random.default_rng(2))
    noisy = make_twin(trajectory, recorded.fixes, {}, loud, 0.0, np.random.default_rng(2))
    step = float(np.median(np.diff(trajectory.gps_s)))
    spread = np.std(noisy.imu.gyro - quiet.imu.gyro) * np.sqrt(step)
    assert spread == pytest.approx(1e-3, rel=0.05)
    off = (noisy.fixes.vel_ned - quiet.fixes.vel_ned) / noisy.fixes.sd_vel_ned
    assert np.std(off) == pytest.approx(1.0, rel=0.1)
    high = (noisy.fixes.height_m - quiet.fixes.height_m) / noisy.fixes.sd_pos_ned[:, 2]
    assert np.std(high) == pytest.approx(0.5, rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--like", "nowhere"], 3, "run.json is missing"),
        ([], 2, "one of the two"),
        (["sample", "--like", "nowhere"], 2, "one of the two"),
    ],
)
def test_what_is_no_run_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command(["simulate", *arguments, "-o", "twin"]) == code
    assert words in capsys.readouterr().err
    assert not Path("twin").exists()
