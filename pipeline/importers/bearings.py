"""Finished sightings of another program as a drive folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io import names
from automap.io.atomic import write_text
from pipeline.importers.target import Import, new_drive

_COLUMNS = ("lat_deg", "lon_deg", "bearing_deg", "depth_m", "class", "sd_deg")
_FORMATS = {"lat_deg": ".9f", "lon_deg": ".9f"}
_NOTES = (
    "bearings.csv  camera positions and bearings to objects; no trajectory is needed.",
    "Next: automap run DRIVE.",
)


def import_bearings(
    source: Path, out: Path, truth: Path | None = None, truth_sd: float = 0.0
) -> list[str]:
    """Write the sightings of ``source``, a CSV, as the drive folder ``out``.

    ``truth`` a CSV or GeoJSON of known positions becomes ``truth/signs.geojson``, in a CSV each
    with ``truth_sd`` metres of its own error. Returns warnings. Raises InputError for a table
    without position or bearing, ConfigError when ``out`` holds anything but an earlier import.
    """
    from automap.io.bearings_import import read_foreign_bearings

    with new_drive("bearings", source, out) as run:
        if run.source.is_dir():
            raise InputError(
                f"{run.source} is a folder; name the CSV file with columns lat, lon, bearing."
            )
        columns, sentences = read_foreign_bearings(run.source)
        for text in sentences:
            run.warn(text)
        run.sources.append(run.source)
        write_text(run.folder / names.BEARINGS, _csv(columns))
        if truth is not None:
            _write_truth(run, truth, truth_sd)
        run.write_manifest("", _NOTES)
    return run.warnings


def _csv(columns: dict[str, np.ndarray]) -> str:
    present = [name for name in _COLUMNS if name in columns]
    cells = []
    for name in present:
        if name == "class":
            cells.append([_quoted(str(v)) for v in columns[name]])
        else:
            form = _FORMATS.get(name, ".6g")
            cells.append([format(v, form) if v - v == 0.0 else "" for v in columns[name].tolist()])
    rows = "\n".join(map(",".join, zip(*cells, strict=True)))
    return ",".join(present) + "\n" + rows + ("\n" if rows else "")


def _quoted(text: str) -> str:
    if any(c in text for c in ',"\n\r'):
        return '"' + text.replace('"', '""') + '"'
    return text


def _write_truth(run: Import, truth: Path, sd_m: float) -> None:
    from automap.io.bearings_import import read_foreign_points
    from automap.io.sign_points import read_sign_points

    run.sources.append(truth)
    target = run.folder / names.TRUTH_DIR / names.TRUTH_SIGNS
    if truth.suffix.lower() in (".json", ".geojson"):
        read_sign_points(truth)
        write_text(target, truth.read_text(encoding="utf-8"))
        return
    lat, lon = read_foreign_points(truth)
    features = [
        {
            "type": "Feature",
            "id": f"t{number:04d}",
            "geometry": {"type": "Point", "coordinates": [float(x), float(y)]},
            "properties": {"class": "", "sd_m": sd_m},
        }
        for number, (x, y) in enumerate(zip(lon, lat, strict=True), start=1)
    ]
    write_text(target, json.dumps({"type": "FeatureCollection", "features": features}, indent=1))
