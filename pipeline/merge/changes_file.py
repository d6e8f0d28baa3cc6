"""``changes.geojson``: what is different from an older map."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from automap.mapping.changes import Change


def changes_geojson(changes: Sequence[Change]) -> str:
    """The changes as a collection of points (RFC 7946, WGS-84); for "gone" where it was."""
    features = [json.dumps(_feature(change), ensure_ascii=False) for change in changes]
    text = '{"type": "FeatureCollection",\n"features": [\n' + ",\n".join(features) + "\n]}\n"
    return text.encode("utf-8", "replace").decode("utf-8")


def _feature(change: Change) -> dict[str, Any]:
    sign, older = change.sign, change.older
    coordinates = [
        round(float(np.degrees(sign.lon_rad)), 7),
        round(float(np.degrees(sign.lat_rad)), 7),
    ]
    if np.isfinite(sign.height_m):
        coordinates.append(round(sign.height_m, 3))
    properties: dict[str, Any] = {
        "change": change.kind,
        "id": sign.id,
        "class": sign.class_name,
        "previous_class": None if older is None else older.class_name,
        "belief": round(change.belief, 3),
        "moved_m": round(change.distance_m, 2) if change.kind == "moved" else None,
        "visited_before": change.visited_before,
        "drives": list(sign.drives),
    }
    return {
        "type": "Feature",
        "id": sign.id,
        "geometry": {"type": "Point", "coordinates": coordinates},
        "properties": properties,
    }
