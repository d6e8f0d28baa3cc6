"""Several drives in one command; one that fails does not stop the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from automap.errors import ConfigError
from automap.io import names
from pipeline.run import registry
from pipeline.run.processes import run_at_once
from pipeline.run.runner import Request, run_drive
from pipeline.settings.load import load_settings
from pipeline.shared.progress import Outcome, Reporter


def out_folders(drives: Sequence[Path], out: Path | None) -> list[Path]:
    """The output folder of each drive.

    Without ``out`` it lies inside the drive. With one drive ``out`` is the folder itself;
    with several it receives one folder per drive, named as the drive's folder and made
    unique by a number. Raises ConfigError when a drive is given twice.
    """
    resolved = [_folder(path) for path in drives]
    for index, path in enumerate(resolved):
        if path in resolved[:index]:
            raise ConfigError(f"{drives[index]} is given twice; leave out one of them")
    if out is None:
        return [
            (path.parent if path.name == names.MANIFEST else path) / names.DEFAULT_OUT
            for path in drives
        ]
    if len(drives) == 1:
        return [out]
    used: list[str] = []
    for path in resolved:
        name, number = path.name or "drive", 2
        while name in used:
            name, number = f"{path.name}-{number}", number + 1
        used.append(name)
    return [out / name for name in used]


def requested(
    config: Path | None,
    assignments: Sequence[str],
    stages: tuple[str | None, str | None, str | None],
    *,
    force: bool,
    dry_run: bool,
    command: Sequence[str],
) -> Request:
    """What a command asks for: settings as ``load_settings`` has them, ``stages`` the only, the
    first and the last one, as ``registry.select`` has them.

    Raises:
        ConfigError: settings or stages that do not exist.
    """
    selected = registry.select(*stages)
    return Request(
        stages=registry.load_stages(registry.ORDER),
        selected=selected,
        settings=load_settings(config, assignments),
        force=force,
        dry_run=dry_run,
        command=command,
    )


def run_drives(
    drives: Sequence[Path],
    out: Path | None,
    request: Request,
    reporter: Reporter,
    jobs: int = 1,
    make: Callable[[], Request] | None = None,
) -> list[Outcome]:
    """Run each drive and return what became of each: in turn, or ``jobs`` at a time where ``make``
    says the same in a process of its own."""
    folders = out_folders(drives, out)
    if make is not None and min(jobs, len(drives)) > 1:
        return run_at_once(list(zip(drives, folders, strict=True)), make, jobs, reporter)
    return [
        run_drive(drive, folder, request, reporter)
        for drive, folder in zip(drives, folders, strict=True)
    ]


def _folder(path: Path) -> Path:
    resolved = path.resolve()
    return resolved.parent if resolved.name == names.MANIFEST else resolved
