"""Stage ingest and check, on a drive written from formulas with one thing wrong at a time."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from input_drive import BOOT_NS, RATE_HZ, START, motion, write_drive, write_imu_rows

from automap.errors import InputError
from automap.io import names
from automap.io.drive import load_drive
from automap.io.imu_csv import read_imu_csv
from automap.io.tables import read_fixes, read_imu
from automap.timebase import ROLLOVER_S, unix_to_gps
from pipeline.check.command import CheckReport, check_drive
from pipeline.run.stage import StageContext
from pipeline.run.stages import ingest
from pipeline.settings.load import Settings


def _ingest(drive: Path, work: Path) -> StageContext:
    work.mkdir(exist_ok=True)
    context = StageContext(load_drive(drive), drive / "_automap", work, Settings())
    ingest.run(context)
    return context


def _edit(drive: Path, old: str, new: str) -> None:
    path = drive / "drive.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def _rewrite(drive: Path, gyro: np.ndarray, accel: np.ndarray) -> None:
    write_imu_rows(drive, gyro, accel, motion().t)


def _errors(report: CheckReport) -> str:
    return "\n".join(
        f"{f.file}: {f.text} -> {f.advice}" for f in report.findings if f.severity == "error"
    )


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "formula")


def test_ingest_writes_readings_and_epochs(drive: Path, tmp_path: Path) -> None:
    context = _ingest(drive, tmp_path / "work")
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
    [
        (1.0, 1 / 9.81, 'accel_unit = "g"'),
        (1.0, 9.81, 'accel_unit = "m/s^2"'),
        (1.0, 1 / 50, "velocity increments"),
        (1.0, 1000 / 9.81, "milli-g"),
        (1.0, 3.0, "correct accel_unit"),
        (57.3, 1.0, 'gyro_unit = "deg/s"'),
        (1 / 57.3, 1.0, 'gyro_unit = "rad/s"'),
    ],
)
def test_a_wrong_unit_is_found_and_stops_the_run(
    drive: Path, tmp_path: Path, gyro_factor: float, accel_factor: float, advice: str
) -> None:
    move = motion()
    _rewrite(drive, move.gyro * gyro_factor, move.accel * accel_factor)
    report = check_drive(drive)
    assert not report.usable
    assert advice in _errors(report)
    with pytest.raises(InputError) as caught:
        _ingest(drive, tmp_path / "work")
    assert advice in str(caught.value)
    assert list((tmp_path / "work").iterdir()) == []


def test_gravity_taken_out_is_not_mistaken_for_a_unit(drive: Path) -> None:
    move = motion()
    _rewrite(drive, move.gyro, move.accel + np.array([0, 0, 9.81]))
    assert "gravity was taken out" in _errors(check_drive(drive))


@pytest.mark.parametrize("axes", ["FLU", "RBD", "BLD", "DRB"])
def test_wrong_axes_are_found_and_stop_the_run(drive: Path, tmp_path: Path, axes: str) -> None:
    _edit(drive, "[imu]\n", f'[imu]\naxes = "{axes}"\n')
    report = check_drive(drive)
    assert not report.usable
    assert 'write axes = "FRD" in [imu]' in _errors(report)
    with pytest.raises(InputError, match=r"imu\.csv: the IMU's axes are not as stated"):
        _ingest(drive, tmp_path / "work")


def test_a_gyro_of_the_wrong_sign_is_found(drive: Path) -> None:
    move = motion()
    _rewrite(drive, -move.gyro, move.accel)
    said = _errors(check_drive(drive))
    assert "turns with the rate about down to -1.00" in said
    assert 'accel_axes = "FRD" and gyro_axes = "' in said


def test_unknown_axes_are_fine(drive: Path) -> None:
    _edit(drive, "[imu]\n", '[imu]\naxes = "unknown"\n')
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
    _edit(drive, "[imu]\n", '[imu]\ntime = "gps_ns"\n')
    assert "the receiver's dates are 1024 weeks early" in _errors(check_drive(drive))


def test_recordings_of_different_times_are_refused(drive: Path) -> None:
    _edit(drive, "[imu]\n", '[imu]\ntime = "gps_ns"\n')
    report = check_drive(drive)
    assert not report.usable
    assert "do not overlap in time" in _errors(report)
    assert "1980-01-06" in _errors(report)


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
    _edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    assert "axes are not as stated" in _errors(check_drive(drive))
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
    _edit(drive, "[0.2, 0.0, -1.0]", arm)
    report = check_drive(drive)
    assert report.usable
    assert said in report.text()


def test_a_stuck_axis_is_found(drive: Path) -> None:
    move = motion()
    accel = move.accel.copy()
    accel[:, 1] = 0.25
    _rewrite(drive, move.gyro, accel)
    assert "ay never changes" in _errors(check_drive(drive))


@pytest.mark.parametrize("content", ["", "t_ns,gx,gy,gz,ax,ay,az\n"])
def test_an_imu_file_without_rows_leaves_the_fixes(
    drive: Path, tmp_path: Path, content: str
) -> None:
    (drive / "imu.csv").write_text(content)
    assert check_drive(drive).usable
    context = _ingest(drive, tmp_path / "work")
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
        _ingest(drive, tmp_path / "work")


def test_a_receiver_that_never_had_a_fix(drive: Path, tmp_path: Path) -> None:
    text = (drive / "gnss.nmea").read_text()
    lines = [line for line in text.splitlines() if "RMC" in line]
    (drive / "gnss.nmea").write_text(
        "".join(_resum(line.replace(",A,", ",V,", 1)) for line in lines)
    )
    report = check_drive(drive)
    assert not report.usable
    assert "never had a fix in 90 epochs" in _errors(report)
    with pytest.raises(InputError, match="never had a fix"):
        _ingest(drive, tmp_path / "work")


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
    context = _ingest(drive, tmp_path / "work")
    assert context.result == "bearings only"


def test_a_finished_trajectory_passes(tmp_path: Path) -> None:
    drive = tmp_path / "d"
    drive.mkdir()
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
    rows = "".join(f"{i}000000000,51.5,{0.0001 * i},10\n" for i in range(9))
    (drive / "trajectory.csv").write_text("t_ns,lat_deg,lon_deg,height_m\n" + rows)
    report = check_drive(drive)
    assert report.usable
    context = _ingest(drive, tmp_path / "work")
    summary: dict[str, Any] = json.loads((tmp_path / "work" / names.INGEST).read_text())
    assert summary["trajectory"]["rows"] == 9
    assert any("no complete attitude" in text for text in context.warnings)


def test_a_camera_that_does_not_fit_its_video(drive: Path) -> None:
    from test_inputs_video import _make

    (drive / "video").mkdir()
    _make(drive / "video" / "front.mp4", list(range(0, 2000, 40)))
    manifest = drive / "drive.toml"
    manifest.write_text(
        manifest.read_text() + "[video.front]\nstart_ns = 0\nwidth = 192\nheight = 128\n"
        "camera_matrix = [[150.0, 0.0, 96.0], [0.0, 150.0, 64.0], [0.0, 0.0, 1.0]]\n"
    )
    assert "192x128, the video has 96x64" in _errors(check_drive(drive))
    _edit(drive, "192", "96")
    _edit(drive, "height = 128", "height = 64")
    errors = _errors(check_drive(drive))
    assert errors.count("another resolution") == 1
    # of another size than the video alone tells, as well
    _edit(drive, "width = 96\nheight = 64\n", "")
    assert _errors(check_drive(drive)).count("another resolution") == 1
    _edit(drive, "schema", 'accept = ["camera_matrix"]\nschema')
    assert check_drive(drive).usable
    _edit(drive, "64.0], [0.0, 0.0", "39.0], [0.0, 0.0")
    _edit(drive, "96.0], [0.0, 150", "48.0], [0.0, 150")
    assert "11 % off that of 96x64" in check_drive(drive).text().replace("\n", " ").replace(
        "  ", ""
    )
    _edit(drive, "[video.front]", "[video.front]\nwidth = 96\nheight = 72")
    assert "its proportions are others" in _errors(check_drive(drive))


def test_frames_of_another_video_are_told(drive: Path) -> None:
    from test_inputs_video import _make

    (drive / "video").mkdir()
    _make(drive / "video" / "front.mp4", list(range(0, 2000, 40)))
    manifest = drive / "drive.toml"
    manifest.write_text(manifest.read_text() + "[video.front]\nwidth = 96\nheight = 64\n")
    rows = [f"{k},{BOOT_NS + k * 40_000_000}" for k in range(60)]
    for n, told in ((60, True), (50, False)):
        text = "\n".join(["frame,t_ns", *rows[:n]])
        (drive / "video" / "front_frames.csv").write_text(text + "\n")
        assert (f"lists {n} frames, the video has 50" in check_drive(drive).text()) == told


def test_a_focal_length_in_millimetres_stops_a_run(drive: Path) -> None:
    """No sign can be placed by a view of 179 deg: nothing to go on with, whatever is accepted."""
    manifest = drive / "drive.toml"
    before = manifest.read_text()
    manifest.write_text(
        'accept = ["camera_view"]\n'
        + before
        + '[video.front]\ndetections = "d.csv"\nframes = "f.csv"\nwidth = 1242\nheight = 375\n'
        "camera_matrix = [[4.2, 0.0, 610.0], [0.0, 4.2, 173.0], [0.0, 0.0, 1.0]]\n"
    )
    (drive / "d.csv").write_text("frame,class,x_min,y_min,x_max,y_max,score\n")
    (drive / "f.csv").write_text("frame,t_ns\n0,0\n1,100000000\n")
    report = check_drive(drive)
    assert "in pixels, not in millimetres" in _errors(report)
    assert not report.usable


def test_frames_that_the_header_does_not_give_are_counted(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import av

    from pipeline.check import camera

    with av.open(str(drive / "front.mkv"), "w", options={"live": "1"}) as container:
        stream = container.add_stream("mpeg4", rate=10, width=96, height=64, pix_fmt="yuv420p")
        for _ in range(30):
            picture = av.VideoFrame.from_ndarray(np.zeros((64, 96, 3), np.uint8), format="bgr24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    with (drive / "drive.toml").open("a") as manifest:
        manifest.write('[video.front]\nfiles = ["front.mkv"]\nstart_ns = 0\n')
    assert "mpeg4 96x64, 30 frames, 3.0 s" in check_drive(drive).text()
    monkeypatch.setattr(camera, "_COUNTED_BYTES", 100)
    text = check_drive(drive).text()
    assert "frames not counted in the file, length not in the file" in text
    assert "nan" not in text


def test_a_folder_that_is_no_drive_is_a_finding(tmp_path: Path) -> None:
    report = check_drive(tmp_path)
    assert not report.usable
    assert "drive.toml" in report.text()


def test_counts_bring_their_sensor_file_into_the_key(drive: Path) -> None:
    assert ingest.sensor_input(load_drive(drive)) is None
    _edit(drive, "[imu]\n", '[imu]\naccel_unit = "counts"\nsensor = "mpu9150"\n')
    found = ingest.sensor_input(load_drive(drive))
    assert found is not None
    assert found in ingest.STAGE.inputs(load_drive(drive))


def _with_wheels(drive: Path, factor: float = 1.0, late_s: float = 0.0, stuck: bool = False) -> str:
    """What is said of wheel speed once a second."""
    move = motion()
    rows = np.arange(0, len(move.t), RATE_HZ)
    speed = factor * move.speed[rows]
    if stuck:
        speed[20:50] = speed[20]
    t_ns = BOOT_NS + np.rint((move.t[rows] + late_s) * 1e9).astype(np.int64)
    lines = [f"{t},{v:.4f}\n" for t, v in zip(t_ns, speed, strict=True)]
    (drive / "odometer.csv").write_text("t_ns,speed_m_s\n" + "".join(lines))
    report = check_drive(drive)
    assert report.usable
    found = [f for f in report.findings if f.file == "odometer.csv"]
    return "\n".join(f"{f.severity}: {f.text} -> {f.advice}" for f in found)


def test_wheel_speed_is_compared_with_the_receivers(drive: Path) -> None:
    said = _with_wheels(drive, 1.03, 0.5)
    assert "ok: 90 wheel speeds over 89.0 s, 1 Hz, up to 16.5 m/s" in said
    late = re.search(r"(\d+) ms late .*, ([\d.]+) times as much", said)
    assert late is not None
    # arrival lies some hundredths of a second behind the epoch, and is taken for a tenth
    assert int(late[1]) == pytest.approx(500, abs=80)
    assert float(late[2]) == pytest.approx(1.03, abs=0.003)


@pytest.mark.parametrize(
    ("factor", "late_s", "stuck", "words"),
    [
        (3.6, 0.0, False, "as in km/h; it is not used -> write speed_m_s in metres per second"),
        (2.2369, 0.0, False, "as in miles per hour; it is not used"),
        (1.0, 7.0, False, "7.0 s later than the receiver's; it is not used -> stamp t_ns"),
        (1.0, 0.0, True, "30 of 90 wheel speeds are stuck while the vehicle drives -> they are"),
    ],
)
def test_wheel_speed_that_cannot_be_is_named(
    drive: Path, factor: float, late_s: float, stuck: bool, words: str
) -> None:
    assert words in _with_wheels(drive, factor, late_s, stuck)


def test_what_stops_a_run_is_what_check_calls_an_error(drive: Path, tmp_path: Path) -> None:
    _edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    (wrong,) = [f for f in check_drive(drive).findings if f.severity == "error"]
    assert wrong.code == "imu_axes"
    assert 'accept = ["imu_axes"] at the top of drive.toml' in wrong.advice
    with pytest.raises(InputError) as caught:
        _ingest(drive, tmp_path / "work")
    assert str(caught.value) == f"{drive / 'imu.csv'}: {wrong.text}; {wrong.advice}."


def test_what_is_accepted_is_a_warning_in_both(drive: Path, tmp_path: Path) -> None:
    _edit(drive, "[imu]\n", '[imu]\naxes = "BLD"\n')
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["imu_axes"]\n' + manifest.read_text())
    report = check_drive(drive)
    assert report.usable
    (told,) = [f.text for f in report.findings if f.severity == "warning"]
    (warning,) = _ingest(drive, tmp_path / "work").warnings
    assert warning == f'{drive / "imu.csv"}: {told}; accepted as "imu_axes"'


def test_a_code_that_nothing_was_found_of_is_told(drive: Path, tmp_path: Path) -> None:
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["imu_axis"]\n' + manifest.read_text())
    said = "accept names imu_axis, and nothing of that name was found"
    assert said in check_drive(drive).text()
    assert any(said in text for text in _ingest(drive, tmp_path / "work").warnings)


def test_an_imu_that_cannot_be_read_is_no_error_of_a_usable_drive(
    drive: Path, tmp_path: Path
) -> None:
    (drive / "imu.csv").write_text("")
    report = check_drive(drive)
    assert "usable: 0 errors, 1 warning" in report.text()
    (told,) = [f for f in report.findings if f.severity == "warning"]
    assert told.code == "imu_unreadable"
    assert told.advice == "the drive goes on without it"
    assert f"{drive}/{told.text}; {told.advice}" in _ingest(drive, tmp_path / "work").warnings


def test_nobody_can_accept_that_there_are_no_positions(drive: Path, tmp_path: Path) -> None:
    (drive / "gnss.nmea").unlink()
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["no_positions"]\n' + manifest.read_text())
    report = check_drive(drive)
    assert not report.usable
    (wrong,) = [f for f in report.findings if f.severity == "error"]
    with pytest.raises(InputError) as caught:
        _ingest(drive, tmp_path / "work")
    assert str(caught.value) == f"{manifest}: {wrong.text}; {wrong.advice}."


@pytest.mark.parametrize("rows", [9, 3])
def test_too_few_readings_leave_the_receiver_alone(drive: Path, tmp_path: Path, rows: int) -> None:
    lines = (drive / "imu.csv").read_text().splitlines(keepends=True)
    (drive / "imu.csv").write_text("".join([lines[0], *lines[1 :: len(lines) // rows]]))
    report = check_drive(drive)
    assert report.usable
    assert "imu_sparse" in [f.code for f in report.findings]
    context = _ingest(drive, tmp_path / "work")
    assert not (tmp_path / "work" / names.IMU).exists()
    assert "goes on with the receiver alone" in " ".join(context.warnings)
