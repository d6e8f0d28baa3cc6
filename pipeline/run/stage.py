"""What a stage is: a function with declared inputs, outputs, settings and a version."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.settings.load import Settings


@dataclass
class StageContext:
    """What a running stage sees.

    ``out`` holds what earlier stages wrote (read only); the stage writes into ``work`` and
    the runner moves the files to ``out`` when the stage has succeeded. ``progress(fraction,
    text)`` may be called at any rate. ``result`` is one short line for the stage table, such
    as "14 signs, median radius 0.8 m".
    """

    drive: Drive
    out: Path
    work: Path
    settings: Settings
    warnings: list[str] = field(default_factory=list)
    metrics: dict[str, Any] = field(default_factory=dict)
    result: str = ""
    verdict: dict[str, Any] | None = None
    """Whether the path may be relied on, by the stage that makes it (``fusion.verdict``)."""
    signs_verdict: dict[str, Any] | None = None
    """Whether the signs may, by the stage that places them."""
    progress: Progress = lambda fraction, text: None

    def warn(self, text: str) -> None:
        """Record one sentence for the user; it goes to the terminal, run.json and the report."""
        self.warnings.append(text)

    def metric(self, name: str, value: Any) -> None:
        """Record a figure (JSON-able) under ``metrics`` in run.json."""
        self.metrics[name] = value


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline.

    ``inputs`` lists the files of the drive that the stage reads (those that do not exist are
    passed over), ``needs`` the files in OUT that earlier stages wrote, ``outputs`` the files
    in OUT it may write (a name that ends in "/" is a folder of files), ``settings`` the
    sections of the configuration it uses, ``setting_files`` the files that these name. A stage
    must do with a missing need when the drive has nothing to make it from: the runner only sees
    to it that the stage which would write it has run. ``run.json`` among the needs means
    that the stage shows what the earlier stages did, and runs after any of them.
    ``manifest`` names the sections of drive.toml the stage uses, None stands for all; a stage
    that is ``blind`` uses nothing of how cameras look and where they sit
    (``io.manifest.CAMERA_KEYS``).
    ``version`` is raised by hand when the result changes for the same input.

    The module of a stage is imported whenever a run looks whether the stage is up to date:
    imports that take long belong into the functions.
    """

    name: str
    version: int
    run: Callable[[StageContext], None]
    inputs: Callable[[Drive], list[Path]]
    needs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: tuple[str, ...] = ()
    setting_files: Callable[[Settings], list[Path]] = lambda settings: []
    manifest: tuple[str, ...] | None = None
    blind: bool = False
