"""A run on the terminal: one line per stage, progress for those that take long."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.shared.progress import Outcome, Progress, Reporter, StageLine
from pipeline.shared.summary import summary_lines

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

_COLOURS = {
    "ran": "green",
    "kept": "blue",
    "would run": "yellow",
    "failed": "red",
    "interrupted": "red",
}
_PATIENCE_S = 0.5
"""A stage shorter than this shows no progress bar."""
_LINE_EVERY_S = 30.0
"""Where there is no terminal, a long stage says at this interval how far it is."""


class Terminal(Reporter):
    """Prints the events of a run to stdout; ``stages`` is how many each drive has."""

    def __init__(self, stages: int = 0) -> None:
        self._bar: Bar | None = None
        self._task: TaskID | None = None
        self._started = 0.0
        self._told = 0.0
        self._stages = stages
        self._finished = 0

    def drive_started(self, drive: Path, out: Path) -> None:
        """Name the drive and where its results go, above the table of its stages."""
        self._finished = 0
        click.echo(f"{drive} -> {out}")
        if self._stages:
            heading = f"  {'stage':<10}{'state':<9} {'time':>9}  result (why it ran)"
            click.echo(click.style(heading, dim=True))

    def stage_started(self, name: str, reason: str) -> None:
        """Start the clock of the stage."""
        self._started = self._told = time.monotonic()

    def stage_progress(self, name: str, fraction: float, text: str) -> None:
        """Show the bar once the stage has taken a while; without a terminal a line at times."""
        if not sys.stdout.isatty():
            self._tell(name, fraction, text)
            return
        if self._bar is None:
            if time.monotonic() - self._started < _PATIENCE_S:
                return
            self._open(name)
        if self._bar is not None and self._task is not None:
            share = min(max(fraction, 0.0), 1.0)
            self._bar.update(self._task, completed=share, note=text)

    def stage_finished(self, line: StageLine) -> None:
        """Print the stage's line: state, time, result, why it ran, its warnings."""
        self.close()
        self._finished += 1
        state = click.style(f"{line.state:<9}", fg=_COLOURS[line.state])
        seconds = f"{line.seconds:7.1f} s" if line.seconds is not None else " " * 9
        reason = click.style(f"({line.reason})", dim=True) if line.reason else ""
        parts = [f"  {line.name:<10}{state} {seconds}", line.result, reason]
        click.echo("  ".join(part for part in parts if part).rstrip())
        for text in line.warnings:
            click.echo(click.style("    warning: ", fg="yellow") + text)

    def note(self, text: str) -> None:
        """Print a sentence about the run."""
        self.close()
        click.echo(click.style("  note: ", fg="yellow") + text)

    def drive_finished(self, outcome: Outcome) -> None:
        """Print the summary of a drive that is done."""
        self.close()
        for text in summary_lines(outcome):
            click.echo(text)

    def _tell(self, name: str, fraction: float, text: str) -> None:
        now = time.monotonic()
        if now - self._told < _LINE_EVERY_S:
            return
        self._told = now
        share = min(max(fraction, 0.0), 1.0)
        passed = now - self._started
        left = f", about {_duration(passed * (1 - share) / share)} left" if share > 0.01 else ""
        what = f": {text}" if text else ""
        click.echo(f"  {name:<10}{share:4.0%} after {_duration(passed)}{left}{what}")

    def _open(self, name: str) -> None:
        from rich.progress import (
            BarColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeRemainingColumn,
        )

        self._bar = Progress(
            TextColumn("  {task.description:<14}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("left"),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.fields[note]}", markup=False),
            transient=True,
        )
        self._bar.start()
        place = f"{self._finished + 1}/{self._stages} " if self._stages else ""
        self._task = self._bar.add_task(f"{place}{name}", total=1.0, note="")

    def close(self) -> None:
        """Take the progress bar away."""
        if self._bar is not None:
            self._bar.stop()
        self._bar = None
        self._task = None


def _duration(seconds: float) -> str:
    """A time for people: seconds, or minutes and seconds."""
    whole = round(seconds)
    return f"{whole} s" if whole < 90 else f"{whole // 60} min {whole % 60:02d} s"


@contextmanager
def progress_bar(name: str, told: bool = True) -> Iterator[Progress]:
    """The progress of one long piece of work: call what it yields with fraction and text. Nothing
    is told where nothing or something else belongs on stdout."""
    if not told:
        yield lambda fraction, text: None
        return
    terminal = Terminal()
    terminal.stage_started(name, "")
    try:
        yield lambda fraction, text: terminal.stage_progress(name, fraction, text)
    finally:
        terminal.close()
