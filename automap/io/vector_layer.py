"""Features of other people's files: GeoPackage, GeoJSON, Shapefile, (Geo)Parquet, CSV and the like.

GDAL reads what it knows through pyogrio, pyarrow reads Parquet (the wheel's GDAL may not) and CSV.
"""

from __future__ import annotations

import glob
import json
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.errors import InputError
from automap.io.tables import check_texts

_TABLES = (".csv", ".tsv", ".txt")
_PARQUET = (".parquet", ".geoparquet", ".pq")
_REDIRECTION = re.compile(rb"<OGR\w+DataSource")
"""Files of GDAL's that are no data but say where any are: other files and the net."""
_SPELLED = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_KNOWN = "GeoPackage, GeoJSON, Shapefile, Parquet or CSV"


@dataclass(frozen=True)
class VectorLayer:
    """Features [n]: ``geometry`` shapely geometries or None, None altogether for a plain table;
    ``crs`` as the file states it (None: not at all); ``columns`` by name, [n] objects."""

    geometry: npt.NDArray[np.object_] | None
    crs: str | None
    columns: dict[str, npt.NDArray[np.object_]]
    count: int

    def __len__(self) -> int:
        return self.count


def read_layer(path: Path, layer: str | None = None, shape: str | None = "Point") -> VectorLayer:
    """Read one layer of a file; without ``layer`` the one that has geometries of ``shape``,
    with None the first that has any.

    Raises InputError when there is no such file or layer, when several may be meant, or when it
    cannot be read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; give a file of {_KNOWN}.")
    suffix = path.suffix.lower()
    try:
        if suffix in _PARQUET:
            return _parquet(path)
        if suffix in _TABLES:
            return _csv(path)
        redirects = path.is_file() and _REDIRECTION.search(_head(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    if redirects:
        raise InputError(f"{path}: only says where else data are; give a file of {_KNOWN}.")
    return _gdal(path, layer, shape)


def layer_files(path: Path) -> list[Path]:
    """The files that a layer is in: a Shapefile is several of one name."""
    parts = path.parent.glob(f"{glob.escape(path.stem)}.*")
    return sorted({path, *parts}) if path.suffix.lower() == ".shp" else [path]


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(4096)


def _gdal(path: Path, layer: str | None, shape: str | None) -> VectorLayer:
    import pyogrio
    import shapely
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import read

    try:
        with warnings.catch_warnings():
            # GDAL's own words on what it passes over
            warnings.simplefilter("ignore")
            listed = pyogrio.list_layers(path)
            if layer is not None and layer not in listed[:, 0]:
                have = ", ".join(map(str, listed[:, 0]))
                raise InputError(f"{path} has no layer {layer}; it has {have}.")
            chosen = layer or _only_layer(path, listed, shape)
            meta, _, wkb, values = read(path, layer=chosen)
            geometry = None if wkb is None else np.asarray(shapely.from_wkb(wkb), object)
    except (DataSourceError, DataLayerError, shapely.errors.GEOSException, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read ({str(error).splitlines()[0]}); give a file of {_KNOWN}."
        ) from error
    columns = {
        str(name): np.asarray(value).astype(object)
        for name, value in zip(meta["fields"], values, strict=True)
    }
    count = len(geometry) if geometry is not None else len(next(iter(columns.values()), []))
    return VectorLayer(geometry, meta.get("crs"), columns, count)


def _only_layer(path: Path, listed: npt.NDArray[np.object_], shape: str | None) -> str | None:
    """The one of the layers [n, 2] (name, kind of geometry) that has ``shape``, or any, or rows."""
    import pyogrio

    spatial = listed[[kind is not None for kind in listed[:, 1]]]
    if shape is None and len(spatial):
        return str(spatial[0, 0])
    shaped = spatial[[str(shape) in str(kind) for kind in spatial[:, 1]]]
    left = next((some for some in (shaped, spatial, listed) if len(some)), listed)[:, 0].tolist()
    if len(left) > 1:
        # forms of GPX and of workbooks have layers with nothing in them
        left = [n for n in left if pyogrio.read_info(path, layer=n)["features"]] or left[:1]
    if len(left) > 1:
        named = "name it with --layer, or " if shape == "Point" else ""
        raise InputError(
            f"{path}: has the layers {', '.join(left)}, and which one is meant is not said; "
            f"{named}save it in a file of its own."
        )
    return left[0] if left else None


def _parquet(path: Path) -> VectorLayer:
    import pyarrow as pa
    import pyarrow.parquet as pq
    import shapely

    try:
        # where memory is short Arrow waits for threads that never began
        with pq.ParquetFile(path) as file:
            table = file.read(use_threads=False)
        check_texts(table)
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no Parquet file ({str(error).splitlines()[0]}).") from error
    columns = {
        name: np.array(table[name].to_pylist(), object)
        for name in table.column_names
        if not pa.types.is_nested(table[name].type) and not pa.types.is_binary(table[name].type)
    }
    try:
        geo = json.loads((table.schema.metadata or {}).get(b"geo", b"{}"))
        name = geo.get("primary_column") or "geometry"
        # without an entry the format means longitude and latitude, with null none is known
        stated = geo["columns"][name].get("crs", "OGC:CRS84") if "columns" in geo else None
        crs = json.dumps(stated) if isinstance(stated, dict) else stated
        geometry = None
        if name in table.column_names and pa.types.is_binary(table[name].type):
            geometry = np.asarray(shapely.from_wkb(table[name].to_pylist()), object)
    except (ValueError, KeyError, TypeError, AttributeError, shapely.errors.GEOSException) as error:
        raise InputError(f"{path}: its geometries cannot be read ({error}).") from error
    return VectorLayer(geometry, crs, columns, len(table))


def _csv(path: Path) -> VectorLayer:
    import codecs
    import csv
    import io

    data = path.read_bytes()
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise InputError(
            f"{path}: is a spreadsheet or an archive and no text; call it .xlsx or unpack it."
        )
    # a spreadsheet's "Unicode text" is UTF-16, its CSV on Windows often of the code page
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("utf-16" if wide else "cp1252", "replace")
    first = text.partition("\n")[0]
    separator = max((";", ",", "\t", "|"), key=first.count)
    try:
        rows = [
            row for row in csv.reader(io.StringIO(text, newline=""), delimiter=separator) if row
        ]
    except csv.Error as error:
        raise InputError(f"{path}: is no CSV file ({error}).") from error
    if len(rows) < 1:
        raise InputError(f"{path}: is empty; its first line must name the columns.")
    header = [name.strip() for name in rows[0]]
    width = len(header)
    for number, row in enumerate(rows[1:], start=2):
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            raise InputError(
                f"{path}, line {number}: {len(row)} cells, but {width} columns are named; quote "
                "cells that hold the separator."
            )
    cells = [[*row, *[""] * width][:width] for row in rows[1:]]
    columns = {
        name: np.array([row[k].strip() for row in cells], object)
        for k, name in enumerate(header)
        if name
    }
    return VectorLayer(None, None, columns, len(cells))


def parse_crs(text: str) -> Any:
    """The coordinate system of a code of EPSG with or without the name, of an identifier, a name or
    WKT, as ``pyproj`` takes them; ValueError, with PROJ's reason, where there is none."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(text.strip())
    except CRSError as error:
        raise ValueError(str(error).splitlines()[0]) from None


def to_degrees(
    x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], crs: str, where: Path
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Longitude and latitude in degrees, WGS-84, of coordinates [n] of any system, east first.

    Raises InputError for a system that PROJ does not know.
    """
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        change = Transformer.from_crs(parse_crs(crs), "OGC:CRS84", always_xy=True)
        lon, lat = change.transform(x, y)
    except (ProjError, ValueError) as error:
        raise InputError(
            f"{where}: its coordinate system {crs[:60]!r} cannot be used "
            f"({str(error).splitlines()[0]}); give another with --crs."
        ) from error
    lon, lat = np.asarray(lon, np.float64), np.asarray(lat, np.float64)
    bad = ~(np.isfinite(lon) & np.isfinite(lat))
    return np.where(bad, np.nan, lon), np.where(bad, np.nan, lat)


def numbers(values: npt.NDArray[np.object_]) -> npt.NDArray[np.float64]:
    """Cells [n] as numbers, a decimal comma too; NaN for what is none."""
    result = np.full(len(values), np.nan)
    for k, value in enumerate(values.tolist()):
        try:
            result[k] = float(value.strip().replace(",", ".") if isinstance(value, str) else value)
        except (TypeError, ValueError, AttributeError):
            continue
    return result


def texts(values: npt.NDArray[np.object_]) -> list[str]:
    """Cells [n] as texts, whole numbers without a point; "" for what is empty."""
    result = []
    for value in values.tolist():
        if value is None or (isinstance(value, float) and np.isnan(value)):
            result.append("")
        elif isinstance(value, float) and value.is_integer():
            result.append(str(int(value)))
        else:
            result.append(str(value).strip())
    return result


def column_named(columns: Mapping[str, Any], names: tuple[str, ...]) -> str | None:
    """The column of one of ``names`` (the first that is there), whatever its case and marks; its
    umlauts as two letters."""
    plain = {
        "".join(c for c in name.lower().translate(_SPELLED) if c.isalnum()): name
        for name in reversed(list(columns))
    }
    return next((plain[name] for name in names if name in plain), None)
