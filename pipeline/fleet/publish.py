"""The files of a store's map: those of a merged map, written cell by cell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from automap import __version__
from automap.export.clock import iso_texts, utc_of_gps
from automap.export.pieces import Kept
from automap.io import names
from automap.io.atomic import write_json
from automap.io.clock_json import write_clock
from automap.io.map_tables import COVERAGE, SIGHTINGS
from automap.io.signs_table import write_signs
from automap.mapping.compare import Comparison, Newer, compare
from automap.mapping.drive_levels import LEVELS
from automap.mapping.identity import name_signs
from automap.mapping.posts import with_supports
from automap.records import FloatArray, IntArray
from automap.records.sign_lists import SignList, changed, values_of
from pipeline.fleet.map_tables import write_looked, write_sightings
from pipeline.fleet.older import Before, fresh_drives, read_older, shared_with
from pipeline.fleet.own_names import OwnNames
from pipeline.fleet.store import Entry, Store
from pipeline.fleet.tracks import gather_tracks, has_tracks, left_out
from pipeline.merge.cell_map import StoreMap
from pipeline.merge.cell_steps import drive_offsets, members
from pipeline.merge.cell_store import Drives, read_drives
from pipeline.merge.command import named_changes
from pipeline.merge.outcome import MapOutcome
from pipeline.merge.output import SCHEMA, in_parts, offset_fields, write_files, write_stored
from pipeline.merge.signs import GPS_CLOCK
from pipeline.merge.whole import Contribution, complete, gather, write_whole
from pipeline.shared.beside import Begin, beside
from pipeline.shared.freed import give_freed_back

HISTORY = "history"
CONTRADICTS = 4.9
"""Sigmas: of ten thousand drives with two axes each one in fifty merges has a drive beyond that by
chance."""


def write_fleet_map(
    out: Path,
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    found: StoreMap,
    before: Before | None,
    least_existence: float,
    made_of: str,
    warnings: list[str],
    progress: Callable[[float], None],
    roads: Path | None = None,
    workers: int = 1,
) -> Comparison | None:
    """Write the map of the drives ``entries``, by recording, into ``out``, by so many ``workers``;
    ``roads`` is a layer on which its signs get a place."""
    give_freed_back()
    with beside(workers if store.place.folder is not None else 1) as begin:
        return _write(
            out, store, cells, entries, found, before, least_existence, made_of, warnings,
            progress, roads, begin,
        )  # fmt: skip


def _write(
    out: Path,
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    found: StoreMap,
    before: Before | None,
    least_existence: float,
    made_of: str,
    warnings: list[str],
    progress: Callable[[float], None],
    roads: Path | None,
    begin: Begin,
) -> Comparison | None:
    drives = read_drives(cells)
    likely = found.existence >= least_existence
    many = has_tracks(store, len(drives))
    if many:
        older = None if before is None else before.folder
        geoid = begin(gather_tracks, store, cells, entries, found.homes, likely, out, older)
    signs = found.signs(drives)
    comparison, taken = _compared(
        store, cells, entries, drives, found, signs, before, least_existence
    )
    ids = name_signs(found.founder, {} if comparison is None else comparison.names, taken)
    if comparison is not None:
        changes = named_changes(comparison.changes, ids)
        comparison = replace(comparison, changes=changes, names={})
    ids = [name if there else "" for name, there in zip(ids, likely.tolist(), strict=True)]
    with_posts = with_supports(changed(signs, id=ids), found.columns["own_variance"])
    assert isinstance(with_posts, SignList)
    on_map = with_posts.at(np.flatnonzero(likely))
    progress(0.1)
    countries = {str(e.done["country"]).upper() for e in entries.values() if e.done.get("country")}
    name = Path(store.place.url).name
    outcome = MapOutcome(
        name=name, signs=on_map, comparison=comparison, warnings=warnings,
        country=countries.pop() if len(countries) == 1 else None, roads=roads,
    )  # fmt: skip
    rows = _drive_rows(store, cells, entries, found, drives, warnings)
    if many:
        warnings.append(left_out(store.place.folder is None))
        outcome = replace(outcome, signs=changed(on_map, geoid_m=geoid()[likely].tolist()))
    else:
        outcome = _with_whole(out, outcome, store, cells, entries, found, drives, ids)
    # what is written now needs the room
    del signs, with_posts, on_map
    found.columns.clear()
    write_signs(out / names.SIGNS_RAW, outcome.signs)
    write_json(out / names.RUN, _run_record(store, outcome, rows))
    write_clock(out / names.SYNC, GPS_CLOCK)
    kept = Kept(None if before is None else before.folder)
    # before all that does not need it: the GeoPackage takes longest
    rest = begin(write_stored, out, name, kept) if in_parts(outcome, out) else None
    progress(0.2)
    counts = write_sightings(out / SIGHTINGS, cells, found, drives, ids)
    del ids
    for row, k in zip(rows, np.argsort(drives.rank), strict=True):
        row["signs"], row["signs_in_map"] = counts[k].tolist()
    last_pass = write_looked(out / COVERAGE, cells, drives)
    progress(0.4)
    summary = _summary(outcome, found, rows, counts, before, made_of)
    summary["cells"] = found.cells
    summary["history"] = [
        *([] if before is None else before.summary.get("history", [])),
        {
            "map": f"{int(before.version if before else 0) + 1:06d}",
            "drives": len(drives),
            "signs": len(outcome.signs),
            "changes": summary.get("changes"),
        },
    ]
    summary["last_pass"] = last_pass
    if rest is not None:
        outcome = replace(outcome, signs=())
    write_files(out, outcome, summary, lambda done: progress(0.4 + 0.6 * done), rest, kept)
    return comparison


def _compared(
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    drives: Drives,
    found: StoreMap,
    signs: SignList,
    before: Before | None,
    least_existence: float,
) -> tuple[Comparison | None, set[str]]:
    """The merged ``signs`` against the map of before, and the names that it has given."""
    if before is None:
        return None, set()
    older = read_older(before, drives)
    newer = Newer(
        signs, found.existence, found.columns["class_share"],
        shared_with(older, cells, found), found.rates,
        list(fresh_drives(store, entries, older, drives)),
    )  # fmt: skip
    return compare(older.map, newer, least_existence), set(values_of(older.map.signs, "id"))


def _drive_rows(
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    found: StoreMap,
    drives: Drives,
    warnings: list[str],
) -> list[dict[str, Any]]:
    """What merge.json says of each drive, in the order of their starts, but for its counts."""
    offset, sd = drive_offsets(cells, found.homes, len(drives))
    starts = iso_texts(utc_of_gps(drives.start_gps_s))
    likely = found.existence[found.pairs.sign] >= 0.5
    in_view = np.bincount(found.pairs.drive[likely], minlength=len(drives))
    seen = np.bincount(found.pairs.drive[likely & found.pairs.seen], minlength=len(drives))
    rows = []
    for k in np.argsort(drives.rank).tolist():
        entry = entries[drives.key[k]]
        off = _contradiction(entry.done.get("sd_m"), offset[k], sd[k])
        if off > CONTRADICTS:
            warnings.append(
                f"{drives.name[k]}: its signs lie {np.hypot(*offset[k, :2]):.1f} m off those of "
                f"the other drives, {off:.0f} sigmas of its path; look at its report."
            )
        rows.append(
            {
                "name": drives.name[k],
                "key": drives.key[k],
                "folder": f"{store.place.url}/{store.result(entry)}",
                "start": starts[k],
                **offset_fields(offset[k], sd[k]),
                "looked": bool(drives.cameras[k]),
                "in_view": int(in_view[k]),
                "seen_of_in_view": int(seen[k]),
                "detection_rate": float(found.rates.drive[k]),
                "error_levels": dict(zip(LEVELS, found.factors[k].tolist(), strict=True)),
            }
        )
    return rows


def _contradiction(stated: list[float | None] | None, offset: FloatArray, sd: FloatArray) -> float:
    """By how many sigmas a drive lies off the others in plan, at most along an axis; by the sigma
    that its path states, as the error levels that the drives show have such drives in them."""
    if not stated or None in stated[:2] or not np.isfinite(offset[:2]).all():
        return 0.0
    sigma = np.hypot(np.array(stated[:2], np.float64), sd[:2])
    return float(np.max(np.abs(offset[:2]) / sigma))


def _with_whole(
    out: Path,
    outcome: MapOutcome,
    store: Store,
    cells: Path,
    entries: Mapping[str, Entry],
    found: StoreMap,
    drives: Drives,
    ids: Sequence[str],
) -> MapOutcome:
    """What a map of not too many drives takes over from them all."""
    named = OwnNames(members(cells, found.homes), np.array([bool(name) for name in ids], np.bool_))
    folder = store.place.folder
    assert folder is not None
    whole = gather(
        [
            Contribution(
                drives.name[k],
                folder / store.result(entries[drives.key[k]]),
                {own: ids[sign] for own, sign in named.of(k).items()},
            )
            for k in np.argsort(drives.rank).tolist()
        ],
        len(outcome.signs),
        outcome.warnings,
    )
    write_whole(out, whole)
    return replace(outcome, signs=complete(outcome.signs, whole))


def _run_record(store: Store, outcome: MapOutcome, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "schema": "automap.run/1",
        "automap": __version__,
        "drive": {"name": outcome.name, "path": f"{store.place.url}/map"},
        "status": "done",
        "merged": [row["folder"] for row in rows],
        "warnings": outcome.warnings,
        "country": outcome.country,
        "drives": [row["name"] for row in rows],
        "stages": {},
        "metrics": {"signs": len(outcome.signs), "drives": len(rows)},
    }


def _summary(
    outcome: MapOutcome,
    found: StoreMap,
    rows: list[dict[str, Any]],
    counts: IntArray,
    before: Before | None,
    made_of: str,
) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "schema": SCHEMA,
        "automap": __version__,
        "made_of": made_of,
        "signs": len(outcome.signs),
        "unlikely_signs": len(found.existence) - len(outcome.signs),
        "sightings": int(counts[:, 0].sum()),
        "sightings_in_map": int(counts[:, 1].sum()),
        "detection_rate": found.rates.overall,
        "error_levels": dict(zip(LEVELS, found.levels.tolist(), strict=True)),
        "drives": rows,
        "warnings": outcome.warnings,
    }
    if outcome.comparison is not None and before is not None:
        told = outcome.comparison
        kinds = [change.kind for change in told.changes]
        summary["previous"] = before.version
        summary["changes"] = {
            kind: kinds.count(kind) for kind in ("new", "gone", "class", "moved")
        } | {
            "unchanged": told.unchanged,
            "unvisited": told.unvisited,
            "unconfirmed": told.unconfirmed,
            "rejected": told.rejected,
        }
    return summary
