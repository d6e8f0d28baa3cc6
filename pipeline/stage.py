"""What a stage is: a function with declared inputs, outputs, settings and a version."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.config import Settings


@dataclass
class StageContext:
    """What a running stage sees.

    ``out`` holds what earlier stages wrote (read only); the stage writes into ``work`` and
    the runner moves the files to ``out`` when the stage has succeeded.
    """

    drive: Drive
    out: Path
    work: Path
    settings: Settings
    warnings: list[str] = field(default_factory=list)
    metrics: dict[str, Any] = field(default_factory=dict)
    progress: Callable[[float, str], None] = lambda fraction, text: None

    def warn(self, text: str) -> None:
        """Record one sentence for the user; it goes to the terminal, run.json and the report."""
        self.warnings.append(text)

    def metric(self, name: str, value: Any) -> None:
        """Record a figure (JSON-able) under ``metrics`` in run.json."""
        self.metrics[name] = value


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline.

    ``inputs`` lists the files of the drive that the stage reads, ``needs`` the files in OUT
    that earlier stages wrote (a missing one is passed over when ``optional``), ``outputs``
    the files in OUT it may write, ``settings`` the sections of the configuration it uses.
    ``version`` is raised by hand when the result changes for the same input.
    """

    name: str
    version: int
    run: Callable[[StageContext], None]
    inputs: Callable[[Drive], list[Path]]
    needs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: tuple[str, ...] = ()
