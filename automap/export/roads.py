"""Where signs stand on the roads of a layer, as a table beside the map and in its columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.export.csv_text import csv_cell
from automap.export.dictionary import SIGN_ROAD_FIELDS
from automap.export.fields import ROAD_FIELDS
from automap.export.sign_columns import SignColumns, wrap_degrees
from automap.records import RoadPosition, Roads, Sign
from automap.signs.on_roads import road_check

RoadRow = Mapping[str, str]
"""The cells of one sign by the names of ``dictionary.SIGN_ROAD_FIELDS``."""
SAME_PLACE_DEG = 1e-6
"""A decimetre: a sign that stands further from where it was put on its road was moved since."""


def road_rows(
    signs: Sequence[Sign], positions: Sequence[RoadPosition | None], roads: Roads
) -> list[RoadRow]:
    """One row for every sign that stands on a road."""
    rows: list[RoadRow] = []
    for sign, at in zip(signs, positions, strict=True):
        if at is not None:
            cells = (
                sign.id,
                roads.ids[at.road],
                roads.names[at.road],
                roads.kind(at.road),
                f"{at.chainage_m:.2f}",
                f"{at.offset_m:.2f}",
                at.side,
                at.direction,
                f"{float(wrap_degrees(np.degrees(np.array([sign.lon_rad])))[0]):.7f}",
                f"{np.degrees(sign.lat_rad):.7f}",
            )
            rows.append(dict(zip((f.name for f in SIGN_ROAD_FIELDS), cells, strict=True)))
    return rows


def roads_csv(rows: Sequence[RoadRow]) -> str:
    """The rows as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow([field.name for field in SIGN_ROAD_FIELDS])
    for row in rows:
        writer.writerow(
            [row[f.name] if f.kind == "real" else csv_cell(row[f.name]) for f in SIGN_ROAD_FIELDS]
        )
    return stream.getvalue().encode("utf-8", "replace").decode()


def read_roads_csv(path: Path) -> list[RoadRow]:
    """The rows of a file that ``roads_csv`` made; InputError for one that is none."""
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        return [
            {
                f.name: str(float(row[f.name]))
                if f.kind == "real"
                else csv_cell(row[f.name], back=True)
                for f in SIGN_ROAD_FIELDS
            }
            for row in rows
        ]
    except (UnicodeDecodeError, csv.Error, KeyError, AttributeError, TypeError, ValueError) as why:
        raise InputError(f"it is no table of signs on roads ({why}); run the export again") from why


def set_roads(columns: SignColumns, rows: Sequence[RoadRow], country: str | None = None) -> int:
    """Put the rows into the signs' columns; without any the columns have nothing of roads.

    Rows of signs that were moved since are left out; returns how many.
    """
    for field in ROAD_FIELDS:
        columns.values.pop(field.name, None)
    if not rows:
        return 0
    by_sign = {row["sign_id"]: row for row in rows}
    own: list[RoadRow] = []
    moved = 0
    for k, name in enumerate(columns.values["id"]):
        row = by_sign.get(name, {})
        if row:
            apart = (
                float(row["lon_deg"]) - float(columns.lon_deg[k]),
                float(row["lat_deg"]) - float(columns.lat_deg[k]),
            )
            if not max(map(abs, apart)) < SAME_PLACE_DEG:
                moved, row = moved + 1, {}
        own.append(row)
    for field in ROAD_FIELDS:
        if field.name == "road_check":
            continue
        cells = [row.get(field.name, "") for row in own]
        columns.values[field.name] = (
            np.array([float(cell or "nan") for cell in cells], np.float64)
            if field.kind == "real"
            else [cell or None for cell in cells]
        )
    columns.values["road_check"] = [
        road_check(name, row.get("road_kind", ""), country) or None
        for name, row in zip(columns.values["class"], own, strict=True)
    ]
    return moved
