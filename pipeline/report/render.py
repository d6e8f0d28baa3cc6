"""Putting the page together: everything it needs stands in the one file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from automap import __version__
from automap.export.beliefs import belief_text
from automap.export.clock import iso_texts, utc_of_gps
from automap.export.icons import words_apart
from automap.export.roads import read_roads_csv, set_roads
from automap.export.sign_columns import Signs, sign_columns
from automap.io import names
from automap.io.web_tiles import Background
from pipeline.pages.render import render
from pipeline.report.evaluation_section import evaluation_section
from pipeline.report.figures import key_figures
from pipeline.report.fusion_section import fusion_section
from pipeline.report.map_data import map_data
from pipeline.report.sections import (
    innovation_section,
    motion_section,
    sensor_section,
    uncertainty_section,
)
from pipeline.report.sync_section import sync_section
from pipeline.report.verdict_section import verdict_section
from pipeline.shared.pictures import read_pictures
from pipeline.shared.products import RunProducts
from pipeline.shared.run_record import country_of, without_folder
from pipeline.shared.values import mapping

TABLE_LIMIT = 1000


def report_html(
    products: RunProducts,
    name: str,
    record: dict[str, Any],
    background: Background | None = None,
) -> str:
    """The page for a run named ``name``; ``record`` is run.json as it stands, ``background`` what
    lies below its map."""
    country = country_of(record)
    signs = sign_columns(products.signs or [], products.clock, country)
    set_roads(signs, products.attempt(names.SIGN_ROADS, read_roads_csv) or [], country)
    sections = {
        "fusion": fusion_section(products),
        "evaluation": evaluation_section(products),
        "sync": sync_section(products),
        "innovations": innovation_section(products),
        "uncertainty": uncertainty_section(products),
        "sensors": sensor_section(products),
        "motion": motion_section(products),
    }
    heading, sections["verdict"] = verdict_section(record)
    content = map_data(products, signs, read_pictures(products), background)
    facts = _facts(products, record)
    return render(
        "report.html.j2",
        leaflet=content is not None,
        name=name,
        when=_when(products),
        figures=key_figures(products, signs),
        # last of all that reads, so that it knows every file that could not be read
        warnings=_warnings(products, record),
        verdict=heading,
        sections=sections,
        sign_table=sign_list(signs),
        map=content,
        stages=_stages(record),
        settings=_flat_rows(record.get("settings")),
        metrics=_flat_rows(record.get("metrics")),
        versions=_versions(record),
        facts=facts,
    )


def _when(products: RunProducts) -> str:
    trajectory = products.trajectory
    if trajectory is None:
        return ""
    first, last = iso_texts(utc_of_gps(trajectory.gps_s[[0, -1]]))
    if first is None or last is None:
        return ""
    day, start = first[:10], first[11:19]
    end = last[11:19] if last[:10] == day else f"{last[:10]} {last[11:19]}"
    return f"{day}, {start} to {end} UTC"


def _warnings(products: RunProducts, record: dict[str, Any]) -> list[str]:
    warnings = record.get("warnings")
    texts = [str(text) for text in warnings] if isinstance(warnings, list) else []
    stages = record.get("stages")
    for stage in stages.values() if isinstance(stages, dict) else ():
        texts += [str(text) for text in mapping(stage).get("warnings") or ()]
    folders = [str(products.out.absolute()), str(products.out)]
    folders += [str(path) for path in (mapping(record.get("drive")).get("path"),) if path]
    told = []
    for text in texts + products.problems:
        for folder in folders:
            # where it lies is this computer's business
            text = text.replace(f"{folder.rstrip('/')}/", "")
            # as it was given from somewhere above
            given = rf"(?<![^\s'\"(])(?:[^\s/'\"(]+/)*{re.escape(Path(folder).name)}/"
            text = re.sub(given, "", text) if Path(folder).name else text
        told.append(text)
    return list(dict.fromkeys(told))


def _stages(record: dict[str, Any]) -> list[tuple[str, str, str, str, str]]:
    rows = []
    for name, value in mapping(record.get("stages")).items():
        stage = mapping(value)
        seconds = stage.get("seconds")
        took = f"{seconds:.2f} s" if isinstance(seconds, int | float) else ""
        state = str(stage.get("status", ""))
        if state == "done" and stage.get("ran") is False:
            state = "kept"
        # the report is being written while its own stage runs
        state = "writing" if state == "running" else state
        rows.append(
            (str(name), state, took, str(stage.get("result", "")), str(stage.get("reason", "")))
        )
    return rows


def _flat_rows(value: Any, prefix: str = "") -> list[tuple[str, str]]:
    if not isinstance(value, dict):
        return []
    rows: list[tuple[str, str]] = []
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, dict):
            rows += _flat_rows(item, f"{name}.")
        elif isinstance(item, list):
            rows.append((name, ", ".join(_text(part) for part in item)))
        else:
            rows.append((name, _text(item)))
    return rows


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}" if abs(value) < 1e6 else f"{value:.3f}"
    return "" if value is None else without_folder(str(value))


def _versions(record: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [("automap", str(record.get("automap", __version__)))]
    rows += [(key, str(record[key])) for key in ("python", "platform") if key in record]
    return rows + [(k, str(v)) for k, v in mapping(record.get("packages")).items()]


def _facts(products: RunProducts, record: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    command = record.get("command")
    if command:
        rows.append(("command", " ".join(map(without_folder, str(command).split(" ")))))
    drive = mapping(record.get("drive"))
    if drive.get("path"):
        rows.append(("drive folder", without_folder(str(drive["path"]))))
    if record.get("started"):
        rows.append(("run started", str(record["started"])))
    for key, value in _flat_rows(products.json(names.INGEST)):
        rows.append((f"read: {key}", value))
    for key, value in _flat_rows(products.json(names.FUSION)):
        rows.append((f"fused: {key}", value))
    return [(key, value) for key, value in rows if len(value) < 400]


def sign_list(signs: Signs) -> dict[str, Any]:
    """The table of the signs: heads, rows, and how many are left out."""
    shown = {"id", "class", "code", "confidence", "n_views", "ce95_m", "side", "facing_deg",
             "height_above_road_m", "size_m", "road_name", "chainage_m", "road_check",
             "status"}  # fmt: skip
    shown_values = signs.first(TABLE_LIMIT).values
    if not any(shown_values["code"]):
        shown.discard("code")
    fields = [field for field in signs.fields if field.name in shown]
    words = words_apart({str(name) for name in signs.classes})
    rows = []
    for row in range(min(len(signs), TABLE_LIMIT)):
        cells = []
        for field in fields:
            value = shown_values[field.name][row]
            if field.name == "confidence":
                value = "" if value != value else belief_text(value)
            elif field.kind == "real":
                value = "" if value != value else f"{value:.{field.decimals}f}"
            elif field.name == "class":
                value = words[str(value)]
            cells.append("" if value is None else str(value))
        rows.append(cells)
    heads = [(f.title, f) for f in fields]
    return {"heads": heads, "rows": rows, "left_out": max(0, len(signs) - TABLE_LIMIT)}
