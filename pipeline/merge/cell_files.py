"""The files of a merge's steps: of each what it found, a digest of what it took, and a stamp of the
files that it took that from, by which it is left out without reading them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from automap import __version__
from automap.io.atomic import atomic_path
from automap.mapping.cells import quadkey
from pipeline.merge.cell_parts import parts
from pipeline.merge.cell_store import COVERED, PATHS

STEPS_VERSION = 22
"""Raised by hand when the steps give something else for the same input."""
FORMAT = f"{__version__} {STEPS_VERSION}"
"""What another version of the steps made is made again."""


def step_file(folder: Path, kind: str, cell: int) -> Path:
    """The file of a step for a cell."""
    return folder / kind / f"{quadkey(cell)}.npz"


def read_columns(path: Path) -> Mapping[str, Any]:
    """All that a step found."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def text_of(path: Path, name: str) -> str:
    """A text of a step's file; "" where it has none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return str(file[name])
    except (OSError, KeyError, ValueError, BadZipFile):
        # missing, damaged or of another version: it is made again
        return ""


def restamp(path: Path, stamp: str) -> bool:
    """Have a step's file say that it goes with other files too, which need not be read again then;
    False where it is damaged."""
    try:
        write_columns(path, **{**read_columns(path), "stamp": np.array(stamp)})
    except (OSError, ValueError, BadZipFile):
        return False
    return True


def stamp_of(files: Sequence[Path], before: Sequence[Path]) -> str:
    """Of the files of a cell and its neighbours by names and sizes, as parts are written once, and
    of the digests of the steps ``before``: where it is as it was, nothing need be read."""
    told = [f"{path.parent.name}/{path.name} {path.stat().st_size}" for path in files]
    told += [text_of(path, "digest") for path in before]
    return hashlib.sha256("\n".join([FORMAT, *told]).encode()).hexdigest()


def covered_file(folder: Path, cell: int) -> Path:
    """Where the coverage of a cell is kept."""
    return step_file(folder, COVERED, cell)


def path_stamp(folder: Path, cell: int) -> str:
    """Of the paths in a cell."""
    return stamp_of(parts(folder, PATHS, [cell]), [])


def is_done(path: Path, stamp: str) -> bool:
    """Whether a step wrote its file from what has this stamp."""
    return text_of(path, "stamp") == stamp


def write_columns(path: Path, **columns: Any) -> None:
    """Write what a step found."""
    with atomic_path(path) as temporary:
        np.savez(temporary, **columns)
