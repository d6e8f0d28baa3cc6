"""Posts and gantries as features of their own: what hangs on each, from the top."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.export.fields import Field
from automap.export.layers import Layer, LayerParts, in_one, times_of_texts, wkb_of_points
from automap.export.sign_columns import SignColumns, Signs
from automap.records import FloatArray, IntArray

ASSEMBLY_FIELDS: tuple[Field, ...] = (
    Field("id", "text", "", "post or gantry, as the signs' support"),
    Field("kind", "text", "", "gantry where a sign hangs over the road, else post"),
    Field("n_faces", "integer", "", "signs, plates and backs that were seen on it"),
    Field(
        "faces", "text", "", "their ids from the top, whichever way they look; ID/back: its back"
    ),
    Field("classes", "text", "", "their classes in the same order, of a back: back"),
    Field("heights_m", "text", "m", "heights above the road of their centres, in the same order"),
    Field("facings_deg", "text", "deg", "directions that they look, in the same order"),
    Field("plates", "text", "", "plates and the signs they belong to, as plate>sign"),
    Field("ways", "integer", "", "directions that faces on it look, those within 90 deg as one"),
    Field("top_above_road_m", "real", "m", "height above the road of the uppermost face", 2),
    Field("side", "text", "", "side of the road in the direction of travel of the first face"),
    Field("sd_h_m", "real", "m", "standard deviation of its place per level axis", 3),
    Field("first_seen", "time", "UTC", "when any of its signs was seen first"),
    Field("last_seen", "time", "UTC", "when any of its signs was seen last"),
)
_BACKS = "n_back_views"
_OF_FACES = (
    "id", "class", "side", "main_sign", "first_seen", "last_seen", _BACKS,
    "height_above_road_m", "facing_deg",
)  # fmt: skip
_NEEDED = (*_OF_FACES, "support", "cov_ee_m2", "cov_nn_m2")
_POSTS = 16_384
"""At once."""


def assembly_parts(signs: Signs) -> LayerParts:
    """The layer in parts of some posts each; what of the signs goes into it is gathered first, as
    those of one post may be anywhere among them."""
    if isinstance(signs, SignColumns):
        return in_one(assembly_layer(signs))
    found: dict[str, list[Any]] = {name: [] for name in _NEEDED}
    known: dict[str, str] = {}
    utc = False
    for part in signs.parts():
        utc = part.utc_known
        for name in _NEEDED:
            column = part.values[name]
            if isinstance(column, np.ndarray):
                found[name].append(column)
            elif name in ("class", "side"):
                found[name] += [known.setdefault(v, v) for v in column]
            else:
                found[name] += column
    values: dict[str, Any] = {
        name: np.concatenate(column) if isinstance(column[0], np.ndarray) else column
        for name, column in found.items()
        if column
    }
    whole = SignColumns(signs.lon_deg, signs.lat_deg, signs.height_m, values, utc)
    there = [k for k in np.flatnonzero(signs.located).tolist() if values["support"][k]]
    names, post = np.unique(np.array([values["support"][k] for k in there]), return_inverse=True)
    at = np.array(there, np.int64)[np.argsort(post, kind="stable")]
    edges = np.searchsorted(np.sort(post), np.arange(0, len(names) + _POSTS, _POSTS))

    def parts() -> Iterator[Layer]:
        for lo, hi in itertools.pairwise(edges.tolist()):
            yield assembly_layer(_rows(whole, np.sort(at[lo:hi])))

    return LayerParts("assemblies", "Unknown", len(names), parts)


def _rows(columns: SignColumns, rows: IntArray) -> SignColumns:
    picked: dict[str, Any] = {
        name: column[rows] if isinstance(column, np.ndarray) else [column[k] for k in rows.tolist()]
        for name, column in columns.values.items()
    }
    return SignColumns(
        columns.lon_deg[rows], columns.lat_deg[rows], columns.height_m[rows], picked,
        columns.utc_known,
    )  # fmt: skip


def assembly_layer(columns: SignColumns) -> Layer:
    """One point for each support of the signs that have a place, in the order of their names.

    It stands at the mean of its signs, those that are known better counting for more. Their errors
    are mostly those of the path, which they share: its sigma is the least of theirs.
    """
    support = columns.values["support"]
    at = np.array([k for k in np.flatnonzero(columns.located).tolist() if support[k]], np.int64)
    names, post = np.unique(np.array([support[k] for k in at], np.str_), return_inverse=True)
    order = np.lexsort((at, -np.nan_to_num(columns.height_m[at], nan=-1e9), post))
    at, post = at[order], post[order]
    first = np.searchsorted(post, np.arange(len(names) + 1))
    variance = 0.5 * (columns.values["cov_ee_m2"] + columns.values["cov_nn_m2"])[at]
    weight = np.where(variance > 0.0, 1.0 / np.maximum(variance, 1e-4), 1e-4)

    def mean(value: FloatArray, weight: FloatArray) -> FloatArray:
        total = np.bincount(post, weight * value, len(names))
        return np.asarray(total / np.bincount(post, weight, len(names)))

    height = columns.height_m[at]
    known = np.isfinite(height)
    # longitudes from the first one on, for posts at the date line
    start = columns.lon_deg[at[first[:-1]]]
    lon = (columns.lon_deg[at] - start[post] + 180.0) % 360.0 - 180.0
    with np.errstate(invalid="ignore"):
        up = mean(np.where(known, height, 0.0), weight * known)
    east = (start + mean(lon, weight) + 180.0) % 360.0 - 180.0
    top = np.fmax.reduceat(columns.values["height_above_road_m"][at], first[:-1])
    spread = np.sqrt(np.fmin.reduceat(variance, first[:-1]))
    # numbers of Python's own are looked at one by one in a third of the time
    values = {
        name: column.tolist() if isinstance(column := columns.values[name], np.ndarray) else column
        for name in _OF_FACES
    }
    rows = [
        _row(values, columns.utc_known, name, at[lo:hi].tolist())
        | {"top_above_road_m": highest, "sd_h_m": sd}
        for name, (lo, hi), highest, sd in zip(
            names.tolist(), itertools.pairwise(first.tolist()), top.tolist(), spread.tolist(),
            strict=True,
        )
    ]  # fmt: skip
    wkb = wkb_of_points(east, mean(columns.lat_deg[at], weight), up)
    arrays: dict[str, npt.NDArray[Any]] = {}
    for field in ASSEMBLY_FIELDS:
        cells = [row[field.name] for row in rows]
        if field.kind == "real":
            arrays[field.name] = np.array(cells, np.float64)
        elif field.kind == "integer":
            arrays[field.name] = np.array(cells, np.int64)
        elif field.kind == "time":
            arrays[field.name] = times_of_texts(cells)
        else:
            arrays[field.name] = np.array([*cells, None], object)[:-1]
    return Layer("assemblies", "Unknown", wkb, arrays, {})


def _row(
    values: Mapping[str, list[Any]], utc_known: bool, name: str, own: list[int]
) -> dict[str, Any]:
    sides = [values["side"][k] for k in own]
    # a back is the other side of its sign
    faces = [(k, back) for k in own for back in (False, True)[: 1 + (values[_BACKS][k] > 0)]]
    facing = [(values["facing_deg"][k] + 180.0 * back) % 360.0 for k, back in faces]
    main = values["main_sign"]
    first = [values["first_seen"][k] for k in own if utc_known and values["first_seen"][k]]
    last = [values["last_seen"][k] for k in own if utc_known and values["last_seen"][k]]
    return {
        "id": name,
        "kind": "gantry" if "overhead" in sides else "post",
        "n_faces": len(faces),
        "faces": ", ".join(values["id"][k] + ("/back" if back else "") for k, back in faces),
        "classes": ", ".join("back" if back else values["class"][k] for k, back in faces),
        "heights_m": _numbers([values["height_above_road_m"][k] for k, _ in faces], 2),
        "facings_deg": _numbers(facing, 0),
        "plates": ", ".join(f"{values['id'][k]}>{main[k]}" for k in own if main[k]) or None,
        "ways": _ways(facing),
        "side": next((s for s in sides if s), None),
        "first_seen": min(first, default=None),
        "last_seen": max(last, default=None),
    }


def _numbers(values: list[float], decimals: int) -> str:
    """Numbers as one text; what is not known is a question mark."""
    return ", ".join(f"{v:.{decimals}f}" if math.isfinite(v) else "?" for v in values)


def _ways(facing_deg: list[float]) -> int:
    """How many directions faces look, those within a right angle of one counted before as one."""
    ways: list[float] = []
    for facing in filter(math.isfinite, facing_deg):
        if all(math.cos(math.radians(facing - other)) < 0.0 for other in ways):
            ways.append(facing)
    return max(len(ways), 1)


def assemblies_geojson(columns: SignColumns) -> str:
    """The same layer as a collection of points (RFC 7946), one feature a line."""
    import shapely

    layer = assembly_layer(columns)
    features = []
    for k, point in enumerate(shapely.from_wkb(layer.wkb)):
        properties: dict[str, Any] = {}
        for field in ASSEMBLY_FIELDS:
            value = layer.columns[field.name][k]
            if field.kind == "real":
                value = round(float(value), field.decimals or 6) if np.isfinite(value) else None
            elif field.kind == "integer":
                value = int(value)
            elif field.kind == "time":
                value = None if np.isnat(value) else f"{value}Z"
            properties[field.name] = value
        x, y = round(point.x, 7), round(point.y, 7)
        place = [x, y, round(point.z, 3)] if point.has_z else [x, y]
        geometry = {"type": "Point", "coordinates": place}
        features.append(
            json.dumps(
                {"type": "Feature", "id": properties["id"], "geometry": geometry,
                 "properties": properties},
                ensure_ascii=False,
            )
        )  # fmt: skip
    text = '{"type": "FeatureCollection",\n"features": [\n' + ",\n".join(features) + "\n]}\n"
    return text.encode("utf-8", "replace").decode("utf-8")
