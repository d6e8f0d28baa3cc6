"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import platform
import re
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from automap.errors import StageError

_ADVICE = {
    errno.ENOSPC: "the disk is full; free some space or choose another output folder",
    errno.EDQUOT: "the disk quota is used up; free some space or choose another output folder",
    errno.EROFS: "the file system is read-only; choose another output folder or work on a copy",
    errno.EACCES: "no permission to write there; choose another output folder or work on a copy",
    errno.EPERM: "no permission to write there; choose another output folder or work on a copy",
    errno.EISDIR: "a folder of that name is in the way; remove it",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another output folder",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter output folder",
}

_TEMPORARY = re.compile(r"\..+\.(?:([0-9a-f]{8})-)?(\d+)\.tmp(\.[^.]*?)?(-journal)?")
_MACHINE = f"{zlib.crc32(os.fsencode(platform.node())):08x}"
"""On a share others' processes have the same numbers, and theirs are not seen here."""
_tidied: set[Path] = set()


def write_failure(path: Path, error: OSError) -> StageError:
    """The sentence for a failed write: the file, what happened, what to do."""
    reason = _ADVICE.get(error.errno or 0, error.strerror or str(error))
    return StageError(f"cannot write {path}: {reason}.")


def make_folder(path: Path) -> Path:
    """Create a folder with its parents; StageError in one sentence when that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise StageError(f"cannot write {path}: a file of that name is in the way.") from None
    except OSError as error:
        raise write_failure(path, error) from error
    return path


@contextmanager
def scratch_file(folder: Path) -> Iterator[IO[bytes]]:
    """A file without a name in ``folder``, gone when the block ends.

    Raises StageError where it cannot be written: what it holds has no other place.
    """
    from tempfile import TemporaryFile

    try:
        with TemporaryFile(dir=folder) as file:
            yield file
    except OSError as error:
        # that of a file with a name says which
        if error.filename is not None:
            raise
        raise write_failure(folder, error) from error


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; on success it replaces ``path`` in one step.

    The temporary file is synced before it is renamed, so that a crash leaves the old file or
    the new one. On any exception, an interrupt included, the temporary file is removed.
    Raises StageError for a disk that is full, a folder that is read-only and the like.
    """
    path = Path(path)
    # the suffix is kept because some writers choose their format by it
    temporary = path.with_name(f".{path.stem}.{_MACHINE}-{os.getpid()}.tmp{path.suffix}")
    make_folder(path.parent)
    if path.exists() and not (path.is_file() or path.is_dir()):
        # a device such as /dev/stdout would be renamed away, by a user who may
        raise StageError(f"cannot write {path}: it is no plain file; choose another name.")
    if not os.access(path.parent, os.W_OK):
        # told here, as libraries that write a file themselves each say it in their own way
        raise write_failure(path, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
    _remove_abandoned(path.parent)
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        put_in_place(temporary, path)
    except OSError as error:
        _discard(temporary)
        told = (getattr(error, name, None) for name in ("filename", "filename2"))
        # a copy names both files
        named = [Path(os.fsdecode(name)) for name in told if name is not None]
        # a failed read inside the block is not ours to reword
        if named and temporary not in named:
            raise
        raise write_failure(path, error) from error
    except BaseException:
        _discard(temporary)
        raise


def put_in_place(source: Path, target: Path) -> None:
    """Rename a file over another, so that the name outlasts a loss of power too; OSError."""
    os.replace(source, target)
    # the name stands in the folder, which is a file of its own; not every file system syncs one
    with suppress(OSError):
        handle = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def is_temporary(path: Path) -> bool:
    """Whether a file is one that ``atomic_path`` made and a killed process left behind."""
    return _TEMPORARY.fullmatch(path.name) is not None


def _discard(path: Path) -> None:
    """Remove a temporary file, and the journal that a database keeps beside it."""
    for name in (path, Path(f"{path}-journal")):
        with suppress(OSError):
            name.unlink()


def _remove_abandoned(folder: Path) -> None:
    """Remove what processes of this machine that were killed left in a folder, once a process."""
    if folder in _tidied:
        return
    _tidied.add(folder)
    with suppress(OSError):
        for name in os.listdir(folder):
            found = _TEMPORARY.fullmatch(name)
            here = found is not None and found[1] in (None, _MACHINE)
            if found is not None and here and not _is_alive(int(found[2])):
                _discard(folder / name)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        # somebody else's
        return True
    return True


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def write_bytes(path: Path, data: bytes) -> None:
    """Write bytes atomically."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def write_chunks(path: Path, chunks: Iterable[bytes | memoryview]) -> None:
    """Write bytes that come in parts atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        for chunk in chunks:
            stream.write(chunk)


def write_json(path: Path, value: Any) -> None:
    """Write JSON atomically; arrays become lists, NaN and infinities null (JSON has neither)."""
    write_text(path, json.dumps(plain(value), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """The same value in JSON's own types."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value
