"""A comparison with an inventory as files: GIS layers, CSV, OpenStreetMap change, MapRoulette."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from automap import __version__
from automap.export.beliefs import belief_text
from automap.export.csv_text import csv_cell
from automap.export.icons import sign_words
from automap.export.kml_cells import clean_text
from automap.export.layers import Layer
from automap.export.osm import LONGEST
from automap.export.osm_tags import direction_tag, traffic_sign_tags

WORK = ("missing", "new", "class", "moved")
"""Kinds that somebody has to look at."""


@dataclass(frozen=True)
class ComparedSign:
    """One row: its kind and what map and inventory say; NaN and "" where either says nothing.

    From where it is listed to where it was found ``east_m``, ``north_m``, after the inventory's
    common shift; ``sd_m`` one sigma per axis of that. ``sure`` is "yes" for those that are for
    work, of whose kind nine of ten are expected to be right (missing ones each with such a
    probability), else "no"; ``more_drives`` past an
    unconfirmed sign that would have to miss it until it is surely gone (NaN: nothing is said);
    ``code`` the map's class in the catalogue of the country.
    """

    kind: str
    probability: float
    sure: str
    id: str
    listed_id: str
    class_name: str
    listed_class: str
    listed_code: str
    distance_m: float
    east_m: float
    north_m: float
    sd_m: float
    facing_deg: float
    facing_sd_deg: float
    lon_deg: float
    lat_deg: float
    listed_lon_deg: float
    listed_lat_deg: float
    more_drives: float = float("nan")
    code: str = ""

    @property
    def is_sure(self) -> bool:
        """Whether it is likely enough to be acted on."""
        return self.sure == "yes"

    @property
    def place(self) -> tuple[float, float]:
        """Longitude and latitude: where it was found, else where it is listed."""
        found = np.isfinite(self.lon_deg) and np.isfinite(self.lat_deg)
        return (self.lon_deg, self.lat_deg) if found else (self.listed_lon_deg, self.listed_lat_deg)

    @property
    def sentence(self) -> str:
        """What to look at, for people."""
        words = sign_words(self.class_name) or "a sign"
        listed = sign_words(self.listed_class) or self.listed_code or "a sign"
        sure = f"probability {belief_text(self.probability)}"
        if self.kind == "new":
            return f"{words} stands here and is not in the inventory ({sure})."
        if self.kind == "missing":
            return (
                f"{listed} ({self.listed_id}) is in the inventory and was not seen: gone ({sure}), "
                "or hidden from every drive by something that stays."
            )
        if self.kind == "class":
            return f"{self.listed_id} is listed as {listed} and was read as {words} ({sure})."
        if self.kind == "moved":
            return (
                f"{words} ({self.listed_id}) was found {self.distance_m:.1f} m from where it is "
                f"listed, sd {self.sd_m:.1f} m ({sure})."
            )
        return f"{words or listed}: {self.kind}."


def comparison_layers(rows: Sequence[ComparedSign]) -> list[Layer]:
    """``comparison``, points where a sign was found (else where it is listed), and ``shifts``,
    lines from where a sign is listed to where it was found."""
    import shapely

    columns: dict[str, Any] = {}
    for field in fields(ComparedSign):
        values = [getattr(row, field.name) for row in rows]
        number = field.type == "float"
        columns["class" if field.name == "class_name" else field.name] = (
            np.array(values, np.float64)
            if number
            else np.array([clean_text(v) or None for v in values], object)
        )
    place = np.array([row.place for row in rows], np.float64).reshape(-1, 2)
    points = np.full(len(rows), None, object)
    good = np.isfinite(place).all(axis=1)
    points[good] = shapely.to_wkb(shapely.points(place[good]))
    pair = [k for k, row in enumerate(rows) if row.kind in ("moved", "class", "matched")]
    ends = np.array(
        [
            [[rows[k].listed_lon_deg, rows[k].listed_lat_deg], [rows[k].lon_deg, rows[k].lat_deg]]
            for k in pair
        ]
    ).reshape(-1, 2, 2)
    lines = np.asarray(shapely.to_wkb(shapely.linestrings(ends)), object).reshape(-1)
    picked = {name: columns[name][pair] for name in ("kind", "id", "listed_id", "distance_m")}
    return [
        Layer("comparison", "Point", points, columns, {}),
        Layer("shifts", "LineString", lines, picked, {}),
    ]


def comparison_csv(rows: Sequence[ComparedSign]) -> str:
    """The rows as CSV, in their order."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    names = [field.name for field in fields(ComparedSign)]
    writer.writerow(["class" if name == "class_name" else name for name in names])
    for row in rows:
        writer.writerow([_cell(name, getattr(row, name)) for name in names])
    return stream.getvalue().encode("utf-8", "replace").decode()


def _cell(name: str, value: Any) -> str:
    if isinstance(value, str):
        return csv_cell(value)
    if not np.isfinite(value):
        return ""
    # eight decimals of a degree are a millimetre
    return f"{value:.8f}" if name.endswith(("lon_deg", "lat_deg")) else f"{value:.3f}"


def osm_change(rows: Sequence[ComparedSign], country: str | None) -> str:
    """An osmChange file to be looked through in JOSM: sure new signs, each with a ``fixme``.

    What OpenStreetMap has already is left alone: a change there states all tags of an object, and
    an inventory holds but some of them. Those are among the tasks for people.
    """
    nodes = [
        _node(row, -number, country)
        for number, row in enumerate((r for r in rows if r.kind == "new" and r.is_sure), start=1)
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<osmChange version="0.6" generator="AutoMap {__version__}">',
    ]
    if nodes:
        lines += ["  <create>", *nodes, "  </create>"]
    return "\n".join([*lines, "</osmChange>"]) + "\n"


def _node(row: ComparedSign, number: int, country: str | None) -> str:
    lon, lat = row.place
    tags = traffic_sign_tags(row.class_name, country)
    tags |= direction_tag(row.facing_deg, row.facing_sd_deg)
    tags |= {"source": "AutoMap", "fixme": f"check: {row.sentence}"}
    cells = "".join(
        f"      <tag k={quoteattr(key)} v={quoteattr(_plain(value))}/>\n"
        for key, value in tags.items()
    )
    return (
        f'    <node id="{number}" version="0" lat="{lat:.7f}" lon="{lon:.7f}">\n{cells}    </node>'
    )


def _plain(value: str) -> str:
    return clean_text(value).encode("utf-8", "replace").decode()[:LONGEST]


def maproulette_tasks(rows: Sequence[ComparedSign]) -> str:
    """Line by line GeoJSON (RFC 8142), each line one task of a MapRoulette challenge, for what is
    sure."""
    lines = []
    for row in rows:
        if row.kind not in WORK or not row.is_sure:
            continue
        lon, lat = row.place
        name = f"{row.kind}-{row.id or row.listed_id}"
        properties = {
            "id": name,
            "kind": row.kind,
            "instruction": row.sentence,
            "probability": round(row.probability, 3),
            "sign": row.id,
            "listed": row.listed_id,
            "class": row.class_name,
            "listed_class": row.listed_class,
        }
        feature = {
            "type": "Feature",
            "id": name,
            "geometry": {"type": "Point", "coordinates": [round(lon, 7), round(lat, 7)]},
            "properties": properties,
        }
        lines.append("\x1e" + json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return "".join(f"{line}\n" for line in lines)
