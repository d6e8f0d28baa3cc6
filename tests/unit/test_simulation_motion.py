"""The simulated motion and the sensors on it agree with physics."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from automap import earth, frames
from automap.effects.gnss import gauss_markov
from automap.effects.vehicle import lever_arm_motion
from automap.errors import ConfigError
from automap.simulation.errors import check_errors
from automap.simulation.imu import record_imu
from automap.simulation.route import distance_over_time, profile_route
from automap.simulation.scenario import (
    CameraSetup,
    Imu,
    Leg,
    Route,
    Scenario,
    SignPlacement,
    Start,
    Stop,
    Vehicle,
)
from automap.simulation.scene import build_scene
from automap.simulation.trajectory import DriveMotion, Motion, drive_motion

ROUTE = Route(
    legs=[
        Leg(length_m=180.0, speed_m_s=14.0, grade_percent=3.0),
        Leg(turn_deg=-90.0, radius_m=15.0, speed_m_s=8.0, bank_deg=2.0),
        Leg(length_m=140.0, speed_m_s=13.0, grade_percent=-2.0),
        Leg(turn_deg=100.0, radius_m=20.0, speed_m_s=8.0),
        Leg(length_m=90.0, speed_m_s=12.0),
    ],
    stops=[Stop(at_m=300.0, hold_s=6.0)],
)


def scenario(lat_deg: float = -35.28, lon_deg: float = 149.13) -> Scenario:
    start = Start(
        utc="2026-03-14T09:20:00Z",
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        height_m=580.0,
        heading_deg=62.0,
    )
    return Scenario(schema="automap.scenario/1", name="test", start=start, route=ROUTE)


@pytest.fixture(scope="module")
def drive() -> DriveMotion:
    return drive_motion(scenario(), np.random.default_rng(1))


def integrate(motion: Motion, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Position error [3] m and attitude error [3] rad at the end of a strapdown integration
    of the perfect readings, written apart from the simulator and from the fusion."""
    grid = np.arange(len(motion.t_s)) * dt
    angle = np.diff(CubicSpline(grid, motion.angular_rate).antiderivative()(grid), axis=0)
    w = motion.angular_rate
    angle += np.cross(w[:-1], w[1:]) * dt * dt / 12.0
    lat, lon, h = motion.lat_rad[0], motion.lon_rad[0], motion.height_m[0]
    v, c = motion.vel_ned[0].copy(), motion.C_n_b[0].copy()
    steps = Rotation.from_rotvec(angle).as_matrix()
    for k in range(len(grid) - 1):
        rm, rn = earth.radii(lat)
        w_ie = earth.RATE * np.array([np.cos(lat), 0.0, -np.sin(lat)])
        w_en = np.array([v[1] / (rn + h), -v[0] / (rm + h), -v[1] * np.tan(lat) / (rn + h)])
        turned = Rotation.from_rotvec(-(w_ie + w_en) * dt).as_matrix() @ c @ steps[k]
        force = 0.5 * (c @ motion.specific_force[k] + turned @ motion.specific_force[k + 1])
        gravity = np.array([0.0, 0.0, earth.gravity(lat, h)])
        new = v + (force + gravity - np.cross(2 * w_ie + w_en, v)) * dt
        mean = 0.5 * (v + new)
        h -= mean[2] * dt
        lat += mean[0] * dt / (rm + h)
        lon += mean[1] * dt / ((rn + h) * np.cos(lat))
        v, c = new, turned
    north, east = earth.metres_per_radian(motion.lat_rad[-1], motion.height_m[-1])
    position = np.array(
        [
            (lat - motion.lat_rad[-1]) * north,
            (lon - motion.lon_rad[-1]) * east,
            motion.height_m[-1] - h,
        ]
    )
    attitude = frames.matrix_to_rotation_vector(c @ motion.C_n_b[-1].T)
    return position, attitude


def test_perfect_readings_integrate_back_to_the_trajectory(drive: DriveMotion) -> None:
    t = np.arange(int(drive.duration_s * 100)) * 0.01
    position, attitude = integrate(drive.at(t), 0.01)
    assert np.abs(position).max() < 0.01
    assert np.abs(attitude).max() < 1e-6


@pytest.mark.parametrize(("lat", "lon"), [(61.0, 179.9999), (-52.0, -70.0), (0.0, 0.0)])
def test_velocity_and_acceleration_are_derivatives(lat: float, lon: float) -> None:
    drive = drive_motion(scenario(lat, lon), np.random.default_rng(2))
    t = np.linspace(1.0, drive.duration_s - 1.0, 400)
    h = 1e-3
    before, now, after = drive.at(t - h), drive.at(t), drive.at(t + h)
    north, east = earth.metres_per_radian(now.lat_rad, now.height_m)
    rate = np.stack(
        [
            (after.lat_rad - before.lat_rad) * north,
            (after.lon_rad - before.lon_rad) * east,
            before.height_m - after.height_m,
        ],
        axis=1,
    ) / (2 * h)
    np.testing.assert_allclose(rate, now.vel_ned, atol=2e-5)
    np.testing.assert_allclose((after.vel_ned - before.vel_ned) / (2 * h), now.accel_ned, atol=2e-4)
    turn = frames.matrix_to_rotation_vector(np.swapaxes(before.C_n_b, 1, 2) @ after.C_n_b) / (2 * h)
    np.testing.assert_allclose(turn, now.turn_rate, atol=2e-5)


def test_at_rest_the_sensors_feel_gravity_and_the_earth(drive: DriveMotion) -> None:
    rest = drive.at(np.linspace(0.2, 1.8, 20))
    lat = np.deg2rad(-35.28)
    force = np.linalg.norm(rest.specific_force, axis=1)
    np.testing.assert_allclose(force, earth.gravity(lat, 580.0), rtol=1e-9)
    assert (rest.specific_force[:, 2] < -9.7).all()
    np.testing.assert_allclose(np.linalg.norm(rest.angular_rate, axis=1), earth.RATE, rtol=1e-6)
    assert np.abs(rest.vel_ned).max() < 1e-9


def test_the_vehicle_stops_leans_outwards_and_keeps_its_limits(drive: DriveMotion) -> None:
    motion = drive.at(np.arange(0.0, drive.duration_s, 0.05))
    speed = np.linalg.norm(motion.vel_ned, axis=1)
    assert speed.max() <= 14.0 + 1e-6
    stopped = (speed < 1e-3) & (motion.t_s > 10.0) & (motion.t_s < drive.duration_s - 5.0)
    assert stopped.sum() * 0.05 > 3.0
    body = np.einsum("nji,nj->ni", motion.C_n_b, motion.vel_ned)
    moving = speed > 2.0
    assert np.abs(body[moving, 1]).max() < 0.05
    sideways = np.einsum("nji,nj->ni", motion.C_n_b, motion.accel_ned)[:, 1]
    assert np.abs(sideways).max() < 2.2 * 1.1
    # a left bend accelerates to the left and tips the body to the right
    left = sideways < -1.5
    assert left.any()
    assert (motion.rpy[left, 0] > 0).all()


def test_a_halt_takes_its_time() -> None:
    vehicle = Vehicle()
    profile = profile_route(ROUTE, vehicle)
    t, v = distance_over_time(profile, ROUTE, standstill_s=4.0)
    assert (np.diff(t) > 0).all()
    assert v[0] == v[-1] == 0.0
    long_rests = (np.diff(t) > 2.0) & (v[:-1] == 0.0)
    np.testing.assert_allclose(np.sort(np.diff(t)[long_rests]), [3.0, 4.0, 5.99], atol=0.02)
    assert np.trapezoid(v, t) == pytest.approx(profile.s[-1], rel=1e-5)


def test_errors_are_added_to_the_reading(drive: DriveMotion) -> None:
    t = np.arange(500) * 0.01 + 20.0
    motion = drive.at(t)
    quiet = Imu(gyro_noise=0.0, accel_noise=0.0)
    t_ns = np.rint(t * 1e9).astype(np.int64)
    errors = {"accel_bias": {"x": 0.1, "z": -0.2}, "gyro_scale": {"z": 0.01}}
    imu = record_imu(t_ns, motion, quiet, errors, np.random.default_rng(1))
    np.testing.assert_allclose(
        imu.accel - motion.specific_force, np.tile([0.1, 0.0, -0.2], (500, 1)), atol=1e-12
    )
    np.testing.assert_allclose(imu.gyro[:, 2], 1.01 * motion.angular_rate[:, 2], atol=1e-12)


def test_white_noise_has_its_density(drive: DriveMotion) -> None:
    motion = drive.at(np.full(20000, 1.0))
    setup = Imu(rate_hz=100.0, gyro_noise=2e-3, accel_noise=3e-2)
    imu = record_imu(np.arange(20000), motion, setup, {}, np.random.default_rng(3))
    np.testing.assert_allclose((imu.gyro - motion.angular_rate).std(axis=0), 2e-2, rtol=0.03)
    np.testing.assert_allclose((imu.accel - motion.specific_force).std(axis=0), 0.3, rtol=0.03)


def test_unknown_errors_are_refused() -> None:
    with pytest.raises(ConfigError, match="accel_bias"):
        check_errors({"acel_bias": {"x": 0.1}})
    with pytest.raises(ConfigError, match="no parameter 'w'"):
        check_errors({"accel_bias": {"w": 0.1}})
    with pytest.raises(ConfigError, match="camera_boresight"):
        check_errors({"camera_boresight": {"roll": 0.1}})


def test_gauss_markov_has_its_sigma_and_time_constant() -> None:
    x = gauss_markov(200_000, np.array([2.0]), 0.02, np.random.default_rng(5))[:, 0]
    assert x.std() == pytest.approx(2.0, rel=0.05)
    lag = 50
    correlation = np.corrcoef(x[:-lag], x[lag:])[0, 1]
    assert correlation == pytest.approx(np.exp(-0.02 * lag), abs=0.04)


def test_the_antenna_swings_about_the_imu(drive: DriveMotion) -> None:
    lever = np.array([0.5, -0.3, -1.2])
    t = np.linspace(8.0, drive.duration_s - 2.0, 200)
    h = 1e-3
    before, now, after = (
        lever_arm_motion(m.C_n_b, m.turn_rate, lever)
        for m in (drive.at(t - h), drive.at(t), drive.at(t + h))
    )
    np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * h), atol=1e-5)


def test_the_ground_is_laid_where_it_is_filmed_and_moves_no_sign(drive: DriveMotion) -> None:
    signs = [SignPlacement(at_m=60.0, sign="regulatory--stop--g1", offset_m=4.0, height_m=2.5)]
    cameras = (CameraSetup(), CameraSetup(box_sd_px=0.5), None)
    filmed, boxed, blind = (
        build_scene(
            scenario().model_copy(update={"camera": camera, "signs": signs}),
            *(drive, np.random.default_rng(7)),
        )
        for camera in cameras
    )
    assert [bool(scene.ground) for scene in (filmed, boxed, blind)] == [True, False, False]
    for other in (boxed, blind):
        assert len(other.things) == len(filmed.things) > 10
        assert (other.signs[0].centre == filmed.signs[0].centre).all()
