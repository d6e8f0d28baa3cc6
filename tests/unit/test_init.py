"""``automap init``: from a folder of recordings to a drive in one try."""

from __future__ import annotations

import errno
import os
import shutil
import tomllib
import zipfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from import_bags import write_own_bag
from import_phones import write_gnss_logger, write_sensor_logger

from automap.errors import AutoMapError, ConfigError
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from pipeline.check.command import check_drive
from pipeline.cli.root import run_command
from pipeline.init.choose import draft_of
from pipeline.init.command import init_drive
from pipeline.init.draft import Draft
from pipeline.init.found import look
from tests.slow_cases import others_slow
from tests.unit.foreign_tables import FOREIGN, SAMPLE, imu_unix_s, sample


def not_converted(kind: str, paths: list[Path], out: Path) -> list[str]:
    raise AssertionError(f"{kind} {paths} {out}")


@pytest.mark.parametrize("name", others_slow(FOREIGN))
def test_a_foreign_table_is_a_drive_in_one_try(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Units, separators, times and the receiver's speeds are those of the drive it was made of."""
    FOREIGN[name](tmp_path / name)
    assert run_command(["init", str(tmp_path / name)]) == 0
    assert "usable: 0 errors" in capsys.readouterr().out
    recording, own = read_recording(load_drive(tmp_path / name)), sample()
    assert recording.failures == ()
    assert recording.imu is not None
    assert own.imu is not None
    np.testing.assert_allclose(recording.imu.gyro, own.imu.gyro, atol=1e-6)
    np.testing.assert_allclose(recording.imu.accel, own.imu.accel, atol=1e-5)
    np.testing.assert_allclose(recording.imu.t_ns * 1e-9, imu_unix_s(), atol=2e-6)
    assert recording.fixes is not None
    assert own.fixes is not None
    at = np.searchsorted(own.fixes.gps_s, recording.fixes.gps_s - 0.01)
    np.testing.assert_allclose(recording.fixes.gps_s, own.fixes.gps_s[at], atol=1e-5)
    for field in ("lat_rad", "lon_rad"):
        mine, theirs = getattr(recording.fixes, field), getattr(own.fixes, field)[at]
        good = recording.fixes.fix_type > 1
        np.testing.assert_allclose(mine[good], theirs[good], atol=1e-10)
    np.testing.assert_allclose(recording.fixes.vel_ned[:, :2], own.fixes.vel_ned[at, :2], atol=1e-4)


def test_every_value_says_why(tmp_path: Path) -> None:
    FOREIGN["german"](tmp_path / "d")
    init_drive(tmp_path / "d", None, not_converted)
    lines = (tmp_path / "d/drive.toml").read_text(encoding="utf-8").splitlines()
    for before, line in pairwise(lines):
        if " = " in line and not line.startswith(("#", "schema", "name")):
            assert "  # " in line or before.startswith("# "), line
        # names of a table's columns are as long as they are
        assert len(line) <= 100 or line.startswith("columns = "), line


@pytest.mark.slow
def test_a_manifest_is_not_written_over_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    FOREIGN["bare"](tmp_path / "d")
    manifest = tmp_path / "d/drive.toml"
    manifest.write_text("mine")
    assert run_command(["init", str(tmp_path / "d")]) == 2
    assert "--force" in capsys.readouterr().err
    assert manifest.read_text() == "mine"
    assert run_command(["init", str(tmp_path / "d"), "--force"]) == 0
    assert tomllib.loads(manifest.read_text(encoding="utf-8"))["gnss"]["file"] == "gnss.ubx"


@pytest.mark.slow
def test_a_folder_of_its_own_says_which_command_made_it(tmp_path: Path) -> None:
    FOREIGN["bare"](tmp_path / "d")
    for more in ([], ["--force"]):
        assert run_command(["init", str(tmp_path / "d"), "-o", str(tmp_path / "o"), *more]) == 0
        manifest = (tmp_path / "o/drive.toml").read_text(encoding="utf-8")
        assert manifest.startswith("# Made by automap init from d\n")


def test_the_sample_drive_without_its_manifest(tmp_path: Path) -> None:
    shutil.copytree(SAMPLE, tmp_path / "d", ignore=shutil.ignore_patterns("drive.toml", "_automap"))
    init_drive(tmp_path / "d", None, not_converted)
    said = tomllib.loads((tmp_path / "d/drive.toml").read_text(encoding="utf-8"))
    assert said["imu"]["gyro_unit"] == "rad/s"
    assert "columns" not in said["imu"]
    assert said["gnss"] == {
        "file": "gnss.ubx",
        "arrival": "gnss_arrival.csv",
        "arrival_time": "boot_ns",
    }
    assert said["video"]["front"]["files"] == ["video/front.mp4"]
    assert said["video"]["front"]["frames"] == "video/front_frames.csv"
    assert check_drive(tmp_path / "d").usable


@pytest.mark.slow
def test_into_another_folder(tmp_path: Path) -> None:
    FOREIGN["bare"](tmp_path / "d")
    before = sorted((tmp_path / "d").iterdir())
    outcome = init_drive(tmp_path / "d", tmp_path / "drive", not_converted)
    assert outcome.drive == tmp_path / "drive"
    assert sorted((tmp_path / "d").iterdir()) == before
    assert check_drive(tmp_path / "drive").usable
    with pytest.raises(ConfigError, match="--force"):
        init_drive(tmp_path / "d", tmp_path / "drive", not_converted)
    # what is told names files that are there: they were named where they lay before the drive
    for text in outcome.told:
        assert Path(text.split(": ")[0]).is_file(), text


def test_a_copy_that_finds_no_room_is_the_targets_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python names the file that it copies from first."""
    FOREIGN["bare"](tmp_path / "d")

    def full(*args: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "sendfile", full)
    target = tmp_path / "drive"
    assert run_command(["init", str(tmp_path / "d"), "-o", str(target)]) == 4
    assert f"cannot write {target}: the disk is full" in capsys.readouterr().err
    assert not target.exists()


def test_a_negated_accelerometer_is_found(tmp_path: Path) -> None:
    """As phones have it: the manifest names the axes of that triad."""
    FOREIGN["bare"](tmp_path / "d")
    table = tmp_path / "d/log.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    turned = [",".join([*row[:4], *(str(-float(cell)) for cell in row[4:])]) for row in rows[1:]]
    table.write_text("\n".join([",".join(rows[0]), *turned]) + "\n")
    init_drive(tmp_path / "d", None, not_converted)
    said = tomllib.loads((tmp_path / "d/drive.toml").read_text(encoding="utf-8"))["imu"]
    assert (said["axes"], said["accel_axes"]) == ("unknown", "BLU")
    assert "gyro_axes" not in said


def test_dates_of_another_zone_than_the_receivers(tmp_path: Path) -> None:
    """Local time without its zone, beside a receiver's log, which is in UTC."""
    FOREIGN["german"](tmp_path / "d")
    (tmp_path / "d/gps.csv").unlink()
    shutil.copy(SAMPLE / "gnss.ubx", tmp_path / "d")
    table = tmp_path / "d/messung.csv"
    text = table.read_text(encoding="latin-1").replace("T09:", "T18:").replace("Z;", ";")
    table.write_text(text.replace("Zeitstempel", "Zeit", 1), encoding="latin-1")
    init_drive(tmp_path / "d", None, not_converted)
    said = tomllib.loads((tmp_path / "d/drive.toml").read_text(encoding="utf-8"))["imu"]
    assert said["utc_offset_h"] == 9.0
    recording = read_recording(load_drive(tmp_path / "d"))
    assert recording.imu is not None
    np.testing.assert_allclose(recording.imu.t_ns * 1e-9, imu_unix_s(), atol=2e-6)


def test_recordings_of_other_programs_are_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two bags of one drive into the folder; a phone's log, which is a file, beside it."""
    (tmp_path / "bags").mkdir()
    write_own_bag(tmp_path / "bags/imu.bag", gnss=False)
    write_own_bag(tmp_path / "bags/gps.bag", imu=False)
    run_command(["init", str(tmp_path / "bags")])
    assert "imported as rosbag" in capsys.readouterr().err
    drive = load_drive(tmp_path / "bags/drive")
    assert drive.imu_file is not None
    assert drive.gnss_file is not None
    log = write_gnss_logger(tmp_path / "walk.txt")
    run_command(["init", str(log)])
    assert load_drive(tmp_path / "walk-drive").gnss_file is not None
    phone = write_sensor_logger(tmp_path / "phone")
    run_command(["init", str(phone), "-o", str(tmp_path / "out")])
    assert load_drive(tmp_path / "out").imu_file is not None


@pytest.mark.parametrize(
    ("files", "code", "said"),
    [
        ({}, 3, "holds nothing that is known"),
        (
            {"notes.csv": b"a,b\n1,2\n"},
            3,
            "notes.csv: its columns say nothing that is known (a, b)",
        ),
        ({"a.bag": b"x", "log.nmea": b"$GPGGA,1,1,,,,0*00\r\n"}, 3, "cannot be read"),
        ({"imu.xlsx": b"PK\x03\x04"}, 3, "imu.xlsx: a workbook; save each of its sheets as CSV"),
        (
            {"ride.FIT": b"\x0e"},
            3,
            "ride.FIT: a watch's or a bicycle computer's track; save it as GPX",
        ),
        ({"a.bag": b"x", "b.mcap": b"y"}, 3, "cannot be read as a ROS recording"),
    ],
)
def test_what_is_no_drive_is_one_sentence(
    files: dict[str, bytes],
    code: int,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert run_command(["init", str(tmp_path)]) == code
    error = capsys.readouterr().err
    assert said in error
    assert error.startswith("error: ")
    assert error.count("\n") == 1


def test_several_drives_in_one_folder_are_refused(tmp_path: Path) -> None:
    FOREIGN["bare"](tmp_path)
    write_gnss_logger(tmp_path / "gnss_log.txt")
    with pytest.raises(ConfigError, match=r"log\.csv \(table\).*automap init FILE"):
        init_drive(tmp_path, None, not_converted)


def test_what_cannot_be_known_is_asked(tmp_path: Path) -> None:
    FOREIGN["bare"](tmp_path)
    shutil.copy(tmp_path / "log.csv", tmp_path / "other.csv")
    asked: list[str] = []

    def answer(question: str, answers: Sequence[str]) -> str:
        asked.append(question)
        if answers:
            assert list(answers) == ["log.csv", "other.csv"]
            return "other.csv"
        return "au" if "Country" in question else "0.4, 0.1 -1.2"

    said = tomllib.loads(draft_of(look(tmp_path), tmp_path, answer).manifest("x"))
    assert len(asked) == 3
    assert said["imu"]["file"] == "other.csv"
    assert said["gnss"]["lever_arm_m"] == [0.4, 0.1, -1.2]
    assert said["site"]["country"] == "AU"
    # unasked: the first of the largest, and the other is named
    silent = draft_of(look(tmp_path), tmp_path, None).manifest("x")
    assert "not taken: other.csv" in silent


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from(["a.csv", "a.txt", "a.zip", "a.mp4", "a.bag", "a.mcap", "a.ubx", "video"]),
    st.one_of(
        st.binary(max_size=300),
        st.text(alphabet="tgxyza_,;0123456789.\n-", max_size=300).map(str.encode),
    ),
)
def test_any_file_is_looked_at(tmp_path: Path, name: str, content: bytes) -> None:
    folder = tmp_path / "f"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / name).write_bytes(content)
    try:
        init_drive(folder, None, lambda kind, paths, out: [])
    except AutoMapError as error:
        assert "\n" not in str(error)  # noqa: PT017


@given(
    st.dictionaries(st.sampled_from(["gx", "t"]), st.text(max_size=20) | st.integers(1, 9)),
    st.text(max_size=300),
    st.text(max_size=20),
)
def test_what_a_draft_says_is_what_is_read(
    columns: dict[str, str | int], why: str, name: str
) -> None:
    """Whatever stands in a header or a file's name: half characters are replaced."""
    draft = Draft(Path("/d"))
    draft.set("imu", "columns", columns, why)
    draft.set("imu", "file", Path("/d/x.csv"), why)
    draft.note("site", why)
    said = tomllib.loads(draft.manifest(name))

    def whole(text: str | int) -> str | int:
        return text if isinstance(text, int) else text.encode("utf-8", "replace").decode()

    assert said["imu"] == {"columns": {k: whole(v) for k, v in columns.items()}, "file": "x.csv"}


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "it is empty"),
        ({"a.jpg": b"x"}, "it holds no table but a.jpg"),
        ({"a.csv": bytes(range(256)) * 10}, "a.csv: is not text"),
        ({"gnss_log.txt": b""}, "unpack it and give that file"),
        (None, "it is no whole .zip"),
    ],
    ids=["empty", "pictures", "garbage", "gnss-logger", "cut"],
)
def test_an_archive_without_tables_is_one_sentence(
    files: dict[str, bytes] | None,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "phone.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in ({"a.csv": b"1,2\n" * 99} if files is None else files).items():
            whole = content or write_gnss_logger(tmp_path / name).read_bytes()
            archive.writestr(name, whole)
    if files is None:
        path.write_bytes(path.read_bytes()[:-30])
    assert run_command(["init", str(path)]) == 3
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "phone-drive").exists()


@pytest.mark.slow
def test_wheel_speed_of_a_cars_computer_finds_its_zone(tmp_path: Path) -> None:
    """A CAN log in local time beside a table of readings and fixes: not the receiver's, the
    wheels'."""
    FOREIGN["german"](tmp_path / "d")
    fixes = (tmp_path / "d/gps.csv").read_text(encoding="latin-1").splitlines()[1:]
    rows = []
    for line in fixes:
        _, time, *place, speed, _ = line.split(";")
        hour = int(time[:2]) + 3
        cells = [f"2026-03-14 {hour:02d}{time[2:]}", "2100", *place[:2], speed]
        rows.append(",".join(cell.replace(",", ".") for cell in cells))
    header = "Time,Engine RPM,Latitude,Longitude,Speed (km/h)"
    (tmp_path / "d/can.csv").write_text("\n".join([header, *rows]) + "\n")
    init_drive(tmp_path / "d", None, not_converted)
    said = tomllib.loads((tmp_path / "d/drive.toml").read_text(encoding="utf-8"))
    assert said["gnss"]["file"] == "gps.csv"
    assert said["odometer"]["file"] == "can.csv"
    assert (said["odometer"]["time"], said["odometer"]["utc_offset_h"]) == ("unix_ns", 3.0)
    assert "wheel" in check_drive(tmp_path / "d").text()
