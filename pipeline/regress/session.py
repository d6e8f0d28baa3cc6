"""A comparison of drives with their stored figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from automap.errors import AutoMapError, ConfigError, StageError
from automap.io import names
from automap.regression.change import Change, Tolerance
from automap.regression.record import DriveRecord, compare, slower_stages
from pipeline.regress.measure import (
    Measured,
    Task,
    read_record,
    read_trajectory_of,
    run_tasks,
)
from pipeline.settings.load import Settings

_TIMED_AGAIN = 2
"""A stage that seems slower is run so many times more; the fastest counts."""

WORK_FOLDER = "_regress"


@dataclass(frozen=True)
class DriveResult:
    """What became of a drive: ``now`` is None after a failure, ``then`` without stored
    figures; ``changes`` has every figure that both have."""

    name: str
    drive: Path
    out: Path
    exit_code: int = 0
    error: str = ""
    then: DriveRecord | None = None
    now: DriveRecord | None = None
    changes: tuple[Change, ...] = field(default_factory=tuple)

    @property
    def moved(self) -> list[Change]:
        """The figures that moved by more than is allowed."""
        return [change for change in self.changes if change.moved]

    @property
    def verdict(self) -> str:
        """One word or two for the drive."""
        if self.now is None:
            return "failed"
        if self.then is None:
            return "no stored figures"
        return "moved" if self.moved else "same"


def drive_names(drives: Sequence[Path]) -> list[str]:
    """The name of each drive, that of its folder; ConfigError when two have the same."""
    found: list[str] = []
    for drive in drives:
        folder = drive.resolve()
        name = folder.parent.name if folder.name == names.MANIFEST else folder.name
        if name in found:
            raise ConfigError(
                f"{drive}: a drive called {name} is given already; a drive's stored figures go "
                "by the name of its folder, so rename one of them."
            )
        found.append(name)
    return found


def run_session(
    drives: Sequence[Path],
    stored: dict[str, DriveRecord],
    work: Path,
    settings: Settings,
    jobs: int = 1,
    allowed: Tolerance | None = None,
    log: Callable[[str], None] = lambda text: None,
) -> list[DriveResult]:
    """Run the drives afresh into ``work`` and compare each with its stored figures.

    ``log`` hears in one line what is being done. A drive that fails has its sentence and exit
    code in its result and does not stop the others.
    """
    allowed = allowed or Tolerance()
    called = drive_names(drives)
    tasks = [
        Task(_folder(drive), work / name, settings)
        for drive, name in zip(drives, called, strict=True)
    ]
    log(f"running {len(tasks)} drive{'s' if len(tasks) != 1 else ''} into {work}")
    measured = run_tasks(tasks, jobs)
    timings = [dict(m.timing) for m in measured]
    for _ in range(_TIMED_AGAIN):
        again = _to_time_again(tasks, called, measured, timings, stored, allowed)
        if not again:
            break
        for index, repeated in _repeat(again, tasks, log):
            for stage, ratio in repeated.timing.items():
                timings[index][stage] = min(timings[index][stage], ratio)
    return [
        _result(name, task, m, timing, stored.get(name), allowed)
        for name, task, m, timing in zip(called, tasks, measured, timings, strict=True)
    ]


def _folder(drive: Path) -> Path:
    return drive.parent if drive.name == names.MANIFEST else drive


def _to_time_again(
    tasks: Sequence[Task],
    called: Sequence[str],
    measured: Sequence[Measured],
    timings: Sequence[dict[str, float]],
    stored: dict[str, DriveRecord],
    allowed: Tolerance,
) -> dict[int, list[str]]:
    """Stages by the drive's index that seem slower than stored."""
    again = {}
    for index, name in enumerate(called):
        then = stored.get(name)
        if then is not None and measured[index].exit_code == 0:
            slow = slower_stages(then.timing, timings[index], allowed)
            if slow:
                again[index] = slow
    return again


def _repeat(
    again: dict[int, list[str]], tasks: Sequence[Task], log: Callable[[str], None]
) -> list[tuple[int, Measured]]:
    """Time stages once more, one drive after the other so that nothing disturbs them."""
    repeats = []
    for index, stages in again.items():
        task = tasks[index]
        log(f"timing {', '.join(stages)} of {task.out.name} again")
        repeats.append(Task(task.drive, task.out, task.settings, tuple(stages)))
    return list(zip(again, run_tasks(repeats, 1), strict=True))


def _result(
    name: str,
    task: Task,
    measured: Measured,
    timing: dict[str, float],
    then: DriveRecord | None,
    allowed: Tolerance,
) -> DriveResult:
    if measured.exit_code != 0:
        return DriveResult(
            name, task.drive, task.out, measured.exit_code, measured.error, then=then
        )
    try:
        now = read_record(task, timing)
        trajectory = read_trajectory_of(task.out)
    except AutoMapError as error:
        return DriveResult(name, task.drive, task.out, error.exit_code, str(error), then=then)
    except (OSError, ValueError, KeyError) as error:
        failure = StageError(f"{task.out}: the results cannot be read ({error}); run again.")
        return DriveResult(name, task.drive, task.out, failure.exit_code, str(failure), then=then)
    changes = compare(then, now, trajectory, allowed) if then is not None else []
    code = 5 if any(change.moved for change in changes) else 0
    return DriveResult(name, task.drive, task.out, code, then=then, now=now, changes=tuple(changes))
