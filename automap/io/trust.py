"""What a folder may name: files inside it, and beyond it those that the user has allowed.

A drive comes from somebody else as often as not. What it names, in its manifest or by a link, is
read, and some of it stands in the results; so it must not be any file of the reader's.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from automap.errors import ConfigError
from automap.io import limits, names

VARIABLE = "AUTOMAP_ALLOW_OUTSIDE"
"""The environment's folders that the user allows, parted as those of PATH are; what a process
starts has them too."""


def allowed_folders() -> tuple[Path, ...]:
    """The folders outside any drive that the user allows, links followed."""
    named = os.environ.get(VARIABLE, "").split(os.pathsep)
    return tuple(Path(text).resolve() for text in named if text.strip())


@contextmanager
def allowing(folders: Iterable[Path]) -> Iterator[None]:
    """Allow folders besides those that are allowed already, as ``--allow-outside`` does."""
    before = os.environ.get(VARIABLE)
    named = [*([before] if before else []), *(str(folder.absolute()) for folder in folders)]
    if named:
        os.environ[VARIABLE] = os.pathsep.join(named)
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before


def leads_out(path: Path, folder: Path) -> bool:
    """Whether a path, links followed, lies neither in ``folder`` nor where the user allows."""
    try:
        real, inside = path.resolve(), folder.resolve()
    except (OSError, RuntimeError):
        # a loop of links, or a name that no file system takes: it leads nowhere
        return False
    return not any(real.is_relative_to(each) for each in (inside, *allowed_folders()))


def check_inside(path: Path, folder: Path, said: str) -> None:
    """ConfigError where a path leads out of ``folder``; ``said`` is what names it, as "drive.toml:
    imu.file"."""
    if leads_out(path, folder):
        inside = path.is_relative_to(folder) and ".." not in path.parts
        shown = str(path.relative_to(folder) if inside else path)
        shown = shown if len(shown) <= 2 * limits.SHOWN else f"{shown[: 2 * limits.SHOWN]}..."
        how = "leads out of the folder by a link" if inside else "is outside the folder"
        raise ConfigError(
            f"{said}: {shown} {how}; copy the file into the folder, or name the folder it is in "
            "with --allow-outside DIR if you trust who made this."
        )


def refuse_links_out(folder: Path) -> None:
    """ConfigError where a link below a folder leads out of it; results and what is hidden may be
    kept elsewhere, and nothing is asked of a single file."""
    for parent, folders, files in os.walk(folder):
        folders[:] = [n for n in folders if n != names.DEFAULT_OUT and not n.startswith(".")]
        for name in (*folders, *files):
            path = Path(parent) / name
            if path.is_symlink():
                check_inside(path, folder, str(folder))
