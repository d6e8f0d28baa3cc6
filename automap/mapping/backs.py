"""Map signs that are the backs of others, which drives the other way saw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.geolocation.merging import are_two_sides
from automap.mapping import limits
from automap.mapping.grid import east_north
from automap.records import FloatArray, IntArray
from automap.signs.backs import fronts_of_backs


def with_backs(n_back_views: IntArray, n_views: IntArray, fronts: IntArray) -> IntArray:
    """Views [n] of the backs of signs, with those of the signs that are the backs of others."""
    total = np.array(n_back_views, np.int64)
    rows = np.flatnonzero(fronts >= 0)
    np.add.at(total, fronts[rows], np.asarray(n_views, np.int64)[rows])
    return total


def map_backs(
    names: Sequence[str],
    lat: FloatArray,
    lon: FloatArray,
    facing_rad: FloatArray,
    cov_enu: FloatArray,
) -> IntArray:
    """Of which of the map signs [n] each is the back, as ``fronts_of_backs`` tells; ``cov_enu``
    [n, 3, 3] m^2."""
    place = east_north(lat, lon, lat[:1], lon[:1])

    def apart(a: int, b: int) -> float:
        offset, total = place[a] - place[b], (cov_enu[a] + cov_enu[b])[:2, :2]
        two_sides = are_two_sides(offset, total, float(np.cos(facing_rad[a] - facing_rad[b])))
        return float(np.hypot(*offset)) if two_sides else np.inf

    own = np.arange(len(names))
    return fronts_of_backs(names, own, place, limits.BACK_REACH_M, apart)
