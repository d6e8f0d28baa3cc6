"""What lies below a map: a file of tiles, a picture from the air, or lines of roads."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.web_tiles import Background, Bounds, Image, decoded, to_world
from automap.records import FloatArray

_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_MOST_TILES = 400
"""Of a cut-out: 25 million pixels of tiles, more than any page shows of one."""


def open_background(path: Path) -> Background:
    """A background, told by the file's content.

    PMTiles and MBTiles of pictures, a GeoPackage of pictures or of lines, a GeoTIFF, or lines in
    any format that GDAL reads. Raises InputError for another or damaged file.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file.")
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    if head[:7] == b"PMTiles":
        from automap.io.tile_archives import PmTiles

        return PmTiles(path)
    if head[:4] in _TIFF:
        from automap.io.geotiff import open_geotiff

        return open_geotiff(path)
    if head == b"SQLite format 3\0":
        return _of_database(path)
    from automap.io.line_tiles import LineTiles

    return LineTiles(path)


def _of_database(path: Path) -> Background:
    from automap.io.geopackage_tiles import open_geopackage_tiles
    from automap.io.line_tiles import LineTiles
    from automap.io.tile_archives import MbTiles, read_only

    try:
        base = read_only(path)
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master")}
        base.close()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is damaged ({error}).") from error
    if "gpkg_contents" in tables:
        return open_geopackage_tiles(path) or LineTiles(path)
    return MbTiles(path) if "tiles" in tables else LineTiles(path)


def check_below(background: Background, map_box: Bounds | None, path: Path) -> None:
    """InputError where a background and a map (west, south, east, north; None: of no place) have
    no place in common."""
    if map_box is None:
        return
    west, south, east, north = background.bounds
    if west <= map_box[2] and east >= map_box[0] and south <= map_box[3] and north >= map_box[1]:
        return
    raise InputError(
        f"{path}: shows {_place(background.bounds)}, and the map lies at {_place(map_box)}; take "
        "another file, or correct its coordinate system."
    )


def _place(box: Bounds) -> str:
    lon, lat = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
    return f"{abs(lat):.3f}° {'N' if lat >= 0 else 'S'} {abs(lon):.3f}° {'E' if lon >= 0 else 'W'}"


def cut_out(background: Background, lon_deg: FloatArray, lat_deg: FloatArray) -> Image | None:
    """The background at the pixels [h, w] of a picture, None where it has nothing there."""
    import cv2

    x, y = to_world(lon_deg, lat_deg)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return None
    box = [float(v) for v in (x[known].min(), y[known].min(), x[known].max(), y[known].max())]
    # as fine as the picture's own pixels
    step = max(box[2] - box[0], 1e-9) / max(lon_deg.shape[1], 1)
    wanted = int(np.ceil(np.log2(1.0 / (step * background.tile_px)) - 0.3))
    zoom = int(np.clip(wanted, background.least_zoom, background.most_zoom))
    while zoom > background.least_zoom and _count(box, zoom) > _MOST_TILES:
        zoom -= 1
    if _count(box, zoom) > _MOST_TILES:
        return None
    n, px = 2**zoom, background.tile_px
    x0, y0 = int(box[0] * n), int(box[1] * n)
    x1, y1 = min(int(box[2] * n), n - 1), min(int(box[3] * n), n - 1)
    mosaic = np.zeros(((y1 - y0 + 1) * px, (x1 - x0 + 1) * px, 4), np.uint8)
    for row in range(y0, y1 + 1):
        for column in range(x0, x1 + 1):
            data = background.tile(zoom, column, row)
            tile = None if data is None else decoded(data)
            if tile is None:
                continue
            if tile.shape[:2] != (px, px):
                tile = np.asarray(cv2.resize(tile, (px, px), interpolation=cv2.INTER_AREA))
            top, left = (row - y0) * px, (column - x0) * px
            mosaic[top : top + px, left : left + px] = tile
    if not mosaic[..., 3].any():
        return None
    columns = ((x * n - x0) * px - 0.5).astype(np.float32)
    rows = ((y * n - y0) * px - 0.5).astype(np.float32)
    shrunk = max(1.0, step * n * px)
    if shrunk > 1.5:
        # what would be skipped is averaged first
        size = (max(1, round(mosaic.shape[1] / shrunk)), max(1, round(mosaic.shape[0] / shrunk)))
        columns *= np.float32(size[0] / mosaic.shape[1])
        rows *= np.float32(size[1] / mosaic.shape[0])
        mosaic = np.asarray(cv2.resize(mosaic, size, interpolation=cv2.INTER_AREA))
    image = cv2.remap(mosaic, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(image, np.uint8)


def _count(box: list[float], zoom: int) -> float:
    n = 2.0**zoom
    return ((box[2] - box[0]) * n + 1) * ((box[3] - box[1]) * n + 1)
