"""Several drives at once, each in a process of its own: one that dies takes no other with it."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from automap.errors import StageError
from pipeline.run.runner import Request, run_drive
from pipeline.shared.progress import Outcome, Reporter, StageLine

Event = tuple[str, tuple[Any, ...]]
"""A method of a reporter and what it is told."""
PATIENCE_S = 10.0
"""So long may a drive that is told to end bring its record up to date: it ends at the next step of
Python, and the longest of compiled code takes seconds."""


def run_at_once(
    work: Sequence[tuple[Path, Path]], make: Callable[[], Request], jobs: int, reporter: Reporter
) -> list[Outcome]:
    """Run drives to their output folders, ``jobs`` at a time; what became of each, in order.

    ``make`` says in each process what is to be done; ``reporter`` is told of a drive when it is
    done. An interrupt ends all, each with its record up to date.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(range(len(work)))
    running: dict[Connection, tuple[int, BaseProcess]] = {}
    done: dict[int, Outcome] = {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                number = waiting.pop(0)
                receiver, sender = context.Pipe(duplex=False)
                process: BaseProcess = context.Process(
                    target=_child, args=(sender, *work[number], make)
                )
                process.start()
                sender.close()
                running[receiver] = number, process
            for ready in wait(list(running)):
                assert isinstance(ready, Connection)
                number, process = running[ready]
                done[number], events = _received(ready, process, *work[number])
                del running[ready]
                for name, told in events:
                    getattr(reporter, name)(*told)
    finally:
        _end([process for _, process in running.values()])
    return [done[number] for number in range(len(work))]


class _Recorded(Reporter):
    """Keeps what a run tells, but for how far it is."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def drive_started(self, drive: Path, out: Path) -> None:
        self.events.append(("drive_started", (drive, out)))

    def stage_finished(self, line: StageLine) -> None:
        self.events.append(("stage_finished", (line,)))

    def note(self, text: str) -> None:
        self.events.append(("note", (text,)))

    def drive_finished(self, outcome: Outcome) -> None:
        self.events.append(("drive_finished", (outcome,)))


def _child(sender: Connection, drive: Path, out: Path, make: Callable[[], Request]) -> None:
    def end(number: int, frame: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise KeyboardInterrupt

    # an interrupt from the keyboard reaches all processes; the first one passes it on
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end)
    recorded = _Recorded()
    try:
        outcome = run_drive(drive, out, make(), recorded)
    except KeyboardInterrupt:
        sys.exit(130)
    # nobody is left to be told where the first process is gone
    with contextlib.suppress(OSError):
        sender.send((outcome, recorded.events))


def _received(
    receiver: Connection, process: BaseProcess, drive: Path, out: Path
) -> tuple[Outcome, list[Event]]:
    """What a process says of its drive, or that it has died."""
    try:
        outcome, events = receiver.recv()
    except EOFError:
        process.join()
        code = process.exitcode or 0
        how = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
        memory = ", most likely for lack of memory" if code == -signal.SIGKILL else ""
        error = StageError(
            f"{drive}: its process {how}{memory}, before the run was done; run it again, with "
            "fewer --jobs"
        )
        outcome = Outcome(drive, drive.resolve().name, out, error.exit_code, error)
        return outcome, [("drive_started", (drive, out)), ("drive_finished", (outcome,))]
    process.join()
    return outcome, events


def _end(processes: Iterable[BaseProcess]) -> None:
    every = list(processes)
    for process in every:
        process.terminate()
    for process in every:
        process.join(PATIENCE_S)
        if process.is_alive():
            process.kill()
            process.join()
