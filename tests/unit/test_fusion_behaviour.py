"""Short drives with one thing out of the ordinary each, against their truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.errors import InputError
from automap.frames import rpy_to_matrix
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.gnss_only import smooth_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.records import Fixes, FixType, FloatArray, ImuData
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import CLOCK, Sensor, errors, horizontal_rms, record
from tests.unit.fusion_motion import Motion, city_drive, make_motion
from tests.unit.fusion_receiver import GPS0, Receiver, receive, select, shifted

SECONDS = 120.0
SENSOR = Sensor()
SEED = 1
DELAY = Prior(0.0, 0.1)


def _fuse(imu: ImuData, fixes: Fixes, lever: FloatArray | None = None) -> FusionResult:
    arm = np.zeros(3) if lever is None else lever
    return fuse_imu_gnss(imu, fixes, CLOCK, FusionOptions(), DELAY, lever_arm=arm)


def _parameter(result: FusionResult, name: str) -> float:
    history = result.parameters
    return float(history.values[-1, history.names.index(name)])


def _heading_rms_deg(error: FloatArray) -> float:
    return float(np.degrees(np.sqrt(np.mean(error[:, 8] ** 2))))


@pytest.fixture(scope="module")
def motion() -> Motion:
    return city_drive(SECONDS, SEED)


@pytest.fixture(scope="module")
def imu(motion: Motion) -> ImuData:
    return record(motion, SENSOR, 2)


@pytest.fixture(scope="module")
def fixes(motion: Motion) -> Fixes:
    return receive(motion, Receiver(), 3)


@pytest.fixture(scope="module")
def plain(imu: ImuData, fixes: Fixes) -> FusionResult:
    """Nothing out of the ordinary: from rest, known axes."""
    return _fuse(imu, fixes)


@pytest.fixture(scope="module")
def plain_rms(plain: FusionResult, motion: Motion) -> float:
    return horizontal_rms(errors(plain.trajectory, motion))


def test_smoothing_beats_the_filter_and_the_fixes(
    plain: FusionResult, plain_rms: float, motion: Motion, fixes: Fixes
) -> None:
    assert plain_rms < 0.95 * horizontal_rms(errors(plain.filtered, motion))
    true = motion.at(fixes.gps_s - GPS0)
    north, east = metres_per_radian(true.lat, true.height)
    off = np.column_stack([(fixes.lat_rad - true.lat) * north, (fixes.lon_rad - true.lon) * east])
    assert plain_rms < 0.95 * horizontal_rms(off)


def test_velocity_attitude_and_biases_are_found(plain: FusionResult, motion: Motion) -> None:
    error = errors(plain.trajectory, motion)
    assert np.sqrt(np.mean(error[:, 3:6] ** 2)) < 0.03
    assert np.degrees(np.sqrt(np.mean(error[:, 6:8] ** 2))) < 0.1
    assert _heading_rms_deg(error) < 0.25
    for axis, true in zip("xyz", SENSOR.gyro_bias, strict=True):
        assert _parameter(plain, f"gyro_bias_{axis}") == pytest.approx(true, abs=5e-4)
    for axis, true in zip("xy", SENSOR.accel_bias[:2], strict=True):
        # a roll of half a degree looks like it, where axes may be crooked by 0.01 rad
        name = f"accel_bias_{axis}"
        sd = float(plain.parameters.sd[-1, plain.parameters.names.index(name)])
        assert sd < 0.1
        assert _parameter(plain, name) == pytest.approx(true, abs=min(2.0 * sd, 0.06))
    assert plain.standstill[0][0] < 1.0
    assert plain.standstill[0][1] == pytest.approx(8.0, abs=1.5)


def test_headings_are_no_surer_than_a_nose_is_on_its_course(plain: FusionResult) -> None:
    """A car that goes askew by the same angle all the way looks like a sensor that is turned; the
    trajectory tells what of its heading's sigma is that."""
    askew = np.radians(FusionOptions().nhc_lasting_deg)
    for path in (plain.trajectory, plain.filtered):
        assert (path.sd_rpy[:, 2] > askew).all()
        assert path.slip_sd == pytest.approx(askew)


def test_every_epoch_has_a_row_from_the_first_on(
    plain: FusionResult, motion: Motion, imu: ImuData
) -> None:
    assert (plain.trajectory.t_ns == imu.t_ns).all()
    error = errors(plain.trajectory, motion)
    assert np.isfinite(error).all()
    first = horizontal_rms(error[:500])
    assert first < 3.0 * max(horizontal_rms(error), 0.5)
    sd = plain.trajectory.sd_pos_ned
    assert (sd > 0.01).all()
    assert np.sqrt(np.mean((error[:, :3] / sd) ** 2)) < 3.0


@pytest.mark.parametrize("kind", others_slow(["streak", "scattered"]))
def test_outliers_hardly_matter(
    kind: str, imu: ImuData, fixes: Fixes, motion: Motion, plain_rms: float
) -> None:
    rng = np.random.default_rng(5)
    off = np.zeros((len(fixes), 3))
    if kind == "scattered":
        hit = rng.random(len(fixes)) < 0.03
        course = rng.uniform(0.0, 2.0 * np.pi, int(hit.sum()))
        off[hit, 0], off[hit, 1] = 25.0 * np.cos(course), 25.0 * np.sin(course)
    else:
        off[300:310, :2] = [28.3, -28.3]
    result = _fuse(imu, shifted(fixes, off))
    assert horizontal_rms(errors(result.trajectory, motion)) < 1.15 * plain_rms
    doubted = ~result.innovations.accepted
    positions = np.char.startswith(result.innovations.channel.astype(str), "position")
    assert 8 <= int((doubted & positions).sum()) <= 3 * len(fixes) // 10


@pytest.mark.slow
def test_half_a_minute_without_fixes(
    imu: ImuData, fixes: Fixes, motion: Motion, plain: FusionResult, plain_rms: float
) -> None:
    t = fixes.gps_s - GPS0
    result = _fuse(imu, select(fixes, (t < 60.0) | (t > 90.0)))
    error = errors(result.trajectory, motion)
    assert horizontal_rms(error) < plain_rms + 0.5
    inside = (np.arange(len(error)) > 6000) & (np.arange(len(error)) < 9000)
    # the receiver's slow error is in all of these; what the gap adds is not
    added = error - errors(plain.trajectory, motion)
    drifted = errors(result.filtered, motion) - errors(plain.filtered, motion)
    assert horizontal_rms(added[inside]) < 0.4 * horizontal_rms(drifted[inside])
    assert horizontal_rms(added[inside]) < 0.3
    # sigmas of positions follow the level of the slow error, which each run asks of its own fixes
    ours, known = result.trajectory.sd_vel_ned[:, :2], plain.trajectory.sd_vel_ned[:, :2]
    # elsewhere both are as unsure as the age of the fixes
    acceleration = 100.0 * np.gradient(plain.trajectory.vel_ned, axis=0)[7200:7800]
    steady = np.linalg.norm(acceleration, axis=1) < 0.2
    assert np.count_nonzero(steady) > 100
    assert (ours[7200:7800][steady] > 1.2 * known[7200:7800][steady]).all()
    ours = result.trajectory.sd_pos_ned[:, :2]
    assert (ours[7200:7800] > ours[10000]).all()


@pytest.mark.slow
def test_two_seconds_of_lost_samples(
    fixes: Fixes, motion: Motion, imu: ImuData, plain_rms: float
) -> None:
    broken = record(motion, SENSOR, 2, lost=[(70.0, 2.0)])
    result = _fuse(broken, fixes)
    assert len(result.trajectory) == len(broken) < len(imu)
    error = errors(result.trajectory, motion)
    assert horizontal_rms(error) < plain_rms + 0.15
    assert _heading_rms_deg(error) < 0.3


def test_fixes_begin_a_while_after_the_samples(imu: ImuData, motion: Motion) -> None:
    late = receive(motion, Receiver(), 3, begin=60.0)
    result = _fuse(imu, late)
    assert len(result.trajectory) == len(imu)
    error = errors(result.trajectory, motion)
    assert horizontal_rms(error) < 4.0
    assert np.abs(error[:100, 3:6]).max() < 0.5


def test_fixes_without_velocity(imu: ImuData, fixes: Fixes, motion: Motion) -> None:
    nothing = np.full_like(fixes.vel_ned, np.nan)
    result = _fuse(imu, replace(fixes, vel_ned=nothing, sd_vel_ned=nothing))
    error = errors(result.trajectory, motion)
    assert horizontal_rms(error) < 2.0
    assert _heading_rms_deg(error) < 0.6


@pytest.mark.slow
def test_fixes_with_horizontal_velocity_only(
    imu: ImuData, fixes: Fixes, motion: Motion, plain_rms: float
) -> None:
    velocity = fixes.vel_ned.copy()
    velocity[:, 2] = np.nan
    result = _fuse(imu, replace(fixes, vel_ned=velocity))
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.2
    assert "velocity_d" not in set(result.innovations.channel)


@pytest.mark.slow
def test_fixes_without_figures_of_their_own(imu: ImuData, fixes: Fixes, motion: Motion) -> None:
    unknown = np.full_like(fixes.vel_ned, np.nan)
    result = _fuse(imu, replace(fixes, sd_pos_ned=unknown, sd_vel_ned=unknown))
    assert horizontal_rms(errors(result.trajectory, motion)) < 2.0


@pytest.mark.slow
def test_fixes_of_type_none_are_not_used(
    imu: ImuData, fixes: Fixes, motion: Motion, plain_rms: float
) -> None:
    t = fixes.gps_s - GPS0
    lost = (t > 50.0) & (t < 55.0)
    off = np.where(lost[:, None], [[500.0, 0.0, 0.0]], 0.0)
    kind = np.where(lost, FixType.NONE, FixType.THREE_D).astype(np.int64)
    result = _fuse(imu, replace(shifted(fixes, off), fix_type=kind))
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.1
    assert result.n_fixes_used <= int((~lost).sum())


@pytest.mark.slow
def test_a_delay_of_the_samples_is_recovered(
    fixes: Fixes, motion: Motion, plain_rms: float
) -> None:
    """Rows are the state at the stamp's instant, not at the late sample's."""
    result = _fuse(record(motion, SENSOR, 2, delay_s=0.15), fixes)
    assert result.delay.mean == pytest.approx(0.15, abs=max(3.0 * result.delay.sd, 0.01))
    assert result.delay.sd < 0.03
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.15
    velocity = errors(result.trajectory, motion)[200:-200, 3:5]
    assert np.sqrt(np.mean(velocity**2)) < 0.06


@pytest.mark.slow
def test_a_delay_of_the_clock_moves_the_gps_times(motion: Motion, fixes: Fixes) -> None:
    result = fuse_imu_gnss(
        record(motion, SENSOR, 2, delay_s=0.1),
        fixes,
        CLOCK,
        FusionOptions(),
        DELAY,
        lever_arm=np.zeros(3),
        delay_is_clock=True,
    )
    moved = CLOCK.gps_s(result.trajectory.t_ns) - result.trajectory.gps_s
    assert moved == pytest.approx(result.delay.mean, abs=1e-6)
    velocity = errors(result.trajectory, motion, late_s=result.delay.mean)[:, 3:5]
    assert np.sqrt(np.mean(velocity**2)) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("latency", others_slow([0.12, -0.1]))
def test_velocities_older_than_positions_are_recovered(
    latency: float, imu: ImuData, motion: Motion, plain_rms: float
) -> None:
    result = _fuse(imu, receive(motion, Receiver(vel_latency=latency), 3))
    found = _parameter(result, "gnss_velocity_latency_s")
    assert found == pytest.approx(latency, abs=0.03)
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.15


def test_late_velocities_beside_a_biased_accelerometer(motion: Motion) -> None:
    """What late courses changed by is of the corrected forces: a bias of 0.3 m/s^2 is no bend."""
    sensor = replace(SENSOR, accel_bias=(0.25, -0.3, 0.05))
    late = receive(motion, Receiver(rate=1.0, vel_latency=0.5, course_latency=-0.4), 3)
    result = _fuse(record(motion, sensor, 2), late)
    error = errors(result.trajectory, motion)[200:-200]
    assert np.sqrt(np.mean(error[:, 3:5] ** 2)) < 0.035
    assert _heading_rms_deg(error) < 0.1
    assert abs(result.delay.mean) < 0.02


@pytest.mark.slow
def test_a_start_in_motion(plain_rms: float) -> None:
    motion = city_drive(SECONDS, SEED, rest_s=0.0, start_speed=12.0)
    result = _fuse(record(motion, SENSOR, 2), receive(motion, Receiver(), 3))
    error = errors(result.trajectory, motion)
    assert result.align_margin > 10.0
    assert horizontal_rms(error) < plain_rms + 0.3
    assert _heading_rms_deg(error) < 0.3


@pytest.mark.slow
def test_a_start_in_reverse() -> None:
    """The car first backs out of a drive: its heading is not the course."""
    speed = [(0, 0), (5, 0), (7, -3), (14, -3), (16, 0), (18, 0), (25, 13), (80, 13), (85, 6)]
    turns = [(9.0, 4.0, 50.0), (30.0, 5.0, -90.0), (50.0, 6.0, 90.0), (85.0, 5.0, -60.0)]
    motion = make_motion([*speed, (100, 12)], turns, SECONDS)
    result = _fuse(record(motion, SENSOR, 2), receive(motion, Receiver(), 3))
    error = errors(result.trajectory, motion)
    assert _heading_rms_deg(error) < 0.3
    backwards = slice(800, 1300)
    ahead = np.cos(result.trajectory.rpy[backwards, 2]) * result.trajectory.vel_ned[backwards, 0]
    ahead += np.sin(result.trajectory.rpy[backwards, 2]) * result.trajectory.vel_ned[backwards, 1]
    assert (ahead < -2.0).all()


@pytest.mark.parametrize(
    "angles",
    [
        (178.0, 7.0, -165.0),
        pytest.param((-90.0, 10.0, 40.0), marks=pytest.mark.slow),
        pytest.param((3.0, -80.0, 90.0), marks=pytest.mark.slow),
    ],
)
def test_an_unknown_mounting_is_found(
    angles: tuple[float, float, float], motion: Motion, fixes: Fixes, plain_rms: float
) -> None:
    c_v_s = rpy_to_matrix(np.radians(angles))
    result = _fuse(record(motion, SENSOR, 2, c_v_s=c_v_s), fixes)
    turn = result.mounting.matrix @ c_v_s.T
    assert np.degrees(np.arccos(min((np.trace(turn) - 1.0) / 2.0, 1.0))) < 1.5
    error = errors(result.trajectory, motion)
    assert horizontal_rms(error) < plain_rms + 0.15
    assert _heading_rms_deg(error) < 0.4


@pytest.mark.parametrize(
    "place",
    [
        (-16.5, 179.9995, 10.0),
        pytest.param((80.0, 10.0, 10.0), marks=pytest.mark.slow),
        pytest.param((0.0, 0.0, 0.0), marks=pytest.mark.slow),
    ],
)
def test_odd_places(place: tuple[float, float, float], plain_rms: float) -> None:
    motion = city_drive(SECONDS, SEED, origin_deg=place)
    result = _fuse(record(motion, SENSOR, 2), receive(motion, Receiver(), 3))
    lon = result.trajectory.lon_rad
    assert (np.abs(lon) <= np.pi).all()
    if place[1] > 179.0:
        assert np.ptp(lon) > 6.0
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.05


@pytest.mark.slow
def test_an_antenna_away_from_the_sensor(imu: ImuData, motion: Motion, plain_rms: float) -> None:
    lever = (0.8, -0.5, -1.5)
    fixes = receive(motion, Receiver(lever=lever), 3)
    result = _fuse(imu, fixes, np.array(lever))
    assert horizontal_rms(errors(result.trajectory, motion)) < plain_rms + 0.05


def test_fixes_alone_are_smoothed(fixes: Fixes, motion: Motion) -> None:
    trajectory = smooth_fixes(fixes, CLOCK, FusionOptions())
    assert len(trajectory) == len(fixes)
    error = errors(trajectory, motion)
    assert horizontal_rms(error) < 1.6
    assert np.sqrt(np.mean(error[:, 3:5] ** 2)) < 0.25
    moving = np.linalg.norm(fixes.vel_ned[:, :2], axis=1) > 3.0
    assert np.degrees(np.sqrt(np.mean(error[moving, 8] ** 2))) < 3.0
    ratio = np.sqrt(np.mean((error[:, :3] / trajectory.sd_pos_ned) ** 2))
    assert ratio < 2.5


def test_hardly_any_input_is_refused(imu: ImuData, fixes: Fixes) -> None:
    away = replace(fixes, gps_s=fixes.gps_s + 1e5)
    with pytest.raises(InputError, match="usable fixes fall within"):
        _fuse(imu, away)
    with pytest.raises(InputError, match="usable samples"):
        _fuse(ImuData(imu.t_ns[:5], imu.gyro[:5], imu.accel[:5]), fixes)
    with pytest.raises(InputError, match="fixes have a position"):
        smooth_fixes(select(fixes, np.arange(1)), CLOCK, FusionOptions())
