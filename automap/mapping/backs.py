"""Map signs that are the backs of others, which drives the other way saw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import metres_per_radian
from automap.gates import gate
from automap.geolocation.limits import AWAY_COSINE
from automap.mapping import limits
from automap.records import FloatArray, IntArray
from automap.signs.backs import is_back, may_be_back

NO_BACK, BACK_OF_NONE = -1, -2


def with_backs(n_back_views: IntArray, n_views: IntArray, fronts: IntArray) -> IntArray:
    """Views [n] of the backs of signs, with those of the signs that are the backs of others."""
    total = np.array(n_back_views, np.int64)
    rows = np.flatnonzero(fronts >= 0)
    np.add.at(total, fronts[rows], np.asarray(n_views, np.int64)[rows])
    return total


def backs_of_others(
    class_name: Sequence[str],
    lat: FloatArray,
    lon: FloatArray,
    facing_rad: FloatArray,
    cov_enu: FloatArray,
) -> IntArray:
    """Of which of the map signs [n] each is the back: ``NO_BACK``, ``BACK_OF_NONE`` where nobody
    saw the front.

    ``cov_enu`` [n, 3, 3] m^2. A sign whose class is that of backs is one; so is a face without
    colours that nobody could read, where one that was read faces the other way.
    """
    from scipy.spatial import cKDTree

    names = [str(name) for name in class_name]
    result = np.where([is_back(name) for name in names], BACK_OF_NONE, NO_BACK).astype(np.int64)
    maybe = np.array([may_be_back(name) for name in names], np.bool_)
    if not maybe.any() or maybe.all():
        return result
    per_lat, per_lon = metres_per_radian(lat, np.zeros(len(lat)))
    first = float(lon[0])
    around = (lon - first + np.pi) % (2.0 * np.pi) - np.pi
    place = np.column_stack([around * per_lon, (lat - lat[0]) * per_lat])
    fronts = np.flatnonzero(~maybe)
    tree = cKDTree(place[fronts])
    for k in np.flatnonzero(maybe).tolist():
        nearest = gate(limits.BACK_PROBABILITY, 2)
        for j in fronts[tree.query_ball_point(place[k], limits.BACK_REACH_M)].tolist():
            if not np.cos(facing_rad[k] - facing_rad[j]) < AWAY_COSINE:
                continue
            offset = place[k] - place[j]
            total = (cov_enu[k] + cov_enu[j])[:2, :2] + limits.THICKNESS_M**2 * np.eye(2)
            square = float(offset @ np.linalg.solve(total, offset))
            if square < nearest:
                nearest, result[k] = square, j
    return result
