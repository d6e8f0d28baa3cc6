"""The generator itself: readings that give the motion back, noise as drawn, files as agreed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.hidden_effects.evidence import make_scene, shifts_of, shifts_of_records, whiten
from tests.hidden_effects.geodesy import meridian_radius, normal_gravity, normal_radius
from tests.hidden_effects.gnss import record_gnss
from tests.hidden_effects.imu import record_imu
from tests.hidden_effects.motion import Motion, displaced, to_body
from tests.hidden_effects.noise import GnssNoise, ImuNoise, coloured, draw_noise, heavy
from tests.hidden_effects.route import Style, draw_plan, draw_style
from tests.hidden_effects.sizes import draw_sheet
from tests.hidden_effects.strapdown import integrate
from tests.hidden_effects.write import ubx_log, write_drive
from tests.slow_cases import others_slow

ARM = np.array([0.4, 0.1, -1.2])
PLACE = (np.radians(-35.3), np.radians(149.1), 580.0)
WARM_UP = (20.0, 15.0, 100.0)


def drive(seed: int, seconds: float = 120.0, rough: bool = False, **installed: object) -> Motion:
    """A random drive."""
    rng = np.random.default_rng(seed)
    plan = draw_plan(rng, draw_style(rng, rough), seconds)
    return Motion(plan, PLACE, seconds, rng, **installed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("seed", "rough", "axle", "seconds"),
    others_slow([(0, False, None, 40), (3, True, [-1.4, 0.1, 0.3], 120)]),
)
def test_ideal_readings_give_the_motion_back(
    seed: int, rough: bool, axle: list[float] | None, seconds: int
) -> None:
    motion = drive(seed, seconds, rough=rough, axle=axle, sideslip=2e-3)
    true = motion.at(np.arange(100 * seconds + 1) / 100.0)
    place, vel, turn = integrate(true, true.force, true.rate, 0.01)
    lat, lon, height = true.lat[::2], true.lon[::2], true.height[::2]
    north = (place[:, 0] - lat) * (meridian_radius(lat) + height)
    east = (place[:, 1] - lon) * (normal_radius(lat) + height) * np.cos(lat)
    assert np.max(np.abs([north, east, place[:, 2] - height])) < 0.02
    assert np.max(np.abs(vel - true.vel_ned[::2])) < 1e-3
    assert np.max(np.abs(turn - true.C_n_b[::2])) < 1e-5
    assert true.speed.max() > 8.0


def test_rear_axle_has_no_sideslip_and_the_imu_ahead_has() -> None:
    rng = np.random.default_rng(5)
    plan = draw_plan(rng, Style(wobble=0.0, circles=True), 120.0)
    motion = Motion(plan, PLACE, 120.0, rng, axle=np.array([-1.4, 0.0, 0.0]))
    t = np.arange(0.0, 120.0, 0.1)
    axle, imu = motion.axle_at(t), motion.at(t)
    assert np.abs(to_body(axle.C_n_b, axle.vel_ned)[:, 1:]).max() < 1e-9
    sideways = to_body(imu.C_n_b, imu.vel_ned)[:, 1]
    np.testing.assert_allclose(sideways, 1.4 * imu.rate_nav[:, 2], atol=1e-9)


def test_sideslip_is_the_outward_angle_per_lateral_acceleration() -> None:
    rng = np.random.default_rng(5)
    plan = draw_plan(rng, Style(wobble=0.0, bank=0.0, grade=0.0, roll_gradient=0.0), 120.0)
    motion = Motion(plan, PLACE, 120.0, rng, sideslip=3e-3)
    state = motion.at(np.arange(5.0, 115.0, 0.1))
    sideways = to_body(state.C_n_b, state.vel_ned)[:, 1]
    lateral = state.force[:, 1]
    rows = np.abs(lateral) > 0.5
    angle = np.arctan2(sideways, state.speed)[rows]
    np.testing.assert_allclose(angle, -3e-3 * lateral[rows], rtol=0.03)


def test_at_rest_and_level_the_accelerometer_reads_minus_g() -> None:
    rng = np.random.default_rng(2)
    style = Style(wobble=0.0, grade=1e-9, bank=1e-9)
    motion = Motion(draw_plan(rng, style, 60.0), PLACE, 60.0, rng)
    state = motion.at(np.array([0.5, 1.0]))
    g = normal_gravity(state.lat, state.height)
    np.testing.assert_allclose(state.force, np.outer(g, [0.0, 0.0, -1.0]), atol=1e-6)


def test_drives_stop_turn_both_ways_and_climb() -> None:
    rng = np.random.default_rng(8)
    for _ in range(4):
        style = draw_style(rng, False)
        motion = Motion(draw_plan(rng, style, 300.0), PLACE, 300.0, rng)
        state = motion.at(np.arange(0.0, 300.0, 0.1))
        assert state.speed.min() >= 0.0
        assert np.mean(state.speed < 0.01) > 0.005
        assert np.mean(state.speed > 5.0) > 0.4
        assert state.rate_nav[:, 2].max() > 0.05
        assert state.rate_nav[:, 2].min() < -0.05
        assert np.ptp(state.height) > 0.5
        assert np.abs(state.force[:, :2]).max() < 7.0


def test_latency_and_offset_have_the_signs_of_the_contract() -> None:
    motion = drive(3)
    silent = GnssNoise(0.0, 0.0, 60.0, 0.0)
    rng = np.random.default_rng(0)
    late = record_gnss(motion, {"gnss_latency": {"s": 0.1}}, silent, rng, ARM)
    fresh = record_gnss(motion, {}, silent, rng, ARM)
    half_second_ago = np.interp(late.tag - 0.1, fresh.tag, fresh.vel[:, 0])
    assert np.abs(late.vel[10:, 0] - half_second_ago[10:]).max() < 0.1
    np.testing.assert_allclose(fresh.error_pos, 0.0, atol=1e-6)
    np.testing.assert_allclose(fresh.error_vel, 0.0, atol=1e-6)
    record = record_imu(motion, {"imu_time_offset": {"s": 0.05}}, ImuNoise(0.0, 0.0), rng, WARM_UP)
    np.testing.assert_allclose(record.stamp - record.true_t, 0.05)
    np.testing.assert_allclose(record.accel, motion.at(record.stamp - 0.05).force)


def test_velocity_lag_is_a_first_order_low_pass() -> None:
    motion = drive(3)
    silent = GnssNoise(0.0, 0.0, 60.0, 0.0, rate_hz=100.0)
    rng = np.random.default_rng(0)
    raw = record_gnss(motion, {}, silent, rng, ARM).vel
    slow = record_gnss(motion, {"gnss_velocity_lag": {"s": 0.2}}, silent, rng, ARM).vel
    rate = np.gradient(slow, 0.01, axis=0)
    np.testing.assert_allclose((slow + 0.2 * rate)[5:-5], raw[5:-5], atol=5e-3)


def test_lever_arm_error_moves_the_antenna() -> None:
    motion = drive(3)
    silent = GnssNoise(0.0, 0.0, 60.0, 0.0)
    rng = np.random.default_rng(0)
    effects = {"gnss_lever_arm": {"x": 0.3, "y": -0.2, "z": 0.1}}
    record = record_gnss(motion, effects, silent, rng, ARM)
    moved = displaced(motion.at(record.tag), ARM + np.array([0.3, -0.2, 0.1]))
    np.testing.assert_allclose(record.lat, moved[0], atol=1e-12)
    np.testing.assert_allclose(
        to_body(motion.at(record.tag).C_n_b, record.error_pos),
        np.broadcast_to([0.3, -0.2, 0.1], record.error_pos.shape),
        atol=1e-6,
    )


def test_noise_has_the_variance_and_memory_that_were_asked_for() -> None:
    rng = np.random.default_rng(1)
    assert np.std(heavy(rng, (200_000,), 4.5)) == pytest.approx(1.0, abs=0.05)
    wander = coloured(rng, 400_000, 2.0, 5.0, 0.2)
    assert np.std(wander) == pytest.approx(2.0, abs=0.1)
    lag = np.mean(wander[25:] * wander[:-25]) / np.var(wander)
    assert lag == pytest.approx(np.exp(-1.0), abs=0.04)


@pytest.mark.parametrize("level", ["quiet", "usual", "poor"])
def test_an_optimal_filter_finds_null_drives_consistent(level: str) -> None:
    rng = np.random.default_rng(11)
    imu_noise, gnss_noise = draw_noise(rng, level)
    sheet = draw_sheet(rng)
    motion = drive(12)
    imu = record_imu(motion, sheet, imu_noise, rng, WARM_UP)
    gnss = record_gnss(motion, sheet, gnss_noise, rng, ARM)
    scene = make_scene(motion, gnss.tag, ARM)
    accel, gyro = (np.array([*sheet[f"{name}_bias_walk"].values()]) for name in ("accel", "gyro"))
    out = whiten(scene, shifts_of_records(scene, imu, gnss), imu_noise, gnss_noise, accel, gyro)
    assert 0.93 < np.mean(out.nu**2) < 1.07


def test_evidence_grows_with_the_square_of_the_error() -> None:
    motion = drive(12)
    rng = np.random.default_rng(0)
    noise = draw_noise(rng, "usual")
    gnss = record_gnss(motion, {}, noise[1], rng, ARM)
    scene = make_scene(motion, gnss.tag, ARM)
    vibration, bias = "speed_vibration", "gyro_bias"
    cases = [{vibration: {"x": 1e-4}}, {vibration: {"x": 2e-4}}, {bias: {"x": 2e-3, "z": 2e-3}}]
    shifts = shifts_of(scene, cases, WARM_UP)
    walk = np.full(3, 1e-5)
    information = np.diag(whiten(scene, shifts, *noise, walk, walk).gram())
    assert information[1] == pytest.approx(4.0 * information[0], rel=1e-3)
    # the base model estimates biases, so that they carry no evidence beyond their prior's
    assert information[2] < 2.0 * (2e-3 / 5e-3) ** 2


def test_the_log_is_what_an_independent_reader_reads() -> None:
    pyubx2 = pytest.importorskip("pyubx2")
    motion = drive(3)
    rng = np.random.default_rng(0)
    record = record_gnss(motion, {}, GnssNoise(0.3, 0.5, 60.0, 0.05, rate_hz=1.0), rng, ARM)
    messages = [m for _, m in pyubx2.UBXReader(_stream(ubx_log(record, 1_400_000_000)))]
    assert len(messages) == 3 * len(record.tag)
    pvt, precise, cov = messages[30:33]
    assert pvt.iTOW == (1_400_000_000 % 604800 + 11) * 1000
    assert pvt.lat == pytest.approx(np.degrees(record.lat[10]), abs=1e-7)
    assert pvt.velE * 1e-3 == pytest.approx(record.vel[10, 1], abs=6e-4)
    assert precise.lon == pytest.approx(np.degrees(record.lon[10]), abs=1e-9)
    assert precise.height == pytest.approx(1000.0 * record.height[10], abs=0.1)
    assert cov.posCovDD == pytest.approx(record.sd_pos[10, 2] ** 2, rel=1e-5)


def test_the_folder_is_read_as_a_drive(tmp_path: Path) -> None:
    from automap.io.drive import load_drive
    from automap.io.imu_csv import imu_format, read_imu_csv
    from automap.io.receiver import read_receiver_log

    motion = drive(3)
    rng = np.random.default_rng(0)
    noise = draw_noise(rng, "usual")
    imu = record_imu(motion, {}, noise[0], rng, WARM_UP)
    gnss = record_gnss(motion, {}, noise[1], rng, ARM)
    write_drive(tmp_path / "d", 1_400_000_000, imu, gnss, ARM, motion.at(imu.stamp[::10]))
    opened = load_drive(tmp_path / "d")
    recording = read_imu_csv(tmp_path / "d" / "imu.csv", imu_format(opened))
    np.testing.assert_allclose(recording.data.accel, imu.accel, rtol=1e-8, atol=1e-8)
    assert not recording.warnings
    fixes = read_receiver_log(tmp_path / "d" / "gnss.ubx").fixes
    np.testing.assert_allclose(fixes.gps_s, 1_400_000_000 + gnss.tag, atol=1e-6)
    np.testing.assert_allclose(fixes.lat_rad, gnss.lat, atol=2e-11)
    np.testing.assert_allclose(fixes.vel_ned, gnss.vel, atol=6e-4)


def test_nothing_of_the_library_goes_into_a_drive() -> None:
    here = Path(__file__).parent
    sources = [p for p in here.glob("*.py") if not p.name.startswith("test_")]
    assert len(sources) > 10
    for path in sources:
        imports = re.findall(r"^\s*(?:from|import) (automap|pipeline)\b", path.read_text(), re.M)
        # only the one that runs the code under test
        assert not imports or path.name == "run_case.py", path.name


def _stream(data: bytes) -> object:
    from io import BytesIO

    return BytesIO(data)
