"""Readings that are of another drive than the fixes are told as that, others are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.evaluation.plausibility import Finding
from automap.frames import rpy_to_matrix
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from pipeline.check.axes import seen_motion
from pipeline.check.command import check_drive
from pipeline.check.same_drive import UsableReceiver, other_drive
from pipeline.check.turned import pieces_of, turned_meanwhile
from pipeline.check.wheels import untied
from pipeline.run.stage import StageContext
from pipeline.run.stages import fuse, ingest, sync
from pipeline.settings.load import Settings
from tests.slow_cases import others_slow
from tests.unit.checked_drive import edit
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive
from tests.unit.input_drive import SPAN_S, write_drive, write_imu_rows

SECONDS = 240.0


@cache
def readings(seed: int) -> ImuData:
    return record(city_drive(SECONDS, seed), Sensor(), seed, rate=10.0)


@cache
def fixes_of(seed: int) -> Fixes:
    return receive(city_drive(SECONDS, seed), Receiver(rate=1.0), seed)


def told(imu: ImuData, fixes: Fixes, of_positions: bool = False) -> str | None:
    receiver = UsableReceiver(fixes, CLOCK, of_positions=of_positions)
    seen = seen_motion(imu, fixes, CLOCK)
    found = other_drive(imu, receiver, seen, pieces_of(imu, fixes, CLOCK, seen), "gnss.ubx")
    return None if found is None else found.text


def turned(imu: ImuData, fixes: Fixes, clock: ClockModel | None = CLOCK) -> Finding | None:
    seen = seen_motion(imu, fixes, clock)
    return turned_meanwhile(imu, fixes, seen, pieces_of(imu, fixes, clock, seen))


def test_readings_of_another_drive_are_told() -> None:
    text = told(readings(1), fixes_of(2))
    assert text is not None
    assert "the readings and gnss.ubx are of two drives: they explain" in text
    assert told(readings(1), fixes_of(1)) is None


def test_velocities_that_err_are_no_other_drive() -> None:
    noise = np.random.default_rng(1).normal(0.0, 1.0, (len(fixes_of(1)), 3))
    quick = receive(city_drive(SECONDS, 1), Receiver(rate=10.0), 1)
    more = np.random.default_rng(2).normal(0.0, 1.0, (len(quick), 3))
    for fixes, errors in ((fixes_of(1), noise), (quick, more)):
        assert told(readings(1), replace(fixes, vel_ned=fixes.vel_ned + errors)) is None


def test_ways_between_rough_positions_are_no_other_drive() -> None:
    """Velocities that a receiver made of positions which scatter by metres, once a second."""
    fixes, imu = fixes_of(1), readings(1)
    rough = np.random.default_rng(3).normal(0.0, 4.0, (len(fixes), 3))
    made = replace(fixes, vel_ned=fixes.vel_ned + np.gradient(rough, axis=0))
    assert told(imu, made) is not None
    assert told(imu, made, of_positions=True) is None


def test_velocities_that_are_mostly_noise_are_no_other_drive() -> None:
    """Positions that err by metres for seconds, of which a receiver makes its velocities: what is
    left of them without their noise is no motion of a vehicle."""
    fixes = receive(city_drive(SECONDS, 1), Receiver(rate=5.0), 1)
    error = np.zeros((len(fixes), 3))
    for i, jolt in enumerate(np.random.default_rng(4).standard_normal((len(fixes) - 1, 3))):
        error[i + 1] = 0.95 * error[i] + 1.5 * jolt
    reflected = replace(fixes, vel_ned=fixes.vel_ned + np.gradient(error, fixes.gps_s, axis=0))
    assert told(readings(1), reflected) is None
    assert told(readings(2), fixes) is not None


def test_positions_that_err_between_houses_are_no_other_drive() -> None:
    """Velocities between them, twice a second, of which the readings explain a third in all, and of
    the first pieces next to nothing: more than those of another drive do of any."""
    fixes = receive(city_drive(SECONDS, 1), Receiver(rate=2.0), 1)
    t = fixes.gps_s - fixes.gps_s[0]
    there = np.sin(2.0 * np.pi * t / 60.0) > 0.0
    error = np.random.default_rng(5).normal(0.0, 0.2, (len(fixes), 3))
    error[there] *= 10.0
    rough = replace(fixes, vel_ned=fixes.vel_ned + np.gradient(error, fixes.gps_s, axis=0))
    assert told(readings(1), rough) is None
    text = told(readings(2), rough)
    assert text is not None
    assert "are of two drives: they explain" in text


@pytest.mark.parametrize(
    "axes", others_slow([np.diag([1.0, -1.0, 1.0]), np.roll(np.eye(3), 1, axis=0), -np.eye(3)])
)
def test_axes_and_units_make_no_other_drive(axes: FloatArray) -> None:
    """Mirrored, turned and negated; the gyro in another unit and one that reads nothing."""
    imu = readings(1)
    turned = replace(imu, gyro=imu.gyro @ axes.T, accel=imu.accel @ axes.T)
    for gyro in (57.3, 0.0):
        assert told(replace(turned, gyro=gyro * turned.gyro), fixes_of(1)) is None


@pytest.mark.parametrize("share", others_slow([0.35, 0.5, 0.7]))
def test_a_file_that_was_put_together_of_two_drives_is_told_with_when(share: float) -> None:
    imu, other = readings(1), readings(2)
    first = (np.arange(len(imu)) < share * len(imu))[:, None]
    mixed = replace(
        imu,
        gyro=np.where(first, imu.gyro, other.gyro),
        accel=np.where(first, imu.accel, other.accel),
    )
    text = told(mixed, fixes_of(1))
    assert text is not None
    at = float(text.split("of two drives from about ")[1].split(" s after")[0])
    assert at == pytest.approx(share * SECONDS, abs=40.0)


@pytest.mark.parametrize("degrees", others_slow([90.0, -120.0, 180.0]))
def test_an_imu_that_was_turned_about_the_vertical_is_told(degrees: float) -> None:
    """Gravity shows nothing of it; seven reasons were given for such a path."""
    imu, fixes = readings(1), fixes_of(1)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    second = (np.arange(len(imu)) >= len(imu) // 2)[:, None]
    for part in (second, ~second):
        gyro, accel = (np.where(part, v @ turn.T, v) for v in (imu.gyro, imu.accel))
        found = turned(replace(imu, gyro=gyro, accel=accel), fixes)
        assert found is not None
        assert (found.severity, found.code) == ("error", "imu_changed")
        told_deg = float(found.text.split("felt ")[1].split(" deg")[0])
        assert told_deg == pytest.approx(abs(degrees), abs=12.0)


def _from(imu: ImuData, share: float, turn: FloatArray, gyro: FloatArray) -> ImuData:
    """Readings that are turned from a share of them on, those of the gyro otherwise."""
    later = (np.arange(len(imu)) >= share * len(imu))[:, None]
    return replace(
        imu,
        gyro=np.where(later, imu.gyro @ gyro.T, imu.gyro),
        accel=np.where(later, imu.accel @ turn.T, imu.accel),
    )


@pytest.mark.parametrize("share", others_slow([0.4, 0.5, 0.6]))
def test_a_mount_that_gives_way_is_told_by_the_level(share: float) -> None:
    """By 11 deg of tilt: heights were 2.8 sigmas off, and a scale error was told."""
    turn = rpy_to_matrix(np.radians([[6.0, -9.0, 15.0]]))[0]
    found = turned(_from(readings(1), share, turn, turn), fixes_of(1))
    assert found is not None
    assert (found.severity, found.code) == ("error", "imu_changed")
    assert "11 deg" in found.text
    whole = rpy_to_matrix(np.radians([[2.0, 1.5, 1.0]]))[0]
    assert turned(_from(readings(1), share, whole, whole), fixes_of(1)) is None, "a load"


@pytest.mark.parametrize(
    ("accel", "gyro", "text"),
    [
        ([1.0, 1.0, 1.0], [1.0, 1.0, -1.0], "the gyro's z axis has the wrong sign"),
        ([1.0, -1.0, 1.0], [1.0, 1.0, 1.0], "the accelerometer's y axis has the wrong sign"),
    ],
)
@pytest.mark.parametrize("known", others_slow([True, False]))
def test_an_axis_whose_sign_changes_is_told_as_that(
    accel: list[float], gyro: list[float], text: str, known: bool
) -> None:
    imu = _from(readings(1), 0.5, np.diag(accel), np.diag(gyro))
    if not known:
        turn = rpy_to_matrix(np.radians([[3.0, -8.0, 100.0]]))[0]
        imu = readings(1)
        case = replace(imu, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T, axes_known=False)
        assert turned(case, fixes_of(1)) is None
        imu = _from(case, 0.5, np.diag(accel), np.diag(gyro))
    found = turned(imu, fixes_of(1))
    assert found is not None
    assert found.code == "imu_changed"
    assert text in found.text


@pytest.mark.slow
def test_one_mounting_is_one_whatever_the_axes() -> None:
    imu, fixes = readings(1), fixes_of(1)
    roll = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    for turn in (np.eye(3), roll, -np.eye(3), np.diag([1.0, -1.0, 1.0])):
        assert turned(replace(imu, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T), fixes) is None
    assert turned(imu, fixes_of(2)) is None
    assert turned(imu, fixes, None) is None


@pytest.mark.slow
def test_stamps_that_are_off_make_no_other_drive() -> None:
    for off in (1.0, 30.0):
        assert told(readings(1), replace(fixes_of(1), gps_s=fixes_of(1).gps_s + off)) is None
    imu = readings(1)
    fast = imu.t_ns[0] + np.rint(1.02 * (imu.t_ns - imu.t_ns[0])).astype(np.int64)
    assert told(replace(imu, t_ns=fast), fixes_of(1)) is None


@pytest.mark.slow
def test_a_run_goes_on_with_the_fixes_and_says_why(tmp_path: Path) -> None:
    """It was doubtful for reasons of which none was it, and its sigmas were too small."""
    folder = write_drive(tmp_path / "drive")
    kept = slice(0, int(10.0 * SPAN_S))
    other = readings(2)
    t = (other.t_ns[kept] - other.t_ns[0]) * 1e-9
    write_imu_rows(folder, other.gyro[kept], other.accel[kept], t)
    (text,) = (f.text for f in check_drive(folder).findings if f.code == "other_drive")
    context = StageContext(load_drive(folder), tmp_path, tmp_path, Settings())
    for stage in (ingest, sync, fuse):
        stage.run(context)
    assert context.verdict is not None
    assert context.verdict["state"] == "doubtful"
    (reason,) = context.verdict["reasons"]
    assert reason["code"] == "other_drive"
    assert text in reason["text"]


def refused(folder: Path, tmp_path: Path) -> str:
    """The sentence with which `run` stops; `check` has the same."""
    context = StageContext(load_drive(folder), tmp_path, tmp_path, Settings())
    with pytest.raises(InputError) as caught:
        ingest.run(context)
    errors = [f.text for f in check_drive(folder).findings if f.severity == "error"]
    assert any(text in str(caught.value) for text in errors)
    return str(caught.value)


def test_a_clock_that_the_motions_do_not_tell_is_refused_by_check_too(tmp_path: Path) -> None:
    """It passed, and the run's second stage stopped."""
    folder = write_drive(tmp_path / "drive")
    (folder / "gnss_arrival.csv").unlink()
    still = np.random.default_rng(1).normal(0.0, 0.01, (900, 6))
    still[:, 5] -= 9.81
    write_imu_rows(folder, still[:, :3], still[:, 3:], np.arange(900) * 0.1)
    assert "does not stand out from their motions" in refused(folder, tmp_path)


@pytest.mark.slow
def test_arrival_times_of_a_longer_log_are_named(tmp_path: Path) -> None:
    folder = write_drive(tmp_path / "drive")
    rows = [line.split(",") for line in (folder / "gnss_arrival.csv").read_text().split()]
    longer = [f"{2 * int(o)},{t}" for o, t in rows[1:]]
    (folder / "gnss_arrival.csv").write_text("\n".join(["offset,t_ns", *longer]) + "\n")
    assert "the two are not of one recording, or the log was cut" in refused(folder, tmp_path)
    # without an IMU they are the only clock
    (folder / "imu.csv").unlink()
    assert "the two are not of one recording, or the log was cut" in refused(folder, tmp_path)


def test_wheels_of_a_clock_that_nothing_ties_are_left_out(tmp_path: Path) -> None:
    """The run stopped in its third stage for what it can do without."""
    folder = write_drive(tmp_path / "drive", imu_section='time = "gps_ns"')
    (folder / "gnss_arrival.csv").unlink()
    edit(folder, "[gnss]", '[odometer]\ntime = "boot_ns"\n[gnss]')
    (folder / "odometer.csv").write_text("t_ns,speed_m_s\n1000,2.0\n2000,2.0\n")
    drive = load_drive(folder)
    told = untied(drive, read_recording(drive))
    assert told is not None
    assert "have nothing in common" in told.text
