"""What the page's map draws: path, fixes and signs in metres around one origin, as JSON."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from automap.export.icons import class_icon, words_apart
from automap.export.kml import class_colours
from automap.export.path import simplified_path
from automap.export.sign_columns import Signs
from automap.export.uncertainty import principal_axes
from automap.gates import OUTSIDE_95, gate
from automap.io.web_tiles import Background
from automap.records import FixType, FloatArray
from pipeline.report.background import cut_below
from pipeline.report.outages import outages
from pipeline.report.path_modes import path_modes
from pipeline.report.sign_cards import sign_cards
from pipeline.shared.pictures import Picture
from pipeline.shared.products import RunProducts

FIX_LIMIT = 6000
SIGN_LIMIT = 5000
TRACK_LIMIT = 500
"""Of drives with some hundred points each: a page of a few MB."""
FACE_PX = 64
FACE_LIMIT = 200


def map_data(
    products: RunProducts,
    signs: Signs,
    pictures: Sequence[Picture] = (),
    background: Background | None = None,
) -> dict[str, Any] | None:
    """Content of the map, None when there is nothing to draw.

    Positions are metres east and north of ``origin`` (degrees) on the local tangent plane,
    rounded to centimetres. ``notes`` are sentences about what was left out to keep it small.
    """
    origin = _origin(products, signs)
    if origin is None:
        return None
    notes: list[str] = []
    data: dict[str, Any] = {
        "origin": [round(origin[1], 9), round(origin[0], 9)],
        "fields": [
            {
                "name": f.name,
                "title": f.title,
                "unit": f.unit_text,
                "meaning": f.meaning,
                "kind": f.kind,
            }
            for f in signs.fields
        ],
        "path": _path(products, origin),
        "tracks": _tracks(products, origin, notes),
        "fixes": _fixes(products, origin, notes),
        "signs": _signs(products, signs, origin, notes, list(pictures)),
        "faces": sign_faces({str(name) for name in signs.classes}),
        "words": words_apart(sorted({str(name) for name in signs.classes})),
    }
    data["background"] = below = cut_below(data, background) if background is not None else None
    if background is not None and below is None:
        notes.append(f"{background.name} shows nothing of the map, so it has no background.")
    data["notes"] = notes
    return data


def sign_faces(classes: set[str]) -> dict[str, str]:
    """Small pictures of the faces of classes, as data URIs."""
    return {
        name: "data:image/png;base64," + base64.b64encode(class_icon(name, FACE_PX)).decode()
        for name in sorted(classes)[:FACE_LIMIT]
    }


def _origin(products: RunProducts, signs: Signs) -> tuple[float, float] | None:
    trajectory, fixes = products.trajectory, products.fixes
    candidates: list[tuple[FloatArray, FloatArray]] = []
    if trajectory is not None:
        candidates.append((np.degrees(trajectory.lat_rad), np.degrees(trajectory.lon_rad)))
    if fixes is not None:
        candidates.append((np.degrees(fixes.lat_rad), np.degrees(fixes.lon_rad)))
    candidates.append((signs.lat_deg, signs.lon_deg))
    for lat, lon in candidates:
        good = np.flatnonzero(np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= 90))
        if len(good):
            middle = good[len(good) // 2]
            return float(lat[middle]), float(lon[middle])
    return None


def _metres(lat_deg: FloatArray, lon_deg: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """East and north [n, 2] of an origin by the radii of curvature at its latitude."""
    from automap.earth import metres_per_radian

    north, east = metres_per_radian(np.radians(origin[0]), 0.0)
    turned = np.mod(lon_deg - origin[1] + 180.0, 360.0) - 180.0
    return np.column_stack(
        [np.radians(turned) * float(east), np.radians(lat_deg - origin[0]) * float(north)]
    )


def _pairs(metres: FloatArray) -> list[list[float]]:
    rounded: list[list[float]] = np.round(metres, 2).tolist()
    return rounded


def _path(products: RunProducts, origin: tuple[float, float]) -> dict[str, Any] | None:
    if products.trajectory is None:
        return None
    path = simplified_path(products.trajectory, tolerance_m=0.15)
    if len(path) < 2:
        return None
    points = _metres(path.lat_deg, path.lon_deg, origin)
    silent = []
    if products.fixes is not None and products.clock is not None:
        gps_s = products.trajectory.gps_s[path.row]
        for start, end in outages(products.fixes):
            inside = np.flatnonzero((gps_s >= start) & (gps_s <= end))
            if len(inside) > 1:
                silent.append(_pairs(points[inside]))
    return {
        "points": _pairs(points),
        "modes": [mode.as_json() for mode in path_modes(products, path)],
        "outages": silent,
    }


def _tracks(
    products: RunProducts, origin: tuple[float, float], notes: list[str]
) -> list[list[list[float]]]:
    """The ways of a merged map's drives."""
    names = list(products.tracks)
    step = max(1, -(-len(names) // TRACK_LIMIT))
    if step > 1:
        notes.append(f"One in {step} of {len(names)} tracks is drawn; tracks.parquet has all.")
    paths = [simplified_path(products.tracks[name], tolerance_m=0.5) for name in names[::step]]
    return [_pairs(_metres(p.lat_deg, p.lon_deg, origin)) for p in paths if len(p) > 1]


def _fixes(products: RunProducts, origin: tuple[float, float], notes: list[str]) -> Any:
    fixes = products.fixes
    if fixes is None:
        return []
    good = np.flatnonzero(
        np.isfinite(fixes.lat_rad)
        & np.isfinite(fixes.lon_rad)
        & (fixes.fix_type != int(FixType.NONE))
    )
    step = max(1, -(-len(good) // FIX_LIMIT))
    if step > 1:
        notes.append(f"One in {step} of {len(good)} fixes is drawn.")
    good = good[::step]
    lat, lon = np.degrees(fixes.lat_rad[good]), np.degrees(fixes.lon_rad[good])
    return _pairs(_metres(lat, lon, origin))


def _signs(
    products: RunProducts,
    signs: Signs,
    origin: tuple[float, float],
    notes: list[str],
    pictures: list[Picture],
) -> Any:
    rows = np.flatnonzero(signs.located)
    if len(rows) > SIGN_LIMIT:
        notes.append(
            f"The first {SIGN_LIMIT} of {len(rows)} signs are drawn; signs.geojson has all."
        )
        rows = rows[:SIGN_LIMIT]
    columns = signs.first(int(rows.max(initial=-1)) + 1)
    values = columns.values
    major, minor, azimuth = principal_axes(
        values["cov_ee_m2"][rows], values["cov_en_m2"][rows], values["cov_nn_m2"][rows]
    )
    scale = float(np.sqrt(gate(OUTSIDE_95, 2)))
    colours = class_colours(signs.classes)
    return {
        "xy": _pairs(_metres(columns.lat_deg[rows], columns.lon_deg[rows], origin)),
        "lonlat": np.round(
            np.column_stack([columns.lon_deg[rows], columns.lat_deg[rows]]), 7
        ).tolist(),
        "height_m": _numbers(columns.height_m[rows], 2),
        "ellipse": [
            _numbers(scale * major, 3),
            _numbers(scale * minor, 3),
            _numbers(azimuth, 4),
        ],
        "colours": colours,
        "rows": [
            [
                _value(field.kind, values[field.name][row], field.decimals)
                for field in columns.fields
            ]
            for row in rows.tolist()
        ],
        "cards": sign_cards(products, pictures, rows.tolist()) if products.signs else [],
    }


def _numbers(values: FloatArray, decimals: int) -> Sequence[float | None]:
    return [round(v, decimals) if np.isfinite(v) else None for v in values.tolist()]


def _value(kind: str, value: Any, decimals: int | None) -> Any:
    if kind == "real":
        number = float(value)
        if not np.isfinite(number):
            return None
        return round(number, decimals) if decimals is not None else float(f"{number:.4g}")
    if kind == "integer":
        return None if value is None else int(value)
    return value
