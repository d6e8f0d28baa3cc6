"""Web map tiles: the grid of Web Mercator (EPSG:3857, OGC Two Dimensional Tile Matrix Set,
WebMercatorQuad), and pictures of its tiles."""

from __future__ import annotations

import io
from typing import Protocol

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray

MERCATOR_M = 20_037_508.342789244
"""Half the side of the world in EPSG:3857, pi times the equatorial radius."""
TILE_PX = 256
MOST_ZOOM = 22
"""At 22 a tile's pixel is 4 cm: no picture of a road from the air is finer."""
MOST_PIXELS = 120_000_000
"""Of a picture held in memory: 480 MB with transparency."""

Bounds = tuple[float, float, float, float]
"""West, south, east, north in degrees."""
Image = npt.NDArray[np.uint8]
"""[h, w, 4] red, green, blue, opacity."""


class Background(Protocol):
    """What can be drawn below a map: ``name`` for people, ``bounds``, the zooms at which its tiles
    add detail, and how many pixels a tile's side has."""

    name: str
    bounds: Bounds
    least_zoom: int
    most_zoom: int
    tile_px: int

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A tile as PNG, JPEG, WebP or AVIF, None where there is nothing."""


def to_world(lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Web Mercator x to the east and y to the south [n], both 0 to 1 over the world."""
    lat = np.radians(np.clip(lat_deg, -89.9, 89.9))
    return (lon_deg + 180.0) / 360.0, 0.5 - np.arcsinh(np.tan(lat)) / (2.0 * np.pi)


def from_world(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitude and latitude in degrees, the inverse of ``to_world``."""
    return x * 360.0 - 180.0, np.degrees(np.arctan(np.sinh((0.5 - y) * 2.0 * np.pi)))


def zoom_for(metres_per_pixel: float) -> int:
    """The least zoom whose tiles are as fine as so many metres of EPSG:3857 a pixel."""
    world = 2.0 * MERCATOR_M / (TILE_PX * max(metres_per_pixel, 1e-3))
    return int(np.clip(np.ceil(np.log2(max(world, 1.0)) - 0.05), 0, MOST_ZOOM))


def encoded(image: Image) -> bytes | None:
    """A picture as JPEG, as PNG where it is partly transparent, None where it is so altogether."""
    import cv2

    if not image[..., 3].any():
        return None
    if image[..., 3].min() == 255:
        bgr = np.ascontiguousarray(image[..., 2::-1])
        good, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])
    else:
        good, data = cv2.imencode(".png", np.ascontiguousarray(image[..., [2, 1, 0, 3]]))
    return data.tobytes() if good else None


def decoded(data: bytes) -> Image | None:
    """The picture that ``data`` holds, None where it cannot be read or is no tile by its size."""
    from PIL import Image as Pictures

    try:
        with Pictures.open(io.BytesIO(data)) as picture:
            if picture.width * picture.height > 4096 * 4096:
                return None
            return np.asarray(picture.convert("RGBA"), np.uint8)
    except (OSError, ValueError, SyntaxError, Pictures.DecompressionBombError):
        return None


def content_type(data: bytes) -> str | None:
    """The kind of a picture by its first bytes, None where no browser shows it."""
    if data.startswith(b"\x89PNG"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "image/webp"
    return "image/avif" if data[4:12] in (b"ftypavif", b"ftypmif1") else None
