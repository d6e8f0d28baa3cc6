"""Posts and gantries as features of their own: what hangs on each, from the top."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.export.fields import Field
from automap.export.layers import Layer, times_of_texts
from automap.export.sign_columns import SignColumns
from automap.records import IntArray

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


def assembly_layer(columns: SignColumns) -> Layer:
    """One point for each support of the signs that have a place, in the order of their names.

    It stands at the mean of its signs, those that are known better counting for more. Their errors
    are mostly those of the path, which they share: its sigma is the least of theirs.
    """
    import shapely

    values = columns.values
    posts: dict[str, list[int]] = {}
    for k in np.flatnonzero(columns.located).tolist():
        if values["support"][k]:
            posts.setdefault(values["support"][k], []).append(k)
    variance = 0.5 * (values["cov_ee_m2"] + values["cov_nn_m2"])
    rows: list[dict[str, Any]] = []
    points = []
    for name in sorted(posts):
        own = sorted(posts[name], key=lambda k: (-np.nan_to_num(columns.height_m[k], nan=-1e9), k))
        at = np.array(own)
        weight = np.where(variance[at] > 0.0, 1.0 / np.maximum(variance[at], 1e-4), 1e-4)
        height = columns.height_m[at]
        known = np.isfinite(height)
        # longitudes from the first one on, for posts at the date line
        lon = (columns.lon_deg[at] - columns.lon_deg[own[0]] + 180.0) % 360.0 - 180.0
        east = columns.lon_deg[own[0]] + np.average(lon, weights=weight)
        place = [(east + 180.0) % 360.0 - 180.0, np.average(columns.lat_deg[at], weights=weight)]
        if known.any():
            place.append(np.average(height[known], weights=weight[known]))
        points.append(shapely.to_wkb(shapely.points(*place), flavor="iso"))
        rows.append(_row(columns, name, at))
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
    wkb = np.array([*points, None], object)[:-1]
    return Layer("assemblies", "Unknown", wkb, arrays, {})


def _row(columns: SignColumns, name: str, at: IntArray) -> dict[str, Any]:
    values = columns.values
    variance = 0.5 * (values["cov_ee_m2"] + values["cov_nn_m2"])[at]
    own = at.tolist()
    sides = [values["side"][k] for k in own]
    above = values["height_above_road_m"][at]
    # a back is the other side of its sign
    faces = [(k, back) for k in own for back in (False, True)[: 1 + (values[_BACKS][k] > 0)]]
    facing = np.array([(values["facing_deg"][k] + 180.0 * back) % 360.0 for k, back in faces])
    main = values["main_sign"]
    first = [values["first_seen"][k] for k in own if columns.utc_known and values["first_seen"][k]]
    last = [values["last_seen"][k] for k in own if columns.utc_known and values["last_seen"][k]]
    return {
        "id": name,
        "kind": "gantry" if "overhead" in sides else "post",
        "n_faces": len(faces),
        "faces": ", ".join(values["id"][k] + ("/back" if back else "") for k, back in faces),
        "classes": ", ".join("back" if back else values["class"][k] for k, back in faces),
        "heights_m": _numbers([values["height_above_road_m"][k] for k, _ in faces], 2),
        "facings_deg": _numbers(facing.tolist(), 0),
        "plates": ", ".join(f"{values['id'][k]}>{main[k]}" for k in own if main[k]) or None,
        "ways": _ways(facing),
        "top_above_road_m": float(np.nanmax(above)) if np.isfinite(above).any() else np.nan,
        "side": next((s for s in sides if s), None),
        "sd_h_m": float(np.sqrt(np.nanmin(variance))) if np.isfinite(variance).any() else np.nan,
        "first_seen": min(first, default=None),
        "last_seen": max(last, default=None),
    }


def _numbers(values: list[float], decimals: int) -> str:
    """Numbers as one text; what is not known is a question mark."""
    return ", ".join(f"{v:.{decimals}f}" if np.isfinite(v) else "?" for v in values)


def _ways(facing_deg: npt.NDArray[np.float64]) -> int:
    """How many directions faces look, those within a right angle of one counted before as one."""
    ways: list[float] = []
    for facing in facing_deg[np.isfinite(facing_deg)].tolist():
        if all(np.cos(np.radians(facing - other)) < 0.0 for other in ways):
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
