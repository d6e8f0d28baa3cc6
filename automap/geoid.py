"""The geoid's height above the ellipsoid, and what receivers say of it.

``geoid.csv`` is a coarse EGM96 (Lemoine et al., NASA/TP-1998-206861): it tells a separation that
is none, has the wrong sign or another unit, and corrects nothing.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from automap.records import Fixes, FloatArray

_STEP_DEG = 5.0
MOST_GEOID_M = 107.0
"""The geoid lies nowhere further from the ellipsoid (EGM2008: south of Sri Lanka)."""
LOWEST_LAND_M = -10.0
"""Roads lie no lower but about a few inland seas; Dutch polders come to -7 m."""
GEOID_SD_M, WRONG_GEOID_M, GEOID_OFF_M = 2.0, 28.0, 12.0
"""The grid errs by 2 m in the root mean square and by 23 m at most anywhere on Earth, receivers
with a grid of 10 degrees by 3.4 m: no right separation is 28 m off, and one whose sign is turned is
within three times both of the opposite."""


@cache
def _grid() -> FloatArray:
    """Heights [37, 73] in m from latitude 90 to -90 and longitude -180 to 180 deg."""
    lines = files("automap").joinpath("geoid.csv").read_text(encoding="utf-8").splitlines()
    rows = np.array([line.split(",") for line in lines if line[0] != "#"], np.float64)
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


def separations(fixes: Fixes) -> tuple[float, float] | None:
    """The separation that ``fixes`` state, 0 where they have none for heights that may be above the
    sea, and the geoid's at their place, m; None where they state nothing."""
    told = np.isfinite(fixes.geoid_sep_m) & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad)
    if not told.any():
        return None
    lat, lon = (np.degrees(np.median(v[told])) for v in (fixes.lat_rad, fixes.lon_rad))
    stated = fixes.geoid_sep_m[told]
    return float(np.median(stated)) if stated.any() else 0.0, geoid_height(float(lat), float(lon))


def maybe_above_sea(fixes: Fixes, stated_m: float) -> bool:
    """Whether heights of ``fixes``, which are taken as above the ellipsoid, may be above the sea:
    no separation is ``stated_m``, and the place would be land."""
    height = float(np.nanmedian(fixes.height_m)) if np.isfinite(fixes.height_m).any() else np.nan
    return stated_m == 0.0 and height > LOWEST_LAND_M


def sign_turned(stated_m: float, there_m: float) -> bool:
    """Whether a separation is the geoid's with the other sign."""
    far = abs(stated_m - there_m) >= WRONG_GEOID_M
    return far and abs(stated_m + there_m) <= GEOID_OFF_M
