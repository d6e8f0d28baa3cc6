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
    """An error where the separation that the receiver states is the geoid's, sign turned."""
    told = np.isfinite(fixes.geoid_sep_m) & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    if not told.any():
        return []
    stated = float(np.median(fixes.geoid_sep_m[told]))
    lat, lon = (np.degrees(np.median(v[told])) for v in (fixes.lat_rad, fixes.lon_rad))
    height = geoid_height(float(lat), float(lon))
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
