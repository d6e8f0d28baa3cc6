"""Positions in projected coordinates, and heights of a national height system.

The datum comes first (``datum.py``: published operations only, with their accuracy); a projection
of the same datum is exact. A height system needs the grid of its geoid; without it PROJ would
take ellipsoidal heights for national ones, tens of metres off, which is refused here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import ConfigError, InputError
from automap.export.datum import Datum, parse_datum
from automap.export.layers import Layer, WkbArray
from automap.export.operations import area_missed, find_crs, operation
from automap.records import FloatArray

if TYPE_CHECKING:
    from pyproj import CRS


@dataclass(frozen=True)
class Projection:
    """A projected system as asked for: ``code`` of the plane, ``datum`` of its longitudes,
    ``heights`` the code of the height system, "" for heights above the ellipsoid."""

    code: str
    name: str
    datum: Datum
    heights: str = ""

    @property
    def crs(self) -> str:
        """Name of the coordinate system for GIS files."""
        return f"{self.code}+{self.heights.partition(':')[2]}" if self.heights else self.code


@dataclass(frozen=True)
class Plane:
    """How to get from longitude and latitude in degrees of the datum, and ellipsoidal height, to
    the plane: ``points`` maps three arrays [n] to easting, northing and height; ``accuracy_m`` of
    the heights' operation, 0 where they stay."""

    projection: Projection
    points: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, ...]]
    operation: str = ""
    accuracy_m: float = 0.0


def parse_projection(text: str, heights: str = "") -> Projection:
    """A system as PROJ takes it ("EPSG:25832", "25832", a name, WKT), with the height system
    ``heights``, such as "EPSG:7837".

    Both may stand in one code ("EPSG:25832+7837", "EPSG:5555"). Raises ConfigError for what is no
    projected system or no height system, or has no code of EPSG, which files are to state.
    """
    crs, up = find_crs(text, "--crs"), find_crs(heights, "--heights") if heights else None
    if crs.is_compound:
        crs, own = crs.sub_crs_list[:2]
        up = up or own
    if not crs.is_projected or crs.geodetic_crs is None:
        raise ConfigError(
            f"--crs {text} is {crs.name}, which is no projected system; for longitude and "
            "latitude in a datum take --datum."
        )
    if up is not None and not up.is_vertical:
        raise ConfigError(f"--heights {heights or text} is {up.name}, which is no height system.")
    try:
        datum = parse_datum(_code(crs.geodetic_crs, text))
    except ConfigError as error:
        raise ConfigError(f"--crs {text}: {error}") from None
    return Projection(_code(crs, text), crs.name, datum, "" if up is None else _code(up, text))


def _code(crs: CRS, text: str) -> str:
    authority = crs.to_authority("EPSG")
    if authority is None:
        raise ConfigError(
            f"--crs {text}: {crs.name} has no code of EPSG, which the files state; name one that "
            "has, such as EPSG:25832."
        )
    return ":".join(authority)


def plane_of(projection: Projection, lon_deg: FloatArray, lat_deg: FloatArray) -> Plane:
    """How to project a map whose positions [n] are in the projection's datum.

    Raises InputError where the system is not made for the place, or PROJ has no grid or no
    operation for the heights, with what is missing.
    """
    from pyproj import Transformer

    good = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    lon, lat = lon_deg[good], lat_deg[good]
    missed = area_missed(projection.code, lon, lat)
    if missed:
        raise InputError(
            f"--crs {projection.code} ({projection.name}) is made for {missed}, and the map lies "
            "elsewhere; name the zone that it lies in."
        )
    crs = find_crs(projection.code, "--crs")
    geodetic = crs.geodetic_crs
    assert geodetic is not None
    flat = Transformer.from_crs(geodetic, crs, always_xy=True)
    rise: Any = None
    accuracy = 0.0
    if projection.heights and len(lon):
        bounds = (float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max()))
        target = f"{_code(geodetic, projection.code)}+{projection.heights.partition(':')[2]}"
        rise, accuracy = operation(
            projection.datum.code, target, f"--heights {projection.heights}", bounds
        )

    def points(lon: FloatArray, lat: FloatArray, up: FloatArray) -> tuple[FloatArray, ...]:
        east, north = flat.transform(lon, lat)
        high = up
        if rise is not None:
            high = rise.transform(lon, lat, np.nan_to_num(up))[2]
            lost = np.isfinite(lon) & np.isfinite(lat) & ~np.isfinite(high)
            if lost.any():
                raise InputError(
                    f"--heights {projection.heights}: its grid does not reach all of the map's "
                    "positions."
                )
            high = np.where(np.isfinite(up), high, np.nan)
        return (*(np.where(np.isfinite(v), v, np.nan) for v in (east, north)), high)

    told = "" if rise is None else str(rise.description)
    return Plane(projection, points, told, accuracy)


def projected_layer(layer: Layer, plane: Plane) -> Layer:
    """The layer with its geometries in the plane."""
    return replace(layer, wkb=projected_wkb(layer.wkb, plane))


def projected_wkb(wkb: WkbArray, plane: Plane) -> WkbArray:
    """Geometries [n] in the plane; None stays None."""
    import shapely

    shapes = shapely.from_wkb(wkb)
    high = shapely.has_z(shapes)
    there = ~shapely.is_missing(shapes)

    def moved(at: FloatArray) -> FloatArray:
        up = at[:, 2] if at.shape[1] == 3 else np.full(len(at), np.nan)
        places = plane.points(at[:, 0], at[:, 1], up)
        return np.stack(places[: at.shape[1]], axis=1)

    out = np.full(len(wkb), None, object)
    for rows, include_z in ((there & high, True), (there & ~high, False)):
        if rows.any():
            turned = shapely.transform(shapes[rows], moved, include_z=include_z)
            out[rows] = shapely.to_wkb(turned, flavor="iso")
    return out
