"""Pictures in any coordinate system as web map tiles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from automap.errors import InputError
from automap.io.web_tiles import MERCATOR_M, TILE_PX, Bounds, Image, encoded, zoom_for
from automap.records import FloatArray

_NODES = 9
"""Of a tile's side at which PROJ is asked; between them it is bilinear: over an eighth of a tile
projections bend by less than a hundredth of a pixel."""
_WINDOW_PX = 4096
"""Side of what is read for one tile at most: beyond it the picture has no level coarse enough."""


class Level(Protocol):
    """One resolution of a picture: ``width`` and ``height`` px, ``to_crs`` [2, 3] from pixels
    (columns, rows, from the first pixel's corner) to coordinates, east first."""

    width: int
    height: int
    to_crs: FloatArray

    def window(self, left: int, top: int, right: int, bottom: int) -> Image:
        """The pixels [bottom - top, right - left, 4]."""


class Warped:
    """Tiles of a picture of several resolutions, the finest first, in the system ``crs``.

    Raises InputError where PROJ does not know the system or the picture lies nowhere in it.
    """

    tile_px = TILE_PX

    def __init__(self, path: Path, crs: str, levels: Sequence[Level]) -> None:
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        self.name = path.name
        self._levels = levels
        try:
            self._into = Transformer.from_crs("EPSG:3857", crs, always_xy=True)
            degrees = Transformer.from_crs(crs, "OGC:CRS84", always_xy=True)
            self._out = Transformer.from_crs(crs, "EPSG:3857", always_xy=True)
        except ProjError as error:
            raise InputError(
                f"{path}: its coordinate system {crs[:60]!r} cannot be used "
                f"({str(error).splitlines()[0]})."
            ) from error
        finest = levels[0]
        x, y = _edge(finest)
        lon, lat = degrees.transform(x, y)
        if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
            raise InputError(
                f"{path}: lies outside of its coordinate system; it states a wrong one or a wrong "
                "place."
            )
        self.bounds: Bounds = (float(min(lon)), float(min(lat)), float(max(lon)), float(max(lat)))
        self._metres = [self._pixel_m(level) for level in levels]
        self.least_zoom, self.most_zoom = 0, zoom_for(self._metres[0])

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A tile, sampled from the level that is just as fine."""
        import cv2

        side = 2.0 * MERCATOR_M / 2**zoom
        pixel = side / TILE_PX
        chosen = max((k for k, m in enumerate(self._metres) if m <= 1.5 * pixel), default=0)
        level = self._levels[chosen]
        u, v = self._pixels(level, x * side - MERCATOR_M, MERCATOR_M - y * side, side)
        inside = np.isfinite(u) & np.isfinite(v)
        inside &= (u > -1) & (v > -1) & (u < level.width + 1) & (v < level.height + 1)
        if not inside.any():
            return None
        left, top = (max(int(np.floor(w[inside].min())) - 2, 0) for w in (u, v))
        right = min(int(np.ceil(u[inside].max())) + 2, level.width)
        bottom = min(int(np.ceil(v[inside].max())) + 2, level.height)
        if right - left < 1 or bottom - top < 1 or max(right - left, bottom - top) > _WINDOW_PX:
            return None
        picture = level.window(left, top, right, bottom)
        # the middle of the first pixel is at a half
        columns, rows = (
            np.nan_to_num(w - 0.5 - start, nan=-1.0).astype(np.float32)
            for w, start in ((u, left), (v, top))
        )
        image = cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        image[~inside | (u < 0) | (v < 0) | (u > level.width) | (v > level.height), 3] = 0
        return encoded(np.asarray(image, np.uint8))

    def _pixels(
        self, level: Level, west: float, north: float, side: float
    ) -> tuple[FloatArray, FloatArray]:
        """Where in a level the middles of a tile's pixels [256, 256] are."""
        share = np.linspace(0.0, 1.0, _NODES)
        x, y = np.meshgrid(west + side * share, north - side * share)
        x, y = self._into.transform(x, y)
        inverse = np.linalg.inv(np.vstack([level.to_crs, [0.0, 0.0, 1.0]]))
        at = (np.arange(TILE_PX) + 0.5) / TILE_PX * (_NODES - 1)
        weights = np.maximum(1.0 - np.abs(at[:, None] - np.arange(_NODES)), 0.0)
        with np.errstate(invalid="ignore"):
            nodes = inverse[:2] @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
            u, v = (weights @ node.reshape(_NODES, _NODES) @ weights.T for node in nodes)
        return u, v

    def _pixel_m(self, level: Level) -> float:
        """The side of a pixel in the picture's middle, in metres of EPSG:3857."""
        middle = np.array([[level.width / 2, level.width / 2 + 1], [level.height / 2] * 2, [1, 1]])
        x, y = self._out.transform(*(level.to_crs @ middle))
        metres = float(np.hypot(x[1] - x[0], y[1] - y[0]))
        return metres if np.isfinite(metres) and metres > 0 else 1.0


def _edge(level: Level) -> tuple[Any, Any]:
    """Points [n] around a level's rim."""
    share = np.linspace(0.0, 1.0, 9)
    one, none = np.ones(9), np.zeros(9)
    u = level.width * np.concatenate([share, one, share, none])
    v = level.height * np.concatenate([none, share, one, share])
    x, y = level.to_crs @ np.stack([u, v, np.ones_like(u)])
    return x, y


class Held:
    """A level whose pixels [h, w, 4] are in memory."""

    def __init__(self, image: Image, to_crs: FloatArray) -> None:
        self.height, self.width = image.shape[:2]
        self.to_crs = to_crs
        self._image = image

    def window(self, left: int, top: int, right: int, bottom: int) -> Image:
        """The pixels themselves, not to be changed."""
        return self._image[top:bottom, left:right]


def pyramid(image: Image, to_crs: FloatArray) -> list[Held]:
    """A picture and its halves down to a tile's size."""
    import cv2

    levels = [Held(image, to_crs)]
    while max(image.shape[:2]) > TILE_PX:
        height, width = (max(1, (n + 1) // 2) for n in image.shape[:2])
        scale = np.diag([image.shape[1] / width, image.shape[0] / height, 1.0])
        image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))
        to_crs = to_crs @ scale
        levels.append(Held(image, to_crs))
    return levels
