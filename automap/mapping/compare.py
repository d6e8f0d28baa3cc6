"""A new map against an older one: names that stay, and the list of changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from automap.mapping import limits
from automap.mapping.attributes import REJECTED
from automap.mapping.changes import (
    Change,
    OlderMap,
    distance_m,
    match_moved,
    match_older,
    shared_sightings,
)
from automap.mapping.existence import DetectionRates, still_there
from automap.mapping.identity import drive_key
from automap.mapping.merge import Merged
from automap.mapping.sightings import CameraView
from automap.mapping.visibility import Passage, head_on, opportunities
from automap.records import BoolArray, FloatArray, IntArray, Sign
from automap.records.sign_lists import numbers_of, values_of

COVERAGE_VIEW = CameraView(0.0, 0.6)
"""Half a sector and more of the directions that a merged map's coverage tells."""


@dataclass(frozen=True)
class Comparison:
    """``names`` of signs that the older map has too, by place among the merged signs;
    ``changes``; the number of older signs that are ``unchanged``, ``unvisited`` by any drive
    since, ``unconfirmed``: missed, but not often enough to be called gone, and ``rejected`` by the
    reviewer of a drive, which says that there never was one."""

    names: dict[int, str]
    changes: list[Change]
    unchanged: int
    unvisited: int
    unconfirmed: int
    rejected: int


@dataclass(frozen=True)
class Newer:
    """A map to be compared: ``signs`` [m], ``existence`` and ``class_share`` [m] of them, sightings
    ``shared`` with signs of the older map, and of the ``fresh`` drives, which the older map did
    not have, where they looked and their numbers among ``rates``."""

    signs: Sequence[Sign]
    existence: FloatArray
    class_share: FloatArray
    shared: Mapping[tuple[int, int], int]
    rates: DetectionRates
    fresh: Sequence[tuple[int, Passage]]


def compare_maps(
    older: OlderMap, merged: Merged, least_existence: float = limits.LEAST_EXISTENCE
) -> Comparison:
    """Match the merged signs to the older map's and say what has changed."""
    fresh = [
        (k, drive) for k, drive in enumerate(merged.drives) if drive_key(drive) not in older.drives
    ]
    shared = shared_sightings(older, merged.keys)
    newer = Newer(
        merged.signs, merged.existence, merged.attributes.class_share, shared, merged.rates, fresh
    )
    return compare(older, newer, least_existence)


def compare(
    older: OlderMap, merged: Newer, least_existence: float = limits.LEAST_EXISTENCE
) -> Comparison:
    """Match the signs of a map to an older one's and say what has changed.

    A sign is gone when drives that the older map did not have would have seen it and did not;
    one that nobody passed since is not. A sign that is gone and one of the same class and
    facing that is new near by are one that moved.
    """
    kept = merged.existence >= least_existence
    matches = match_older(older.signs, merged.signs, merged.shared)
    changes: list[Change] = []
    unchanged = unconfirmed = rejected = 0
    gone: dict[int, float] = {}
    classes, older_classes = (values_of(s, "class_name") for s in (merged.signs, older.signs))
    states = values_of(merged.signs, "status")
    for place, before in matches.items():
        belief = float(merged.existence[place])
        if kept[place] and classes[place] != older_classes[before]:
            now, then = merged.signs[place], older.signs[before]
            share = float(merged.class_share[place])
            changes.append(Change("class", now, then, share, distance_m(now, then), place=place))
        elif kept[place]:
            unchanged += 1
        elif states[place] == REJECTED:
            rejected += 1
        elif belief < limits.GONE_BELOW:
            gone[before] = 1.0 - belief
        else:
            unconfirmed += 1
    missing = np.setdiff1d(np.arange(len(older.signs)), list(matches.values()))
    visited, still = _still_there(older, merged, missing)
    for before, was_visited, belief in zip(missing.tolist(), visited, still, strict=True):
        if was_visited and belief < limits.GONE_BELOW:
            gone[before] = 1.0 - float(belief)
        elif was_visited:
            unconfirmed += 1
    new = [k for k in np.flatnonzero(kept).tolist() if k not in matches]
    moved = match_moved(older.signs, sorted(gone), merged.signs, new)
    for place, before in moved.items():
        now, then = merged.signs[place], older.signs[before]
        belief = float(merged.existence[place]) * gone.pop(before)
        changes.append(Change("moved", now, then, belief, distance_m(now, then), place=place))
    for before, belief in gone.items():
        changes.append(Change("gone", older.signs[before], older.signs[before], belief))
    seen_before = _seen_before(older, merged.signs, new)
    for place, before_too in zip(new, seen_before, strict=True):
        if place not in moved:
            belief = float(merged.existence[place])
            now = merged.signs[place]
            changes.append(Change("new", now, None, belief, visited_before=before_too, place=place))
    ids = values_of(older.signs, "id")
    names = {place: ids[before] for place, before in (matches | moved).items()}
    return Comparison(names, changes, unchanged, int((~visited).sum()), unconfirmed, rejected)


def _still_there(
    older: OlderMap, merged: Newer, missing: IntArray
) -> tuple[BoolArray, list[float]]:
    """Which of the older signs ``missing`` fresh drives had in view, and the belief left."""
    signs = [older.signs[k] for k in missing]
    visited = np.zeros(len(signs), np.bool_)
    start = numbers_of(signs, "confidence")[0]
    hits = np.array([max(len(s.drives), 1) for s in signs], np.float64)
    if not signs or not merged.fresh:
        return visited, start.tolist()
    lat, lon, facing = numbers_of(signs, "lat_rad", "lon_rad", "facing_rad")
    views = opportunities([drive for _, drive in merged.fresh], lat, lon, facing)
    views = views.at(head_on(views, facing))
    visited[views.sign] = True
    weight = merged.rates.miss_weight(np.array([k for k, _ in merged.fresh], np.int64)[views.drive])
    left = still_there(views.sign, weight, merged.rates, start, hits)
    return visited, left.tolist()


def _seen_before(
    older: OlderMap, signs: Sequence[Sign], places: Sequence[int]
) -> list[bool | None]:
    """Whether the older map's drives looked at the places of signs; None when not known."""
    if older.coverage is None or not places:
        return [None] * len(places)
    own = [signs[k] for k in places]
    lat, lon, facing = numbers_of(own, "lat_rad", "lon_rad", "facing_rad")
    before: Any = SimpleNamespace(path=older.coverage, cameras=(COVERAGE_VIEW,))
    looked = set(opportunities([before], lat, lon, facing).sign.tolist())
    return [k in looked for k in range(len(places))]
