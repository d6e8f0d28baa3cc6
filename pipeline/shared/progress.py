"""What a run tells whoever watches it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from automap.errors import AutoMapError

Progress = Callable[[float, str], None]
"""Told how far a long step is, 0 to 1, and what it does."""

State = Literal["ran", "kept", "would run", "failed", "interrupted"]


@dataclass(frozen=True)
class StageLine:
    """What became of one stage: ``reason`` says why it ran, ``result`` what came out."""

    name: str
    state: State
    reason: str = ""
    seconds: float | None = None
    result: str = ""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What became of one drive; ``record`` is the content of run.json."""

    drive: Path
    name: str
    out: Path
    exit_code: int
    error: AutoMapError | None = None
    stages: tuple[StageLine, ...] = ()
    record: dict[str, Any] = field(default_factory=dict)


class Reporter:
    """Receives the events of a run; as it stands it tells nobody."""

    def drive_started(self, drive: Path, out: Path) -> None:
        """A drive's turn has come."""

    def stage_started(self, name: str, reason: str) -> None:
        """A stage starts, for this reason."""

    def stage_progress(self, name: str, fraction: float, text: str) -> None:
        """The stage is this far (0 to 1), doing this."""

    def stage_finished(self, line: StageLine) -> None:
        """A stage has ended, was kept, or (dry run) was looked at."""

    def note(self, text: str) -> None:
        """One sentence about the run as a whole."""

    def drive_finished(self, outcome: Outcome) -> None:
        """The drive is done or has failed."""
