"""Small backgrounds of every kind whose colours say where a pixel lies."""

from __future__ import annotations

import io
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, TiffImagePlugin
from pyproj import Transformer

from automap.io.web_tiles import from_world, to_world

EAST, NORTH, SPAN_M = 8.4700, 48.9750, 1500.0
"""Middle and half the side of what the pictures show: round the path of ``export_inputs``."""


def colour(lon: Any, lat: Any) -> np.ndarray[Any, Any]:
    """Red grows to the east, green to the north, blue is the same everywhere."""
    red = 128 + (np.asarray(lon) - EAST) * 4000.0
    green = 128 + (np.asarray(lat) - NORTH) * 6000.0
    rgb = np.stack([red, green, np.full_like(red, 90.0)], axis=-1)
    return np.rint(np.clip(rgb, 0, 255)).astype(np.uint8)


def png(rgb: np.ndarray[Any, Any], kind: str = "PNG") -> bytes:
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, kind)
    return out.getvalue()


def tile(zoom: int, x: int, y: int, px: int = 256) -> bytes:
    at = (np.arange(px) + 0.5) / px
    u, v = np.meshgrid(x + at, y + at)
    return png(colour(*from_world(u / 2**zoom, v / 2**zoom)))


def tiles(zooms: range) -> list[tuple[int, int, int]]:
    """The tiles of some zooms that cover the place."""
    found = []
    for zoom in zooms:
        d = SPAN_M / 111_000
        x, y = to_world(
            np.array([EAST - 1.5 * d, EAST + 1.5 * d]), np.array([NORTH - d, NORTH + d])
        )
        n = 2**zoom
        found += [
            (zoom, i, j)
            for i in range(int(x[0] * n), int(x[1] * n) + 1)
            for j in range(int(y[1] * n), int(y[0] * n) + 1)
        ]
    return found


def write_mbtiles(path: Path, zooms: range = range(12, 17), kind: str = "png") -> Path:
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        base.execute(
            "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, "
            "tile_data BLOB)"
        )
        base.execute("INSERT INTO metadata VALUES ('name', 'made'), ('format', ?)", (kind,))
        rows = [(z, x, 2**z - 1 - y, tile(z, x, y)) for z, x, y in tiles(zooms)]
        base.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    base.close()
    return path


def write_pmtiles(path: Path, zooms: range = range(12, 17), kind: str = "PNG") -> Path:
    from pmtiles.tile import Compression, TileType, zxy_to_tileid
    from pmtiles.writer import Writer

    listed = tiles(zooms)
    d = SPAN_M / 111_000
    with path.open("wb") as file:
        writer = Writer(file)
        for number, at in sorted((zxy_to_tileid(*at), at) for at in listed):
            writer.write_tile(number, tile(*at))
        writer.finalize(
            {
                "tile_type": TileType[kind],
                "tile_compression": Compression.NONE,
                "min_zoom": zooms[0],
                "max_zoom": zooms[-1],
                "min_lon_e7": int((EAST - 1.5 * d) * 1e7),
                "min_lat_e7": int((NORTH - d) * 1e7),
                "max_lon_e7": int((EAST + 1.5 * d) * 1e7),
                "max_lat_e7": int((NORTH + d) * 1e7),
                "center_zoom": zooms[0],
                "center_lon_e7": int(EAST * 1e7),
                "center_lat_e7": int(NORTH * 1e7),
            },
            {"name": "made"},
        )
    return path


def picture_of(epsg: int, px: int = 400) -> tuple[np.ndarray[Any, Any], float, float, float, float]:
    """A picture [px, px, 3] in a coordinate system, with west, north and the pixel's sides."""
    into = Transformer.from_crs("OGC:CRS84", f"EPSG:{epsg}", always_xy=True)
    x, y = into.transform(EAST, NORTH)
    geographic = abs(x) <= 180
    high = SPAN_M / 111_000 if geographic else SPAN_M
    wide = 1.5 * high
    step_x, step_y = 2 * wide / px, 2 * high / px
    at = np.arange(px) + 0.5
    u, v = np.meshgrid(x - wide + at * step_x, y + high - at * step_y)
    lon, lat = into.transform(u, v, direction="INVERSE")
    return colour(lon, lat), x - wide, y + high, step_x, step_y


def write_geotiff(path: Path, epsg: int | None = 25832, **changes: Any) -> Path:
    rgb, west, north, step_x, step_y = picture_of(epsg or 25832, changes.get("px", 400))
    west, north = west + changes.get("east", 0.0), north
    info = TiffImagePlugin.ImageFileDirectory_v2()
    if changes.get("placed", True):
        info[33550] = (step_x, step_y, 0.0)
        info[33922] = (0.0, 0.0, 0.0, west, north, 0.0)
        info.tagtype[33550] = info.tagtype[33922] = 12
    if epsg is not None:
        geographic = epsg in (4326, 4258)
        key = (2048 if geographic else 3072, 0, 1, changes.get("stated", epsg))
        model = (1024, 0, 1, 2 if geographic else 1)
        info[34735] = (1, 1, 0, 3, *model, 1025, 0, 1, 1, *key)
        info.tagtype[34735] = 3
    Image.fromarray(rgb).save(path, "TIFF", tiffinfo=info, compression="tiff_lzw")
    return path


def write_geopackage(path: Path, epsg: int = 25832, zooms: int = 3) -> Path:
    rgb, west, north, step_x, step_y = picture_of(epsg, 512)
    with sqlite3.connect(path) as base:
        base.executescript(
            "CREATE TABLE gpkg_contents (table_name TEXT, data_type TEXT, srs_id INTEGER);"
            "CREATE TABLE gpkg_spatial_ref_sys (srs_id INTEGER, organization TEXT, "
            "organization_coordsys_id INTEGER, definition TEXT);"
            "CREATE TABLE gpkg_tile_matrix_set (table_name TEXT, srs_id INTEGER, min_x REAL, "
            "min_y REAL, max_x REAL, max_y REAL);"
            "CREATE TABLE gpkg_tile_matrix (table_name TEXT, zoom_level INTEGER, "
            "matrix_width INTEGER, matrix_height INTEGER, tile_width INTEGER, "
            "tile_height INTEGER, pixel_x_size REAL, pixel_y_size REAL);"
            'CREATE TABLE "air ""photo" (id INTEGER PRIMARY KEY, zoom_level INTEGER, '
            "tile_column INTEGER, tile_row INTEGER, tile_data BLOB);"
        )
        name = 'air "photo'
        base.execute("INSERT INTO gpkg_contents VALUES (?, 'tiles', ?)", (name, epsg))
        base.execute("INSERT INTO gpkg_spatial_ref_sys VALUES (?, 'EPSG', ?, '')", (epsg, epsg))
        high, wide = 512 * step_y, 512 * step_x
        base.execute(
            "INSERT INTO gpkg_tile_matrix_set VALUES (?, ?, ?, ?, ?, ?)",
            (name, epsg, west, north - high, west + wide, north),
        )
        for zoom in range(zooms):
            n = 2**zoom
            px = 512 // n // (2 ** (zooms - 1 - zoom))
            small = np.asarray(Image.fromarray(rgb).resize((px * n, px * n), Image.Resampling.BOX))
            base.execute(
                "INSERT INTO gpkg_tile_matrix VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                (name, zoom, n, n, px, px, wide / (px * n), high / (px * n)),
            )
            for row in range(n):
                for column in range(n):
                    part = small[row * px : (row + 1) * px, column * px : (column + 1) * px]
                    base.execute(
                        'INSERT INTO "air ""photo" (zoom_level, tile_column, tile_row, tile_data) '
                        "VALUES (?, ?, ?, ?)",
                        (zoom, column, row, png(part)),
                    )
    base.close()
    return path


def write_roads(path: Path) -> Path:
    """A road to the east through the middle and an area, as GeoJSON."""
    d = 0.01
    line = [[EAST - d, NORTH], [EAST + d, NORTH]]
    ring = [[EAST, NORTH], [EAST, NORTH + d], [EAST + d, NORTH + d], [EAST, NORTH]]
    import json

    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": kind, "coordinates": points}}
        for kind, points in (("LineString", line), ("Polygon", [ring]), ("Point", [EAST, NORTH]))
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path
