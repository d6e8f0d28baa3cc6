"""Where the drives of a store stand: as JSON, in the terminal, and for a monitor."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from automap.export.clock import iso_texts, utc_of_gps
from automap.io import names
from automap.io.atomic import plain
from pipeline.fleet.orders import current_key
from pipeline.fleet.store import SCHEMA, SETTINGS, Entry, Store
from pipeline.fleet.versions import MAP, current
from pipeline.shared.values import listing, mapping, number
from pipeline.shared.verdicts import KEYS, doubted, verdicts

PAGE, LINES, METRICS = "status.html", "drives.jsonl", "automap_fleet.prom"
FOLDER = "status"
_SHOWN = 20
_CHANGES = ("new", "gone", "class", "moved")
_NUMBERS = ("signs", "hours", "km", "seconds", "processor_s", "peak_bytes")


def drive_line(entry: Entry, key: str | None) -> dict[str, Any]:
    """What is told of one drive."""
    done = entry.done
    told = verdicts(done)
    stored = [number(mapping(f).get("bytes")) or 0 for f in mapping(done.get("files")).values()]
    return {
        "digest": entry.digest,
        "name": entry.name,
        "path": entry.path,
        "state": entry.state(key),
        "reason": _text(entry.aside.get("error")),
        "kind": _text(entry.aside.get("kind")),
        **{key: told[of].state if of in told else None for of, key in KEYS.items()},
        "verdict_reasons": [text for each in told.values() for text in each.reasons],
        "doubts": [doubt.sentence() for doubt in doubted(done)],
        "warnings": [*map(str, listing(done.get("warnings"))), *filter(None, [entry.lost])],
        "older_settings": bool(done and key) and done.get("made_with", done.get("key")) != key,
        **{name: number(done.get(name)) for name in _NUMBERS},
        "stored_bytes": int(sum(stored)) or None,
        "automap": _text(done.get("automap")),
    }


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def status(store: Store) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Counts of the whole store, and a line of each drive."""
    key = store.read(SETTINGS).get("key")
    now = current_key(store)
    drives = [drive_line(entry, key) for entry in store.entries() if not entry.replaced]
    done = [line for line in drives if line["state"] == "done"]

    def total(name: str) -> float:
        return float(sum(line[name] or 0.0 for line in done))

    hours = total("seconds") / 3600.0
    told = {
        "schema": SCHEMA,
        "store": store.place.url,
        "drives": len(drives),
        "done": len(done),
        "waiting": sum(line["state"] == "waiting" for line in drives),
        "aside": sum(line["state"] == "aside" for line in drives),
        "older_settings": sum(line["older_settings"] for line in done),
        "older_version": len(done) if now not in (None, key) else 0,
        "doubtful": sum(bool(line["doubts"]) for line in done),
        "hours": total("hours"),
        "km": total("km"),
        "machine_hours": hours,
        "hours_per_machine_hour": total("hours") / hours if hours else None,
        "km_per_machine_hour": total("km") / hours if hours else None,
        "largest_peak_bytes": max((line["peak_bytes"] or 0 for line in done), default=0),
        "stored_bytes": int(total("stored_bytes")),
        "reasons": {d["path"] or d["name"]: d["reason"] for d in drives if d["state"] == "aside"},
        "map": _map(store, done),
    }
    return dict(plain(told)), [dict(plain(line)) for line in drives]


def _map(store: Store, done: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    version = current(store)
    summary = store.read(f"maps/{version}/{names.MERGE}") if version else {}
    counts = {name: number(summary.get(name)) for name in ("signs", "sightings", "cells")}
    if not version.isdecimal() or None in counts.values():
        # there is none, or what it says of itself is damaged
        return None
    passes = [number(value) for value in mapping(summary.get("last_pass")).values()]
    last = np.array([value for value in passes if value is not None], np.float64)
    folder = store.place.folder
    drives = len(listing(summary.get("drives")))
    return {
        "version": version,
        "path": f"{store.place.url}/maps/{version}" if folder is None else str(folder / MAP),
        "drives": drives,
        "not_in_it": max(len(done) - drives, 0),
        **counts,
        "changes": _counts(summary.get("changes")),
        "oldest_cell": iso_texts(utc_of_gps(last[[last.argmin()]]))[0] if len(last) else None,
        "newest_cell": iso_texts(utc_of_gps(last[[last.argmax()]]))[0] if len(last) else None,
        "warnings": [str(text) for text in listing(summary.get("warnings"))],
        "history": [mapping(step) for step in listing(summary.get("history"))],
    }


def _counts(changes: Any) -> dict[str, int] | None:
    """Signs by what became of them; None where nothing was compared."""
    told = {kind: number(mapping(changes).get(kind)) for kind in _CHANGES}
    return {kind: int(count or 0) for kind, count in told.items()} if changes else None


def summary_lines(told: dict[str, Any], drives: Sequence[dict[str, Any]]) -> list[str]:
    """A store in a few lines, with the reasons."""
    lines = [
        f"{told['store']}: {told['drives']} drives",
        f"  done        {told['done']}, {told['hours']:.1f} hours, {told['km']:.0f} km"
        + _rate(told),
        f"  waiting     {told['waiting']}",
        f"  put aside   {told['aside']}",
    ]
    for line in [d for d in drives if d["state"] == "aside"][:_SHOWN]:
        lines.append(f"    - {line['reason']}")
    if told["doubtful"]:
        lines.append(f"  doubtful    {told['doubtful']}")
        for line in [d for d in drives if d["doubts"]][:_SHOWN]:
            lines.append(f"    - {line['path'] or line['name']}: {'; '.join(line['doubts'])}")
    if told["older_settings"]:
        lines.append(f"  settings    {told['older_settings']} were done with older ones")
    if told["older_version"]:
        lines.append(
            f"  version     {told['older_version']} were done by another version of automap, or "
            "with other files that the settings name; automap fleet run does them anew"
        )
    made = told["map"]
    if made is None:
        lines.append("  map         none; automap fleet merge makes it")
        return lines
    behind = f", {made['not_in_it']} drives are not in it" if made["not_in_it"] > 0 else ""
    lines.append(
        f"  map         {made['path']} ({made['version']}): {made['signs']} signs from "
        f"{made['drives']} drives{behind}"
    )
    if made["changes"]:
        counts = ", ".join(f"{made['changes'][k]} {k}" for k in _CHANGES)
        lines.append(f"  changes     {counts}")
    lines.append(
        f"  cells       {made['cells']}, passed last {str(made['oldest_cell'])[:10]} to "
        f"{str(made['newest_cell'])[:10]}"
    )
    return lines


def _rate(told: dict[str, Any]) -> str:
    # a time next to nothing makes no rate
    if None in (told["hours_per_machine_hour"], told["km_per_machine_hour"]):
        return ""
    return (
        f"; {told['hours_per_machine_hour']:.1f} hours and {told['km_per_machine_hour']:.0f} km "
        "per hour of a process"
    )


def write_status(store: Store, folder: Path | None = None) -> None:
    """Write page, lines and metrics to ``STORE/status``, or to a folder; StoreGoneError where the
    store is not there any more."""
    from pipeline.fleet.page import status_page
    from pipeline.fleet.places import Folder

    store.present()
    told, drives = status(store)
    place, below = (store.place, f"{FOLDER}/") if folder is None else (Folder(folder), "")
    lines = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in drives)
    place.write(f"{below}{PAGE}", status_page(told, drives).encode())
    place.write(f"{below}{LINES}", lines.encode("utf-8", "replace"))
    place.write(f"{below}{METRICS}", metrics(told).encode())


_METRICS = (
    ("drives_done", "done", "Drives that are done"),
    ("drives_waiting", "waiting", "Drives that wait"),
    ("drives_aside", "aside", "Drives put aside"),
    ("drives_doubtful", "doubtful", "Drives done whose path or signs are doubtful or worse"),
    ("driven_hours", "hours", "Hours of the drives that are done"),
    ("driven_km", "km", "Kilometres of the drives that are done"),
    ("machine_hours", "machine_hours", "Hours of processes that the drives took"),
    ("largest_peak_bytes", "largest_peak_bytes", "Most memory that a drive took"),
    ("stored_bytes", "stored_bytes", "Bytes of the drives' results"),
)


def metrics(told: dict[str, Any]) -> str:
    """Gauges in the text format of Prometheus, for the collector of text files."""
    rows = [(name, text, told[field]) for name, field, text in _METRICS]
    made = told["map"] or {}
    rows += [
        ("map_signs", "Signs of the map", made.get("signs", 0)),
        ("map_drives", "Drives of the map", made.get("drives", 0)),
        ("map_version", "Number of the map", int(made.get("version", 0))),
    ]
    for kind, count in (made.get("changes") or {}).items():
        rows.append((f"map_changes_{kind}", f"Signs {kind} against the map before", count))
    return "".join(
        f"# HELP automap_fleet_{name} {text}.\n# TYPE automap_fleet_{name} gauge\n"
        f"automap_fleet_{name} {value:g}\n"
        for name, text, value in rows
    )
