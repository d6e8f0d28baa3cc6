"""Lines and outlines of a vector layer, drawn as web map tiles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.vector_layer import read_layer, to_degrees
from automap.io.web_tiles import Bounds, encoded, to_world

_COLOUR = (120, 130, 140, 255)
"""A grey that is seen on light and on dark, and takes no part in the colours of signs and path."""
_SHIFT = 4
"""Bits of a pixel that OpenCV draws lines to."""


class LineTiles:
    """Roads, kerbs or outlines of a file of GIS. Raises InputError where it holds none."""

    tile_px = 512
    least_zoom, most_zoom = 0, 22

    def __init__(self, path: Path) -> None:
        import shapely

        self.name = path.name
        low = path.name.lower()
        table = read_layer(path, "lines" if low.endswith((".osm", ".pbf")) else None, None)
        shapes = [] if table.geometry is None else [g for g in table.geometry if g is not None]
        shapes = [g for g in shapes if shapely.get_dimensions(g) >= 1 and not g.is_empty]
        if not shapes:
            raise InputError(f"{path}: holds no lines, and so nothing to lay below a map.")
        outlines = [shapely.boundary(g) if shapely.get_dimensions(g) == 2 else g for g in shapes]
        parts = shapely.get_parts(shapely.force_2d(np.array(outlines, object)))
        # a collection's boundary has no parts of its own
        parts = parts[np.isin(shapely.get_type_id(parts), (1, 2))]
        points, owner = shapely.get_coordinates(parts, return_index=True)
        lon, lat = to_degrees(points[:, 0], points[:, 1], table.crs or "OGC:CRS84", path)
        good = np.isfinite(lon) & np.isfinite(lat) & (np.abs(lat) <= 90)
        if good.sum() < 2:
            raise InputError(f"{path}: its lines lie outside of its coordinate system.")
        lon, lat, owner = lon[good], lat[good], owner[good]
        self.bounds: Bounds = (
            *(float(lon.min()), float(lat.min())),
            *(float(lon.max()), float(lat.max())),
        )
        x, y = to_world(lon, lat)
        starts = np.flatnonzero(np.diff(owner, prepend=-1))
        lines = np.split(np.column_stack([x, y]), starts[1:])
        self._lines = np.array([shapely.linestrings(r) for r in lines if len(r) > 1] or [], object)
        self._tree = shapely.STRtree(self._lines)

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """The lines in a tile; from afar they are thin."""
        import cv2
        import shapely

        side = 1.0 / 2**zoom
        rim = 8.0 * side / self.tile_px
        box = (x * side - rim, y * side - rim, (x + 1) * side + rim, (y + 1) * side + rim)
        found = self._lines[self._tree.query(shapely.box(*box))]
        inside = shapely.get_parts(shapely.clip_by_rect(found, *box))
        drawn = []
        for line in inside:
            points = (shapely.get_coordinates(line) - [x * side, y * side]) / side * self.tile_px
            if len(points) > 1:
                drawn.append(np.rint(points * 2**_SHIFT).astype(np.int32))
        if not drawn:
            return None
        image = np.zeros((self.tile_px, self.tile_px, 4), np.uint8)
        image[..., :3] = _COLOUR[:3]
        width = 1 if zoom < 13 else 2 if zoom < 17 else 4
        opacity = np.zeros((self.tile_px, self.tile_px), np.uint8)
        cv2.polylines(opacity, drawn, False, 255, width, cv2.LINE_AA, _SHIFT)
        image[..., 3] = opacity
        return encoded(image)
