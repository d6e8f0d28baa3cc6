"""Tile pyramids of pictures in a GeoPackage (OGC 12-128r18, clause 2.2), in any system."""

from __future__ import annotations

import sqlite3
import threading
from functools import lru_cache
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.tile_archives import read_only
from automap.io.warped import Warped
from automap.io.web_tiles import Image, decoded
from automap.records import FloatArray

_KEPT = 64
"""Decoded tiles kept in memory, 16 MB of them."""


class _Matrix:
    """One zoom of a tile pyramid."""

    def __init__(self, pyramid: _Pyramid, zoom: int, columns: int, rows: int, tile: tuple[int, int],
                 pixel: tuple[float, float], corner: tuple[float, float]) -> None:  # fmt: skip
        self._pyramid, self._zoom, self._tile = pyramid, zoom, tile
        self.width, self.height = columns * tile[0], rows * tile[1]
        self.to_crs: FloatArray = np.array(
            [[pixel[0], 0.0, corner[0]], [0.0, -pixel[1], corner[1]]], np.float64
        )

    def window(self, left: int, top: int, right: int, bottom: int) -> Image:
        """The pixels, put together from the tiles that hold them."""
        wide, high = self._tile
        image = np.zeros((bottom - top, right - left, 4), np.uint8)
        for row in range(top // high, (bottom - 1) // high + 1):
            for column in range(left // wide, (right - 1) // wide + 1):
                tile = self._pyramid.tile(self._zoom, column, row)
                if tile is None or tile.shape[:2] != (high, wide):
                    continue
                x0, y0 = column * wide, row * high
                first = max(left, x0), max(top, y0)
                last = min(right, x0 + wide), min(bottom, y0 + high)
                image[first[1] - top : last[1] - top, first[0] - left : last[0] - left] = tile[
                    first[1] - y0 : last[1] - y0, first[0] - x0 : last[0] - x0
                ]
        return image


class _Pyramid:
    def __init__(self, base: sqlite3.Connection, table: str) -> None:
        self._base, self._lock = base, threading.Lock()
        quoted = table.replace('"', '""')
        self._query = (
            f'SELECT tile_data FROM "{quoted}" WHERE zoom_level = ? AND tile_column = ? AND '
            "tile_row = ?"
        )
        self.tile = lru_cache(maxsize=_KEPT)(self._tile)

    def _tile(self, zoom: int, column: int, row: int) -> Image | None:
        with self._lock:
            try:
                found = self._base.execute(self._query, (zoom, column, row)).fetchone()
            except (sqlite3.Error, UnicodeDecodeError):
                return None
        return decoded(found[0]) if found and isinstance(found[0], bytes) else None


def open_geopackage_tiles(path: Path) -> Warped | None:
    """A background of the first tile pyramid of a GeoPackage, None where it has none.

    Raises InputError for a damaged file.
    """
    base = read_only(path)
    try:
        listed = base.execute(
            "SELECT table_name, srs_id FROM gpkg_contents WHERE data_type = 'tiles'"
        ).fetchall()
        if not listed:
            return None
        table, srs = listed[0]
        min_x, max_y = base.execute(
            "SELECT min_x, max_y FROM gpkg_tile_matrix_set WHERE table_name = ?", (table,)
        ).fetchone()
        matrices = base.execute(
            "SELECT zoom_level, matrix_width, matrix_height, tile_width, tile_height, "
            "pixel_x_size, pixel_y_size FROM gpkg_tile_matrix WHERE table_name = ? "
            "ORDER BY zoom_level DESC",
            (table,),
        ).fetchall()
        quoted = str(table).replace('"', '""')
        used = {z for (z,) in base.execute(f'SELECT DISTINCT zoom_level FROM "{quoted}"')}
        organisation, number, text = base.execute(
            "SELECT organization, organization_coordsys_id, definition FROM gpkg_spatial_ref_sys "
            "WHERE srs_id = ?",
            (srs,),
        ).fetchone()
    except (sqlite3.Error, TypeError, ValueError) as error:
        raise InputError(f"{path}: its tiles cannot be read ({error}).") from error
    pyramid = _Pyramid(base, str(table))
    levels = [
        _Matrix(pyramid, z, w, h, (tw, th), (px, py), (min_x, max_y))
        for z, w, h, tw, th, px, py in matrices
        if z in used
    ]
    if not levels:
        raise InputError(f"{path}: holds no tiles.")
    if str(organisation).upper() == "EPSG" and number and int(number) > 0:
        return Warped(path, f"EPSG:{int(number)}", levels)
    if not text or text == "undefined":
        raise InputError(f"{path}: its tiles have no coordinate system.")
    return Warped(path, str(text), levels)
