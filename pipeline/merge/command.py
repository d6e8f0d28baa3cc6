"""``automap merge``: output folders of runs in, one map out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import ConfigError, InputError, closed
from automap.io import names
from pipeline.merge.distinct import distinct, doubted
from pipeline.merge.inputs import RunSigns, read_run
from pipeline.merge.outcome import MergeOutcome
from pipeline.merge.seen_again import by_later_drives
from pipeline.shared.progress import Progress
from pipeline.shared.run_record import results_of

if TYPE_CHECKING:
    from automap.mapping.changes import Change, OlderMap
    from automap.mapping.compare import Comparison
    from automap.mapping.merge import Merged
    from automap.records import Sign


def merge_runs(
    folders: Sequence[Path],
    out: Path,
    previous: Path | None = None,
    least_existence: float = 0.5,
    progress: Progress = lambda fraction, text: None,
    roads: Path | None = None,
    background: Path | None = None,
) -> MergeOutcome:
    """Merge the runs in ``folders`` into one map in ``out``.

    ``previous`` is an older map whose names are kept and against which changes are listed; by
    default the map that stands in ``out``. ``roads`` is a layer on which the signs get a place,
    ``background`` lies below the report's map. A folder that cannot be read is left out with a
    warning as long as another can. Raises InputError when none can, ConfigError for an ``out``
    that is one of them.
    """
    from automap.mapping.compare import compare_maps
    from automap.mapping.merge import merge_drives
    from automap.mapping.posts import with_supports
    from pipeline.merge.output import write_map

    started = time.monotonic()
    folders = [results_of(folder) for folder in folders]
    _check_folders(folders, out)
    if background is not None and not background.is_file():
        raise ConfigError(f"--background {background}: no such file.")
    if previous is None and (out / names.MERGE).is_file():
        previous = out
    older = None if previous is None else _read_older(previous)
    runs, warnings = _read_all(folders, lambda done: progress(0.25 * done, "reading"))
    merged = merge_drives(
        [run.signs for run in runs], lambda done, text: progress(0.25 + 0.55 * done, text)
    )
    warnings += by_later_drives(merged)
    comparison = None
    if older is not None:
        comparison = compare_maps(older, merged, least_existence)
    progress(0.82, "writing")
    signs, ids = _named(merged, comparison, older, least_existence)
    if comparison is not None:
        comparison = replace(comparison, changes=named_changes(comparison.changes, ids))
    signs = list(with_supports(signs, merged.own_variance))
    countries = {run.country.upper() for run in runs if run.country}
    outcome = MergeOutcome(
        name=out.resolve().name,
        signs=[s for s in signs if s.id],
        comparison=comparison,
        warnings=warnings,
        country=countries.pop() if len(countries) == 1 else None,
        roads=roads,
        background=background,
        folder=out,
        merged=merged,
        files=[],
        summary={},
        seconds=0.0,
    )
    folder_of = {run.signs.name: run.folder for run in runs}
    files, summary = write_map(
        outcome,
        signs,
        [folder_of[drive.name] for drive in merged.drives],
        previous,
        lambda done: progress(0.82 + 0.18 * done, "writing"),
    )
    return replace(outcome, files=files, summary=summary, seconds=time.monotonic() - started)


def _check_folders(folders: Sequence[Path], out: Path) -> None:
    resolved = [folder.resolve() for folder in folders]
    for folder in folders:
        if not folder.exists():
            raise InputError(f"{folder}: no such output folder; give folders of runs.")
    for number, folder in enumerate(resolved):
        if folder in resolved[:number]:
            raise ConfigError(f"{folders[number]} is given twice; leave out one of them.")
    if out.resolve() in resolved:
        raise ConfigError(f"-o {out} is one of the runs to be merged; choose another folder.")
    if (out / names.RUN).is_file() and not (out / names.MERGE).is_file():
        raise ConfigError(f"-o {out} holds the results of a run; choose another folder.")


def _read_all(
    folders: Sequence[Path], progress: Callable[[float], None]
) -> tuple[list[RunSigns], list[str]]:
    runs: list[RunSigns] = []
    warnings: list[str] = []
    first_error: InputError | None = None
    for number, folder in enumerate(folders):
        try:
            runs.append(_read(folder))
            warnings += runs[-1].warnings
        except InputError as error:
            first_error = first_error or error
            warnings.append(f"left out: {error}")
        progress((number + 1) / len(folders))
    if not runs and first_error is not None:
        raise first_error
    return _distinct(runs, warnings), warnings


def _read(folder: Path) -> RunSigns:
    try:
        return read_run(folder)
    except PermissionError as error:
        raise closed(error) from None


def _distinct(runs: list[RunSigns], warnings: list[str]) -> list[RunSigns]:
    """Runs of different drives, each under a name of its own.

    Two runs of one recording, or of parts of it, see the same twice and are no two passes.
    """
    from automap.mapping.sightings import canonical_order

    # of runs that started at once under one name the first is that of the first folder by name
    runs = sorted(runs, key=lambda run: str(run.folder.resolve()))
    runs = [runs[k] for k in canonical_order([run.signs for run in runs])]
    places, told = distinct([run.candidate for run in runs], "another run of the drive of")
    runs = [runs[k] for k in places]
    warnings += told
    warnings += [
        f"{run.name}: its path is {run.verdict} and in the map"
        + (f": {run.reason}" if run.reason else ".")
        for run in doubted([run.candidate for run in runs])
    ]
    kept: list[RunSigns] = []
    used: set[str] = set()
    for run in runs:
        name, number = run.signs.name, 1
        while name in used:
            number += 1
            name = f"{run.signs.name}-{number}"
        used.add(name)
        kept.append(replace(run, signs=replace(run.signs, name=name)))
    return kept


def _read_older(folder: Path) -> OlderMap:
    from automap.export.geojson import read_signs_geojson
    from automap.io.map_tables import COVERAGE, SIGHTINGS, read_coverage, read_members
    from automap.io.signs_table import read_signs
    from automap.mapping.changes import OlderMap
    from pipeline.merge.signs import GPS_CLOCK

    if not folder.is_dir():
        raise InputError(f"{folder}: no such map; give a folder that automap merge wrote.")
    table, file = folder / names.SIGNS_RAW, folder / names.SIGNS_GEOJSON
    if table.is_file():
        signs = read_signs(table)
    elif file.is_file():
        signs = read_signs_geojson(file, GPS_CLOCK)
    else:
        raise InputError(f"{folder} holds no map ({names.SIGNS_GEOJSON} is missing).")
    members = read_members(folder / SIGHTINGS) if (folder / SIGHTINGS).is_file() else {}
    coverage = read_coverage(folder / COVERAGE) if (folder / COVERAGE).is_file() else None
    drives = frozenset(key.rpartition("|")[0] for key in members)
    return OlderMap(
        [s for s in signs if np.isfinite(s.lat_rad) and np.isfinite(s.lon_rad)],
        members, drives, coverage,
    )  # fmt: skip


def _named(
    merged: Merged,
    comparison: Comparison | None,
    older: OlderMap | None,
    least_existence: float,
) -> tuple[list[Sign], list[str]]:
    """All merged signs, those of the map with their names, the unlikely ones with ""; and the names
    of all."""
    from automap.mapping.identity import name_signs

    taken = {s.id for s in older.signs} if older is not None else set()
    if older is not None:
        taken |= set(older.members.values())
    kept = comparison.names if comparison is not None else {}
    ids = name_signs(merged.founders, kept, taken)
    likely = merged.existence >= least_existence
    signs = [replace(sign, id=ids[k] if likely[k] else "") for k, sign in enumerate(merged.signs)]
    return signs, ids


def named_changes(changes: Sequence[Change], ids: Sequence[str]) -> list[Change]:
    """The changes with the names of all merged signs, in the order of kind and name."""
    result = [
        replace(change, sign=replace(change.sign, id=ids[change.place]))
        if change.place >= 0
        else change
        for change in changes
    ]
    order = {"new": 0, "gone": 1, "class": 2, "moved": 3}
    return sorted(result, key=lambda c: (order[c.kind], c.sign.class_name, c.sign.id))
