"""Several drives at once: the same as in turn, and no process takes the others with it."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from pipeline.run.batch import run_drives
from pipeline.run.runner import Request
from pipeline.run.stage import StageContext
from pipeline.shared.progress import Outcome, Reporter, StageLine
from tests.unit.fake_stages import doubler, make_drive, reader
from tests.unit.test_runner import request


class Told(Reporter):
    """Keeps what a reporter is told."""

    def __init__(self) -> None:
        self.drives: list[str] = []
        self.lines: list[str] = []

    def stage_finished(self, line: StageLine) -> None:
        self.lines.append(f"{line.name} {line.state} {line.result}")

    def drive_finished(self, outcome: Outcome) -> None:
        self.drives.append(outcome.drive.name)


def killed() -> Request:
    """A run in which the stage of the drive "doomed" is killed."""

    def run(context: StageContext) -> None:
        if context.drive.name == "doomed":
            os.kill(os.getpid(), signal.SIGKILL)

    return request([reader(), doubler(run)])


def slow(marks: Path) -> Request:
    """A run that lasts until it is told to end."""

    def run(context: StageContext) -> None:
        (marks / f"{context.drive.name}-{os.getpid()}").touch()
        time.sleep(120.0)

    return request([reader(), doubler(run)])


@pytest.mark.slow
def test_drives_at_once_give_what_drives_in_turn_do(tmp_path: Path) -> None:
    drives = [make_drive(tmp_path / name) for name in ("a", "b", "c")]
    drives.insert(1, tmp_path / "missing")
    alone, told = Told(), Told()
    first = run_drives(drives, tmp_path / "turn", request(), alone)
    second = run_drives(drives, tmp_path / "once", request(), told, 2, request)
    assert [o.exit_code for o in second] == [o.exit_code for o in first] == [0, 3, 0, 0]
    assert [str(o.error) for o in second] == [str(o.error) for o in first]
    assert sorted(told.drives) == sorted(alone.drives)
    assert sorted(told.lines) == sorted(alone.lines)
    for name in ("a", "b", "c"):
        for file in ("lines.txt", "double.txt"):
            once = (tmp_path / "once" / name / file).read_bytes()
            assert once == (tmp_path / "turn" / name / file).read_bytes()
    # a run again keeps all stages
    again = run_drives(drives, tmp_path / "once", request(), Reporter(), 3, request)
    assert {line.state for o in again for line in o.stages} == {"kept"}


def test_a_process_that_dies_takes_no_other_with_it(tmp_path: Path) -> None:
    drives = [make_drive(tmp_path / name) for name in ("doomed", "sound")]
    told = Told()
    bad, good = run_drives(drives, tmp_path / "maps", killed(), told, 2, killed)
    assert bad.exit_code == 4
    assert "doomed: its process was ended by signal 9, most likely for lack" in str(bad.error)
    assert good.exit_code == 0
    assert sorted(told.drives) == ["doomed", "sound"]
    # and the folder is not locked for good
    (again,) = run_drives(drives[:1], tmp_path / "maps" / "doomed", request(), Reporter())
    assert again.exit_code == 0


@pytest.mark.slow
def test_an_interrupt_ends_all_with_their_records(tmp_path: Path) -> None:
    drives = [make_drive(tmp_path / name) for name in ("a", "b", "c")]
    marks = tmp_path / "marks"
    marks.mkdir()
    make = partial(slow, marks)

    def interrupt() -> None:
        until = time.monotonic() + 60.0
        while len(list(marks.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        run_drives(drives, tmp_path / "maps", make(), Reporter(), 2, make)
    begun = sorted(mark.name for mark in marks.iterdir())
    assert [name[0] for name in begun] == ["a", "b"]
    for name in begun:
        with pytest.raises(ProcessLookupError):
            os.kill(int(name[2:]), 0)
    for name in ("a", "b"):
        record = json.loads((tmp_path / "maps" / name / "run.json").read_text())
        assert record["status"] == "interrupted"
    assert not (tmp_path / "maps" / "c").exists()
