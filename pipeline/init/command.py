"""``automap init``: from a folder of recordings to a drive that can be checked and run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.atomic import write_text
from automap.io.csv_columns import listed
from automap.io.csv_layout import read_layout
from automap.io.exif_images import IMAGE_SUFFIXES
from automap.io.named_table import look_at_table
from automap.timebase import MOST_ZONE_H
from pipeline.importers.parts import copy_or_link
from pipeline.importers.target import Import, new_drive
from pipeline.init.archive import extract_tables
from pipeline.init.cameras import Ask
from pipeline.init.choose import draft_of
from pipeline.init.draft import AS_UTC, NOTES, Draft
from pipeline.init.found import Found, Table, look
from pipeline.init.joined import Joined, join, write_joined
from pipeline.init.reasons import ALONE
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
    """Make a drive of what lies in the folder, or is the file or the archive, ``source``.

    Tables and receiver logs stay as they are and get a manifest beside them, or are copied into
    ``out``; other programs' recordings are converted into ``out``, else into a folder of their own
    beside them. Raises ConfigError where a manifest is there and ``force`` is not given, and where
    the recordings are of several drives; InputError where there are none.
    """
    found = look(source)
    if found.recordings and found.is_drive:
        # a table and a recording that holds its own: nobody can know which is meant
        raise ConfigError(f"{source} holds recordings of several kinds: {_listed(found)}; {_ONE}.")
    if found.recordings:
        return _convert(source, out, found, convert, force)
    folder = source if source.is_dir() else source.parent
    joined = _join(found)
    if joined is None and not found.is_drive:
        if found.archives:
            return _unpack(source, out, found, ask, force)
        raise InputError(_nothing(source, found))
    _refuse(out or folder, force)
    if out is None:
        draft = _drafted(folder, found, joined, ask)
        write_text(folder / names.MANIFEST, draft.manifest(folder.resolve().name))
        return Outcome(folder, _told(found, joined, draft))
    with new_drive("init", source, out) as run:
        _copy(run, found)
        draft = _drafted(run.folder, look(run.folder), joined, ask)
        run.write_manifest(draft.text(), NOTES)
        # the folder that was filled has gone by now
        told = [text.replace(str(run.folder), str(out)) for text in _told(found, joined, draft)]
    return Outcome(out, told + run.warnings)


_MANY = 4
"""Files that end alike, from which they are told in one line."""
_ONE = "put each in a folder of its own, or name one: automap init FILE -o DRIVE"


def _nothing(source: Path, found: Found) -> str:
    text = (
        f"{source} holds nothing that is known: no table of inertial readings or fixes, no "
        "receiver log, no recording of another program"
    )
    inside = sorted({part.parent.name for part in source.glob("*/*") if part.is_file()})
    if inside and source.is_dir():
        text += f" (folders in it are not looked into: {listed(tuple(inside))}; give one of them)"
    if not found.passed:
        return f"{text}."
    path, why = next(iter(found.passed.items()))
    others = ", ".join(other.name for other in list(found.passed)[1:6])
    return f"{text}; {path.name}: {why}" + (f"; found are {others} as well." if others else ".")


def _join(found: Found) -> Joined | None:
    """Gyroscope and accelerometer of two tables, where no table holds both."""
    if found.of_kind("imu"):
        return None
    return join([*found.passed, *(table.path for table in found.tables)])


def _drafted(folder: Path, found: Found, joined: Joined | None, ask: Ask | None) -> Draft:
    if joined is not None:
        path = folder / names.IMU_TABLE
        write_joined(joined, path)
        found.tables.append(Table(path, {"imu": look_at_table(path, "imu")}))
    draft = draft_of(found, folder, ask)
    if joined is not None:
        for key, triad, unit in (
            ("gyro_unit", joined.gyro, "rad/s"),
            ("accel_unit", joined.accel, "m/s^2"),
        ):
            if triad.unit is not None:
                draft.set("imu", key, unit, f"{triad.path.name} is in {triad.unit}")
    settle(draft)
    _zones(draft, ask)
    return draft


def _zones(draft: Draft, ask: Ask | None) -> None:
    """The zone of dates that nothing tells: as the user says."""
    open_ones = [s for s in draft.sections if draft.why(s, "utc_offset_h") == AS_UTC]
    answer = (
        ask("Hours by which the tables' times are ahead of UTC?", ()) if open_ones and ask else ""
    )
    try:
        hours = float(answer)
    except ValueError:
        return
    for section in open_ones if abs(hours) <= MOST_ZONE_H else ():
        draft.set(section, "utc_offset_h", hours, "as you said")


def _told(found: Found, joined: Joined | None, draft: Draft | None = None) -> list[str]:
    """What the user has to know of what was and was not used, and of what was taken for granted."""
    parts = () if joined is None else (joined.gyro.path, joined.accel.path)
    passed = _passed({path: why for path, why in found.passed.items() if path not in parts})
    if draft is not None:
        zones = [s for s in draft.sections if draft.why(s, "utc_offset_h") == AS_UTC]
        files = dict.fromkeys(draft.get(section, "file") for section in zones)
        passed += [f"{file}: its times name no zone and are taken as UTC" for file in files]
        passed += [*_unread(found, draft), *dict.fromkeys(draft.doubts)]
    if joined is None:
        return passed
    gyro, accel = (path.name for path in parts)
    passed = [text.replace(ALONE, "; another table of that sensor is used") for text in passed]
    return [f"{names.IMU_TABLE} is made of {gyro} and {accel}", *passed]


def _passed(files: dict[Path, str]) -> list[str]:
    """A sentence a file that is not used; many that end alike, for one reason, are told in one."""
    alike: dict[tuple[str, str], list[Path]] = {}
    for path, why in files.items():
        alike.setdefault((why, path.suffix.lower()), []).append(path)
    told = []
    for (why, suffix), paths in alike.items():
        if len(paths) < _MANY:
            told += [f"{path}: not used: {why}" for path in paths]
            continue
        advice = ""
        if suffix in IMAGE_SUFFIXES:
            advice = (
                "; images with their places: put them in a folder of their own, for "
                "'automap import mapillary'"
            )
        first, last = paths[0], paths[-1].name
        told.append(f"{first} to {last}, {len(paths)} files: not used: {why}{advice}")
    return told


def _unread(found: Found, draft: Draft) -> list[str]:
    """The columns of the drive's tables that nothing is read of, a sentence a table."""
    told = []
    for table in found.tables:
        forms = [
            draft.get(section, "columns")
            for section in draft.sections
            if getattr(draft.get(section, "file"), "name", None) == table.path.name
        ]
        if not forms or None in forms:
            continue
        read = {each for form in forms for each in form.values()}
        left = tuple(
            name
            for at, name in enumerate(read_layout(table.path).names, 1)
            if name and not {name, at} & read
        )
        if left:
            told.append(f"{table.path}: columns that are not used: {listed(left)}")
    return told


def _unpack(source: Path, out: Path | None, found: Found, ask: Ask | None, force: bool) -> Outcome:
    """A drive of the tables in an archive, beside it where no other place is named."""
    if len(found.archives) > 1:
        listed = ", ".join(path.name for path in found.archives)
        raise ConfigError(f"{source} holds several recordings: {listed}; {_ONE}.")
    archive = found.archives[0]
    target = out or archive.parent / f"{archive.stem}-{_INSIDE}"
    _refuse(target, force)
    with new_drive("init", archive, target) as run:
        extract_tables(archive, run.folder)
        run.sources.append(archive)
        inside = look(run.folder)
        if inside.recordings:
            raise InputError(f"{archive} holds {_listed(inside)}; unpack it and give that file.")
        joined = _join(inside)
        if joined is None and not inside.is_drive:
            text = _nothing(archive, inside)
            raise InputError(text.replace(str(run.folder), str(archive)))
        draft = _drafted(run.folder, inside, joined, ask)
        run.write_manifest(draft.text(), NOTES)
        told = [
            text.replace(str(run.folder), str(archive)) for text in _told(inside, joined, draft)
        ]
    return Outcome(target, told + run.warnings)


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
    return Outcome(target, [f"imported as {kind}", *warnings, *_told(found, None)])


def _refuse(folder: Path, force: bool) -> None:
    if (folder / names.MANIFEST).exists() and not force:
        raise ConfigError(
            f"{folder / names.MANIFEST} is there; --force writes it anew, automap check says what "
            "it holds."
        )


def _copy(run: Import, found: Found) -> None:
    """The files of a drive in its folder; videos, which are large, as links."""
    plain = [*(p for p, _ in found.logs), *(t.path for t in found.tables), *found.finished]
    camera = [*found.frames, *found.detections, *found.calibrations]
    for path in (*plain, *camera, *found.videos):
        target = run.folder / path.name
        if target.exists():
            raise ConfigError(f"{path.name} is there twice; rename one of the two.")
        copy_or_link(path, target, path in found.videos)
        run.sources.append(path)


def _listed(found: Found) -> str:
    parts = [f"{p.name} ({kind})" for kind, paths in found.recordings.items() for p in paths]
    parts += [f"{p.name} ({kind})" for p, kind in found.logs]
    parts += [f"{t.path.name} (table)" for t in found.tables]
    return ", ".join(parts)
