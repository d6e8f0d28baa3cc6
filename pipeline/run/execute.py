"""One stage at work: a folder of its own, then its files moved to their place."""

from __future__ import annotations

import errno
import logging
import shutil
from contextlib import suppress
from pathlib import Path

from automap.errors import AutoMapError, StageError, of_system
from automap.io.atomic import is_temporary, make_folder, put_in_place, write_failure
from pipeline.run.stage import Stage, StageContext
from pipeline.shared.freed import trim

log = logging.getLogger(__name__)

_WRITE_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


def work_folder(out: Path, stage: str) -> Path:
    """Where a stage writes until it has succeeded."""
    return out / f"{stage}.tmp"


def remove_leftovers(out: Path, stages: tuple[str, ...]) -> None:
    """Delete what a killed run left behind."""
    for name in stages:
        shutil.rmtree(work_folder(out, name), ignore_errors=True)
    for path in out.glob(".*.tmp*"):
        if is_temporary(path):
            with suppress(OSError):
                path.unlink()


def execute(stage: Stage, context: StageContext) -> list[str]:
    """Run the stage and put its files into OUT; returns their names.

    An output that the stage wrote in an earlier run and not in this one is removed. Raises
    AutoMapError with one sentence for every failure; the traceback goes to the log.
    """
    work = context.work
    shutil.rmtree(work, ignore_errors=True)
    try:
        # an interrupt may come as soon as it is there
        make_folder(work)
        _call(stage, context)
        if not work.is_dir():
            raise StageError(
                f"{work} was removed while stage {stage.name} wrote there; run the command again"
            )
        written = sorted(str(p.relative_to(work)) for p in work.rglob("*") if p.is_file())
        undeclared = [name for name in written if not _declared(name, stage)]
        if undeclared:
            raise StageError(
                f"stage {stage.name} wrote {', '.join(undeclared)}, which is not among its "
                "declared outputs; nothing of it was kept, please report this"
            )
        for name in written:
            _put(work / name, context.out / name)
        for name in stage.outputs:
            if name.endswith("/"):
                _remove_others(context.out / name, context.out, written)
            elif name not in written:
                (context.out / name).unlink(missing_ok=True)
        return written
    finally:
        _remove(work)


def _remove(work: Path) -> None:
    """Delete a work folder, also where an interrupt comes meanwhile."""
    try:
        shutil.rmtree(work, ignore_errors=True)
    except KeyboardInterrupt:
        shutil.rmtree(work, ignore_errors=True)
        raise


def _declared(name: str, stage: Stage) -> bool:
    folders = tuple(output for output in stage.outputs if output.endswith("/"))
    return name in stage.outputs or name.startswith(folders)


def _remove_others(folder: Path, out: Path, written: list[str]) -> None:
    """Delete the files of an output folder that this run did not write."""
    kept = set(written)
    if folder.is_symlink():
        return
    for path in folder.glob("*"):
        if path.is_file() and str(path.relative_to(out)) not in kept:
            path.unlink()
    with suppress(OSError):
        folder.rmdir()


def _call(stage: Stage, context: StageContext) -> None:
    # what the stage before has freed
    trim()
    try:
        stage.run(context)
    except AutoMapError:
        raise
    except MemoryError as error:
        log.exception("stage %s", stage.name)
        raise StageError(
            f"stage {stage.name} ran out of memory; close other programs or split the drive"
        ) from error
    except OSError as error:
        log.exception("stage %s", stage.name)
        if error.errno in _WRITE_ERRORS:
            raise write_failure(Path(error.filename or context.work), error) from error
        raise StageError(
            f"stage {stage.name}: {error.filename or 'a file'}: "
            f"{error.strerror or error}; check that it is there and can be read"
        ) from error
    except Exception as error:
        log.exception("stage %s", stage.name)
        raise of_system(error) or StageError(
            f"stage {stage.name} failed unexpectedly ({type(error).__name__}: {error}); run "
            f"with --debug for the traceback, which also stands in {context.out / 'automap.log'}"
        ) from error


def _put(source: Path, target: Path) -> None:
    make_folder(target.parent)
    try:
        put_in_place(source, target)
    except OSError as error:
        raise write_failure(target, error) from error
