"""The units of a table of fixes that nothing but its numbers tells."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from automap.errors import InputError
from automap.io.angle_text import DEGREES_MINUTES, may_be_degrees_minutes
from automap.io.speed_unit import WINDOW_S, speed_unit, tracks
from automap.io.table_units import to_si
from automap.records import FloatArray

_FULL_TURN, _FEW = {"rad": 2.0 * np.pi, "deg": 360.0, "gon": 400.0}, 10
_MOST_MINUTES = 18_060.0
"""No degrees with minutes are more; less may be a few wrong cells, or the wrong columns."""
_CLOSE_RAD = 0.2
"""Courses of a receiver that moves are that close to those of its positions in the median: 11 deg
are a metre of error against five of way."""
_CERTAIN_NATS = math.log(1e6)
"""Odds of a million, as for every other mistake of a unit."""


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
    if "course" in assumed:
        unit = _course_unit(seconds, lat, lon, np.degrees(columns["course"]))
        if unit != "deg":
            found["course"] = unit
    return found


def exchanged(lat: FloatArray, lon: FloatArray) -> bool:
    """Whether latitudes and longitudes [n], in rad as they are read, can only be each other's.

    None is a latitude; as degrees and minutes all would lie in the open sea off Guinea. Courses
    do not tell: those from east, counter-clockwise, look alike.
    """
    # 0, 0 stands where there was no fix yet
    known = np.isfinite(lat) & np.isfinite(lon) & ((lat != 0.0) | (lon != 0.0))
    north, east = np.abs(lat[known]), np.abs(lon[known])
    beyond = (north > 0.5 * np.pi) & (north <= np.pi) & (east <= 0.5 * np.pi)
    return bool(len(north)) and bool(beyond.all())


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


def _course_unit(seconds: FloatArray, lat: FloatArray, lon: FloatArray, course: FloatArray) -> str:
    """The unit in which courses [n], as numbers, are those of the positions: "deg" where no other
    is beyond doubt."""
    largest = float(np.nanmax(np.abs(course), initial=0.0))
    if largest > _FULL_TURN["gon"]:
        return "deg"
    other = "rad" if largest <= _FULL_TURN["rad"] + 1e-3 else "gon"
    first, last, north, east = tracks(seconds, lat, lon)
    along = np.exp(-1j * np.arctan2(east, north))
    off = {}
    for unit in ("deg", other):
        told = np.exp(1j * to_si(course, unit, "angle"))
        off[unit] = along * (told[first] + told[last])
    known = np.isfinite(off["deg"])
    if np.count_nonzero(known) < _FEW:
        return "deg"
    middle = {unit: _middle(values[known]) for unit, values in off.items()}
    if middle[other] > _CLOSE_RAD:
        return "deg"
    if other == "rad":
        return other if middle["deg"] > _CLOSE_RAD else "deg"
    if largest > _FULL_TURN["deg"] + 1.0:  # digits may go beyond by less
        return other
    # degrees from another north are off by one angle, which is no matter of the unit: likelihoods
    # with sizes by the median, of windows that do not overlap
    one = np.exp(-1j * np.angle(np.mean(off["deg"][known])))
    many = len(np.unique(seconds[first[known]] // WINDOW_S))
    gain = many * math.log(max(_middle(one * off["deg"][known]), 1e-9) / max(middle[other], 1e-9))
    return other if gain > _CERTAIN_NATS else "deg"


def _middle(turns: npt.NDArray[np.complex128]) -> float:
    """Median size, rad, of the angles of ``turns`` [n]."""
    return float(np.median(np.abs(np.angle(turns))))
