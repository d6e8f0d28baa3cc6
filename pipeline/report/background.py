"""The part of a background that lies below the report's map, in the page itself."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from automap.earth import metres_per_radian
from automap.io.background import cut_out
from automap.io.web_tiles import Background, Image
from automap.records import FloatArray

MOST_PX = 1600
"""Pixels of the longer side: a screen's."""
MOST_BYTES = 900_000
"""Of the picture: with its base64, the pictures of the signs and all else the page stays below
5 MB."""
_RIM_M = 40.0
"""Shown round what the map has: signs stand within that of the road."""
_FINEST_M = 0.1
"""A pixel: what is finer shows no more of a kerb."""


def cut_below(data: dict[str, Any], background: Background) -> dict[str, Any] | None:
    """``src`` (data URI), ``box`` (west, south, east, north in metres of the map), ``text`` and
    whether it is ``opaque``; None where the background has nothing there."""
    box = _extent(data)
    if box is None:
        return None
    lon0, lat0 = data["origin"]
    north_m, east_m = (float(v) for v in metres_per_radian(np.radians(lat0), 0.0))
    west, south, east, north = box
    pixel = max(max(east - west, north - south) / MOST_PX, _FINEST_M)
    columns, rows = (max(2, round(side / pixel)) for side in (east - west, north - south))
    x = west + (np.arange(columns) + 0.5) * (east - west) / columns
    y = north - (np.arange(rows) + 0.5) * (north - south) / rows
    lon = np.broadcast_to(lon0 + np.degrees(x / east_m), (rows, columns))
    lat = np.broadcast_to((lat0 + np.degrees(y / north_m))[:, None], (rows, columns))
    image = cut_out(background, lon, lat)
    if image is None or not image[..., 3].any():
        return None
    opaque = bool(image[..., 3].mean() > 250)
    kind, content = _small(image, opaque)
    metres = (east - west) / columns
    return {
        "src": f"data:image/{kind};base64," + base64.b64encode(content).decode(),
        "box": [round(v, 2) for v in box],
        "text": f"Background: {background.name}, a pixel {metres:.1f} m",
        "opaque": opaque,
    }


def _extent(data: dict[str, Any]) -> tuple[float, float, float, float] | None:
    """What path, tracks and signs take up, with a rim; not fixes, which may be anywhere."""
    parts = [data["signs"]["xy"], *data["tracks"]]
    if data["path"] is not None:
        parts.append(data["path"]["points"])
    told = [np.asarray(part, np.float64).reshape(-1, 2) for part in parts if len(part)]
    if not told:
        return None
    points: FloatArray = np.concatenate(told)
    low, high = points.min(axis=0), points.max(axis=0)
    rim = np.maximum(_RIM_M, 0.05 * (high - low))
    west, south = (low - rim).tolist()
    east, north = (high + rim).tolist()
    return west, south, east, north


def _small(image: Image, opaque: bool) -> tuple[str, bytes]:
    """JPEG, or PNG for lines, of at most ``MOST_BYTES``."""
    import cv2

    while True:
        if opaque:
            # what is beyond the background is the page's grey
            share = image[..., 3:].astype(np.float64) / 255.0
            flat = (image[..., :3] * share + 238.0 * (1.0 - share)).astype(np.uint8)
            flat = np.ascontiguousarray(flat[..., ::-1])
            kind, (good, content) = (
                "jpeg",
                cv2.imencode(".jpg", flat, [cv2.IMWRITE_JPEG_QUALITY, 80]),
            )
        else:
            swapped = np.ascontiguousarray(image[..., [2, 1, 0, 3]])
            kind, (good, content) = "png", cv2.imencode(".png", swapped)
        if good and len(content) <= MOST_BYTES:
            return kind, bytes(content.tobytes())
        size = (max(1, round(0.8 * image.shape[1])), max(1, round(0.8 * image.shape[0])))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
