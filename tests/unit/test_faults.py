"""Faults in whole commands: some of what the long run puts in; the judge sees what is wrong."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from tests.faults.child import Ended
from tests.faults.commands import undated
from tests.faults.judge import unsynced, wrong_end, wrong_files
from tests.faults.shim import environment

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc to build the failing calls with")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the failing calls are Linux's")
@pytest.mark.slow
def test_faults_in_an_export_leave_the_old_file_or_the_new_one() -> None:
    # kinds that begin otherwise: those the long run still finds wrong are among the others
    words = ["--only", "export gpx", "--kind", "[!rsn]*", "--count", "5", "--seed", "3"]
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.run", *words],
        cwd=ROOT, env=environment(), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| all | 5 | 5 |" in done.stdout


def ended(code: int, err: str = "", hung: bool = False) -> Ended:
    return Ended(code, "", err, 1.0, 100.0, hung)


@pytest.mark.parametrize(
    ("end", "killed", "wrong"),
    [
        (ended(0), False, False),
        (ended(4, "error: the disk is full.\n"), False, False),
        (ended(-9), True, False),
        (ended(-9), False, True),
        (ended(1, "error: x\n"), False, True),
        (ended(4), False, True),
        (ended(4, "Traceback (most recent call last)\n"), False, True),
        (ended(0, "warning: x\n" * 9), False, True),
        (ended(0, hung=True), False, True),
    ],
)
def test_the_judge_of_an_end(end: Ended, killed: bool, wrong: bool) -> None:
    assert bool(wrong_end(end, killed)) == wrong


def test_the_judge_of_files(tmp_path: Path) -> None:
    (tmp_path / "map").write_bytes(b"new")
    (tmp_path / "run.json").write_bytes(b"{}")
    judged = (tmp_path, {"map": b"old"}, {"map": b"new"}, frozenset({"run.json"}))
    assert wrong_files(*judged, dead=False) == ""
    (tmp_path / "run.json").write_bytes(b"{")
    assert "half written" in wrong_files(*judged, dead=False)
    (tmp_path / "run.json").unlink()
    (tmp_path / "map").write_bytes(b"ne")
    assert "neither" in wrong_files(*judged, dead=False)
    (tmp_path / "map").unlink()
    (tmp_path / ".map.1.tmp").touch()
    assert "left behind" in wrong_files(*judged, dead=False)
    assert wrong_files(*judged, dead=True) == ""


def test_the_judge_of_a_geopackage_goes_by_its_rows(tmp_path: Path) -> None:
    path = tmp_path / "map.gpkg"
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE signs (name TEXT)")
        db.executemany("INSERT INTO signs VALUES (?)", [("a",), ("b",)])
        db.commit()
        whole, raw = undated(path), path.read_bytes()
        # other pages with the same rows
        db.execute("CREATE TABLE gone (x)")
        db.execute("DROP TABLE gone")
        db.commit()
        assert path.read_bytes() != raw
        assert undated(path) == whole
        db.execute("DELETE FROM signs WHERE name = 'b'")
        db.commit()
    assert undated(path) != whole
    path.write_bytes(raw[:-100])
    assert undated(path) == raw[:-100]


@pytest.mark.parametrize(
    ("log", "names"),
    [
        ("w /o/.a.tmp; s /o/.a.tmp; r /o/.a.tmp /o/a; s /o", []),
        ("w /o/.a.tmp; r /o/.a.tmp /o/a; s /o", ["/o/a"]),
        ("s /o/.a.tmp; w /o/.a.tmp; r /o/.a.tmp /o/a; s /o", ["/o/a"]),
        ("w /o/.a.tmp; s /o/.a.tmp; r /o/.a.tmp /o/a", ["the name of /o/a"]),
    ],
)
def test_the_judge_of_a_loss_of_power(log: str, names: list[str]) -> None:
    rows = [line.split() for line in log.split("; ")]
    assert unsynced("\n".join("\t".join([*row, "", ""][:3]) for row in rows)) == names
