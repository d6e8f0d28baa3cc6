"""Broken drives through the real command: one sentence and the right exit code, or a warning
and the best that the rest allows; never a traceback or a file written in half."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from automap.io import atomic, names
from automap.io.tables import read_table
from automap.timebase import gps_to_unix
from pipeline.cli.root import run_command
from tests.slow_cases import others_slow
from tests.unit.broken_drive import (
    Break,
    bearings,
    both,
    cells,
    content,
    cut,
    finished_trajectory,
    later,
    manifest,
    no_fix,
    noise,
    rows,
    second_half_later,
    sentences,
    times,
    without,
    write_short_drive,
    wrong_checksums,
)

IMU, GNSS, ARRIVAL = "imu.csv", "gnss.nmea", "gnss_arrival.csv"
FRAMES, BOXES = "video/front_frames.csv", "video/front_detections.csv"
THREE_BEARINGS = (
    "lat_deg,lon_deg,bearing_deg\n48.0,11.0,45.0\n48.0,11.0005,320.0\n48.0001,11.0,60.0\n"
)

NAN_IN_TRAJECTORY = rows(
    "trajectory.csv", lambda x: [*x[:9], x[9].replace("149.0", "nan"), *x[10:]]
)


@dataclass(frozen=True)
class Told:
    """What a command said: the exit code and both streams."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_short_drive(tmp_path_factory.mktemp("whole") / "trip")


@pytest.fixture
def drive(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "trip"))


def tell(capsys: pytest.CaptureFixture[str], *words: object) -> Told:
    """Run the command line; whatever happens, no traceback and no temporary file."""
    capsys.readouterr()
    code = run_command([str(word) for word in words])
    told = Told(code, *capsys.readouterr())
    assert "Traceback" not in told.out + told.err
    assert "unexpectedly" not in told.out + told.err
    return told


def assert_nothing_half_written(out: Path) -> None:
    """OUT holds no temporary file, and all that its record calls an output is there whole."""
    if not out.is_dir():
        return
    assert [path.name for path in out.rglob("*") if ".tmp" in path.name] == []
    record = json.loads((out / names.RUN).read_text())
    for stage in record["stages"].values():
        assert stage["status"] in ("done", "failed", "interrupted")
        for name, about in stage.get("outputs", {}).items():
            assert (out / name).stat().st_size == about["bytes"]


def at_ends(fields: list[str]) -> list[str]:
    """A receiver with a fix in the first and in the last epoch alone."""
    return fields if fields[1] in ("100000.00", "100029.00") else no_fix(fields)


def middle(lines: list[str]) -> list[str]:
    """The middle third of a table."""
    third = len(lines) // 3
    return [lines[0], *lines[third : 2 * third]]


FAILURES: list[tuple[str, Break, int, str]] = [
    ("imu_empty_gnss_empty", both(content(IMU, b""), content(GNSS, b"")), 3, r"nmea is empty"),
    ("turned_imu", manifest("[imu]", '[imu]\naxes = "FLU"'), 3, r'write axes = "FRD" in \[imu\]'),
    ("gnss_empty", content(GNSS, b""), 3, r"gnss\.nmea is empty; record"),
    ("gnss_noise", noise(GNSS), 3, r"no UBX, NMEA or RTKLIB content in its 5000 bytes"),
    ("gnss_all_checksums", wrong_checksums(1), 3, r"60 message starts have a wrong checksum"),
    ("gnss_no_fix", sentences(no_fix), 3, r"never had a fix in 30 epochs"),
    ("gnss_one_fix", sentences(lambda f: f if f[1] == "100000.00" else no_fix(f)), 3, "needs two"),
    ("imu_between_fixes", both(sentences(at_ends), rows(IMU, middle)), 3, r"0 of 2 fixes lie in"),
    ("gnss_absent", without(GNSS, "gnss.nmea", "arrival"), 3, r"no receiver log; without GPS"),
    ("gnss_misnamed", manifest("gnss.nmea", "gnss.nema"), 3, r"is gnss\.nmea meant\?"),
    ("imu_misnamed", manifest("imu.csv", "imv.csv"), 3, r"is imu\.csv meant\?"),
    ("imu_is_folder", both(without(IMU), lambda d: (d / IMU).mkdir()), 3, r"which is no file"),
    ("gyro_in_deg", cells(IMU, "gx gy gz", times(57.29578)), 3, r'write gyro_unit = "deg/s"'),
    ("accel_in_g", cells(IMU, "ax ay az", times(1 / 9.80665)), 3, r'write accel_unit = "g"'),
    ("stamps_in_ms", cells(IMU, "t_ns", lambda t: t[:-6]), 3, r"look like milliseconds"),
    ("stamps_in_us", cells(IMU, "t_ns", lambda t: t[:-3]), 3, r"look like microseconds"),
    ("accel_dead", cells(IMU, "ax ay az", lambda value: "5.6"), 3, r"ax never changes"),
    ("no_overlap", cells(IMU, "t_ns", later(3600)), 3, r"do not overlap in time: IMU 20"),
    (
        "imu_18_s_late",
        cells(IMU, "t_ns", later(18)),
        3,
        r"IMU stamps read \+17\.\d s against.*18 leap",
    ),
    ("arrival_steps", rows(ARRIVAL, second_half_later(5)), 3, r"arrival times jump by \+5\.0"),
    ("optics_wrong", manifest("639.5]", "6.395]"), 3, r"belongs to another resolution"),
    ("toml_key", manifest("lever_arm_m", "lever_arm"), 2, r"did you mean lever_arm_m\?"),
    ("toml_section", manifest("[gnss]", "[gps]"), 2, r"did you mean gnss\?"),
    ("toml_syntax", manifest("[imu]", "[imu"), 2, r"not valid TOML"),
    ("toml_empty", content("drive.toml", b""), 2, r'add schema = "automap\.drive/1"'),
    ("toml_latin1", content("drive.toml", b'name = "\xfc"'), 2, r"byte 8 is not UTF-8"),
    ("toml_absent", without("drive.toml"), 3, r"drive\.toml is missing"),
    ("folder_empty", lambda d: (shutil.rmtree(d), d.mkdir())[0], 3, r"drive\.toml is missing"),
    ("folder_absent", shutil.rmtree, 3, r"no such drive folder"),
    ("trajectory_header", finished_trajectory("t_ns,latt,lon_deg,z"), 3, r"no column lat_deg"),
    ("bearings_header", bearings(THREE_BEARINGS.replace("g_d", "gd")), 3, r"no column bearing_deg"),
    ("bearings_empty", bearings(""), 3, r"bearings\.csv is empty"),
]
# two thirds each time
FAILING = [case for start in (1, 2, 0) for case in FAILURES[start::3]]


SURVIVED: list[tuple[str, Break, str, str]] = [
    ("imu_empty", content(IMU, b""), "fuse", r"imu\.csv is empty.*without it[^$]*GPS track alone"),
    ("imu_header", rows(IMU, lambda x: x[:1]), "fuse", r"not one usable row[^$]*GPS track alone"),
    ("imu_noise", noise(IMU), "sync", r"imu\.csv is not text"),
    ("imu_column_gone", rows(IMU, lambda x: [r.rsplit(",", 1)[0] for r in x]), "sync", "column az"),
    (
        "imu_absent",
        without(IMU, "imu.csv"),
        "fuse",
        r"no IMU recording: .*smoothed GPS track alone",
    ),
    ("imu_cut", cut(IMU), "sync", r"1 row was left out as unreadable, the first in line \d+"),
    ("imu_nan", rows(IMU, lambda x: [*x[:9], x[9] + "nan", *x[10:]]), "ingest", r"line 10"),
    ("imu_twice", rows(IMU, lambda x: [x[0], *sorted(x[1:] * 2)]), "sync", r"1500 rows"),
    ("gnss_cut", cut(GNSS), "sync", r"ends inside the sentence \$GN... at byte \d+"),
    ("gnss_some_checksums", wrong_checksums(5), "sync", r"12 NMEA messages have a wrong checksum"),
    ("gnss_old_week", sentences(lambda f: week_back(f)), "sync", r"moved on by 1024 weeks"),
    ("arrival_empty", content(ARRIVAL, b""), "sync", r"arrival\.csv is empty; .* goes on without"),
    ("arrival_header", rows(ARRIVAL, lambda x: x[:1]), "sync", r"not one usable row"),
    ("arrival_alien", cells(ARRIVAL, "offset", later(1)), "sync", r"belong to none of the epochs"),
    ("arrival_misnamed", manifest("_arrival.csv", "_arival.csv"), "sync", r"arrival\.csv meant\?"),
    ("boxes_empty", content(BOXES, b""), "detect", r"detections\.csv is empty"),
    ("boxes_of_other_frames", cells(BOXES, "frame", times(99)), "detect", r"without a stamp"),
    ("frames_empty", content(FRAMES, b""), "detect", r"front_frames\.csv is empty"),
    ("frames_of_another_day", cells(FRAMES, "t_ns", later(86400)), "geolocate", r"clock of the fr"),
    ("video_absent", without("video"), "detect", r"neither a readable video nor detections"),
    ("trajectory_only", finished_trajectory(), "report", r"no way to GPS time"),
    ("trajectory_nan", both(finished_trajectory(), NAN_IN_TRAJECTORY), "fuse", r"1 rows? without"),
    ("bearings_only", bearings(THREE_BEARINGS), "report", r"1 signs from 3 sightings"),
    (
        "bearings_some",
        bearings(THREE_BEARINGS + "x,y,z\n"),
        "report",
        r"line 5, column lat_deg: 'x'",
    ),
]
# every second each time
SURVIVING = [*SURVIVED[::2], *SURVIVED[1::2]]


def week_back(fields: list[str]) -> list[str]:
    """The date that a receiver gives whose ten-bit week has overflowed once more."""
    if fields[0].endswith("RMC"):
        fields[9] = "150904"
    return fields


@pytest.mark.parametrize(
    ("change", "code", "said"),
    others_slow([case[1:] for case in FAILING], len(FAILING) - len(FAILING[::3])),
    ids=[case[0] for case in FAILING],
)
def test_a_drive_that_cannot_be_used_is_one_sentence(
    drive: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Break,
    code: int,
    said: str,
) -> None:
    change(drive)
    out = tmp_path / "out"
    told = tell(capsys, "run", drive, "-o", out)
    assert told.code == code
    assert re.fullmatch(r"error: [^\n]+\n", told.err)
    assert re.search(said, told.err)
    assert str(drive) in told.err or "receiver" in told.err or "arrival" in told.err
    assert_nothing_half_written(out)
    checked = tell(capsys, "check", drive)
    assert checked.code == 3
    assert "not usable" in checked.out


@pytest.mark.parametrize(
    ("change", "last", "said"),
    others_slow([case[1:] for case in SURVIVING], len(SURVIVING[::2])),
    ids=[case[0] for case in SURVIVING],
)
def test_a_drive_with_something_missing_gives_the_best_of_the_rest(
    drive: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Break,
    last: str,
    said: str,
) -> None:
    change(drive)
    out = tmp_path / "out"
    told = tell(capsys, "run", drive, "-o", out, "--to", last)
    assert told.err == ""
    assert told.code == 0
    assert re.search(said, told.out)
    assert_nothing_half_written(out)


def test_one_bad_drive_does_not_stop_the_other(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = Path(shutil.copytree(drive, tmp_path / "bad"))
    content(GNSS, b"")(bad)
    told = tell(capsys, "run", bad, drive, "-o", tmp_path / "out", "--to", "sync")
    assert told.code == 3
    assert "bad/gnss.nmea is empty" in told.err
    assert (tmp_path / "out" / "trip" / names.SYNC).is_file()


def test_an_output_folder_that_is_a_file(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (drive / names.DEFAULT_OUT).write_text("")
    told = tell(capsys, "run", drive)
    assert told.code == 4
    assert "a file of that name is in the way" in told.err
    (tmp_path / "file").write_text("")
    told = tell(capsys, "run", drive, "-o", tmp_path / "file" / "out")
    assert told.code == 4
    assert "is a file, not a folder" in told.err


@pytest.mark.parametrize("write", others_slow(range(8)))
def test_a_disk_that_fills_up_leaves_whole_files_and_the_next_run_goes_on(
    drive: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    write: int,
) -> None:
    out, left, fsync = tmp_path / "out", [write], os.fsync

    def full(handle: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(atomic.os, "fsync", full)
        told = tell(capsys, "run", drive, "-o", out, "--to", "sync")
    assert told.code == 4
    assert re.fullmatch(r"error: cannot write [^\n]+: the disk is full; [^\n]+\n", told.err)
    assert [path.name for path in out.rglob("*") if ".tmp" in path.name] == []
    told = tell(capsys, "run", drive, "-o", out, "--to", "sync")
    assert (told.code, told.err) == (0, "")
    assert_nothing_half_written(out)


@pytest.mark.slow
@pytest.mark.parametrize("base", others_slow(["gps_ns", "unix_ns"]))
def test_frames_of_another_clock_are_brought_to_that_of_the_trajectory(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], base: str
) -> None:
    def stamps(out: Path) -> np.ndarray:
        told = tell(capsys, "run", drive, "-o", out, "--to", "geolocate")
        assert told.code == 0
        table = read_table(out / names.OBSERVATIONS, ("t_ns", "frame"))
        return np.asarray(table["t_ns"].to_numpy())

    expected = stamps(tmp_path / "first")
    assert len(expected) == 10
    clock = json.loads((tmp_path / "first" / names.SYNC).read_text())

    def convert(cell: str) -> str:
        gps_s = clock["ref_gps_s"] + (int(cell) - clock["ref_ns"]) * 1e-9
        return str(round((gps_s if base == "gps_ns" else float(gps_to_unix(gps_s))) * 1e9))

    both(
        cells(FRAMES, "t_ns", convert),
        manifest("[video.front]", f'[video.front]\ntime = "{base}"'),
    )(drive)
    np.testing.assert_allclose(stamps(tmp_path / "second"), expected, atol=2e6)


def test_frames_whose_clock_nothing_ties_to_the_trajectory_are_refused(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both(
        without(IMU, "imu.csv"),
        without(ARRIVAL, "arrival"),
    )(drive)
    told = tell(capsys, "run", drive, "-o", tmp_path / "out", "--to", "geolocate")
    assert told.code == 0
    assert "[video.front]: the 10 detections of this camera cannot be placed" in told.out
    checked = tell(capsys, "check", drive)
    assert "have nothing in common" in " ".join(checked.out.split())


def test_a_recording_that_may_not_be_read_is_bad_input(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (drive / IMU).chmod(0)
    if os.access(drive / IMU, os.R_OK):
        pytest.skip("this user may read every file")
    told = tell(capsys, "run", drive, "-o", tmp_path / "out")
    assert told.code == 3
    assert "imu.csv: cannot be read" in told.err
    assert tell(capsys, "check", drive).code == 3
