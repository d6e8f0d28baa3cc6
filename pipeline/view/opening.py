"""Opening the map in an output folder."""

from __future__ import annotations

from pathlib import Path

from automap.errors import InputError
from automap.io import names
from automap.io.json_text import parse_json
from automap.io.review_json import read_review
from pipeline.shared.run_record import drive_of, results_of
from pipeline.view.drives import MapDrive
from pipeline.view.signs import read_sign_table
from pipeline.view.viewed_map import ViewedMap


def open_map(out: Path) -> ViewedMap:
    """Read the map in an output folder, or in the ``_automap`` of a drive folder.

    Raises InputError when there is neither a sign nor a trajectory, or a damaged review.
    """
    out = results_of(out)
    if not out.is_dir():
        raise InputError(f"{out} is no output folder of automap run; run the drive first.")
    signs = read_sign_table(out)
    merged = _merged_drives(out)
    drives = [_own_drive(out)] if merged is None else merged
    if signs is None and (merged is not None or drives[0].trajectory is None):
        inside = sorted(p.parent.name for p in out.glob(f"*/{names.RUN}"))
        hint = f"; it has the runs {', '.join(inside[:4])}, view one of them" if inside else ""
        raise InputError(f"{out} holds neither signs nor a trajectory{hint or '; run the drive'}.")
    read_review(out / names.REVIEW)
    name = drives[0].name if merged is None else out.resolve().name
    return ViewedMap(out.resolve(), name, merged is not None, signs, drives)


def _merged_drives(out: Path) -> list[MapDrive] | None:
    """The drives of a merged map, None where ``out`` is the map of one run."""
    if not (out / names.MERGE).is_file():
        return None
    try:
        listed = parse_json((out / names.MERGE).read_text(encoding="utf-8"))["drives"]
        return [_drive_of(out, str(value["name"]), Path(value["folder"])) for value in listed]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{out / names.MERGE} cannot be used ({error}); merge the drives again."
        ) from error


def _drive_of(out: Path, name: str, folder: Path) -> MapDrive:
    """A drive of a merged map; a folder that is no longer there shows nothing of it."""
    root = out.resolve()
    # a relative name was one of where the merge was started, mostly beside the map
    places = [folder, root.parent / folder, root / folder, root.parent / folder.name]
    place = next((p for p in places if (p / names.RUN).is_file()), None)
    if place is None:
        lost = f"The results of {name} are not at {folder} any more, so its views are not shown."
        return MapDrive(name, None, None, [lost])
    found = _own_drive(place)
    return MapDrive(name, place, found.folder)


def _own_drive(out: Path) -> MapDrive:
    """The drive that a run in ``out`` was made of."""
    name, folder = drive_of(out)
    if not (folder / names.MANIFEST).is_file():
        folder = out.resolve().parent
    known = (folder / names.MANIFEST).is_file()
    return MapDrive(name, out, folder if known else None)
