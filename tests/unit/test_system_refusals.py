"""What the system refuses and what nobody means: names, numbers, files that are hardly there."""

from __future__ import annotations

import errno
import os
import platform
import shutil
import socket
import subprocess
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from export_inputs import write_run

from automap.errors import AutoMapError, ConfigError, InputError, StageError, of_system
from automap.fusion.passes import rate_of_turn
from automap.io import atomic
from automap.io.limits import MAX_MESSAGE
from automap.io.manifest import Manifest
from automap.records import ImuData
from pipeline.check.axes import usable_readings
from pipeline.cli.root import run_command
from pipeline.settings.load import load_settings
from pipeline.view.command import serving
from tests.unit.broken_drive import rows, write_short_drive

LONG = "n" * 300
PROJECT = Path(__file__).resolve().parents[2]


def told(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and stderr of a command; never a word of Python's."""
    capsys.readouterr()
    code = run_command(words)
    text = "".join(capsys.readouterr())
    assert "unexpectedly" not in text
    assert "Traceback" not in text
    assert len(text) < 5000
    return code, text


COMMANDS = [
    ["check", "IT"],
    ["run", "IT", "--to", "ingest"],
    ["export", "IT", "--format", "csv"],
    ["export", "OUT", "--format", "gpkg", "-o", "IT"],
    ["import", "sensor-logger", "IT", "-o", "NEW"],
    ["merge", "IT", "-o", "NEW"],
    ["merge", "OUT", "-o", "IT"],
    ["view", "IT", "--no-browser"],
    ["calibrate", "static", "IT", "-o", "NEW"],
    ["gap", "IT", "-o", "NEW"],
]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
@pytest.mark.parametrize("kind", ["loop of links", "long", "not UTF-8"])
def test_a_name_that_the_system_does_not_take(
    words: list[str], kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    it = tmp_path / {"long": LONG, "not UTF-8": "caf\udce9"}.get(kind, "loop")
    if kind == "loop of links":
        it.symlink_to(it)
    real = {"IT": str(it), "OUT": str(tmp_path), "NEW": str(tmp_path / "new")}
    code, text = told([real.get(word, word) for word in words], capsys)
    assert code in (2, 3, 4)
    assert text.count("error: ") == 1
    if kind == "not UTF-8":
        assert "is not UTF-8; rename it" in text


def test_a_file_of_a_drive_whose_name_is_not_utf8(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_short_drive(tmp_path / "trip")
    os.rename(drive / "imu.csv", os.fsencode(drive) + b"/imu\xfe.csv")
    for command in ("check", "run"):
        code, text = told([command, str(drive)], capsys)
        assert code == 2
        assert "imu\\udcfe.csv" in text


def test_a_message_is_no_book(capsys: pytest.CaptureFixture[str]) -> None:
    code, text = told(["run", "x", "--set", "a" * 100_000 + "=1"], capsys)
    assert code == 2
    assert len(text) < MAX_MESSAGE + 100


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (OSError(errno.EIO, "Input/output error", "/d/imu.csv"), StageError),
        (OSError(errno.ESTALE, "Stale file handle"), StageError),
        (PermissionError(errno.EACCES, "Permission denied", "/d"), InputError),
        (MemoryError(), StageError),
        (ImportError("a.so: failed to map segment from shared object"), StageError),
        (RuntimeError("Symlink loop from '/d'"), ConfigError),
        (OSError(errno.ELOOP, "Too many levels", "/d"), ConfigError),
    ],
)
def test_what_the_system_refuses_has_a_sentence(
    error: Exception, kind: type[AutoMapError], capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    assert type(of_system(error)) is kind
    assert of_system(ValueError("a mistake of ours")) is None

    def fail(*args: object) -> None:
        raise error

    monkeypatch.setattr("pipeline.check.command.check_drive", fail)
    code, text = told(["check", "x"], capsys)
    assert code == kind.exit_code
    assert text.startswith("error: ")


@pytest.mark.parametrize("arm", [1e9, -101.0])
def test_a_point_that_is_on_no_vehicle(arm: float) -> None:
    truck = {"schema": "automap.drive/1", "gnss": {"lever_arm_m": [-14.0, 0.0, -3.5]}}
    assert Manifest.model_validate(truck).gnss.lever_arm_m == (-14.0, 0.0, -3.5)
    for section in ("gnss", "video"):
        value = {"lever_arm_m": [arm, 0.0, 0.0]}
        with pytest.raises(ValueError, match="more than 100; correct it or its unit"):
            Manifest.model_validate(
                {
                    "schema": "automap.drive/1",
                    section: {"front": value} if section == "video" else value,
                }
            )


@pytest.mark.parametrize(
    "text", ["fuse.gyro_noise=1e300", "fuse.prior_sd={accel_bias={x=1e13}}", "export.datum=1e13"]
)
def test_a_setting_that_no_quantity_has(text: str) -> None:
    with pytest.raises(ConfigError):
        load_settings(None, [text])
    assert load_settings(None, ["fuse.gyro_noise=1e3"]).fuse.gyro_noise == 1e3


def test_the_largest_noise_is_told_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = write_short_drive(tmp_path / "trip")
    words = ["run", str(drive), "--to", "fuse", "--set", "fuse.gyro_noise=1e12"]
    code, text = told(words, capsys)
    assert code == 4
    assert "did not stay finite" in text


def test_ten_readings_make_a_path(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = write_short_drive(tmp_path / "trip")
    rows("imu.csv", lambda lines: lines[:11])(drive)
    assert told(["run", str(drive), "--to", "fuse"], capsys)[0] == 0


def test_a_turn_over_fewer_readings_than_its_window() -> None:
    t_ns = np.arange(4) * 10_000_000
    found = rate_of_turn(t_ns * 1e-9, np.tile([0.0, 0.0, 0.1], (4, 1)))
    # the same rate throughout is the gyro's bias
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_readings_that_all_stay_are_judged_as_they_are() -> None:
    n = 200
    t_ns = np.arange(n) * 10_000_000
    imu = ImuData(t_ns, np.full((n, 3), 0.1), np.tile([0.1, 0.2, 9.8], (n, 1)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(usable_readings(imu)) == n


def test_a_sigma_below_nothing_is_unknown(tmp_path: Path) -> None:
    from automap.io.receiver import read_receiver_log
    from tests.unit.receiver_messages import sentence

    body = "GNGGA,1200{i:02}.00,4807.0380,N,01131.0000,E,1,08,0.9,545.4,M,46.9,M,,"
    error = "GNGST,1200{i:02}.00,1.0,,,,{sd},2.0,{sd}"
    date = "GNRMC,1200{i:02}.00,A,4807.0380,N,01131.0000,E,022.4,084.4,230324,,,A"
    for sd, expected in (("-3.0", np.nan), ("3.0", 3.0)):
        log = b"".join(
            sentence(text.format(i=i, sd=sd)) for i in range(6) for text in (body, error, date)
        )
        path = tmp_path / "gnss.nmea"
        path.write_bytes(log)
        fixes = read_receiver_log(path).fixes
        np.testing.assert_array_equal(fixes.sd_pos_ned[:, 0], np.full(6, expected))
        np.testing.assert_array_equal(fixes.sd_pos_ned[:, 1], np.full(6, 2.0))


@pytest.mark.parametrize(
    "place", ["out/" + "n" * 300, "out/loop", "out/closed.txt", "out/report.html"]
)
def test_the_viewer_answers_whatever_the_disk_does(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = write_run(tmp_path / "out", signs=2, seconds=20.0)
    (out / "loop").symlink_to("loop")
    for name in ("closed.txt", "report.html"):
        (out / name).write_text("x")
    read = Path.read_bytes

    def broken(path: Path) -> bytes:
        if path.name in ("closed.txt", "report.html"):
            raise OSError(errno.EIO, "Input/output error", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", broken)
    with (
        serving(out) as server,
        socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as connection,
    ):
        head = f"GET /{server.token}/{place} HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}"
        connection.sendall(f"{head}\r\nConnection: close\r\n\r\n".encode())
        answer = b""
        while part := connection.recv(65536):
            answer += part
    assert answer.split()[1] in (b"404", b"500")
    assert server.token.encode() not in answer
    assert str(tmp_path).encode() not in answer


def test_a_full_disk_under_a_sheet_is_told_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from xlsxwriter.exceptions import FileCreateError
    from xlsxwriter.workbook import Workbook

    def close(book: Workbook) -> None:
        raise FileCreateError(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    monkeypatch.setattr(Workbook, "close", close)
    out = write_run(tmp_path / "out", signs=2, seconds=20.0)
    code, text = told(["export", str(out), "--format", "xlsx"], capsys)
    assert code == 4
    assert "the disk is full; free some space" in text


def test_a_record_that_the_disk_does_not_give_is_no_missing_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = write_run(tmp_path / "out", signs=2, seconds=20.0)
    read = Path.read_text

    def broken(path: Path, *args: object, **more: object) -> str:
        if path.name == "run.json":
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(path))
        return read(path, *args, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "read_text", broken)
    code, text = told(["export", str(out), "--format", "gpx"], capsys)
    assert code == 4
    assert "run.json: Input/output error" in text


def test_what_a_killed_merge_left_is_removed(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2, seconds=20.0)
    left = tmp_path / "map" / ".merge.x"
    left.mkdir(parents=True)
    (left / "signs.geojson").touch()
    assert run_command(["merge", str(out), "-o", str(tmp_path / "map"), "--quiet"]) == 0
    assert not left.exists()


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    gone = 4_194_300  # above the most that Linux gives
    for name in (f".map.{gone}.tmp.gpkg", f".map.{gone}.tmp.gpkg-journal", f".a.{gone}.tmp"):
        (tmp_path / name).touch()
    here = f"{zlib.crc32(platform.node().encode()):08x}"
    (tmp_path / f".b.{here}-{gone}.tmp.csv").touch()
    elsewhere = f".b.{'0' * 8}-{gone}.tmp.csv"
    alive = [f".map.{os.getpid()}.tmp.gpkg", ".map.tmp.gpkg", "map.1.tmp.gpkg", elsewhere]
    for name in alive:
        (tmp_path / name).touch()
    atomic.write_text(tmp_path / "new.txt", "x")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*alive, "new.txt"])
    # the folder is looked through once: a map may have ten thousand pictures
    (tmp_path / f".map.{gone}.tmp.gpkg").touch()
    atomic.write_text(tmp_path / "newer.txt", "x")
    assert (tmp_path / f".map.{gone}.tmp.gpkg").exists()


def test_a_database_that_fails_takes_its_journal_along(tmp_path: Path) -> None:
    def write() -> None:
        with atomic.atomic_path(tmp_path / "map.gpkg") as path:
            path.touch()
            Path(f"{path}-journal").touch()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert not list(tmp_path.iterdir())


def test_a_folder_that_was_removed_under_the_shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    shutil.rmtree(here)
    assert told(["--version"], capsys)[0] == 0


WITH_LITTLE_ROOM = """
import os, resource, sys
from pathlib import Path
from pipeline.cli import main

used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
room = used + (int(sys.argv[1]) << 20)
resource.setrlimit(resource.RLIMIT_AS, (room, room))
# of the processor: who asks for memory for ever does nothing else
resource.setrlimit(resource.RLIMIT_CPU, (30, 30))
main(["check", sys.argv[2]])
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="it needs Linux's /proc")
@pytest.mark.parametrize("room_mb", [48, 130, 200, 240])
def test_where_memory_is_short_a_command_ends_with_a_sentence(room_mb: int, tmp_path: Path) -> None:
    """Less than the libraries of linear algebra need, and about as much."""
    drive = write_short_drive(tmp_path / "drive")
    done = subprocess.run(
        [sys.executable, "-c", WITH_LITTLE_ROOM, str(room_mb), str(drive)],
        cwd=PROJECT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert done.stderr.startswith("error: the memory is used up; ")
    assert len(done.stderr.splitlines()) == 1
