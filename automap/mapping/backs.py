"""Map signs that are the backs of others, which drives the other way saw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import metres_per_radian
from automap.gates import gate
from automap.geolocation.limits import AWAY_COSINE
from automap.mapping import limits
from automap.records import BoolArray, FloatArray
from automap.signs.backs import backs_of_others


def map_backs(
    names: Sequence[str],
    lat: FloatArray,
    lon: FloatArray,
    facing_rad: FloatArray,
    cov_enu: FloatArray,
) -> BoolArray:
    """Which of the map signs [n] are backs of others among them; ``cov_enu`` [n, 3, 3] m^2."""
    per_lat, per_lon = metres_per_radian(lat, np.zeros(len(lat)))
    around = (lon - lon[:1] + np.pi) % (2.0 * np.pi) - np.pi
    place = np.column_stack([around * per_lon, (lat - lat[:1]) * per_lat])
    likely = gate(limits.BACK_PROBABILITY, 2)

    def other_side(a: int, b: int) -> bool:
        if not np.cos(facing_rad[a] - facing_rad[b]) < AWAY_COSINE:
            return False
        offset = place[a] - place[b]
        total = (cov_enu[a] + cov_enu[b])[:2, :2] + limits.THICKNESS_M**2 * np.eye(2)
        return bool(offset @ np.linalg.solve(total, offset) < likely)

    own = np.arange(len(names))
    return backs_of_others(names, own, place, limits.BACK_REACH_M, other_side)
