"""Checks of where on Earth and when the fixes are, and how coarsely that is written.

``countries.csv`` holds the box around each part of every country, in degrees, from Natural
Earth's borders at 1:110 million (public domain, https://www.naturalearthdata.com). Small islands
are not in it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from functools import cache
from importlib.resources import files

import numpy as np

from automap.evaluation.plausibility import Finding
from automap.records import Fixes, FloatArray
from automap.sync.digits import place_digits
from automap.timebase import ROLLOVER_S, gps_to_iso, unix_to_gps
from pipeline.check import limits

Box = tuple[float, float, float, float]
"""South, west, north, east, deg."""
_MISTAKES: tuple[tuple[str, Callable[[float, float], tuple[float, float]]], ...] = (
    ("latitude and longitude are swapped", lambda lat, lon: (lon, lat)),
    ("north and south are swapped: give the latitude its sign", lambda lat, lon: (-lat, lon)),
    ("east and west are swapped: give the longitude its sign", lambda lat, lon: (lat, -lon)),
    ("both signs are turned", lambda lat, lon: (-lat, -lon)),
    ("latitude and longitude are swapped, and a sign is turned", lambda lat, lon: (-lon, lat)),
    ("latitude and longitude are swapped, and a sign is turned", lambda lat, lon: (lon, -lat)),
)


def check(fixes: Fixes, country: str | None, written_s: float | None) -> list[Finding]:
    """Findings on places and dates of ``fixes`` that are good.

    ``country``: ISO code of two letters as the manifest gives it; ``written_s``: when the log was
    last written, UNIX time, None when unknown.
    """
    return [*_dates(fixes, written_s), *_country(fixes, country), *_coarse(fixes)]


@cache
def boxes() -> dict[str, tuple[Box, ...]]:
    """The boxes of each country by its ISO code of two letters."""
    text = files("pipeline.check").joinpath("countries.csv").read_text(encoding="utf-8")
    found: dict[str, tuple[Box, ...]] = {}
    for code, *edges in list(csv.reader(io.StringIO(text)))[1:]:
        south, west, north, east = map(float, edges)
        found[code] = (*found.get(code, ()), (south, west, north, east))
    return found


def inside(lat_deg: float, lon_deg: float, country: str) -> bool:
    """Whether a place is in a country's boxes, or near them."""
    near = limits.BORDER_DEG
    return any(
        south - near <= lat_deg <= north + near and west - near <= lon_deg <= east + near
        for south, west, north, east in boxes()[country]
    )


def _country(fixes: Fixes, country: str | None) -> list[Finding]:
    code = "" if country is None else country.upper()
    known = np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    if not known.any() or code not in boxes():
        return []
    lat = float(np.degrees(np.median(fixes.lat_rad[known])))
    lon = float(np.degrees(np.median(fixes.lon_rad[known])))
    if inside(lat, lon, code):
        return []
    text = f"the fixes are at latitude {lat:.3f}, longitude {lon:.3f}, which is not in {code}"
    meant = [what for what, way in _MISTAKES if _on_earth(*way(lat, lon), code)]
    advice = meant[0] if meant else "correct country in [site], or the columns of the log"
    return [Finding("error", text, advice, "wrong_country")]


def _on_earth(lat_deg: float, lon_deg: float, country: str) -> bool:
    return abs(lat_deg) <= 90.0 and inside(lat_deg, lon_deg, country)


def _dates(fixes: Fixes, written_s: float | None) -> list[Finding]:
    dated: FloatArray = fixes.gps_s[np.isfinite(fixes.gps_s)]
    if not len(dated) or written_s is None:
        return []
    first = float(np.median(dated))
    ahead_s = first - float(unix_to_gps(written_s))
    early = abs(ahead_s + ROLLOVER_S) < limits.COPIED_S
    if ahead_s <= limits.AHEAD_S and not early:
        return []
    if early:
        text = (
            f"the fixes are of {gps_to_iso(first)[:10]}, 1024 weeks before the log was written, as "
            "of receivers that are older than that"
        )
        advice = "write the dates of the drive into the log, or update the receiver"
        return [Finding("warning", text, advice + "; signs get that date", "date_rolled_over")]
    text = (
        f"the fixes are of {gps_to_iso(first)[:10]}, {ahead_s / 86400.0:.0f} days after the log "
        "was written"
    )
    advice = "the receiver's date, or the clock of the recorder, is wrong; signs get that date"
    return [Finding("warning", text, advice, "date_ahead")]


def _coarse(fixes: Fixes) -> list[Finding]:
    """A warning for positions that were cut to steps far above what a receiver errs by."""
    digits = place_digits(fixes)
    if digits is None:
        return []
    return [
        Finding(
            "warning",
            f"positions come in steps of {digits.step_m:.3g} m, with {digits.decimals} decimals of "
            f"{digits.unit}",
            "export them with seven decimals of a degree: velocities and the IMU make up for a "
            "part of it only",
        )
    ]
