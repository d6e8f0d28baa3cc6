"""A map in projected coordinates: what some formats get with ``--crs`` and ``--heights``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.earth import metres_per_radian
from automap.errors import ConfigError, InputError
from automap.export.datum import parse_datum
from automap.export.projected import Plane, parse_projection, plane_of
from automap.records import FloatArray
from pipeline.export.content import MapContent
from pipeline.export.datum import in_datum

PROJECTED_FORMATS = ("gpkg", "shapefile", "flatgeobuf", "parquet", "csv", "xlsx", "postgis")
"""Formats that can hold projected coordinates; the others are longitude and latitude."""
_USUAL_STRETCH = 0.01
"""Systems made for surveying keep lengths to 0.001, those of large countries to some thousandths;
Web Mercator stretches them by one over the cosine of the latitude."""


def check_projected(crs: str, heights: str, datum: str, fmt: str) -> None:
    """Raise ConfigError when ``fmt`` cannot be in such a system, or the wishes do not agree."""
    if heights and not crs:
        raise ConfigError("--heights belongs to --crs, as in --crs EPSG:25832 --heights EPSG:7837.")
    if not crs:
        return
    if fmt not in PROJECTED_FORMATS:
        raise ConfigError(
            f"--crs {crs}: {fmt} has longitude and latitude only; take one of "
            f"{', '.join(PROJECTED_FORMATS)}."
        )
    projection = parse_projection(crs, heights)
    if datum and parse_datum(datum).code != projection.datum.code:
        raise ConfigError(
            f"--datum {datum}: {projection.name} belongs to the datum {projection.datum.name}; "
            "leave --datum out."
        )


def in_projection(content: MapContent, crs: str, heights: str, datum: str) -> MapContent:
    """The same content with the plane ``crs``, and what was done in its lineage.

    ``datum`` may say the year of the coordinates. Raises as ``in_datum`` and ``plane_of``.
    """
    projection = parse_projection(crs, heights)
    try:
        content = in_datum(content, datum or projection.datum.code)
    except InputError as error:
        # the datum's name stands in the system's
        why = str(error).removeprefix(f"--datum {projection.datum.name}").removeprefix(":").strip()
        raise InputError(f"--crs {crs} ({projection.name}): {why}") from None
    plane = plane_of(projection, content.signs.lon_deg, content.signs.lat_deg)
    located = content.signs.located
    places = content.signs.lon_deg[located], content.signs.lat_deg[located]
    stretch = _stretch(plane, *places) if located.any() else 1.0
    if abs(stretch - 1.0) > _USUAL_STRETCH:
        content.warnings.append(
            f"Lengths in {projection.name} ({projection.code}) are {stretch:.2f} times those in "
            "metres on the ground; to measure in, take a system of the country."
        )
    lineage = content.lineage | {"projection": f"{projection.name} ({projection.code})"}
    if projection.heights:
        lineage |= {
            "height_system": projection.heights,
            "height_operation": plane.operation,
            "height_accuracy_m": plane.accuracy_m,
        }
    return replace(content, lineage=lineage, crs=projection.crs, plane=plane)


def _stretch(plane: Plane, lon_deg: FloatArray, lat_deg: FloatArray) -> float:
    """How many times as long as on the ellipsoid a short way is, at the middle of points [n]."""
    lon, lat = float(np.median(lon_deg)), float(np.median(lat_deg))
    step = 1e-4
    north, east = metres_per_radian(np.array([np.radians(lat)]), 0.0)
    lons, lats = np.array([lon, lon, lon + step]), np.array([lat, lat + step, lat])
    x, y, _ = plane.points(lons, lats, np.zeros(3))
    ways = np.hypot(x[1:] - x[0], y[1:] - y[0]) / np.radians(step)
    return float(np.max(ways / np.concatenate([north, east])))
