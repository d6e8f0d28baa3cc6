"""The unit of a receiver's speeds, by how fast its positions move."""

from __future__ import annotations

import numpy as np

from automap.earth import metres_per_radian
from automap.io.table_units import UNITS
from automap.records import FloatArray, IntArray

SAME_RATIO = 0.07
"""Two units of speed differ by 15 % or more (knots and mph do), so half of it parts them all."""

WINDOW_S, _MOVING_M_S, _FEW = 2.0, 3.0, 10


def tracks(
    seconds: FloatArray, lat: FloatArray, lon: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Where positions [n], rad, at ``seconds`` [n] move: rows [k] from and to, some seconds apart,
    and the way between them to the north and the east [k], m."""
    ahead = np.searchsorted(seconds, seconds + WINDOW_S)
    first = np.flatnonzero(ahead < len(seconds))
    last = ahead[first]
    length = seconds[last] - seconds[first]
    north, east = metres_per_radian(np.nan_to_num(lat[first]), np.zeros(len(first)))
    north, east = north * (lat[last] - lat[first]), east * (lon[last] - lon[first])
    use = (length < 2 * WINDOW_S) & (np.hypot(north, east) > _MOVING_M_S * length)
    return first[use], last[use], north[use], east[use]


def speed_unit(seconds: FloatArray, lat: FloatArray, lon: FloatArray, speed: FloatArray) -> str:
    """The unit in which speeds [n] are those of positions [n], rad, at ``seconds`` [n].

    "m/s" where too little moves or where no unit fits.
    """
    good = np.isfinite(lat) & np.isfinite(lon) & np.isfinite(speed)
    seconds, lat, lon, speed = (values[good] for values in (seconds, lat, lon, speed))
    first, last, north, east = tracks(seconds, lat, lon)
    moved = np.hypot(north, east) / (seconds[last] - seconds[first])
    told = 0.5 * (speed[first] + speed[last])
    fast = told > 0.0
    if np.count_nonzero(fast) < _FEW:
        return "m/s"
    ratio = float(np.median(told[fast] / moved[fast]))
    off = {unit: abs(np.log(ratio * factor)) for unit, factor in UNITS["speed"].items()}
    best = min(off, key=lambda unit: off[unit])
    return best if off[best] < SAME_RATIO else "m/s"
