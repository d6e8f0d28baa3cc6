"""Lines of roads from a GIS file or an extract of OpenStreetMap."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.vector_layer import (
    VectorLayer,
    column_named,
    numbers,
    read_layer,
    texts,
    to_degrees,
)
from automap.records import Roads

_IDS = (
    *("roadid", "strassenschluessel", "strassennummer", "strassennr", "id", "osmid", "wayid"),
    *("roadno", "roadnr", "roadnumber", "roadkey", "roadcode", "strnr", "strno", "strassenno"),
    *("routeid", "strid", "linkid", "segmentid", "ref", "nr", "fid", "gid"),
)
_NAMES = (
    *("name", "roadname", "strname", "streetname", "strassenname", "strasse", "bezeichnung", "ref"),
)
_STARTS = (
    *("chainagestart", "startm", "fromm", "frommeasure", "startchainage"),
    *("vonstation", "vonm", "stationvon", "anfangsstation"),
)
_KINDS = ("highway", "fclass", "roadclass", "roadtype", "functionalclass", "roadkind")
_ONE_WAYS = ("oneway", "onewaydir", "einbahn")
_ALONG = frozenset({"yes", "true", "1", "f", "ft"})
_AGAINST = frozenset({"-1", "reverse", "t", "tf"})
"""Of one-way roads: OpenStreetMap's words, and those of Geofabrik's and navigation layers."""
_TAG = re.compile(r'"((?:[^"\\]|\\.)*)"=>"((?:[^"\\]|\\.)*)"')
"""A tag in GDAL's column other_tags."""
_NOT_DRIVEN = frozenset(
    {
        *("footway", "path", "steps", "cycleway", "pedestrian", "bridleway", "corridor"),
        *("proposed", "construction", "platform", "elevator", "raceway", "abandoned"),
    }
)
"""Values of OpenStreetMap's ``highway`` that no car drives on."""


def read_roads(path: Path, box: tuple[float, float, float, float]) -> Roads:
    """Roads that touch ``box`` (west, south, east, north in degrees), whole.

    ``.osm`` and ``.osm.pbf`` are read by GDAL, and what no car drives on is left out. A file
    without a coordinate system is taken for longitude and latitude. Raises InputError for a file
    that cannot be read or holds no lines.
    """
    import shapely

    name = path.name.lower()
    osm = name.endswith((".osm", ".osm.pbf", ".pbf"))
    table = read_layer(path, "lines" if osm else None, "LineString")
    if table.geometry is None or not np.isin(shapely.get_type_id(table.geometry), (1, 5)).any():
        raise InputError(f"{path}: holds no lines; a layer of roads does.")
    drivable = np.isin(shapely.get_type_id(table.geometry), (1, 5))
    if "highway" in table.columns:
        kind = np.array(texts(table.columns["highway"]), object)
        drivable &= ~np.isin(kind, list(_NOT_DRIVEN))
        drivable &= (kind != "") | (not osm)
    other = table.columns.get("other_tags")
    tags = [dict(_TAG.findall(text)) for text in ([] if other is None else texts(other))]
    tags = tags or [{}] * len(table)
    ids, titles, starts = _columns(table, tags)
    kinds, oneway = _kinds(table, tags)
    lines: list[np.ndarray] = []
    rows: list[int] = []
    begun: list[float] = []
    for row in np.flatnonzero(drivable).tolist():
        geometry = table.geometry[row]
        if geometry is None or geometry.is_empty:
            continue
        at = starts[row]
        for part in shapely.get_parts(geometry):
            points = shapely.get_coordinates(part)
            lon, lat = to_degrees(points[:, 0], points[:, 1], table.crs or "OGC:CRS84", path)
            good = np.isfinite(lon) & np.isfinite(lat)
            if good.sum() < 2:
                continue
            # parts of one road count on
            begun.append(at)
            at += _length_m(lon[good], lat[good])
            lines.append(np.column_stack([lon[good], lat[good]]))
            rows.append(row)
    keep = [k for k, line in enumerate(lines) if _touches(line, box)]
    if not keep:
        raise InputError(
            f"{path}: none of its {len(lines)} roads lies where the drive went; check its "
            "coordinate system."
        )
    return Roads(
        [lines[k] for k in keep],
        [ids[rows[k]] for k in keep],
        [titles[rows[k]] for k in keep],
        np.array([begun[k] for k in keep], np.float64),
        [kinds[rows[k]] for k in keep],
        np.array([oneway[rows[k]] for k in keep], np.int64),
        () if column_named(table.columns, _IDS) else tuple(table.columns),
    )


def _columns(
    table: VectorLayer, tags: Sequence[Mapping[str, str]]
) -> tuple[list[str], list[str], list[float]]:
    own = column_named(table.columns, _IDS)
    title = column_named(table.columns, _NAMES)
    start = column_named(table.columns, _STARTS)
    # no number that may pass for a key
    rows = [f"row {k + 1}" for k in range(len(table))]
    ids = rows if own is None else texts(table.columns[own])
    titles = [""] * len(table) if title is None else texts(table.columns[title])
    first = np.zeros(len(table)) if start is None else numbers(table.columns[start])
    # motorways have a number and seldom a name
    titles = [name or tag.get("ref", "") for name, tag in zip(titles, tags, strict=True)]
    return ids, titles, np.nan_to_num(first).tolist()


def _kinds(table: VectorLayer, tags: Sequence[Mapping[str, str]]) -> tuple[list[str], list[int]]:
    """Kind of each road ("" unknown), and whether it is driven one way."""
    kind = column_named(table.columns, _KINDS)
    kinds = [""] * len(table) if kind is None else texts(table.columns[kind])
    told = column_named(table.columns, _ONE_WAYS)
    ways = [tag.get("oneway", "") for tag in tags] if told is None else texts(table.columns[told])
    oneway = []
    for way, name, tag in zip(ways, kinds, tags, strict=True):
        word = way.lower()
        # a motorway and a roundabout need not say it
        implied = word == "" and (name == "motorway" or tag.get("junction") == "roundabout")
        oneway.append(1 if word in _ALONG or implied else -1 if word in _AGAINST else 0)
    return kinds, oneway


def _length_m(lon: np.ndarray, lat: np.ndarray) -> float:
    from pyproj import Geod

    return float(Geod(ellps="WGS84").line_length(lon, lat))


def _touches(line: np.ndarray, box: tuple[float, float, float, float]) -> bool:
    west, south, east, north = box
    low, high = line.min(axis=0), line.max(axis=0)
    return bool(low[0] <= east and high[0] >= west and low[1] <= north and high[1] >= south)
