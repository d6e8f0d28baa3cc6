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
from tests.slow_cases import others_slow
from tests.unit.test_gap import scenario_with

NONE = np.zeros(3)
QUIET = NoiseModel(
    accel=0.0,
    gyro=0.0,
    wander_tau_s=60.0,
    wander=NONE,
    multipath_tau_s=10.0,
    multipath=NONE,
    white=NONE,
    bias=NONE,
    velocity=NONE,
    velocity_wander_tau_s=4.0,
    velocity_wander=0.0,
    position_sd=np.array([1.0, 1.0, 2.0]),
    common_sd=np.array([0.7, 0.7, 3.0]),
    velocity_sd=np.full(3, 0.1),
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
    # up to the last row, of which no two are at one time
    assert np.array_equal(twin.truth.t_s, trajectory.gps_s - trajectory.gps_s[0])
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    others_slow(["wander", "velocity_wander", "multipath", "bias"]),
)
def test_errors_that_last_do_so_for_as_long_as_they_say(
    recorded: SimulatedSensors, trajectory: Trajectory, kind: str
) -> None:
    """Twenty receivers: the size over all of them, and how alike errors are 5 s apart."""
    assert recorded.fixes is not None
    size = 0.3 if kind == "velocity_wander" else np.full(3, 0.3)
    loud = replace(QUIET, **{kind: size})
    rng = np.random.default_rng(4)
    quiet = make_twin(trajectory, recorded.fixes, {}, QUIET, 0.0, rng).fixes
    errors = []
    for _ in range(20):
        fixes = make_twin(trajectory, recorded.fixes, {}, loud, 0.0, rng).fixes
        if kind == "velocity_wander":
            errors.append((fixes.vel_ned - quiet.vel_ned)[:, 2])
        else:
            errors.append((quiet.height_m - fixes.height_m) / fixes.sd_pos_ned[:, 2])
    e = np.array(errors)
    assert np.sqrt(np.mean(e**2)) == pytest.approx(0.3, rel=0.35)
    step = round(5.0 / float(np.median(np.diff(quiet.gps_s))))
    alike = np.mean(e[:, step:] * e[:, :-step]) / np.mean(e**2)
    tau = {"wander": 60.0, "multipath": 10.0, "bias": np.inf, "velocity_wander": 4.0}[kind]
    assert alike == pytest.approx(np.exp(-5.0 / tau), abs=0.15)


def test_fixes_without_a_figure_err_by_geometry_and_by_what_it_does_not_thin_out(
    recorded: SimulatedSensors, trajectory: Trajectory
) -> None:
    assert recorded.fixes is not None
    n = len(recorded.fixes)
    bare = replace(recorded.fixes, sd_pos_ned=np.full((n, 3), np.nan), hdop=np.full(n, 2.0))
    twin = make_twin(trajectory, bare, {}, QUIET, 0.0, np.random.default_rng(1))
    expected = [np.hypot(2.0, 0.7), np.hypot(2.0, 0.7), 5.0]
    assert twin.fixes.sd_pos_ned[0] == pytest.approx(expected)


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
