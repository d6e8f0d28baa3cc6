"""The folder of a merged map: the files of a run, and what only a merge has."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap import __version__
from automap.errors import StageError
from automap.io import names
from automap.io.atomic import make_folder, put_in_place, write_json, write_text
from automap.io.map_tables import COVERAGE, SIGHTINGS, TRACKS
from pipeline.merge.changes_file import changes_geojson
from pipeline.merge.coverage import coverage_of
from pipeline.merge.seen_again import since_reviewed
from pipeline.merge.signs import GPS_CLOCK
from pipeline.merge.whole import MOST_PICTURED
from pipeline.shared.beside import later
from pipeline.shared.lock import locked

if TYPE_CHECKING:
    from automap.export.pieces import Kept
    from automap.mapping.merge import Merged
    from automap.records import FloatArray, Sign
    from pipeline.merge.outcome import MapOutcome, MergeOutcome
    from pipeline.merge.whole import Contribution

CHANGES = "changes.geojson"
SCHEMA = "automap.merge/1"
LONGEST_FIRST = ("gpkg", "kmz", "kml", "geojson", "parquet")
"""The formats of every map by the time that they take."""


def write_map(
    outcome: MergeOutcome,
    signs: Sequence[Sign],
    folders: Sequence[Path],
    previous: Path | None,
    progress: Callable[[float], None],
) -> tuple[list[Path], dict[str, Any]]:
    """Write all files of the map; returns them, and what merge.json says. ``signs`` are all merged
    ones, the unlikely ones without a name; ``folders`` those of the drives, in their order.

    An older map gives way when the new one is complete. ConfigError while another process
    writes there.
    """
    out = make_folder(outcome.folder)
    with locked(out):
        # of a merge that was killed; nobody else writes here now
        for left in out.glob(".merge.*"):
            shutil.rmtree(left, ignore_errors=True)
        with tempfile.TemporaryDirectory(dir=out, prefix=".merge.") as temporary:
            new = Path(temporary)
            with suppress(FileNotFoundError):
                # what a reviewer decided about the older map
                shutil.copyfile(out / names.REVIEW, new / names.REVIEW)
            try:
                written, summary = _write_files(new, outcome, signs, folders, previous, progress)
            except StageError as error:
                raise StageError(str(error).replace(str(new), str(out))) from error
            (new / names.REVIEW).unlink(missing_ok=True)
            optional = (CHANGES, TRACKS, names.OBSERVATIONS, names.SIGN_ROADS, names.REJECTED)
            for name in optional:
                if not (new / name).exists():
                    (out / name).unlink(missing_ok=True)
            shutil.rmtree(out / names.PICTURES, ignore_errors=True)
            # merge.json last: it says that the map is complete
            for path in sorted(new.iterdir(), key=lambda path: path.name == names.MERGE):
                put_in_place(path, out / path.name)
    return [out / path.name for path in written], summary


def _write_files(
    out: Path,
    outcome: MergeOutcome,
    signs: Sequence[Sign],
    folders: Sequence[Path],
    previous: Path | None,
    progress: Callable[[float], None],
) -> tuple[list[Path], dict[str, Any]]:
    from automap.io.clock_json import write_clock
    from automap.io.map_tables import write_coverage
    from automap.io.signs_table import write_signs
    from pipeline.merge.whole import complete, gather, write_whole

    whole = gather(
        contributions(outcome.merged, signs, folders), len(outcome.signs), outcome.warnings
    )
    outcome = replace(outcome, signs=complete(outcome.signs, whole))
    write_whole(out, whole)
    write_signs(out / names.SIGNS_RAW, outcome.signs)
    _write_sightings(out / SIGHTINGS, outcome.merged, signs)
    write_coverage(out / COVERAGE, coverage_of(outcome.merged.drives))
    progress(0.25)
    write_json(out / names.RUN, _run_record(outcome, folders, len(outcome.signs)))
    write_clock(out / names.SYNC, GPS_CLOCK)
    summary = merge_summary(outcome, signs, folders, previous)
    rest = later(write_stored, out, outcome.name, None) if in_parts(outcome, out) else None
    written = write_files(out, outcome, summary, progress, rest)
    # with the warnings of what was written, and the count that a review left
    write_json(out / names.RUN, _run_record(outcome, folders, summary["signs"]))
    return written, summary


def in_parts(outcome: MapOutcome, out: Path) -> bool:
    """Whether the map's signs are so many that they are read part by part: they have no pictures
    then, and must have no roads and no decisions of a reviewer either."""
    many = len(outcome.signs) > MOST_PICTURED and outcome.roads is None
    return many and not (out / names.REVIEW).exists()


def write_files(
    out: Path,
    outcome: MapOutcome,
    summary: dict[str, Any],
    progress: Callable[[float], None],
    rest: Callable[[], None] | None = None,
    kept: Kept | None = None,
) -> list[Path]:
    """Write what a map consists of, once ``run.json``, clock, signs, sightings and coverage are
    there; returns the files for people. ``summary`` becomes merge.json, with the count of signs
    that a review left. With a ``rest``, begun
    as ``write_stored``, the signs are read part by part from their table, and pieces of their files
    ``kept``."""
    from automap.export.roads import roads_csv
    from pipeline.export.content import map_content, stored_content
    from pipeline.export.formats import (
        FORMATS,
        STANDARD_FORMATS,
        write_dictionary,
        write_rejected,
    )
    from pipeline.export.roads import tried_on_roads
    from pipeline.merge.report import merge_report

    files = [out / FORMATS[fmt][0] for fmt in STANDARD_FORMATS]
    content = (
        stored_content(out, outcome.name, kept)
        if rest is not None
        else map_content(out, outcome.name, on_roads=False, fresh=True)
    )
    # what a review says of itself; that there is no path is nothing new of a merge
    outcome.warnings.extend(content.products.problems)
    rejected = content.products.rejected
    outcome.warnings.extend(since_reviewed(rejected))
    summary |= {"signs": len(content.source), "rejected_signs": len(rejected)}
    told = len(content.warnings)
    rows = [] if rest is not None else tried_on_roads(content, outcome.roads)
    if rows:
        write_text(out / names.SIGN_ROADS, roads_csv(rows))
    outcome.warnings.extend(content.warnings[told:])
    report = merge_report(outcome, summary, content)
    for number, fmt in enumerate(_not_begun(out)):
        FORMATS[fmt][1](content, out / FORMATS[fmt][0])
        progress(0.3 + 0.6 * (number + 1) / len(files))
    if rest is not None:
        rest()
    for fmt in LONGEST_FIRST:
        _begun(out, fmt).unlink()
    write_dictionary(out / names.DICTIONARY)
    if content.products.rejected:
        write_rejected(content, out / names.REJECTED)
    changes = outcome.comparison.changes if outcome.comparison is not None else None
    if changes is not None:
        write_text(out / CHANGES, changes_geojson(changes))
        files.append(out / CHANGES)
    write_text(out / names.REPORT, report)
    write_json(out / names.MERGE, summary)
    return [*files, out / names.REPORT, out / names.MERGE]


def write_stored(out: Path, name: str, kept: Kept | None) -> None:
    """Write what no other process has begun of a map whose signs are read part by part, once its
    ``run.json``, clock and signs are there; in a process of its own, say."""
    from pipeline.export.content import stored_content
    from pipeline.export.formats import FORMATS

    content = None
    for file, write in map(FORMATS.__getitem__, _not_begun(out)):
        content = content or stored_content(out, name, kept)
        write(content, out / file)


def _not_begun(out: Path) -> Iterator[str]:
    """Formats that are still to be written, each given to one process only: two that take the
    longest of those left are done at about the same time."""
    for fmt in LONGEST_FIRST:
        with suppress(FileExistsError):
            _begun(out, fmt).touch(exist_ok=False)
            yield fmt


def _begun(out: Path, fmt: str) -> Path:
    """The file that says that a process writes a format."""
    return out / f".{fmt}.begun"


def _run_record(outcome: MergeOutcome, folders: Sequence[Path], signs: int) -> dict[str, Any]:
    """The lineage of the map, in the form in which a run states its own."""
    return {
        "schema": "automap.run/1",
        "automap": __version__,
        "drive": {"name": outcome.folder.resolve().name, "path": str(outcome.folder.resolve())},
        "status": "done",
        "merged": [str(folder.resolve()) for folder in folders],
        "warnings": outcome.warnings,
        "country": outcome.country,
        "drives": [drive.name for drive in outcome.merged.drives],
        "stages": {},
        "metrics": {"signs": signs, "drives": len(folders)},
    }


def merge_summary(
    outcome: MergeOutcome, signs: Sequence[Sign], folders: Sequence[Path], previous: Path | None
) -> dict[str, Any]:
    """The content of merge.json."""
    from automap.mapping.drive_levels import LEVELS

    merged = outcome.merged
    in_map = np.array([bool(sign.id) for sign in signs], np.bool_)
    counted = in_map[merged.sign] if len(signs) else np.zeros(0, np.bool_)
    rates = merged.rates
    summary: dict[str, Any] = {
        "schema": SCHEMA,
        "automap": __version__,
        "signs": len(outcome.signs),
        "rejected_signs": 0,
        "unlikely_signs": int((~in_map).sum()),
        "sightings": len(merged.sightings),
        "sightings_in_map": int(counted.sum()),
        "detection_rate": rates.overall,
        "error_levels": dict(zip(LEVELS, merged.levels.tolist(), strict=True)),
        "drives": [
            _drive_summary(merged, number, folder, counted) for number, folder in enumerate(folders)
        ],
        "warnings": outcome.warnings,
    }
    if outcome.comparison is not None:
        found = outcome.comparison
        kinds = [change.kind for change in found.changes]
        summary["previous"] = None if previous is None else str(previous.resolve())
        summary["changes"] = {
            kind: kinds.count(kind) for kind in ("new", "gone", "class", "moved")
        } | {
            "unchanged": found.unchanged,
            "unvisited": found.unvisited,
            "unconfirmed": found.unconfirmed,
            "rejected": found.rejected,
        }
    return summary


def offset_fields(offset: FloatArray, sd: FloatArray) -> dict[str, dict[str, float | None]]:
    """How far a drive's signs lie off the map, ``offset`` [3] with ``sd`` [3] in m; untold where
    the sigma is zero: without a trajectory nothing tells what its signs share."""
    told = {
        name: [float(v) if s > 0.0 else None for v, s in zip(values, sd, strict=True)]
        for name, values in (("offset_m", offset), ("offset_sd_m", sd))
    }
    return {name: dict(zip("enu", values, strict=True)) for name, values in told.items()}


def _drive_summary(
    merged: Merged, number: int, folder: Path, counted: np.ndarray[Any, np.dtype[np.bool_]]
) -> dict[str, Any]:
    from automap.export.clock import iso_texts, utc_of_gps
    from automap.mapping.drive_levels import LEVELS

    drive = merged.drives[number]
    lo, hi = (int(v) for v in merged.sightings.first[number : number + 2])
    pairs = merged.pairs
    likely = (pairs.drive == number) & (merged.existence[pairs.sign] >= 0.5)
    return {
        "name": drive.name,
        "folder": str(folder.resolve()),
        "start": iso_texts(utc_of_gps(np.array([drive.start_gps_s])))[0],
        "signs": hi - lo,
        "signs_in_map": int(counted[lo:hi].sum()),
        **offset_fields(merged.adjusted.drive_offset[number], merged.adjusted.drive_sd[number]),
        "looked": bool(drive.cameras)
        and drive.path is not None
        and bool(np.isfinite(drive.path.yaw_rad).any()),
        "in_view": int(likely.sum()),
        "seen_of_in_view": int((likely & pairs.seen).sum()),
        "detection_rate": float(merged.rates.drive[number]),
        "error_levels": dict(zip(LEVELS, merged.factors[number].tolist(), strict=True)),
    }


def _write_sightings(path: Path, merged: Merged, signs: Sequence[Sign]) -> None:
    from automap.io.map_tables import write_sightings
    from automap.mapping.identity import sighting_key

    s, sign = merged.sightings, merged.sign
    drives = [merged.drives[k] for k in s.drive.tolist()]
    own_ids = [d.ids[row] for d, row in zip(drives, s.row.tolist(), strict=True)]
    a = merged.adjusted
    turn = (s.lon - a.lon[sign] + np.pi) % (2 * np.pi) - np.pi
    east, north = turn * s.per_lon, (s.lat - a.lat[sign]) * s.per_lat
    write_sightings(
        path,
        {
            "key": [sighting_key(d, i) for d, i in zip(drives, own_ids, strict=True)],
            "drive": [d.name for d in drives],
            "drive_sign": own_ids,
            "class": [s.classes[code] for code in s.code.tolist()],
            "sign_id": [signs[k].id for k in sign.tolist()],
        },
        {
            "lat_deg": np.degrees(s.lat),
            "lon_deg": np.degrees(s.lon),
            "height_m": s.height,
            "existence": merged.existence[sign],
            "offset_e_m": a.offset[:, 0],
            "offset_n_m": a.offset[:, 1],
            "offset_u_m": a.offset[:, 2],
            "residual_e_m": east - a.offset[:, 0],
            "residual_n_m": north - a.offset[:, 1],
            "residual_u_m": s.height - a.height[sign] - a.offset[:, 2],
        },
    )


def contributions(
    merged: Merged, signs: Sequence[Sign], folders: Sequence[Path]
) -> Iterator[Contribution]:
    """What the drives of a merge, in ``folders`` in their order, saw of the map's signs; ``signs``
    are all merged ones, those off the map without a name."""
    from pipeline.merge.whole import Contribution

    first, row = merged.sightings.first, merged.sightings.row
    for number, (drive, folder) in enumerate(zip(merged.drives, folders, strict=True)):
        mine = range(int(first[number]), int(first[number + 1]))
        named = {drive.ids[int(row[k])]: signs[merged.sign[k]].id for k in mine}
        yield Contribution(drive.name, folder, {own: name for own, name in named.items() if name})
