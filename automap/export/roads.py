"""Where signs stand on the roads of a layer, as a table and as a layer of the map."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.export.csv_text import csv_cell
from automap.export.dictionary import ROAD_FIELDS
from automap.export.layers import Layer, point_wkb
from automap.export.sign_columns import SignColumns
from automap.records import RoadPosition, Roads, Sign

RoadRow = Mapping[str, str]
"""The cells of one sign by the names of ``dictionary.ROAD_FIELDS``."""


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
                f"{at.chainage_m:.2f}",
                f"{at.offset_m:.2f}",
                at.side,
                at.direction,
            )
            rows.append(dict(zip((f.name for f in ROAD_FIELDS), cells, strict=True)))
    return rows


def roads_csv(rows: Sequence[RoadRow]) -> str:
    """The rows as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow([field.name for field in ROAD_FIELDS])
    for row in rows:
        writer.writerow(
            [row[f.name] if f.kind == "real" else csv_cell(row[f.name]) for f in ROAD_FIELDS]
        )
    return stream.getvalue().encode("utf-8", "replace").decode()


def read_roads_csv(path: Path) -> list[RoadRow]:
    """The rows of a file that ``roads_csv`` made; InputError for one that is none."""
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        return [
            {
                f.name: row[f.name] if f.kind == "real" else csv_cell(row[f.name], back=True)
                for f in ROAD_FIELDS
            }
            for row in rows
        ]
    except (UnicodeDecodeError, csv.Error, KeyError, AttributeError, TypeError) as error:
        raise InputError(f"it is no table of signs on roads ({error})") from error


def road_layer(columns: SignColumns, rows: Sequence[RoadRow]) -> Layer:
    """Layer ``sign_roads``: the signs that stand on a road, with their places on it."""
    place = {name: k for k, name in enumerate(columns.values["id"])}
    known = [row for row in rows if row["sign_id"] in place]
    arrays = {
        f.name: np.array([float(row[f.name]) for row in known], np.float64)
        if f.kind == "real"
        else np.array([row[f.name] or None for row in known], object)
        for f in ROAD_FIELDS
    }
    points = point_wkb(columns)[[place[row["sign_id"]] for row in known]]
    return Layer("sign_roads", "Unknown", points, arrays, {})
