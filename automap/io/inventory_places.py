"""Where the entries of a foreign list are: the readings of its coordinates that lead to the map."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.vector_layer import VectorLayer, numbers, to_degrees
from automap.records import BoolArray, FloatArray


def read_places(
    path: Path,
    table: VectorLayer,
    columns: Mapping[str, str],
    crs: str | None,
    near: tuple[FloatArray, FloatArray] | None,
    warnings: list[str],
) -> tuple[FloatArray, FloatArray]:
    """Longitudes and latitudes [n] in degrees, NaN for none; what is doubtful is added to
    ``warnings``. ``crs`` and ``near`` as of ``read_inventory``, ``columns`` by role."""
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
    return lon, lat


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
