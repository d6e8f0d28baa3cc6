"""Which sightings of several passes show one sign, and the trajectory's error in each pass.

Each needs the other. A pass that is metres off its true way sees all its signs moved alike, and
taken one by one a sign of it may lie nearer to its neighbour than to itself; signs that stand
alone tell how far the pass is off. So sightings are grouped, the trajectory is adjusted by the
groups, and the sightings, moved with it, are grouped anew until nothing changes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from automap.geolocation.control import match_control
from automap.geolocation.merging import find_backs, group_sightings
from automap.geolocation.sightings import Sighting
from automap.geolocation.trajectory_adjustment import (
    Adjustment,
    adjust_trajectory,
    shift_sighting,
)
from automap.geolocation.views import Views
from automap.records import FloatArray, SignPoints, Trajectory
from automap.signs.backs import BACK_OF_NONE, NO_BACK

_ROUNDS = 4
"""Groupings at most; ends where none changes."""


@dataclass(frozen=True)
class Passes:
    """Sightings as the adjusted trajectory gives them; ``groups`` of their numbers, one a sign;
    ``backs`` numbers of the sightings that show the backs of signs, by the number of the sign's
    group (-1: of one that nobody saw from in front); ``controlled`` surveyed
    place [3] and covariance [3, 3] by the number of a group; ``adjustment`` None where nothing
    tells the trajectory's error."""

    sightings: list[Sighting]
    groups: list[list[int]]
    backs: Mapping[int, list[int]]
    controlled: Mapping[int, tuple[FloatArray, FloatArray]]
    adjustment: Adjustment | None


def join_passes(
    views: Views,
    sightings: Sequence[Sighting],
    trajectory: Trajectory,
    control: SignPoints | None,
    adjust: bool,
) -> Passes:
    """Group the sightings, and adjust the trajectory by them when ``adjust``."""
    seen, adjustment = list(sightings), None
    before: list[list[int]] | None = None
    for _ in range(_ROUNDS):
        groups = group_sightings(views, seen)
        fronts = find_backs(views, seen, groups).tolist()
        kept = [number for number, front in enumerate(fronts) if front == NO_BACK]
        backs: dict[int, list[int]] = {}
        for number, front in enumerate(fronts):
            if front != NO_BACK:
                place = -1 if front == BACK_OF_NONE else kept.index(front)
                backs.setdefault(place, []).extend(groups[number])
        groups = [groups[number] for number in kept]
        controlled = match_control(control, seen, groups, views.origin) if control else {}
        if not adjust or groups == before:
            break
        adjustment = adjust_trajectory(trajectory, sightings, groups, controlled)
        if adjustment is None:
            seen = list(sightings)
            break
        seen = [shift_sighting(sighting, adjustment) for sighting in sightings]
        before = groups
    return Passes(seen, groups, backs, controlled, adjustment)
