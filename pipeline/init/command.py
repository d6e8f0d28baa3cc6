"""``automap init``: from a folder of recordings to a drive that can be checked and run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.atomic import write_text
from pipeline.importers.parts import copy_or_link
from pipeline.importers.target import Import, new_drive
from pipeline.init.choose import Ask, draft_of
from pipeline.init.draft import NOTES, Draft
from pipeline.init.found import Found, look
from pipeline.init.settle import settle

Convert = Callable[[str, list[Path], Path], list[str]]
"""Imports recordings of a kind as a drive, and returns warnings."""

_INSIDE = "drive"
"""Folder of a converted drive where none is named; beside a recording that is one file or folder it
bears its name as well."""


@dataclass(frozen=True)
class Outcome:
    """The drive folder that was made, and sentences for the user."""

    drive: Path
    told: list[str] = field(default_factory=list)


def init_drive(
    source: Path,
    out: Path | None,
    convert: Convert,
    ask: Ask | None = None,
    force: bool = False,
) -> Outcome:
    """Make a drive of what lies in the folder, or is the file, ``source``.

    Tables and receiver logs stay as they are and get a manifest beside them, or are copied into
    ``out``; other programs' recordings are converted into ``out``, else into a folder of their own
    beside them. Raises ConfigError where a manifest is there and ``force`` is not given, and where
    the recordings are of several drives; InputError where there are none.
    """
    found = look(source)
    if found.recordings and found.is_drive:
        # a table and a recording that holds its own: nobody can know which is meant
        raise ConfigError(f"{source} holds recordings of several kinds: {_listed(found)}; {_ONE}.")
    if not found.recordings and not found.is_drive:
        raise InputError(
            f"{source} holds nothing that is known: no table of inertial readings or fixes, no "
            "receiver log, no recording of another program"
            + (
                f"; found are {', '.join(p.name for p in found.passed[:6])}."
                if found.passed
                else "."
            )
        )
    if found.recordings:
        return _convert(source, out, found, convert, force)
    folder = source if source.is_dir() else source.parent
    _refuse(out or folder, force)
    if out is None:
        draft = _drafted(found, folder, ask)
        write_text(folder / names.MANIFEST, draft.manifest(folder.resolve().name))
        return Outcome(folder, _passed(found))
    with new_drive("init", source, out) as run:
        _copy(run, found)
        run.write_manifest(_drafted(look(run.folder), run.folder, ask).text(), NOTES)
    return Outcome(out, _passed(found) + run.warnings)


_ONE = "put each in a folder of its own, or name one: automap init FILE -o DRIVE"


def _drafted(found: Found, folder: Path, ask: Ask | None) -> Draft:
    draft = draft_of(found, folder, ask)
    settle(draft)
    return draft


def _convert(
    source: Path, out: Path | None, found: Found, convert: Convert, force: bool
) -> Outcome:
    if len(found.recordings) > 1:
        raise ConfigError(f"{source} holds recordings of several kinds: {_listed(found)}; {_ONE}.")
    (kind, paths), *_ = found.recordings.items()
    if len(paths) > 1 and kind not in ("rosbag", "gopro"):
        raise ConfigError(f"{source} holds several recordings: {_listed(found)}; {_ONE}.")
    whole = source.is_file() or paths == [source]
    beside = source.parent / f"{source.stem}-{_INSIDE}" if whole else source / _INSIDE
    target = out or beside
    _refuse(target, force)
    warnings = convert(kind, paths, target)
    return Outcome(target, [f"imported as {kind}", *warnings, *_passed(found)])


def _refuse(folder: Path, force: bool) -> None:
    if (folder / names.MANIFEST).exists() and not force:
        raise ConfigError(
            f"{folder / names.MANIFEST} is there; --force writes it anew, automap check says what "
            "it holds."
        )


def _copy(run: Import, found: Found) -> None:
    """The files of a drive in its folder; videos, which are large, as links."""
    plain = [*(p for p, _ in found.logs), *(t.path for t in found.tables), *found.finished]
    camera = [*found.frames, *found.detections]
    for path in (*plain, *camera, *found.videos):
        target = run.folder / path.name
        if target.exists():
            raise ConfigError(f"{path.name} is there twice; rename one of the two.")
        copy_or_link(path, target, path in found.videos)
        run.sources.append(path)


def _passed(found: Found) -> list[str]:
    return [f"{path}: nothing is known of this file; it is not used" for path in found.passed]


def _listed(found: Found) -> str:
    parts = [f"{p.name} ({kind})" for kind, paths in found.recordings.items() for p in paths]
    parts += [f"{p.name} ({kind})" for p, kind in found.logs]
    parts += [f"{t.path.name} (table)" for t in found.tables]
    return ", ".join(parts)
