"""The units of a table of fixes that nothing but its numbers tells."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automap.errors import InputError
from automap.io.angle_text import DEGREES_MINUTES, may_be_degrees_minutes
from automap.io.speed_unit import speed_unit, tracks
from automap.io.table_units import to_si
from automap.records import FloatArray

_FULL_TURN_RAD, _FEW = 2.0 * np.pi, 10
_MOST_MINUTES = 18_060.0
"""No degrees with minutes are more; less may be a few wrong cells, or the wrong columns."""
_CLOSE_RAD = 0.2
"""Courses of a receiver that moves are that close to those of its positions in the median: 11 deg
are a metre of error against five of way."""


def told_by_numbers(
    path: object, seconds: FloatArray, columns: Mapping[str, FloatArray], assumed: frozenset[str]
) -> dict[str, str]:
    """Our name -> the unit of columns [n] whose unit is ``assumed`` and cannot be or is not.

    ``columns`` in SI by the assumed units, ``seconds`` [n] their times. Raises InputError where
    latitudes and longitudes are no angles in any unit that can be told.
    """
    found: dict[str, str] = {}
    lat, lon = columns["lat"], columns["lon"]
    if {"lat", "lon"} <= assumed:
        unit = _position_unit(path, np.degrees(lat), np.degrees(lon))
        if unit != "deg":
            found |= {"lat": unit, "lon": unit}
            lat, lon = (to_si(np.degrees(values), unit, "angle") for values in (lat, lon))
    if "speed" in assumed:
        unit = speed_unit(seconds, lat, lon, columns["speed"])
        if unit != "m/s":
            found["speed"] = unit
    if "course" in assumed and _in_radians(seconds, lat, lon, np.degrees(columns["course"])):
        found["course"] = "rad"
    return found


def _position_unit(path: object, lat: FloatArray, lon: FloatArray) -> str:
    """The unit of latitudes and longitudes [n] that no name tells, as numbers."""
    known = np.isfinite(lat) & np.isfinite(lon) & ((lat != 0.0) | (lon != 0.0))
    if not known.any():
        return "deg"
    lat, lon = lat[known], lon[known]
    north, east = float(np.median(np.abs(lat))), float(np.median(np.abs(lon)))
    if north <= 90.0 and east <= 360.0:
        # as degrees all of it would lie in the open sea off Guinea
        sea = (np.abs(lat) < 0.5 * np.pi).all() and (np.abs(lon) < np.pi).all()
        return "rad" if sea else "deg"
    if may_be_degrees_minutes(lat, 90.0) and may_be_degrees_minutes(lon, 180.0):
        return DEGREES_MINUTES
    if _MOST_MINUTES < max(north, east) <= 180e7:
        raise InputError(
            f"{path}: latitudes of {north:.9g} and longitudes of {east:.9g} are no degrees; write "
            'what they are, as units = { lat = "1e-7 deg", lon = "1e-7 deg" } (or 1e-6, 1e-5), in '
            "[gnss]; eastings and northings have to be converted first."
        )
    return "deg"


def _in_radians(seconds: FloatArray, lat: FloatArray, lon: FloatArray, course: FloatArray) -> bool:
    """Whether courses [n], as numbers, are those of the positions in rad and not in deg."""
    if not np.nanmax(np.abs(course), initial=0.0) <= _FULL_TURN_RAD + 1e-3:
        return False
    first, last, north, east = tracks(seconds, lat, lon)
    along = np.arctan2(east, north)
    off = {}
    for unit, factor in (("rad", 1.0), ("deg", np.pi / 180.0)):
        turns = np.exp(1j * factor * course[first]) + np.exp(1j * factor * course[last])
        off[unit] = np.abs(np.angle(turns * np.exp(-1j * along)))
    known = np.isfinite(off["rad"])
    if np.count_nonzero(known) < _FEW:
        return False
    middle = {unit: float(np.median(values[known])) for unit, values in off.items()}
    return middle["rad"] < _CLOSE_RAD < middle["deg"]
