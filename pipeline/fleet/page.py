"""The page of a store: what a manager asks of a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.pages.render import sections_page
from pipeline.pages.section import Figure, Section
from pipeline.report.figures import duration_text, metres_text
from pipeline.shared.values import mapping

_ROWS = 500


def status_page(told: dict[str, Any], drives: Sequence[dict[str, Any]]) -> str:
    """The page of what ``status`` tells."""
    made = told["map"]
    driven = f"{duration_text(3600.0 * told['hours'])}, {metres_text(1000.0 * told['km'])}"
    figures = [
        Figure(str(told["done"]), "drives done", driven),
        Figure(str(told["waiting"]), "waiting", ""),
        Figure(str(told["aside"]), "put aside", ""),
        Figure(str(told["doubtful"]), "doubtful", "or unusable"),
    ]
    if made is not None:
        figures.append(Figure(str(made["signs"]), "signs", f"map {made['version']}"))
    parts = [
        ("Put aside", _aside(drives)),
        ("Doubtful paths", _doubtful(drives)),
        ("Map", _map(made)),
        ("Cost", _cost(told)),
        ("Drives", _drives(drives)),
    ]
    warnings = made["warnings"] if made is not None else []
    return sections_page("Fleet", told["store"], figures, parts, warnings)


def _aside(drives: Sequence[dict[str, Any]]) -> Section:
    rows: list[tuple[str, ...]] = [
        (d["name"], d["kind"] or "", d["reason"] or "") for d in drives if d["reason"]
    ]
    return Section(
        header=("drive", "kind", "reason"),
        rows=rows[:_ROWS],
        absent="" if rows else "No drive was put aside.",
    )


def _doubtful(drives: Sequence[dict[str, Any]]) -> Section:
    rows: list[tuple[str, ...]] = [
        (d["path"], "; ".join(d["doubts"])) for d in drives if d["doubts"]
    ]
    return Section(
        header=("drive", "what is doubtful"),
        rows=rows[:_ROWS],
        absent="" if rows else "Path and signs of every drive that is done may be relied on.",
    )


def _map(made: dict[str, Any] | None) -> Section:
    if made is None:
        return Section(absent="There is no map yet.")
    section = Section(header=("map", "drives", "signs", "new", "gone", "another class", "moved"))
    section.sentences.append(
        f"{made['path']}: {made['signs']} signs from {made['sightings']} sightings of "
        f"{made['drives']} drives, in {made['cells']} cells, the one that was not passed for "
        f"longest last on {str(made['oldest_cell'])[:10]}."
    )
    for step in reversed(made["history"]):
        changes = mapping(step.get("changes"))
        section.rows.append(
            (
                *(str(step.get(name, "")) for name in ("map", "drives", "signs")),
                *(str(changes.get(kind, "")) for kind in ("new", "gone", "class", "moved")),
            )
        )  # fmt: skip
    return section


def _cost(told: dict[str, Any]) -> Section:
    if not told["machine_hours"]:
        return Section(absent="No drive is done yet.")
    if None in (told["hours_per_machine_hour"], told["km_per_machine_hour"]):
        return Section(absent="The drives that are done do not say how long they took.")
    return Section(
        sentences=[
            f"The drives that are done took {duration_text(3600.0 * told['machine_hours'])} of a "
            f"process, for {told['hours_per_machine_hour']:.1f} hours and "
            f"{told['km_per_machine_hour']:.0f} km of road in each hour; "
            f"{told['largest_peak_bytes'] / 1e9:.2f} GB of memory at most, and "
            f"{told['stored_bytes'] / 1e9:.3g} GB in the store."
        ]
    )


def _drives(drives: Sequence[dict[str, Any]]) -> Section:
    section = Section(
        header=("drive", "state", "verdict", "signs", "km", "minutes of a process", "memory, GB"),
        folded="All drives" if len(drives) > 40 else "",
    )
    for d in drives[:_ROWS]:
        section.rows.append(
            (
                d["name"], d["state"], d["verdict"] or "", _number(d["signs"], 1.0, 0),
                _number(d["km"], 1.0, 1), _number(d["seconds"], 60.0, 1),
                _number(d["peak_bytes"], 1e9, 2),
            )
        )  # fmt: skip
    if len(drives) > _ROWS:
        section.sentences.append("The rest is in drives.jsonl.")
    return section


def _number(value: float | None, unit: float, digits: int) -> str:
    return "" if value is None else f"{value / unit:.{digits}f}"
