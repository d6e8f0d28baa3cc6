"""Whether a receiver's separation of the geoid has the right sign.

``geoid.csv`` is a coarse EGM96: it tells a sign where the geoid is far from the ellipsoid, and
corrects nothing.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from automap.evaluation.plausibility import Finding
from automap.records import Fixes, FloatArray
from pipeline.check import limits

_STEP_DEG = 5.0


@cache
def _grid() -> FloatArray:
    """Heights [37, 73] in m from latitude 90 to -90 and longitude -180 to 180 deg."""
    lines = files("pipeline.check").joinpath("geoid.csv").read_text(encoding="utf-8").splitlines()
    rows = np.loadtxt([line for line in lines if not line.startswith("#")], delimiter=",")
    return np.column_stack([rows, rows[:, 0]])


def geoid_height(lat_deg: float, lon_deg: float) -> float:
    """Height in m of the geoid above the ellipsoid, to some metres: between the grid's four
    corners around a place, linear in latitude and in longitude."""
    grid = _grid()
    down, right = (90.0 - lat_deg) / _STEP_DEG, ((lon_deg + 180.0) % 360.0) / _STEP_DEG
    row, column = min(int(down), len(grid) - 2), int(right)
    v, u = down - row, right - column
    north, south = grid[row : row + 2, column : column + 2] @ [1.0 - u, u]
    return float((1.0 - v) * north + v * south)


def check(fixes: Fixes) -> list[Finding]:
    """An error where the separation that the receiver states is the geoid's, sign turned; a warning
    where it is stated as none and heights may be above either."""
    told = np.isfinite(fixes.geoid_sep_m) & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    if not told.any():
        return []
    stated = float(np.median(fixes.geoid_sep_m[told]))
    lat, lon = (np.degrees(np.median(v[told])) for v in (fixes.lat_rad, fixes.lon_rad))
    height = geoid_height(float(lat), float(lon))
    if not np.any(fixes.geoid_sep_m[told]):
        return _no_separation(fixes, height)
    if abs(stated - height) < limits.WRONG_GEOID_M or abs(stated + height) > limits.GEOID_OFF_M:
        return []
    text = (
        f"the geoid is stated {stated:+.1f} m from the ellipsoid and is {height:+.0f} m there: the "
        f"separation has the wrong sign, so heights are off by some {2.0 * abs(height):.0f} m"
    )
    advice = (
        "turn the sign of the separation in what wrote the log: ellipsoid to geoid, up positive"
    )
    return [Finding("error", text, advice, "geoid_sign")]


def _no_separation(fixes: Fixes, geoid_m: float) -> list[Finding]:
    """A warning where nothing tells whether heights are above the ellipsoid or above the sea."""
    height = float(np.nanmedian(fixes.height_m)) if np.isfinite(fixes.height_m).any() else np.nan
    # of what is land either way
    land = min(height, height - geoid_m) > limits.LOWEST_LAND_M
    if abs(geoid_m) < limits.GEOID_OFF_M or not land:
        return []
    return [
        Finding(
            "warning",
            f"the geoid is stated 0 m from the ellipsoid and is {geoid_m:+.0f} m there: heights "
            "are taken as above the ellipsoid, and are off by as much if they are above the sea",
            "let the receiver send the separation with GGA, or NAV-PVT, or write it into the table",
            "height_surface",
        )
    ]
