"""The page of a merged map: how many, how sure, what changed, how far off each drive was."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from automap import __version__
from automap.export.icons import sign_words, words_apart
from automap.export.sign_columns import SignColumns, Signs
from automap.io import names
from automap.io.signs_table import first_signs
from automap.mapping.limits import TELLING_DRIVES
from automap.records import FloatArray, IntArray
from pipeline.pages.render import sections_page
from pipeline.pages.section import Figure, Section

if TYPE_CHECKING:
    from pipeline.export.content import MapContent
    from pipeline.merge.outcome import MapOutcome
    from pipeline.shared.products import RunProducts

_ROWS = 500
_PART = r"[^/\\:;,'\"()\s](?:[^/\\:;,'\"()]*[^/\\:;,'\"()\s])?"
_FOLDERS = re.compile(rf"(?<![\w.:/\\])(?:[A-Za-z]:)?[/\\](?:{_PART}[/\\])+(?!_automap\b)")
"""Of a path from the root on, all but its name (and the drive's, of a folder of results)."""
_KINDS = {"new": "new", "gone": "gone", "class": "another class", "moved": "moved"}


def merge_report(outcome: MapOutcome, summary: dict[str, Any], content: MapContent) -> str:
    """The page; ``summary`` is the content of merge.json, ``content`` that of the map's files."""
    from automap.errors import InputError
    from automap.io.background import open_background
    from pipeline.report.map_data import map_data
    from pipeline.report.render import sign_list

    background = None
    if outcome.background is not None:
        try:
            background = open_background(outcome.background)
        except InputError as error:
            outcome.warnings.append(f"The report's map has no background: {error}")
    signs = content.source
    radius = signs.radii_m()
    parts = [("How often signs were seen", _seen_section(signs.seen_by(), radius))]
    if outcome.comparison is not None:
        parts.append(("Changes", changes_section(outcome, summary)))
    parts += [
        ("Drives", _drives_section(summary)),
        ("Errors", _error_section(summary)),
        ("Classes", _class_section(content.source)),
    ]
    previous = _FOLDERS.sub("", str(summary.get("previous", "none")))
    facts = [("version", __version__), ("previous map", previous)]
    figures = _figures(len(signs), radius, summary)
    drives = {drive["folder"]: drive["name"] for drive in summary["drives"]}
    return sections_page(
        "Merged map", outcome.name, figures, parts,
        [_without_folders(text, drives) for text in outcome.warnings], facts,
        map=map_data(_with_first(content), signs, content.pictures, background),
        sign_table=sign_list(signs),
    )  # fmt: skip


def _without_folders(text: str, drives: Mapping[str, str]) -> str:
    """A sentence without where files lie, which is this computer's business: of a ``drives`` folder
    the drive's name."""
    if _FOLDERS.search(text):
        for folder, name in drives.items():
            text = text.replace(f"{folder}/", f"{name}/")
    return _FOLDERS.sub("", text)


def _with_first(content: MapContent) -> RunProducts:
    """The products with the signs that the map shows, where signs are read part by part."""
    from pipeline.report.map_data import SIGN_LIMIT

    if isinstance(content.source, SignColumns):
        return content.products
    shown = np.flatnonzero(content.source.located)[:SIGN_LIMIT]
    path = content.products.out / names.SIGNS_RAW
    return replace(content.products, signs=first_signs(path, int(shown.max(initial=-1)) + 1))


def _figures(signs: int, radius: FloatArray, summary: dict[str, Any]) -> list[Figure]:
    """``signs`` are those of the map, after its review."""
    one = len(summary["drives"]) == 1
    figures = [
        Figure(str(signs), "signs", f"from {summary['sightings']} sightings"),
        Figure(str(len(summary["drives"])), "drive" if one else "drives", ""),
    ]
    if len(radius):
        text = f"{np.median(radius):.2f} m"
        figures.append(Figure(text, "95 % radius, median", "trajectory errors included"))
    seen, in_view = (
        sum(drive[name] for drive in summary["drives"]) for name in ("seen_of_in_view", "in_view")
    )
    if len(summary["drives"]) >= TELLING_DRIVES and in_view:
        share = f"{100.0 * seen / in_view:.0f} %"
        figures.append(Figure(share, "seen when in view", f"{seen} of {in_view} times"))
    if "changes" in summary:
        count = sum(summary["changes"][kind] for kind in _KINDS)
        figures.append(Figure(str(count), "changes", "against the older map"))
    return figures


def _seen_section(seen_by: IntArray, radius: FloatArray) -> Section:
    section = Section(header=("drives that saw a sign", "signs", "95 % radius, median, m"))
    if not len(seen_by):
        section.absent = "The drives saw no signs."
        return section
    counts = Counter(seen_by.tolist())
    for number in sorted(counts)[:30]:
        text = f"{np.median(radius[seen_by == number]):.2f}"
        seen = str(number) if number else "none: a reviewer added it"
        section.rows.append((seen, str(counts[number]), text))
    return section


def changes_section(outcome: MapOutcome, summary: dict[str, Any]) -> Section:
    """The list of changes, the same as changes.geojson."""
    found = outcome.comparison
    assert found is not None
    section = Section(header=("change", "id", "class", "before", "belief", "note"))
    section.sentences.append(
        f"{found.unchanged} signs as before; {found.unvisited} were not passed again; "
        f"{found.unconfirmed} were missed, but not often enough to be called gone; "
        f"{found.rejected} were rejected by reviewers of drives."
    )
    if not found.changes:
        section.absent = "Nothing has changed."
    for change in found.changes[:_ROWS]:
        section.rows.append(change_row(change))
    if len(found.changes) > _ROWS:
        rest = len(found.changes) - _ROWS
        section.sentences.append(f"{rest} further changes are in changes.geojson.")
    return section


def change_row(change: Any) -> tuple[str, ...]:
    """One change as texts: kind, id, class, class before, belief, note."""
    note = ""
    if change.kind == "moved":
        note = f"{change.distance_m:.1f} m"
    elif change.kind == "new" and change.visited_before is not None:
        note = "passed before without it" if change.visited_before else "not passed before"
    before = "" if change.older is None else change.older.class_name
    return (
        _KINDS[change.kind], change.sign.id, sign_words(change.sign.class_name),
        sign_words(before) if before != change.sign.class_name else "",
        f"{change.belief:.2f}", note,
    )  # fmt: skip


def _drives_section(summary: dict[str, Any]) -> Section:
    section = Section(
        header=(
            "drive", "start, UTC", "signs", "in the map", "off east, m", "north", "up",
            "seen of those in view",
        ),
        folded="All drives" if len(summary["drives"]) > 40 else "",
    )  # fmt: skip
    section.sentences.append(
        "How far each drive's signs lie off the map on average, with one sigma: the error of its "
        "trajectory, which its signs share. It wanders along a drive; sightings.parquet has it "
        "sign by sign."
    )
    for drive in summary["drives"][:_ROWS]:
        offsets = [
            _with_sd(drive["offset_m"][axis], drive["offset_sd_m"][axis])
            for axis in ("e", "n", "u")
        ]
        seen = f"{drive['seen_of_in_view']} of {drive['in_view']}" if drive["in_view"] else ""
        section.rows.append(
            (
                drive["name"], (drive["start"] or "")[:19].replace("T", " "),
                str(drive["signs"]), str(drive["signs_in_map"]), *offsets, seen,
            )
        )  # fmt: skip
    if len(summary["drives"]) > _ROWS:
        section.sentences.append("The rest is in merge.json.")
    return section


def _with_sd(value: float | None, sd: float | None) -> str:
    return "" if value is None or sd is None else f"{round(value, 2) + 0.0:+.2f} ± {sd:.2f}"


def _error_section(summary: dict[str, Any]) -> Section:
    levels = summary["error_levels"]
    section = Section()
    if len(summary["drives"]) == 1:
        section.sentences.append(
            "Of one drive nothing tells how often it sees a sign in view, or whether its errors "
            "are as large as it states."
        )
        return section
    section.sentences.append(
        f"Where drives overlap, what wanders of their errors is {levels['wanders']:.2f} times what "
        f"they state, what lasts all along a drive {levels['lasts']:.2f} times and the signs' own "
        f"errors {levels['own']:.2f} times. Covariances are scaled by that."
    )
    few = len(summary["drives"]) < TELLING_DRIVES
    usual = ", as is usual: two drives do not tell" if few else ""
    section.sentences.append(
        f"A drive that has a sign in view sees it with probability "
        f"{summary['detection_rate']:.2f}{usual}."
    )
    unlikely = summary["unlikely_signs"]
    if unlikely:
        places = "1 place where something was seen is" if unlikely == 1 else (
            f"{unlikely} places where something was seen are"
        )  # fmt: skip
        section.sentences.append(
            f"{places} left out of the map, because drives that should have seen a sign there did "
            "not, or a reviewer of a drive rejected it."
        )
    return section


def _class_section(signs: Signs) -> Section:
    counts = Counter(signs.classes)
    words = words_apart(counts)
    return Section(
        header=("class", "signs"),
        rows=[(words[name], str(n)) for name, n in counts.most_common()],
        folded="All classes" if len(counts) > 20 else "",
    )
