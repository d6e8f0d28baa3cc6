"""What is different from an older map: new, gone, another class, moved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from automap.earth import ecef
from automap.mapping import limits
from automap.mapping.candidates import facing_evidence, facing_variance
from automap.mapping.classes import class_evidence
from automap.mapping.grid import east_north
from automap.records import DrivePath, FloatArray, Sign
from automap.records.sign_lists import numbers_of, values_of


@dataclass(frozen=True)
class OlderMap:
    """A merged map of before: its signs, ``members`` (key of a sighting to the sign's id), the
    ``drives`` that it was made of, and where these looked."""

    signs: Sequence[Sign]
    members: Mapping[str, str] = field(default_factory=dict)
    drives: frozenset[str] = frozenset()
    coverage: DrivePath | None = None


@dataclass(frozen=True)
class Change:
    """One difference. ``kind`` "new", "gone", "class" or "moved"; ``sign`` as it is now (for
    "gone" as it was), ``older`` as it was; ``belief`` that the change is real; for "new",
    ``visited_before`` whether the older map's drives had the place in view."""

    kind: str
    sign: Sign
    older: Sign | None
    belief: float
    distance_m: float = float("nan")
    visited_before: bool | None = None
    place: int = -1
    """Of ``sign`` among the merged signs, -1 for one that is gone."""


def shared_sightings(older: OlderMap, keys: Sequence[Sequence[str]]) -> dict[tuple[int, int], int]:
    """How many sightings a sign, by place among ``keys`` of its sightings, has in common with a
    sign of the older map."""
    number = {name: k for k, name in enumerate(values_of(older.signs, "id"))}
    return Counter(
        (place, number[before])
        for place, own in enumerate(keys)
        for key in own
        if (before := older.members.get(key, "")) in number
    )


def match_older(
    older: Sequence[Sign], signs: Sequence[Sign], shared: Mapping[tuple[int, int], int]
) -> dict[int, int]:
    """Place of the older sign for each sign that is the same one, by place among ``signs``.

    ``shared`` sightings decide first, then nearness within the two covariances, with facing and
    class agreeing.
    """
    result = one_to_one((-count, *pair) for pair, count in shared.items())
    rest = [k for k in range(len(signs)) if k not in result]
    before_rest = sorted(set(range(len(older))) - set(result.values()))
    costs = _costs(signs, rest, older, before_rest, limits.SAME_PLACE_M, False)
    return result | one_to_one(costs)


def match_moved(
    older: Sequence[Sign], gone: Sequence[int], signs: Sequence[Sign], new: Sequence[int]
) -> dict[int, int]:
    """Which ``new`` signs are ``gone`` ones put up elsewhere near by: one class, one facing,
    and the nearest such pair first."""
    near = _costs(signs, new, older, gone, limits.MOVED_M, True)
    return one_to_one(c for c in near if signs[c[1]].class_name == older[c[2]].class_name)


def one_to_one(pairs: Iterable[tuple[float, int, int]]) -> dict[int, int]:
    """The second of each first one in ``pairs`` of a cost and two places, the least cost first."""
    result: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in sorted(pairs):
        if i not in result and j not in taken:
            result[i] = j
            taken.add(j)
    return result


def distance_m(a: Sign, b: Sign) -> float:
    """Distance in plan."""
    return float(np.hypot(*_difference(a, b)))


def _difference(a: Sign, b: Sign) -> FloatArray:
    return east_north(a.lat_rad, a.lon_rad, b.lat_rad, b.lon_rad, np.nan_to_num(a.height_m))


def _costs(
    signs: Sequence[Sign],
    rows: Sequence[int],
    older: Sequence[Sign],
    older_rows: Sequence[int],
    reach_m: float,
    far: bool,
) -> list[tuple[float, int, int]]:
    """Costs of pairs within reach; unless ``far``, only those that agree within sigmas."""
    if not rows or not older_rows:
        return []
    names = sorted({*values_of(signs, "class_name"), *values_of(older, "class_name")})
    code = {name: k for k, name in enumerate(names)}
    evidence = class_evidence(names)
    places = []
    for among, own in ((signs, rows), (older, older_rows)):
        lat, lon = (v[list(own)] for v in numbers_of(among, "lat_rad", "lon_rad"))
        places.append(ecef(lat, lon, np.zeros(len(own))))
    costs = []
    found: Any = cKDTree(places[1]).query_ball_point(places[0], reach_m * 1.01)
    for i, near in zip(rows, found, strict=True):
        for place in near:
            j = older_rows[place]
            a, b = signs[i], older[j]
            told = evidence[code[a.class_name], code[b.class_name]]
            if np.isfinite(a.facing_rad) and np.isfinite(b.facing_rad):
                variance = facing_variance(a.facing_sd_rad) + facing_variance(b.facing_sd_rad)
                told += facing_evidence(a.facing_rad - b.facing_rad, variance)
            if told == -np.inf:
                continue
            difference = _difference(a, b)
            if far:
                costs.append((float(np.hypot(*difference)), i, j))
                continue
            covariance = np.nan_to_num(
                a.cov_enu[:2, :2] + b.cov_enu[:2, :2]
            ) + limits.MAP_SLACK_M**2 * np.eye(2)
            square = float(difference @ np.linalg.solve(covariance, difference))
            if square < limits.SAME_GATE and told > limits.DIFFERENT + limits.SAME_GROUP:
                costs.append((0.5 * square - told, i, j))
    return costs
