"""The drive folder that an import writes: whole or not at all, with its lineage."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automap import __version__
from automap.errors import ConfigError, InputError, StageError
from automap.io import names
from automap.io.atomic import make_folder, put_in_place, write_failure, write_json, write_text
from automap.io.json_text import parse_json
from automap.io.toml_file import toml_value
from automap.io.trust import refuse_links_out

MARKS = ("# Made by automap import: ", "# Made by automap init")
LINEAGE = "import.json"
SCHEMA = "automap.import/1"
_DAMAGE = (ValueError, KeyError, IndexError, TypeError, struct.error, EOFError, OverflowError)
"""What reading bytes that are not what they should be can end in."""
_OF_WRITES = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""Nothing that is read meets these."""
_EARLIER = ("truth", "video", "can_speed.csv")
"""What imports wrote before they kept a list of it."""


@dataclass
class Import:
    """An import under way: ``folder`` receives the files, ``sources`` are those read and
    ``warnings`` what the user should know, one sentence each."""

    kind: str
    source: Path
    out: Path
    folder: Path
    sources: list[Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def warn(self, text: str) -> None:
        """Keep a sentence for the user."""
        if text not in self.warnings:
            self.warnings.append(text)

    def write_manifest(self, sections: str, notes: Sequence[str] = ()) -> None:
        """Write ``drive.toml``: where it is from, ``notes`` on the files, then ``sections``."""
        made = MARKS[1] if self.kind == "init" else MARKS[0] + self.kind
        head = [f"{made} from {_one_line(self.source.resolve().name)}", "#"]
        head += [f"# {note}".rstrip() for note in notes]
        name = toml_value(self.out.name)
        body = f'schema = "automap.drive/1"\nname = {name}\n\n{sections.strip()}\n'
        write_text(self.folder / names.MANIFEST, "\n".join(head) + "\n" + body)


@contextmanager
def new_drive(kind: str, source: Path, out: Path) -> Iterator[Import]:
    """A folder to fill; on success it becomes ``out`` with its lineage, else nothing remains.

    Raises ConfigError when ``out`` holds anything but an earlier import or ``source`` has links
    that lead out of it, InputError when ``source`` does not exist, StageError when it cannot be
    written.
    """
    source, out = Path(source), Path(out)
    _check_target(out)
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder; check the path.")
    refuse_links_out(source)
    make_folder(out.parent)
    try:
        temporary = tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.")
    except OSError as error:
        raise write_failure(out, error) from error
    with temporary:
        folder = make_folder(Path(temporary.name) / "drive")
        run = Import(kind, source, out, folder)
        try:
            yield run
        except StageError as error:
            # the user knows the drive's folder, not the one that is filled
            raise StageError(str(error).replace(str(folder), str(out))) from error
        except OSError as error:
            raise _reworded(error, run) from error
        except _DAMAGE as error:
            raise InputError(
                f"{source} cannot be imported as {kind}: it is damaged or of another kind "
                f"({type(error).__name__}: {error}); check that KIND is right and copy it again."
            ) from error
        try:
            _write_lineage(run)
            _move(folder, out)
        except OSError as error:
            raise _reworded(error, run) from error


def _reworded(error: OSError, run: Import) -> Exception:
    """A failed write is the target's fault, a failed read the source's. A copy that finds no room
    names the source first."""
    if error.errno in _OF_WRITES:
        return write_failure(run.out, error)
    named = Path(os.fsdecode(error.filename)) if error.filename else None
    if named is None or named.is_relative_to(run.folder.parent) or named.is_relative_to(run.out):
        return write_failure(run.out, error)
    return InputError(f"{named} cannot be read ({error.strerror}); check the file and its rights.")


def _check_target(out: Path) -> None:
    if not out.exists():
        return
    if not out.is_dir():
        raise ConfigError(f"{out} is a file; name a folder for the drive.")
    manifest = out / names.MANIFEST
    if manifest.is_file():
        with manifest.open(encoding="utf-8", errors="replace") as stream:
            if stream.readline().startswith(MARKS):
                return
    if any(out.iterdir()):
        raise ConfigError(f"{out} is not empty and was not made by an import; name another folder.")


def _write_lineage(run: Import) -> None:
    written = [p for p in sorted(run.folder.rglob("*")) if p.is_file()]
    write_json(
        run.folder / LINEAGE,
        {
            "schema": SCHEMA,
            "kind": run.kind,
            "automap": __version__,
            "source": run.source.resolve().name,
            "source_files": [_described(path, run.source) for path in run.sources],
            "written": {str(p.relative_to(run.folder)): _digest(p) for p in written},
            "warnings": run.warnings,
        },
    )


def _described(path: Path, source: Path) -> dict[str, Any]:
    root = source if source.is_dir() else source.parent
    name = path.relative_to(root) if path.is_relative_to(root) else Path(path.name)
    return {"file": str(name), "bytes": path.stat().st_size, "sha256": _digest(path)}


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _move(folder: Path, out: Path) -> None:
    """Put the finished folder in its place; an earlier import's files give way, results stay."""
    if not out.exists():
        put_in_place(folder, out)
        return
    for name in _written_before(out):
        old = out / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
    # the manifest goes last: until then the old one marks the folder as ours
    for item in sorted(folder.rglob("*"), key=lambda path: path.name == names.MANIFEST):
        if item.is_file():
            target = out / item.relative_to(folder)
            make_folder(target.parent)
            put_in_place(item, target)


def _written_before(out: Path) -> list[str]:
    """Files of the import that made ``out``, the manifest not among them."""
    try:
        written = parse_json((out / LINEAGE).read_text(encoding="utf-8"))["written"]
        found = [str(name) for name in written]
    except (OSError, ValueError, KeyError, TypeError):
        return list(_EARLIER)
    inside = [n for n in found if not Path(n).is_absolute() and ".." not in Path(n).parts]
    return [name for name in inside if name != names.MANIFEST]


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)
