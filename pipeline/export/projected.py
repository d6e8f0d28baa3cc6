"""A map in projected coordinates: what some formats get with ``--crs`` and ``--heights``."""

from __future__ import annotations

from dataclasses import replace

from automap.errors import ConfigError, InputError
from automap.export.datum import parse_datum
from automap.export.projected import parse_projection, plane_of
from pipeline.export.content import MapContent
from pipeline.export.datum import in_datum

PROJECTED_FORMATS = ("gpkg", "shapefile", "flatgeobuf", "parquet", "csv", "xlsx", "postgis")
"""Formats that can hold projected coordinates; the others are longitude and latitude."""


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
    lineage = content.lineage | {"projection": f"{projection.name} ({projection.code})"}
    if projection.heights:
        lineage |= {
            "height_system": projection.heights,
            "height_operation": plane.operation,
            "height_accuracy_m": plane.accuracy_m,
        }
    return replace(content, lineage=lineage, crs=projection.crs, plane=plane)
