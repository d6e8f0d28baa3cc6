"""A list of signs as some authority keeps it: any table of points, with any names of columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.vector_layer import (
    VectorLayer,
    column_named,
    numbers,
    read_layer,
    texts,
    to_degrees,
)
from automap.records import BoolArray, FloatArray

ROLES = {
    "id": (
        *("id", "signid", "assetid", "objectid", "zeichenid", "nummer", "nr", "number", "ref"),
        *("lfdnr", "laufendenummer", "inventarnummer", "inventarnr", "schildnr", "standortnr"),
        *("osmid", "fid", "gid", "uuid", "name"),
    ),
    "class": (
        *("class", "trafficsign", "signclass", "signcode", "signtype", "vzkat", "vznr", "vz"),
        *("zeichennummer", "zeichennr", "verkehrszeichen", "zeichen", "mutcd", "mutcdcode", "code"),
        *("vznummer", "vzkatnr", "vzkatnummer", "zeichencode", "vzcode"),
        *("type", "typ", "value", "klasse", "category"),
    ),
    "lat": ("lat", "latitude", "latdeg", "breite", "geogrbreite", "latitudedeg", "breitengrad"),
    "lon": (
        *("lon", "lng", "long", "longitude", "londeg", "laenge", "laengengrad", "longitudedeg"),
        "geogrlaenge",
    ),
    "x": ("x", "easting", "east", "rechtswert", "rw", "ostwert", "e", "xcoord", "koordx"),
    "y": ("y", "northing", "north", "hochwert", "hw", "nordwert", "n", "ycoord", "koordy"),
    "facing": (
        *("facing", "facingdeg", "direction", "bearing", "azimuth", "azimut", "heading"),
        *("richtung", "ausrichtung", "blickrichtung", "orientation", "orientierung"),
    ),
    "sd": ("sd", "sdm", "accuracy", "accuracym", "sigma", "genauigkeit", "precision"),
    "value": ("speed", "speedlimit", "limit", "maxspeed", "wert", "text", "aufschrift"),
}
"""What is read of a list, and names that such columns have, without marks and in lower case."""

_POINTS = (
    *("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE"),
    *("S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW"),
)
_COMPASS = {name: 22.5 * k for k, name in enumerate(_POINTS)}


@dataclass(frozen=True)
class InventoryFile:
    """Listed signs [n] as they are told: ``ids``, ``codes`` ("" none), positions in rad (NaN for
    none), ``facing_rad`` and ``sd_m`` (NaN unknown); the names of the columns by role, and of those
    ``unread``; sentences about what is doubtful."""

    ids: list[str]
    codes: list[str]
    lat_rad: FloatArray
    lon_rad: FloatArray
    facing_rad: FloatArray
    sd_m: FloatArray
    columns: dict[str, str]
    unread: tuple[str, ...] = ()
    warnings: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.ids)


def read_inventory(
    path: Path,
    stated: Mapping[str, str] | None = None,
    crs: str | None = None,
    layer: str | None = None,
    near: tuple[FloatArray, FloatArray] | None = None,
) -> InventoryFile:
    """Read the list in ``path``.

    ``stated`` names columns by role (``ROLES``), others are guessed; ``crs`` replaces the file's
    own; ``near`` are latitudes and longitudes (rad) where the signs should be: coordinates that
    only lie there when they are read otherwise (``_near_readings``) are, with a warning. Raises
    InputError for a list without positions or in an unknown coordinate system, ConfigError for an
    unknown role or column.
    """
    table = read_layer(path, layer)
    columns = _columns(path, table, stated or {})
    warnings: list[str] = []
    x, y, told = _coordinates(path, table, columns)
    system = crs or told
    if system is None:
        x, y, system = _guessed_system(path, x, y, warnings)
    lon, lat = to_degrees(x, y, system, path)
    if near is not None:
        lon, lat = _near_readings(path, (x, y), (lon, lat), system, near, warnings)
    lon, lat = _on_earth(path, lon, lat)
    outside = int((~(np.isfinite(lon) & np.isfinite(lat))).sum())
    if outside:
        warnings.append(f"{path}: {outside} of {len(table)} entries have no usable position.")
    if near is not None:
        warnings += _far(path, lon, lat, near)
    if "class" not in columns:
        have = ", ".join(list(table.columns)[:12]) or "none"
        warnings.append(
            f"{path}: no column says what the signs are (columns: {have}), so classes are not "
            "compared; name one with --columns class=NAME."
        )

    def column(role: str) -> list[str]:
        return texts(table.columns[columns[role]]) if role in columns else [""] * len(table)

    ids = column("id")
    if len(set(ids)) < len(ids):
        ids = (
            [
                name if name and ids.count(name) == 1 else f"{name or 'row'}#{k + 1}"
                for k, name in enumerate(ids)
            ]
            if len(ids) < 20000
            else [f"{n}#{k + 1}" for k, n in enumerate(ids)]
        )
        if "id" in columns:
            warnings.append(f"{path}: names of entries repeat; their places are added to them.")
    codes, values = column("class"), column("value")
    facing = _directions(column("facing"))
    odd = [cell for cell, a in zip(column("facing"), facing, strict=True) if cell and np.isnan(a)]
    if odd:
        warnings.append(
            f"{path}: directions of {len(odd)} entries are neither degrees within 360 nor points "
            f"of the compass, such as {odd[0][:20]!r}; they are not used."
        )
    sd = numbers(table.columns[columns["sd"]]) if "sd" in columns else np.full(len(table), np.nan)
    return InventoryFile(
        ids,
        [_with_value(code, value) for code, value in zip(codes, values, strict=True)],
        np.radians(lat),
        np.radians(lon),
        np.radians(facing),
        np.where(sd > 0.0, sd, np.nan),
        columns,
        tuple(name for name in table.columns if name not in columns.values()),
        warnings,
    )


def _columns(path: Path, table: VectorLayer, stated: Mapping[str, str]) -> dict[str, str]:
    for role, name in stated.items():
        if role not in ROLES:
            raise ConfigError(f"--columns: no {role!r}; it takes {', '.join(ROLES)}.")
        if name not in table.columns:
            have = ", ".join(table.columns) or "no columns"
            raise ConfigError(f"--columns {role}={name}: {path} has {have}.")
    columns = dict(stated)
    for role, names in ROLES.items():
        found = column_named(table.columns, names)
        if role not in columns and found is not None and found not in columns.values():
            columns[role] = found
    return columns


def _coordinates(
    path: Path, table: VectorLayer, columns: Mapping[str, str]
) -> tuple[FloatArray, FloatArray, str | None]:
    """East and north coordinates, and the system that the file states."""
    import shapely

    if table.geometry is not None:
        kinds = shapely.get_type_id(table.geometry)
        lines = int(np.isin(kinds, (1, 2, 3, 5, 6)).sum())
        if lines:
            raise InputError(
                f"{path}: {lines} of {len(table)} entries are lines or areas; an inventory of "
                "signs holds points."
            )
        points = shapely.centroid(table.geometry)
        return shapely.get_x(points), shapely.get_y(points), table.crs
    if "lat" in columns and "lon" in columns:
        lon, lat = (numbers(table.columns[columns[role]]) for role in ("lon", "lat"))
        return lon, lat, "OGC:CRS84"
    if "x" in columns and "y" in columns:
        x, y = (numbers(table.columns[columns[role]]) for role in ("x", "y"))
        return x, y, None
    have = ", ".join(table.columns) or "none"
    raise InputError(
        f"{path}: no columns of positions were found (columns: {have}); name them with "
        "--columns lat=NAME,lon=NAME or --columns x=NAME,y=NAME and --crs."
    )


def _guessed_system(
    path: Path, x: FloatArray, y: FloatArray, warnings: list[str]
) -> tuple[FloatArray, FloatArray, str]:
    known = np.isfinite(x) & np.isfinite(y)
    if known.any() and (np.abs(x[known]).max() > 180.0 or np.abs(y[known]).max() > 180.0):
        raise InputError(
            f"{path}: states no coordinate system and its coordinates are no degrees; give the "
            "system with --crs, such as --crs EPSG:25832."
        )
    warnings.append(f"{path}: states no coordinate system; longitude and latitude are taken.")
    return x, y, "OGC:CRS84"


def _near_readings(
    path: Path,
    given: tuple[FloatArray, FloatArray],
    found: tuple[FloatArray, FloatArray],
    system: str,
    near: tuple[FloatArray, FloatArray],
    warnings: list[str],
) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes [n], those of entries that only another reading brings to the map by
    that: the other way round, degrees among metres, the number of the zone ahead of an easting."""
    (x, y), (lon, lat) = given, (each.copy() for each in found)
    finite = np.isfinite(x) & np.isfinite(y)
    known = int(finite.sum())
    zoned = np.where(finite, x, np.nan) % 1e6
    for what, east, north, crs in (
        ("are the other way round; they were turned", y, x, system),
        ("are degrees and not of the system; they are taken as such", x, y, "OGC:CRS84"),
        ("are degrees and not of the system; they are taken as such", y, x, "OGC:CRS84"),
        ("begin with the number of the zone; it was taken off", zoned, y, system),
    ):
        away = ~_about(lon, lat, near)
        if not away.any():
            break
        other = to_degrees(east[away], north[away], crs, path)
        good = _about(*other, near)
        n = int(good.sum())
        if n:
            at = np.flatnonzero(away)[good]
            lon[at], lat[at] = other[0][good], other[1][good]
            whose = "its coordinates" if n == known else f"coordinates of {n} of {known} entries"
            warnings.append(f"{path}: {whose} {what}.")
    return lon, lat


def _about(lon: FloatArray, lat: FloatArray, near: tuple[FloatArray, FloatArray]) -> BoolArray:
    """Which places [n] lie within some ten kilometres about the map."""
    south, north = np.degrees([near[0].min(), near[0].max()]) + np.array([-0.1, 0.1])
    west, east = np.degrees([near[1].min(), near[1].max()]) + np.array([-0.2, 0.2])
    return np.asarray((lon > west) & (lon < east) & (lat > south) & (lat < north))


def _on_earth(path: Path, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes; NaN for what is none, and for what tables have for nothing: 0, 0.

    Raises InputError where none of them is one.
    """
    known = np.isfinite(lon) & np.isfinite(lat)
    degrees = known & (np.abs(lat) <= 90.0) & (np.abs(lon) <= 360.0)
    if known.any() and not degrees.any():
        first = int(np.argmax(known))
        raise InputError(
            f"{path}: its latitudes and longitudes are no degrees (the first are {lat[first]:.10g} "
            f"and {lon[first]:.10g}); name such columns with --columns x=NAME,y=NAME and give the "
            "coordinate system with --crs."
        )
    good = degrees & ~((lat == 0.0) & (lon == 0.0))
    return np.where(good, lon, np.nan), np.where(good, lat, np.nan)


def _far(
    path: Path, lon: FloatArray, lat: FloatArray, near: tuple[FloatArray, FloatArray]
) -> list[str]:
    """How many entries lie elsewhere than the map."""
    known = np.isfinite(lon) & np.isfinite(lat)
    far = known & ~_about(lon, lat, near)
    if not far.any():
        return []
    where = f"they are round {np.median(lat[far]):.3f}, {np.median(lon[far]):.3f}"
    if far.sum() == known.sum():
        return [f"{path}: none of its entries lies near the map; {where}. Check --crs."]
    number = f"{int(far.sum())} of {len(lat)} entries lie"
    return [f"{path}: {number} more than 10 km from the map and are not compared; {where}."]


def _directions(cells: list[str]) -> FloatArray:
    """Degrees, or points of the compass; NaN for what is neither."""
    result = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if cell.upper() in _COMPASS:
            result[k] = _COMPASS[cell.upper()]
            continue
        value = numbers(np.array([cell.rstrip("°")], object))[0]
        if abs(value) <= 360.0:
            result[k] = value
    return result


def _with_value(code: str, value: str) -> str:
    """``R4-1`` with 60 in a column of its own is ``R4-1[60]``; one with a number keeps it.
    OpenStreetMap's word for limits stands beside the tag that has the number."""
    digits = value.split(" ")[0]
    if digits.isdigit() and code.strip().lower() == "maxspeed":
        return f"maximum speed limit {digits}"
    bare = code.split(":")[-1].strip().upper().removeprefix("VZ").strip()
    if digits.isdigit() and bare in ("274", "278", "R4-1", "R4-12", "R2-1"):
        return f"{code}[{digits}]"
    return code
