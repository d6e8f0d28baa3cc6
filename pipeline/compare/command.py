"""``automap compare``: a map and an inventory in, what differs out."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap import __version__
from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.atomic import make_folder, write_json, write_text
from pipeline.shared.products import RunProducts, load_products
from pipeline.shared.values import json_object

if TYPE_CHECKING:
    from automap.export.inventory import ComparedSign
    from automap.inventory.comparison import InventoryComparison
    from automap.inventory.findings import Inventory
    from automap.io.inventory_file import InventoryFile
    from automap.mapping.sightings import DriveSigns
    from automap.records import Sign

GPKG, CSV, REPORT = "comparison.gpkg", "comparison.csv", "report.html"
OSM, TASKS, SUMMARY = "comparison.osc", "maproulette.geojson", "comparison.json"
KINDS = ("matched", "moved", "class", "new", "missing", "unconfirmed", "not_seen")


@dataclass(frozen=True)
class CompareOutcome:
    """``rows`` of all signs, ``summary`` as comparison.json has it, ``files`` written."""

    rows: list[ComparedSign]
    summary: dict[str, Any]
    files: list[Path]
    warnings: list[str]


def compare_with_inventory(
    folder: Path,
    inventory: Path,
    out: Path,
    columns: Mapping[str, str] | None = None,
    crs: str | None = None,
    layer: str | None = None,
    country: str | None = None,
) -> CompareOutcome:
    """Compare the map in ``folder`` with the list in ``inventory`` and write the result to ``out``.

    ``columns`` names the list's columns by role, ``crs`` its coordinate system, ``country`` the
    catalogue of its codes where they do not say (default: the drive's). Raises InputError for a
    folder without a map and a list that cannot be used, ConfigError for an ``out`` in the way.
    """
    from automap.export.gis import write_layers
    from automap.export.inventory import (
        comparison_csv,
        comparison_layers,
        maproulette_tasks,
        osm_change,
    )
    from automap.export.inventory_style import comparison_styles
    from automap.inventory.comparison import compare_inventory
    from automap.inventory.country import country_of_list
    from automap.io.inventory_file import read_inventory
    from automap.signs.classes import country_set, load_classes
    from automap.signs.national import country_code
    from pipeline.compare.doubts import doubts
    from pipeline.compare.listing import listed_signs, no_country, placeless, without_repeats
    from pipeline.compare.report import comparison_report
    from pipeline.shared.run_record import country_of, drive_of, results_of

    if country is not None and not country_code(country):
        raise ConfigError(f"--country {country}: give two letters of ISO 3166, such as AU.")
    folder = results_of(folder)
    if out.resolve() == folder.resolve() or (out / names.RUN).is_file():
        raise ConfigError(f"-o {out} holds a map; choose another folder for the comparison.")
    products = _map(folder)
    warnings = list(products.problems)
    signs = _signs(products, warnings)
    near = (np.array([s.lat_rad for s in signs]), np.array([s.lon_rad for s in signs]))
    read = read_inventory(inventory, columns, crs, layer, near if signs else None)
    warnings += read.warnings
    driven = country_of(products.json(names.RUN))
    named = {sign.class_name for sign in signs}
    listed, rows_of = listed_signs(read, country or driven, inventory, warnings, named)
    listed, rows_of = without_repeats(listed, rows_of, read, signs, inventory, warnings)
    drives = _drives(folder, warnings)
    at_home = len(country_set(driven)) < len(load_classes())
    shares, left_out = _class_shares(products, signs), _left_out(folder, warnings)
    if any(shares) and not driven:
        warnings += no_country(folder, country or country_of_list(read.codes, listed.class_name))
    country = country or driven
    result = compare_inventory(signs, listed, drives, shares, at_home, left_out)
    doubtful, findings = doubts(result, signs, listed, inventory, placeless(read, country))
    warnings += doubtful
    rows = [_row(finding, signs, listed, read, rows_of, country) for finding in findings]
    summary = _summary(result, rows, read, inventory, len(signs), country)
    make_folder(out)
    layers = comparison_layers(rows)
    write_layers(out / GPKG, layers, crs="OGC:CRS84", styles=comparison_styles())
    write_text(out / CSV, comparison_csv(rows))
    write_text(out / OSM, osm_change(rows, country))
    write_text(out / TASKS, maproulette_tasks(rows))
    name = drive_of(folder)[0]
    # pages are given away: where files lie is nobody's business
    told = [text.replace(str(inventory), inventory.name) for text in warnings]
    told = [text.replace(str(folder), name) for text in told]
    write_text(out / REPORT, comparison_report(name, rows, summary, products, told))
    write_json(out / SUMMARY, summary)
    files = [out / file for file in (GPKG, CSV, OSM, TASKS, REPORT, SUMMARY)]
    return CompareOutcome(rows, summary, files, warnings)


def _map(folder: Path) -> RunProducts:
    if not folder.is_dir():
        raise InputError(f"{folder}: no such map; give a folder of automap run or merge.")
    products = load_products(folder)
    if products.signs is None:
        none = f"{folder} holds no signs; run the drive up to the export first."
        raise InputError(products.lost.get(names.SIGNS_RAW, none))
    return products


def _signs(products: RunProducts, warnings: list[str]) -> list[Sign]:
    """Signs that have a position and are not the backs of others."""
    from automap.signs.backs import is_back

    signs = [s for s in products.signs or [] if not is_back(s.class_name)]
    placed = [s for s in signs if math.isfinite(s.lat_rad) and math.isfinite(s.lon_rad)]
    if len(placed) < len(signs):
        warnings.append(f"{len(signs) - len(placed)} signs of the map have no position.")
    return placed


def _drives(folder: Path, warnings: list[str]) -> list[DriveSigns]:
    """Where cameras looked, drive by drive; a merged map without tracks counts as one drive."""
    from automap.io.map_tables import COVERAGE, TRACKS, read_coverage, read_tracks
    from automap.mapping.compare import COVERAGE_VIEW
    from automap.mapping.sightings import DriveSigns
    from automap.mapping.visibility import STRIDE
    from automap.records import DrivePath
    from pipeline.merge.inputs import even_path, read_run

    if not (folder / names.MERGE).is_file():
        run = read_run(folder)
        warnings.extend(run.warnings)
        return [run.signs]
    paths: dict[str, DrivePath] = {}
    if (folder / TRACKS).is_file():
        told = json_object(folder / names.MERGE).get("drives")
        blind = {d.get("name") for d in told or () if d.get("looked") is False}
        for name, track in read_tracks(folder / TRACKS).items():
            if len(track) and name not in blind:
                paths[name] = even_path(track)
    elif (folder / COVERAGE).is_file():
        looked = read_coverage(folder / COVERAGE)
        # a row is a cell by itself, and of paths every second row is looked at
        paths[""] = DrivePath(
            *(np.repeat(getattr(looked, f.name), STRIDE, axis=0) for f in fields(DrivePath))
        )
    else:
        warnings.append(
            f"{folder} has neither {TRACKS} nor {COVERAGE}: what was in view is not known, so "
            "nothing is missing."
        )
    blank: dict[str, Any] = {
        f.name: np.zeros(0) for f in fields(DriveSigns) if f.default is MISSING
    }
    blank |= {"start_gps_s": math.nan, "ids": (), "cov_enu": np.zeros((0, 3, 3))}
    return [
        DriveSigns(**blank | {"name": name, "path": path, "cameras": (COVERAGE_VIEW,)})
        for name, path in paths.items()
    ]


def _left_out(folder: Path, warnings: list[str]) -> list[Sign]:
    """What drives of a merge saw and its map leaves out as unlikely, each drive's by itself, less
    what that drive is off there; without its covariance and facing, which are not kept."""
    from automap.earth import metres_per_radian
    from automap.io.map_tables import SIGHTINGS
    from automap.io.tables import read_table
    from automap.records import Sign

    if not (folder / names.MERGE).is_file() or not (folder / SIGHTINGS).is_file():
        return []
    numbers = ("lat_deg", "lon_deg", "existence", "offset_e_m", "offset_n_m")
    left_out: list[Sign] = []
    try:
        columns = ("sign_id", "key", "drive", "class", *numbers)
        table = read_table(folder / SIGHTINGS, columns, numbers)
    except InputError as error:
        warnings.append(f"{error} What drives saw and the map leaves out does not count.")
        return left_out
    unknown, nan = np.full((3, 3), math.nan), math.nan
    for row in table.filter(table.column("sign_id").is_null()).to_pylist():
        lat, lon, exists, east, north = (nan if row[n] is None else float(row[n]) for n in numbers)
        lat, lon = math.radians(lat), math.radians(lon)
        per_lat, per_lon = metres_per_radian(lat, 0.0)
        lat, lon = lat - north / float(per_lat), lon - east / float(per_lon)
        if math.isfinite(lat) and math.isfinite(lon) and math.isfinite(exists):
            left_out.append(Sign(
                row["key"], row["class"] or "", lat, lon, nan, unknown, exists, 0, 0, 0, nan,
                nan, nan, "", drives=(row["drive"] or "",), existence=exists,
            ))  # fmt: skip
    return left_out


def _class_shares(products: RunProducts, signs: Sequence[Sign]) -> list[dict[str, float]]:
    """What the views of each sign give to each class, where the runs' detector tells it.

    A name that several drives gave says more than the mean of their views does.
    """
    from automap.io.detections_table import CLASS_SHARES
    from automap.signs.class_shares import mean_of
    from automap.signs.classes import load_classes

    seen = products.observations
    if seen is None or not {CLASS_SHARES, "sign_id"} <= set(seen.column_names):
        return []
    rows = seen.group_by(["sign_id", CLASS_SHARES]).aggregate([([], "count_all")])
    counts: dict[str, dict[str, int]] = {}
    for sign, text, n in zip(*(rows[k].to_pylist() for k in rows.column_names), strict=True):
        counts.setdefault(sign or "", {})[text or ""] = n
    named = load_classes()
    return [
        mean_of(counts.get(s.id, {})) if len(s.drives) < 2 or s.class_name not in named else {}
        for s in signs
    ]


def _row(
    finding: Any,
    signs: Sequence[Sign],
    listed: Inventory,
    read: InventoryFile,
    rows_of: Sequence[int],
    country: str | None,
) -> ComparedSign:
    from automap.export.inventory import ComparedSign
    from automap.signs.national import national_code

    sign = signs[finding.sign] if finding.sign >= 0 else None
    at = finding.listed
    facing = sign.facing_rad if sign is not None else listed.facing_rad[at]
    return ComparedSign(
        kind=finding.kind,
        probability=finding.probability,
        sure="yes" if finding.sure else "no",
        id="" if sign is None else sign.id,
        listed_id="" if at < 0 else listed.ids[at],
        class_name="" if sign is None else sign.class_name,
        listed_class="" if at < 0 else listed.class_name[at],
        listed_code="" if at < 0 else read.codes[rows_of[at]],
        distance_m=finding.distance_m,
        east_m=finding.east_m,
        north_m=finding.north_m,
        sd_m=finding.sd_m,
        facing_sd_deg=math.nan if sign is None else math.degrees(sign.facing_sd_rad),
        facing_deg=math.degrees(facing) % 360.0 if math.isfinite(facing) else math.nan,
        lon_deg=math.nan if sign is None else math.degrees(sign.lon_rad),
        lat_deg=math.nan if sign is None else math.degrees(sign.lat_rad),
        listed_lon_deg=math.nan if at < 0 else math.degrees(listed.lon_rad[at]),
        listed_lat_deg=math.nan if at < 0 else math.degrees(listed.lat_rad[at]),
        more_drives=finding.more_drives or math.nan,
        code="" if sign is None else national_code(sign.class_name, country) or "",
    )


def _summary(
    result: InventoryComparison,
    rows: Sequence[ComparedSign],
    read: InventoryFile,
    inventory: Path,
    n_signs: int,
    country: str | None,
) -> dict[str, Any]:
    """The content of comparison.json."""
    from pipeline.compare.alike import moved_alike

    counts = Counter(row.kind for row in rows)
    sure = Counter(row.kind for row in rows if row.is_sure)
    square = result.normalised_square
    stated = np.asarray(read.sd_m, np.float64)
    return {
        "schema": "automap.comparison/1",
        "automap": __version__,
        "inventory": inventory.name,
        "columns": read.columns,
        "columns_not_used": list(read.unread),
        "country": country,
        "signs": n_signs,
        "listed": len(read),
        "kinds": {kind: counts.get(kind, 0) for kind in KINDS},
        "sure": {kind: sure.get(kind, 0) for kind in KINDS},
        "inventory_shift_m": {"e": float(result.shift_m[0]), "n": float(result.shift_m[1])},
        "inventory_sd_m": result.sd_m,
        "inventory_sd_stated_m": float(np.median(stated)) if np.isfinite(stated).all() else None,
        "normalised_square": None if math.isnan(square) else square,
        "moved_alike": [
            {
                "listed_ids": [rows[k].listed_id for k in group.rows],
                "e": group.east_m,
                "n": group.north_m,
            }
            for group in moved_alike(result.findings)
        ],
        "detection_rate": result.detection,
        "directions_turned": result.directions.turned,
        "directions_used": result.directions.used,
    }


def columns_of(text: str | None) -> dict[str, str]:
    """``class=VZ_NR,id=NR`` as a mapping; ConfigError for anything else."""
    columns = {}
    for part in (text or "").split(","):
        role, sign, name = part.partition("=")
        if part.strip() and not (sign and role.strip() and name.strip()):
            raise ConfigError(f"--columns: {part!r} is not of the form ROLE=COLUMN.")
        if part.strip():
            columns[role.strip()] = name.strip()
    return columns


def summary_text(summary: Mapping[str, Any]) -> str:
    """comparison.json as text."""
    return json.dumps(summary, indent=2)
