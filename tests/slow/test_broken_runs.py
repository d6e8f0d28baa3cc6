"""Runs that are stopped, and places that cannot be written: the command as its own process."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from automap.io import names
from pipeline.run.registry import ORDER
from tests.unit.broken_drive import write_short_drive

pytestmark = pytest.mark.slow

_DROP_BOUND = 24  # prctl's PR_CAPBSET_DROP
_OVERRIDES = (1, 2)  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_short_drive(tmp_path_factory.mktemp("drives") / "trip")


# the stage has written its files, and they are not in their place yet
_HELD = """
import pathlib, sys, time
from pipeline.run import execute
whole, held, ready = execute._call, sys.argv.pop(1), pathlib.Path(sys.argv.pop(1))
def call(stage, context):
    whole(stage, context)
    if stage.name == held:
        ready.touch()
        time.sleep(60)
execute._call = call
"""
_MAIN = "from pipeline.cli import main; main()"


def start(*words: object, as_user: bool = False, before: str = "") -> subprocess.Popen[str]:
    """The command in a process group of its own; ``as_user``: bound by rights even as root."""
    return subprocess.Popen(
        [sys.executable, "-c", before + _MAIN, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=Path(__file__).parents[2],
        preexec_fn=_as_user if as_user else _as_started_by_hand,
    )


def _as_started_by_hand() -> None:
    # a background job ignores interrupts, and what it starts does too
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _as_user() -> None:
    _as_started_by_hand()
    for capability in _OVERRIDES:
        ctypes.CDLL(None).prctl(_DROP_BOUND, capability, 0, 0, 0)


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=300)
    assert "Traceback" not in out + err
    assert "unexpectedly" not in out + err
    return process.returncode, out, err


def wait_for(seen: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + 120
    while process.poll() is None and not seen() and time.monotonic() < end:
        time.sleep(0.01)


def temporaries(out: Path) -> list[str]:
    return [path.name for path in out.rglob("*") if ".tmp" in path.name]


def states(out: Path) -> dict[str, str]:
    record = json.loads((out / names.RUN).read_text())
    return {name: stage["status"] for name, stage in record["stages"].items()}


@pytest.mark.parametrize("stage", ORDER)
def test_an_interrupt_leaves_nothing_half_written_and_the_next_run_resumes(
    drive: Path, tmp_path: Path, stage: str
) -> None:
    out, ready = tmp_path / "out", tmp_path / "ready"
    process = start(stage, ready, "run", drive, "-o", out, before=_HELD)
    wait_for(ready.exists, process)
    os.killpg(process.pid, signal.SIGINT)
    code, _, err = finish(process)
    before = ORDER[: ORDER.index(stage)]
    assert (code, err.strip()) == (130, "interrupted; the same command resumes")
    assert temporaries(out) == []
    assert states(out) == {**dict.fromkeys(before, "done"), stage: "interrupted"}
    code, text, _ = finish(start("run", drive, "-o", out))
    assert code == 0
    kept = [line.split()[0] for line in text.splitlines() if " kept " in line]
    assert kept == list(before)
    assert states(out) == dict.fromkeys(ORDER, "done")


def test_what_a_killed_run_left_is_removed(drive: Path, tmp_path: Path) -> None:
    out, ready = tmp_path / "out", tmp_path / "ready"
    process = start("fuse", ready, "run", drive, "-o", out, before=_HELD)
    wait_for(ready.exists, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert temporaries(out) == ["fuse.tmp"]
    (out / ".run.77.tmp.json").write_text("{")
    code, _, _ = finish(start("run", drive, "-o", out))
    assert code == 0
    assert temporaries(out) == []
    assert states(out) == dict.fromkeys(ORDER, "done")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Mounts a file system in memory with the options given; skips where that is not allowed."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(options: str) -> Path:
        words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
        try:
            done = subprocess.run(words, capture_output=True, check=False)
        except FileNotFoundError:
            pytest.skip("there is no mount command")
        if done.returncode:
            pytest.skip("this user may not mount a small file system")
        return place

    yield mount
    if place.is_mount():
        subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("size", ["64k", "200k", "900k"])
def test_a_full_disk_is_said_and_the_next_run_goes_on(
    drive: Path, small_disk: Callable[[str], Path], size: str
) -> None:
    disk = small_disk(f"size={size}")
    code, _, err = finish(start("run", drive, "-o", disk / "out"))
    assert code == 4
    assert err.count("\n") == 1
    assert "the disk is full; free some space" in err
    assert temporaries(disk / "out") == []
    small_disk("remount,size=60m")
    code, _, _ = finish(start("run", drive, "-o", disk / "out"))
    assert code == 0
    assert states(disk / "out") == dict.fromkeys(ORDER, "done")


def test_a_read_only_disk_is_said(drive: Path, small_disk: Callable[[str], Path]) -> None:
    disk = small_disk("size=1m")
    small_disk("remount,ro")
    code, _, err = finish(start("run", drive, "-o", disk / "out"))
    assert code == 4
    assert "the file system is read-only; choose another output folder" in err


def test_a_folder_without_the_right_to_write_is_said(drive: Path, tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    code, _, err = finish(start("run", drive, "-o", tmp_path / "out", as_user=True))
    tmp_path.chmod(0o755)
    assert code == 4
    assert "no permission to write there; choose another output folder" in err


@pytest.mark.parametrize("name", ["imu.csv", "gnss.nmea", "drive.toml"])
def test_a_file_without_the_right_to_read_is_bad_input(tmp_path: Path, name: str) -> None:
    broken = write_short_drive(tmp_path / "trip")
    (broken / name).chmod(0)
    code, _, err = finish(start("run", broken, as_user=True))
    assert code == 3
    assert f"{name}" in err
    assert "Permission denied" in err
    assert finish(start("check", broken, as_user=True))[0] == 3
