"""Map signs that are the backs of others, which drives the other way saw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from automap.gates import gate
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


def are_two_sides(difference: FloatArray, covariance: FloatArray, cosine: float) -> bool:
    """Whether two faces may be face and back of one sign, by the ``difference`` [a] of their
    places, in plan or with the height, m, its covariance [a, a], and the cosine between them."""
    slack = [limits.THICKNESS_M, limits.THICKNESS_M, limits.HEIGHT_SLACK_M][: len(difference)]
    square = difference @ np.linalg.solve(covariance + np.diag(slack) ** 2, difference)
    return bool(cosine < limits.AWAY_COSINE and square < gate(limits.BACK_PROBABILITY, len(slack)))


def map_backs(columns: Mapping[str, Any]) -> IntArray:
    """Of which of the map signs of ``columns`` [n] each is the back, as ``fronts_of_backs``
    tells."""
    lat, lon, cov_enu = columns["lat"], columns["lon"], columns["cov_enu"]
    place = east_north(lat, lon, lat[:1], lon[:1])

    def apart(a: int, b: int) -> float:
        offset, total = place[a] - place[b], (cov_enu[a] + cov_enu[b])[:2, :2]
        turn = columns["facing_rad"][a] - columns["facing_rad"][b]
        two_sides = are_two_sides(offset, total, float(np.cos(turn)))
        return float(np.hypot(*offset)) if two_sides else np.inf

    own = np.arange(len(lat))
    return fronts_of_backs(columns["class_name"], own, place, limits.BACK_REACH_M, apart)
