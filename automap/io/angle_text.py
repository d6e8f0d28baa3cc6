"""Latitudes and longitudes as people write them: degrees, minutes, seconds, letters of hemispheres.

``ddmm.mmmm`` is a number of degrees and minutes as NMEA 0183 has it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from automap.records import FloatArray

DEGREES_MINUTES = "ddmm.mmmm"
SPELLED_OUT = "dms"
"""Units of columns of angles that are no plain numbers."""

POSITIVE, NEGATIVE = {"NS": "N", "EW": "E"}, {"NS": "S", "EW": "W"}
"""Letters of hemispheres, north and south or east and west. O is east in German and west in
Spanish, French, Italian and Portuguese, so it is none."""

_PART = re.compile(r"(\d+(?:[.,]\d+)?)")
_ANGLE = re.compile(
    r"\s*(?P<before>[NSEWnew])?\s*(?P<sign>[+-])?\s*"
    r"(?P<d>\d{1,3}(?:[.,]\d*)?)"
    r"(?:\s*(?:[°º:d]|deg|\s)\s*(?P<m>\d{1,2}(?:[.,]\d*)?))?"
    r"(?:\s*(?:['′’:m]|min|\s)\s*(?P<s>\d{1,2}(?:[.,]\d*)?))?"
    r"\s*(?:[°º'′’\"″”dms:]|''|deg|min|sec)*\s*(?P<after>[NSEWnew])?\s*"
)
"""A small s is a second, a great one is south."""


def parse_angles(cells: Iterable[str], letters: str) -> FloatArray:
    """Degrees [n] of cells such as ``48°8'15.3"N``, ``11 34.8 E`` and ``-33.87``; NaN where one is
    none. ``letters`` "NS" or "EW" are those of the hemispheres."""
    return np.array([_parsed(cell, letters) for cell in cells], np.float64)


def _parsed(cell: str, letters: str) -> float:
    found = _ANGLE.fullmatch(cell)
    if found is None:
        return np.nan
    parts = [float((found[key] or "0").replace(",", ".")) for key in ("d", "m", "s")]
    marks = [mark.upper() for mark in (found["before"], found["after"]) if mark]
    finer = [found[key] for key in ("m", "s") if found[key] is not None]
    # only the last part has a fraction, minutes and seconds stop at sixty
    broken = any(not part.is_integer() for part in parts[: len(finer)])
    if broken or max(parts[1:]) >= 60.0 or len(marks) > 1 or not set(marks) <= set(letters):
        return np.nan
    if marks and found["sign"] == "-":
        return np.nan
    negative = found["sign"] == "-" or marks == [NEGATIVE[letters]]
    size = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    return -size if negative else size


def is_spelled_out(cells: Sequence[str], letters: str) -> bool:
    """Whether nearly all of some cells are angles and most of them no plain numbers."""
    filled = [cell for cell in cells if cell]
    if not filled or all(_PART.fullmatch(cell.lstrip("+-")) for cell in filled[:3]):
        return False
    known = np.isfinite(parse_angles(filled, letters))
    return bool(np.mean(known) > 0.5)


def signs(cells: Iterable[str], letters: str) -> FloatArray:
    """1 and -1 [n] of letters of hemispheres, NaN where a cell holds none."""
    value = {POSITIVE[letters]: 1.0, NEGATIVE[letters]: -1.0}
    return np.array([value.get(cell.strip().upper()[:1], np.nan) for cell in cells], np.float64)


def are_signs(cells: Sequence[str], letters: str) -> bool:
    """Whether some cells hold letters of hemispheres alone."""
    filled = {cell.strip().upper() for cell in cells if cell.strip()}
    return bool(filled) and filled <= {POSITIVE[letters], NEGATIVE[letters]}


def from_degrees_minutes(values: FloatArray) -> FloatArray:
    """Degrees [n] of numbers [n] in which the hundreds are degrees and the rest minutes; NaN beyond
    a whole turn."""
    size = np.where(np.abs(values) < 100.0 * 360.0, np.abs(values), np.nan)
    whole = np.floor(size / 100.0)
    return np.asarray(np.copysign(whole + (size - 100.0 * whole) / 60.0, values))


def may_be_degrees_minutes(values: FloatArray, most: float) -> bool:
    """Whether numbers [n] may be degrees, up to ``most``, and minutes: these stop at sixty."""
    size = np.abs(values[np.isfinite(values)])
    return bool(len(size)) and bool((size % 100.0 < 60.0).all() and (size <= 100.0 * most).all())
