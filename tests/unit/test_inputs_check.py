"""Stage ingest and check, on a drive written from formulas with one thing wrong at a time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from input_drive import BOOT_NS, START, motion, write_drive, write_imu_rows

from automap.errors import InputError
from automap.io import names
from automap.io.drive import load_drive
from automap.io.imu_csv import read_imu_csv
from automap.io.recording import Recording
from automap.io.tables import read_fixes, read_imu
from automap.timebase import ROLLOVER_S, unix_to_gps
from pipeline.check.command import check_drive
from pipeline.check.judge import judge
from pipeline.run.stages import ingest
from tests.slow_cases import others_slow
from tests.unit.checked_drive import edit, errors_told, ingested


def _rewrite(drive: Path, gyro: np.ndarray, accel: np.ndarray) -> None:
    write_imu_rows(drive, gyro, accel, motion().t)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "formula")


def test_ingest_writes_readings_and_epochs(drive: Path, tmp_path: Path) -> None:
    context = ingested(drive, tmp_path / "work")
    imu = read_imu(tmp_path / "work" / names.IMU)
    np.testing.assert_allclose(imu.accel, motion().accel, rtol=1e-6)
    fixes = read_fixes(tmp_path / "work" / names.FIXES)
    assert len(fixes) == 90
    assert abs(fixes.gps_s[0] - float(unix_to_gps(START.timestamp()))) < 1e-6
    # the first epoch arrived 60 ms and a little after it was valid
    assert 0.06 <= (fixes.arrival_ns[0] - imu.t_ns[0]) * 1e-9 < 0.2
    summary = json.loads((tmp_path / "work" / names.INGEST).read_text())
    assert summary["imu"]["used"] == len(imu)
    assert summary["gnss"]["fix_types"] == {"THREE_D": 90}
    assert context.warnings == []
    assert "90 fixes" in context.result


def test_a_good_drive_has_no_findings(drive: Path) -> None:
    report = check_drive(drive)
    assert report.usable, report.text()
    assert {f.severity for f in report.findings} <= {"ok", "info"}, report.text()
    assert "usable: 0 errors, 0 warnings" in report.text()
    assert json.loads(json.dumps(report.as_dict()))["usable"] is True
    said = report.text()
    for part in (
        "50.0 Hz",
        "90 fixes of 90 epochs",
        "overlap",
        "forward force to +",
        "on the down axis",
    ):
        assert part in said


@pytest.mark.parametrize(
    ("gyro_factor", "accel_factor", "advice"),
    others_slow(
        [
            (1.0, 1 / 9.81, 'accel_unit = "g"'),
            (1.0, 9.81, 'accel_unit = "m/s^2"'),
            (1.0, 1 / 50, "velocity increments"),
            (1.0, 1000 / 9.81, "milli-g"),
            (1.0, 3.0, "correct accel_unit"),
            (57.3, 1.0, 'gyro_unit = "deg/s"'),
            (1 / 57.3, 1.0, 'gyro_unit = "rad/s"'),
        ],
        3,
    ),
)
def test_a_wrong_unit_is_found_and_stops_the_run(
    drive: Path, tmp_path: Path, gyro_factor: float, accel_factor: float, advice: str
) -> None:
    move = motion()
    _rewrite(drive, move.gyro * gyro_factor, move.accel * accel_factor)
    report = check_drive(drive)
    assert not report.usable
    assert advice in errors_told(report)
    with pytest.raises(InputError) as caught:
        ingested(drive, tmp_path / "work")
    assert advice in str(caught.value)
    assert list((tmp_path / "work").iterdir()) == []


def test_one_axis_in_another_unit_is_found_by_the_motion(drive: Path) -> None:
    """Gravity does not tell it, and the noise of both triads was blamed."""
    move = motion()
    _rewrite(drive, move.gyro, move.accel / np.array([9.81, 1.0, 1.0]))
    said = errors_told(check_drive(drive))
    assert "the force forward" in said
    assert "one axis of the accelerometer is in another unit" in said


def test_gravity_taken_out_is_not_mistaken_for_a_unit(drive: Path) -> None:
    move = motion()
    _rewrite(drive, move.gyro, move.accel + np.array([0, 0, 9.81]))
    assert "gravity was taken out" in errors_told(check_drive(drive))


@pytest.mark.parametrize("axes", others_slow(["FLU", "RBD", "BLD", "DRB"]))
def test_wrong_axes_are_found_and_stop_the_run(drive: Path, tmp_path: Path, axes: str) -> None:
    edit(drive, "[imu]\n", f'[imu]\naxes = "{axes}"\n')
    report = check_drive(drive)
    assert not report.usable
    assert 'write axes = "FRD" in [imu]' in errors_told(report)
    with pytest.raises(InputError, match=r"imu\.csv: the IMU's axes are not as stated"):
        ingested(drive, tmp_path / "work")


def test_a_gyro_of_the_wrong_sign_is_found(drive: Path) -> None:
    move = motion()
    _rewrite(drive, -move.gyro, move.accel)
    said = errors_told(check_drive(drive))
    assert "turns with the rate about down to -1.00" in said
    assert 'accel_axes = "FRD" and gyro_axes = "' in said


def test_unknown_axes_are_fine(drive: Path) -> None:
    edit(drive, "[imu]\n", '[imu]\naxes = "unknown"\n')
    move = motion()
    _rewrite(drive, move.gyro[:, [2, 0, 1]], move.accel[:, [2, 0, 1]])
    assert check_drive(drive).usable


def test_dates_that_are_1024_weeks_early_are_told_as_such(drive: Path) -> None:
    imu = read_imu_csv(drive / "imu.csv").data
    since = imu.t_ns - BOOT_NS + round((unix_to_gps(START.timestamp()) + ROLLOVER_S) * 1e9)
    lines = [
        f"{t}," + ",".join(map(str, row))
        for t, row in zip(since, np.hstack([imu.gyro, imu.accel]).tolist(), strict=True)
    ]
    (drive / "imu.csv").write_text("\n".join(["t_ns,gx,gy,gz,ax,ay,az", *lines]))
    edit(drive, "[imu]\n", '[imu]\ntime = "gps_ns"\n')
    assert "the receiver's dates are 1024 weeks early" in errors_told(check_drive(drive))


def test_recordings_of_different_times_are_refused(drive: Path) -> None:
    edit(drive, "[imu]\n", '[imu]\ntime = "gps_ns"\n')
    report = check_drive(drive)
    assert not report.usable
    assert "do not overlap in time" in errors_told(report)
    assert "1980-01-06" in errors_told(report)


def test_a_clock_is_judged_by_the_axes_that_were_found(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pipeline.check import imu as inertial
    from pipeline.check.axes import WeighedAxes

    asked: list[Any] = []
    mended = WeighedAxes((), read_imu_csv(drive / "imu.csv").data)
    monkeypatch.setattr(inertial, "weigh_axes", lambda *_: mended)
    monkeypatch.setattr(inertial, "offset", lambda imu, *_: asked.append(imu))
    monkeypatch.setattr(inertial, "steadiness", lambda imu, *_: [asked.append(imu)][:0])
    assert check_drive(drive).usable
    assert [imu is mended.imu for imu in asked] == [True, True]
    # where stated axes are wrong, nothing is said of the clock
    monkeypatch.undo()
    monkeypatch.setattr(inertial, "offset", lambda imu, *_: asked.append(imu))
    edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    assert "axes are not as stated" in errors_told(check_drive(drive))
    assert len(asked) == 2


@pytest.mark.parametrize(
    ("arm", "said"),
    [
        ("[12.0, 0.0, -1.0]", "12.0 m long"),
        ("[-30.0, 10.0, -50.0]", "59.2 m long, more than any vehicle, and is left out"),
        ("[0.0, 0.0, 1.4]", "below the IMU"),
    ],
)
def test_a_strange_lever_arm_is_a_warning(drive: Path, arm: str, said: str) -> None:
    edit(drive, "[0.2, 0.0, -1.0]", arm)
    report = check_drive(drive)
    assert report.usable
    assert said in report.text()


@pytest.mark.parametrize(
    ("vehicle", "said"),
    [
        (
            "imu_above_road_m = 0.5",
            "lever_arm_m puts the camera 0.40 m under the road",
        ),
        ("imu_above_road_m = 1.65", ""),
        ("", "lever_arm_m puts the camera 0.90 m below the IMU"),
    ],
)
def test_a_camera_below_the_road_is_a_warning(drive: Path, vehicle: str, said: str) -> None:
    with (drive / "drive.toml").open("a") as file:
        file.write(f"[vehicle]\n{vehicle}\n[video.front]\nlever_arm_m = [-1.4, -0.05, 0.9]\n")
    told = [item.sentence() for item in judge(load_drive(drive), Recording()).found]
    told = [text for text in told if "puts the camera" in text]
    assert len(told) == bool(said)
    assert all(said in text and "down is positive" in text for text in told)


def test_a_stuck_axis_is_found(drive: Path) -> None:
    move = motion()
    accel = move.accel.copy()
    accel[:, 1] = 0.25
    _rewrite(drive, move.gyro, accel)
    assert "ay never changes" in errors_told(check_drive(drive))


@pytest.mark.parametrize("content", ["", "t_ns,gx,gy,gz,ax,ay,az\n"])
def test_an_imu_file_without_rows_leaves_the_fixes(
    drive: Path, tmp_path: Path, content: str
) -> None:
    (drive / "imu.csv").write_text(content)
    assert check_drive(drive).usable
    context = ingested(drive, tmp_path / "work")
    assert not (tmp_path / "work" / names.IMU).exists()
    assert (tmp_path / "work" / names.FIXES).exists()
    said = " ".join(context.warnings)
    assert "imu.csv" in said
    assert "the drive goes on without it" in said


def test_without_any_usable_file_the_run_stops(drive: Path, tmp_path: Path) -> None:
    (drive / "imu.csv").write_text("")
    (drive / "gnss.nmea").write_bytes(b"")
    report = check_drive(drive)
    assert not report.usable
    with pytest.raises(InputError, match=r"gnss\.nmea is empty"):
        ingested(drive, tmp_path / "work")


def test_a_receiver_that_never_had_a_fix(drive: Path, tmp_path: Path) -> None:
    text = (drive / "gnss.nmea").read_text()
    lines = [line for line in text.splitlines() if "RMC" in line]
    (drive / "gnss.nmea").write_text(
        "".join(_resum(line.replace(",A,", ",V,", 1)) for line in lines)
    )
    report = check_drive(drive)
    assert not report.usable
    assert "never had a fix in 90 epochs" in errors_told(report)
    with pytest.raises(InputError, match="never had a fix"):
        ingested(drive, tmp_path / "work")


def _resum(line: str) -> str:
    body = line[1:].split("*")[0]
    checksum = 0
    for character in body.encode():
        checksum ^= character
    return f"${body}*{checksum:02X}\r\n"


def test_a_drive_of_bearings_alone_passes(tmp_path: Path) -> None:
    drive = tmp_path / "d"
    drive.mkdir()
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
    (drive / "bearings.csv").write_text("lat_deg,lon_deg,bearing_deg\n51.5,-0.1,20\n")
    assert check_drive(drive).usable
    context = ingested(drive, tmp_path / "work")
    assert context.result == "bearings only"


def test_a_finished_trajectory_passes(tmp_path: Path) -> None:
    drive = tmp_path / "d"
    drive.mkdir()
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
    rows = "".join(f"{i}000000000,51.5,{0.0001 * i},10\n" for i in range(9))
    (drive / "trajectory.csv").write_text("t_ns,lat_deg,lon_deg,height_m\n" + rows)
    report = check_drive(drive)
    assert report.usable
    context = ingested(drive, tmp_path / "work")
    summary: dict[str, Any] = json.loads((tmp_path / "work" / names.INGEST).read_text())
    assert summary["trajectory"]["rows"] == 9
    assert any("no complete attitude" in text for text in context.warnings)


def test_a_folder_that_is_no_drive_is_a_finding(tmp_path: Path) -> None:
    report = check_drive(tmp_path)
    assert not report.usable
    assert "drive.toml" in report.text()


def test_counts_bring_their_sensor_file_into_the_key(drive: Path) -> None:
    assert ingest.sensor_input(load_drive(drive)) is None
    edit(drive, "[imu]\n", '[imu]\naccel_unit = "counts"\nsensor = "mpu9150"\n')
    found = ingest.sensor_input(load_drive(drive))
    assert found is not None
    assert found in ingest.STAGE.inputs(load_drive(drive))


def test_an_imu_that_cannot_be_read_is_no_error_of_a_usable_drive(
    drive: Path, tmp_path: Path
) -> None:
    (drive / "imu.csv").write_text("")
    report = check_drive(drive)
    assert "usable: 0 errors, 1 warning" in report.text()
    (told,) = [f for f in report.findings if f.severity == "warning"]
    assert told.code == "imu_unreadable"
    assert told.advice == "the drive goes on without it"
    assert f"{drive}/{told.text}; {told.advice}" in ingested(drive, tmp_path / "work").warnings


@pytest.mark.parametrize("rows", [9, 3])
def test_too_few_readings_leave_the_receiver_alone(drive: Path, tmp_path: Path, rows: int) -> None:
    lines = (drive / "imu.csv").read_text().splitlines(keepends=True)
    (drive / "imu.csv").write_text("".join([lines[0], *lines[1 :: len(lines) // rows]]))
    report = check_drive(drive)
    assert report.usable
    assert "imu_sparse" in [f.code for f in report.findings]
    context = ingested(drive, tmp_path / "work")
    assert not (tmp_path / "work" / names.IMU).exists()
    assert "goes on with the receiver alone" in " ".join(context.warnings)
