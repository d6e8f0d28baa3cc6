"""The drives that are done as sightings by cells: what a merge works on, and no more than a copy
of what the drives' results say, which may be made anew at any time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from automap.errors import InputError
from automap.io import names
from automap.io.atomic import write_json
from automap.mapping.sightings import DriveSigns
from pipeline.fleet.store import DONE, Entry, Store
from pipeline.merge.cell_store import DRIVES, PATHS, SIGHTINGS, add_drives, read_drives
from pipeline.merge.distinct import candidate, distinct, doubted
from pipeline.merge.doubles import marks_told
from pipeline.merge.inputs import read_run
from pipeline.shared.beside import ahead, beside
from pipeline.shared.run_record import unlike_record
from pipeline.shared.values import json_object, mapping

CONTENTS = "contents.json"
BATCH = 100
"""Drives that are read before they are put into cells: a hundred with a thousand signs each are
100 MB, and each batch is a file in every cell that it touches."""
_NAMED = 10
"""Drives of which a warning has the names: a line or two."""
_READ = (
    names.RUN, names.SYNC, names.SIGNS_RAW, names.SIGNS_GEOJSON, names.TRAJECTORY_ADJUSTED,
    names.TRAJECTORY, names.OBSERVATIONS,
)  # fmt: skip


def wanted(store: Store, warnings: list[str]) -> dict[str, Entry]:
    """Drives that are done by the names of their recordings; one recording counts once, and so do
    its parts. One whose files have changed counts as it was until it is run again."""
    there = {entry.digest: entry for entry in store.entries()}
    entries = [entry for entry in there.values() if _counts(entry, there)]
    here = store.place.folder
    runs = [
        candidate(
            entry.path, recording(entry), marks_told(entry.done.get("marks")),
            entry.done.get("verdict"), None if here is None else here / store.result(entry),
        )
        for entry in entries
    ]  # fmt: skip
    places, told = distinct(runs, "another copy of")
    warnings += told
    found = doubted([runs[k] for k in places])
    if found:
        more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
        each = ", ".join(f"{run.name} ({run.verdict})" for run in found[:_NAMED])
        warnings.append(
            f"paths in the map that are doubtful or unusable: {each}{more}; automap fleet status "
            "says why."
        )
    return {runs[k].key: entries[k] for k in places}


def _counts(entry: Entry, there: Mapping[str, Entry]) -> bool:
    """It is done, or changed and nothing that came in its place has been run: its signs would be
    gone for a while, and new ones under other names after that."""
    if not entry.done or entry.aside:
        return False
    seen = {entry.digest}
    while entry.replaced:
        newer = there.get(entry.successor)
        if newer is None or newer.digest in seen or newer.done or newer.aside:
            return False
        seen.add(newer.digest)
        entry = newer
    return True


def older_results(drives: Collection[Entry], key: str | None) -> list[str]:
    """Sentences about drives whose results are not those that settings of this ``key`` give, or
    not of their files as they are now."""
    told = []
    if count := 0 if key is None else sum(entry.done["key"] != key for entry in drives):
        told.append(
            f"{count} of the drives are as another version of automap, or other settings or files "
            "that these name, made them; automap fleet run makes them anew."
        )
    if count := sum(entry.replaced for entry in drives):
        told.append(
            f"{count} of the drives have changed and are in the map as they were; automap fleet "
            "run makes them anew."
        )
    return told


def recording(entry: Entry) -> str:
    """What names a recording, however often it is run."""
    return str(entry.done.get("recording") or entry.digest)


def version(entry: Entry) -> str:
    """What names a result: the drive's files and the settings."""
    return f"{entry.digest}-{entry.done.get('made_with', entry.done['key'])}"


def update_contents(
    store: Store,
    cells: Path,
    drives: dict[str, Entry],
    warnings: list[str],
    progress: Callable[[float], None],
    workers: int = 1,
    also: Callable[[str, Entry], object] | None = None,
) -> dict[str, Any]:
    """Bring the cells in ``cells`` up to date with ``drives``; what is there of each by recording.

    Results of more than a batch are read by so many ``workers``, which do what is to be done with
    each ``also``, and put into cells by this process.
    May be ended at any time and called again. A result that cannot be read is forgotten, and its
    drive waits again.
    """
    known = mapping(json_object(cells / CONTENTS).get("drives"))
    there = list(read_drives(cells).key)
    stale = [
        k for k in there if k not in drives or known.get(k, {}).get("version") != version(drives[k])
    ]
    if stale:
        # numbers are given anew; cells whose sightings come out as they were stay
        for kind in (DRIVES, SIGHTINGS, PATHS):
            shutil.rmtree(cells / kind, ignore_errors=True)
    order = [k for k in there if k in drives] if stale else []
    there = [] if stale else there
    # neighbours in one batch: else each of a hundred batches has a file in each of its cells
    fresh = sorted(
        set(drives) - set(there) - set(order),
        key=lambda k: (str(drives[k].done.get("cell", "")), drives[k].digest),
    )
    order += fresh
    told = _named(known, drives)
    write_json(cells / CONTENTS, {"drives": told})
    batches = [order[start : start + BATCH] for start in range(0, len(order), BATCH)]
    words = [(store, [(drives[k], k, told[k]["name"]) for k in batch], also) for batch in batches]
    workers = min(workers, len(batches)) if store.place.folder is not None else 1
    with beside(workers, workers) as begin:
        found = ahead(begin, _read_batch, words, workers)
        for done, (batch, read) in enumerate(zip(batches, found, strict=True)):
            for key, drive in zip(batch, read, strict=True):
                if isinstance(drive, str):
                    warnings.append(f"left out until it is run again: {drive}")
                    store.unmark(drives[key].digest, DONE)
                    del told[key]
            good = [drive for drive in read if not isinstance(drive, str)]
            if good:
                add_drives(cells, good)
            progress((done + 1) / len(batches))
    return told


def _named(known: dict[str, Any], drives: dict[str, Entry]) -> dict[str, Any]:
    """Recordings with version and a name that no other has; those known keep theirs."""
    told: dict[str, Any] = {}
    used = {known[k]["name"] for k in drives if k in known}
    for key in sorted(drives, key=lambda k: drives[k].digest):
        entry = drives[key]
        name = known[key]["name"] if key in known else entry.name
        if key not in known and name in used:
            name = f"{name}-{entry.digest[:6]}"
        used.add(name)
        told[key] = {"version": version(entry), "name": name, "digest": entry.digest}
    return told


def _read_batch(
    store: Store,
    entries: Sequence[tuple[Entry, str, str]],
    also: Callable[[str, Entry], object] | None = None,
) -> list[DriveSigns | str]:
    """What drives saw, by the keys and names that go with them; of a result that cannot be read the
    sentence why not."""
    read: list[DriveSigns | str] = []
    for entry, key, name in entries:
        try:
            with result_folder(store, entry, _READ) as folder:
                check_whole(folder, entry)
                signs = read_run(folder).signs
            if also is not None:
                also(key, entry)
            read.append(replace(signs, key=key, name=name))
        except InputError as error:
            read.append(str(error))
    return read


def check_whole(folder: Path, entry: Entry) -> None:
    """InputError where a file of a drive's result is not as long as it was published: a copy that
    was cut short, or a disk that was full."""
    published = mapping(entry.done.get("files"))
    sizes = {name: mapping(told).get("bytes") for name, told in published.items()}
    # an export may write the other two again
    for name in set(_READ) - {names.SIGNS_GEOJSON, names.RUN}:
        if told := unlike_record(folder, sizes, name):
            raise InputError(told)


@contextmanager
def result_folder(store: Store, entry: Entry, files: Sequence[str]) -> Iterator[Path]:
    """The folder of a drive's result on this machine, with the files that are named."""
    result = store.result(entry)
    if store.place.folder is not None:
        yield store.place.folder / result
        return
    with tempfile.TemporaryDirectory(prefix="automap-fleet-result.") as folder:
        for name in files:
            if name in entry.done.get("files", {}):
                store.place.get(f"{result}/{name}", Path(folder) / name)
        yield Path(folder)
