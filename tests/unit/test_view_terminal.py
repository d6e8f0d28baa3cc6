"""A run on the terminal and in a pipe, and its log."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from pipeline.cli.root import run_command
from pipeline.run import registry
from pipeline.run.runner import LOG_FILE
from pipeline.shared import terminal
from pipeline.shared.progress import StageLine
from tests.unit.fake_stages import doubler, make_drive, reader, teller


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(terminal, "time", clock)
    return clock


def test_in_a_pipe_a_long_stage_says_how_far_it_is(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = terminal.Terminal(7)
    shown.drive_started(Path("golf"), Path("out"))
    shown.stage_started("detect", "never ran")
    for _ in range(300):
        clock.now += 1.0
        shown.stage_progress("detect", (clock.now - 100) / 400, "frame")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "golf -> out"
    assert lines[1].split() == ["stage", "state", "time", "result", "(why", "it", "ran)"]
    assert len(lines) == 2 + 10
    assert lines[2].strip() == "detect      8% after 30 s, about 6 min 10 s left: frame".strip()
    assert lines[-1].strip().startswith("detect     75% after 5 min 00 s, about 1 min 40 s left")


def test_a_short_stage_says_nothing_until_it_is_done(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = terminal.Terminal(1)
    shown.stage_started("sync", "never ran")
    shown.stage_progress("sync", 0.0, "")
    assert capsys.readouterr().out == ""
    shown.stage_finished(StageLine("sync", "ran", "never ran", 1.25, "good to 1 ms", ("late",)))
    out = capsys.readouterr().out
    assert re.search(r"  sync      ran +1\.[23] s  good to 1 ms  \(never ran\)\n", out)
    assert "    warning: late\n" in out


def test_on_a_terminal_there_is_a_bar_with_the_time_left(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    shown = terminal.Terminal(7)
    shown.stage_started("fuse", "")
    shown.stage_progress("fuse", 0.1, "filter")
    assert shown._bar is None
    clock.now += 2.0
    shown.stage_progress("fuse", 0.5, "filter [1/2]")
    assert shown._bar is not None
    task = shown._bar.tasks[0]
    assert (task.description, task.completed, task.fields["note"]) == (
        "1/7 fuse",
        0.5,
        "filter [1/2]",
    )
    shown.stage_finished(StageLine("fuse", "ran", "", 2.0, "done"))
    assert shown._bar is None
    assert "fuse" in capsys.readouterr().out


def test_the_log_says_what_ran_with_what_and_how_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stages = [reader(), doubler(), teller()]
    monkeypatch.setattr(registry, "load_stages", lambda names: stages)
    drive = make_drive(tmp_path / "drive")
    out = tmp_path / "out"
    assert run_command(["run", str(drive), "-o", str(out), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    log = (out / LOG_FILE).read_text(encoding="utf-8")
    assert re.search(r"INFO pipeline\.run\.runner: .* with automap \S+, Python 3\.\d+\.\d+, ", log)
    assert re.search(r"stage ingest ran after \d+\.\d{3} s: 2 lines", log)
    assert re.search(r"done after \d+\.\d{3} s\n$", log)
