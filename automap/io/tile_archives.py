"""Archives of web map tiles as pictures: PMTiles (version 3) and MBTiles (version 1.3)."""

from __future__ import annotations

import gzip
import sqlite3
import threading
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.web_tiles import TILE_PX, Bounds, content_type, decoded, from_world

_FINEST = 30  # zoom; a tile is 4 cm wide
_MOST_STEPS = 3000  # millions a query, a minute or two; some for every tile of an archive
_WORLD: Bounds = (-180.0, -85.06, 180.0, 85.06)
_VECTORS = (
    "holds vector tiles, which are not drawn; give tiles of pictures, or the lines themselves as "
    "GeoPackage or GeoJSON."
)


class PmTiles:
    """Pictures of a PMTiles archive. Raises InputError where it holds none or is damaged."""

    def __init__(self, path: Path) -> None:
        from pmtiles.reader import MmapSource, Reader
        from pmtiles.tile import Compression, TileType

        self.name = path.name
        try:
            with path.open("rb") as file:
                self._reader = Reader(MmapSource(file))
            header = self._reader.header()
            kind, packed = header["tile_type"], header["tile_compression"]
            self.least_zoom, self.most_zoom = int(header["min_zoom"]), int(header["max_zoom"])
            ends = ("min_lon", "min_lat", "max_lon", "max_lat")
            self.bounds = _checked(tuple(header[f"{end}_e7"] * 1e-7 for end in ends))
        # the reader fails in many ways of its own on what is no archive
        except Exception as error:
            raise InputError(f"{path}: is no PMTiles archive of version 3, or damaged.") from error
        if kind in (TileType.MVT, TileType.MLT):
            raise InputError(f"{path}: {_VECTORS}")
        self._packed = packed == Compression.GZIP
        self.tile_px = _side(self, path)

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A tile as it is stored."""
        try:
            data = self._reader.get(zoom, x, y)
            return gzip.decompress(data) if data and self._packed else data
        except Exception:
            return None


class MbTiles:
    """Pictures of an MBTiles database. Raises InputError where it holds none or is damaged."""

    def __init__(self, path: Path) -> None:
        self.name = path.name
        self._lock = threading.Lock()
        self._base = read_only(path)
        try:
            told = dict(self._base.execute("SELECT name, value FROM metadata"))
            zooms = self._base.execute(
                "SELECT min(zoom_level), max(zoom_level) FROM tiles "
                "WHERE zoom_level BETWEEN 0 AND ?",
                (_FINEST,),
            )
            least, most = zooms.fetchone()
        except (sqlite3.Error, ValueError) as error:
            raise InputError(f"{path}: is no MBTiles database ({error}).") from error
        if str(told.get("format")) in ("pbf", "mvt"):
            raise InputError(f"{path}: {_VECTORS}")
        if least is None:
            raise InputError(f"{path}: holds no tiles.")
        self.least_zoom, self.most_zoom = int(least), int(most)
        try:
            self.bounds = _checked(tuple(float(v) for v in str(told["bounds"]).split(",")))
        except (KeyError, ValueError):
            self.bounds = self._covered()
        self.tile_px = _side(self, path)

    def tile(self, zoom: int, x: int, y: int) -> bytes | None:
        """A tile as it is stored; rows count from the south there."""
        query = (
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?"
        )
        with self._lock:
            try:
                row = self._base.execute(query, (zoom, x, 2**zoom - 1 - y)).fetchone()
            except (sqlite3.Error, UnicodeDecodeError):
                return None
        return bytes(row[0]) if row and isinstance(row[0], bytes) else None

    def _covered(self) -> Bounds:
        """Where the tiles of the finest zoom lie."""
        query = (
            "SELECT min(tile_column), min(tile_row), max(tile_column), max(tile_row) FROM tiles "
            "WHERE zoom_level = ?"
        )
        n = 2.0**self.most_zoom
        try:
            ends = self._base.execute(query, (self.most_zoom,)).fetchone()
            west, south, east, north = (min(max(float(end), 0.0), n) for end in ends)
        except (sqlite3.Error, TypeError, ValueError):
            return _WORLD
        x = np.array([west, east + 1.0]) / n
        y = 1.0 - np.array([south, north + 1.0]) / n
        lon, lat = from_world(x, y)
        return float(lon[0]), float(lat[0]), float(lon[1]), float(lat[1])


def read_only(path: Path) -> sqlite3.Connection:
    """A database that is only read, by any thread that holds its lock; a query without an end,
    as views of a hostile file have, is broken off."""
    try:
        base = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True,
                               check_same_thread=False)  # fmt: skip
    except sqlite3.Error as error:
        raise InputError(f"{path}: cannot be read as a database ({error}).") from error
    steps = 0

    def begins(statement: str) -> None:
        nonlocal steps
        steps = 0

    def goes_on() -> bool:
        nonlocal steps
        steps += 1
        return steps > _MOST_STEPS

    base.set_trace_callback(begins)
    base.set_progress_handler(goes_on, 1_000_000)
    return base


def _checked(bounds: tuple[float, ...]) -> Bounds:
    west, south, east, north = bounds
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        return _WORLD
    return west, south, east, north


def _side(archive: PmTiles | MbTiles, path: Path) -> int:
    """Pixels of a tile's side, of the first tile that is found from the widest zoom on."""
    west, south, east, north = archive.bounds
    from automap.io.web_tiles import to_world

    x, y = to_world(np.array([0.5 * (west + east)]), np.array([0.5 * (south + north)]))
    for zoom in range(archive.least_zoom, archive.most_zoom + 1):
        data = archive.tile(zoom, int(x[0] * 2**zoom), int(y[0] * 2**zoom))
        if data is None:
            continue
        if content_type(data) is None:
            break
        image = decoded(data)
        return TILE_PX if image is None else int(image.shape[1])
    else:
        return TILE_PX
    raise InputError(f"{path}: its tiles are no pictures of PNG, JPEG, WebP or AVIF.")
