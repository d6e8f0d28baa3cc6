"""Signs and tracks as PMTiles: one file of vector tiles, which web maps read in pieces.

GDAL cuts each layer into tiles; a tile of both is one after the other, since a vector tile is a
list of layers (Mapbox Vector Tile Specification 2.1, section 4.1).
"""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.export.gis import failure_of, write_layer
from automap.export.layers import Layer, path_layer, sign_layer
from automap.export.path import Path as MapPath
from automap.export.sign_columns import SignColumns
from automap.io.atomic import atomic_path

LEAST_ZOOM, MOST_ZOOM = 6, 15
"""From a country to a street: at 15 a tile's 4096 steps are 0.3 m, finer than signs are known."""


def write_pmtiles(path: Path, columns: SignColumns, track: MapPath | None) -> None:
    """Write layers ``signs`` and ``trajectory``, those that have anything.

    Raises InputError where neither has.
    """
    layers = [_flat(sign_layer(columns), [f.name for f in columns.fields])]
    if track is not None and len(track) > 1:
        layers.append(_flat(path_layer(track), ["speed_m_s", "sd_h_m", "drive"]))
    layers = [layer for layer in layers if len(layer)]
    if not layers:
        raise InputError(f"{path}: the map has neither a path nor a sign with a place to be drawn.")
    parts = [_cut(path, layer) for layer in layers]
    with atomic_path(path) as temporary:
        _join(parts, temporary)


def _flat(layer: Layer, names: Sequence[str]) -> Layer:
    """The layer without heights, places that no map shows, and what tiles cannot hold."""
    import shapely

    there = np.flatnonzero([wkb is not None for wkb in layer.wkb])
    shapes = shapely.force_2d(shapely.from_wkb(layer.wkb[there]))
    columns = {}
    for name in names:
        if name in layer.columns:
            values = layer.columns[name][there]
            if values.dtype.kind == "M":
                values = np.array(
                    [None if np.isnat(v) else f"{v}Z" for v in values] + [None], object
                )[:-1]
            columns[name] = values
    wkb = np.asarray(shapely.to_wkb(shapes), object).reshape(-1)
    kind = layer.geometry_type.split()[0].replace("Unknown", "Point")
    return Layer(layer.name, kind, wkb, columns, {})


def _cut(path: Path, layer: Layer) -> bytes:
    """The layer's own tiles, made in memory: GDAL does not see that files cannot be written."""
    from pyogrio.errors import DataLayerError, DataSourceError

    # no sign is left out of a full tile
    options = {"MAX_SIZE": "5000000", "MAX_FEATURES": "1000000"}
    options |= {"MINZOOM": str(LEAST_ZOOM), "MAXZOOM": str(MOST_ZOOM)}
    tiles = BytesIO()
    try:
        write_layer(tiles, layer, "PMTiles", "EPSG:4326", dataset_options=options)
    except (DataSourceError, DataLayerError) as error:
        raise failure_of(path, layer.name, error) from error
    return tiles.getvalue()


def _join(parts: Sequence[bytes], target: Path) -> None:
    from pmtiles.reader import MemorySource, Reader, all_tiles
    from pmtiles.tile import Compression, zxy_to_tileid
    from pmtiles.writer import Writer

    tiles: dict[int, bytes] = {}
    layers: list[Any] = []
    bounds: list[tuple[int, int, int, int]] = []
    header: dict[str, Any] = {}
    for part in parts:
        source = MemorySource(part)
        reader = Reader(source)
        header = reader.header()
        layers += reader.metadata().get("vector_layers", [])
        bounds.append(
            tuple(header[f"{e}_e7"] for e in ("min_lon", "min_lat", "max_lon", "max_lat"))
        )
        packed = header["tile_compression"] == Compression.GZIP
        for zxy, tile in all_tiles(source):
            plain = gzip.decompress(tile) if packed else tile
            number = zxy_to_tileid(*zxy)
            tiles[number] = tiles.get(number, b"") + plain
    west, south, east, north = (
        pick(b[k] for b in bounds) for k, pick in enumerate((min, min, max, max))
    )
    header |= {"min_lon_e7": west, "min_lat_e7": south, "max_lon_e7": east, "max_lat_e7": north}
    header["tile_compression"] = Compression.GZIP
    with target.open("wb") as file:
        writer = Writer(file)
        for number in sorted(tiles):
            writer.write_tile(number, gzip.compress(tiles[number], mtime=0))
        writer.finalize(header, {"name": "AutoMap", "vector_layers": layers})
