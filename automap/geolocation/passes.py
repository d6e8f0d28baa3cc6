"""Which sightings of several passes show one sign, and the trajectory's error in each pass.

A drive is a merge of its passes: each stretch of a camera that is too short to come by a sign twice
counts as a drive of its own, and their sightings are associated as those of many drives are. A pass
that is metres off its true way sees all its signs moved alike, and taken one by one a sign of it
may lie nearer to its neighbour than to itself; the stretch is laid over the others as a whole. By
the signs that are found in several the trajectory is adjusted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import pdtr

from automap.earth import from_local_ned, metres_per_radian
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.control import match_control
from automap.geolocation.sightings import Sighting, class_of
from automap.geolocation.trajectory_adjustment import (
    Adjustment,
    Placed,
    place_signs,
    shift_sighting,
)
from automap.geolocation.views import Views
from automap.mapping.association import Members
from automap.mapping.backs import backs
from automap.mapping.by_cells import joined_signs
from automap.mapping.sightings import Sightings
from automap.records import FloatArray, IntArray, SignPoints, Trajectory
from automap.signs.backs import NO_BACK

_ROUNDS = 4
"""At most, in which surveyed signs are looked for with the adjusted trajectory."""


@dataclass(frozen=True)
class Passes:
    """``groups`` of numbers of sightings, one a sign, and how these are ``placed``; ``sightings``
    as the adjusted trajectory gives them; ``fronts`` of which sign each is the back, as
    ``fronts_of_backs`` tells; ``controlled`` surveyed place [3] and covariance [3, 3] by the number
    of a sign; ``adjustment`` None where nothing tells the trajectory's error."""

    sightings: list[Sighting]
    groups: list[list[int]]
    placed: Placed
    fronts: IntArray
    controlled: Mapping[int, tuple[FloatArray, FloatArray]]
    adjustment: Adjustment | None


def join_passes(
    views: Views,
    sightings: Sequence[Sighting],
    trajectory: Trajectory,
    control: SignPoints | None,
    adjust: bool,
) -> Passes:
    """Group the sightings and place the signs; ``adjust`` the trajectory by them."""
    groups = group_sightings(views, sightings)
    members = [[sightings[m] for m in group] for group in groups]
    names = [class_of(own) for own in members]
    towards = np.array([np.sum([s.facing for s in own], axis=0) for own in members]).reshape(-1, 2)
    frames = [views.frame[np.concatenate([s.landmark.rows for s in own])] for own in members]

    def beside(a: int, b: int) -> bool:
        """A camera sees one side of a sign."""
        return bool(np.isin(frames[a], frames[b]).any())

    controlled: dict[int, tuple[FloatArray, FloatArray]] = {}
    for _ in range(_ROUNDS):
        placed, adjustment = place_signs(trajectory, sightings, groups, controlled, adjust)
        plan, covariance = placed.place[:, :2], placed.covariance[:, :2, :2]
        fronts = backs(names, plan, covariance, np.arctan2(towards[:, 1], towards[:, 0]), beside)
        faces = {k: names[k] for k in np.flatnonzero(fronts == NO_BACK).tolist()}
        before = controlled
        controlled = match_control(control, faces, placed, views.origin) if control else {}
        if not adjust or controlled.keys() == before.keys():
            break
    seen = [s if adjustment is None else shift_sighting(s, adjustment) for s in sightings]
    return Passes(seen, groups, placed, fronts, controlled, adjustment)


def group_sightings(views: Views, sightings: Sequence[Sighting]) -> list[list[int]]:
    """Numbers of the sightings of each sign, in the order of first sight."""
    if not sightings:
        return []
    frames = [np.unique(views.frame[sighting.landmark.rows]) for sighting in sightings]
    columns = of_stretches(sightings, frames, views.origin)
    members = Members(joined_signs(columns))
    rows = np.split(columns.row[members.order], members.edges[1:-1])
    groups = [sorted(own.tolist()) for own in rows]
    return sorted(groups, key=lambda own: min(int(sightings[m].landmark.rows[0]) for m in own))


def seen_beside(a: IntArray, b: IntArray) -> bool:
    """Whether two sightings, each in its frames [n] in order, share frames as two signs would.

    Two signs that are found by themselves are together in ``n_a n_b / n`` of the n frames in which
    both are in view. Two tracks that take turns with the boxes of one sign are together only where
    it had two boxes.
    """
    together = len(np.intersect1d(a, b, assume_unique=True))
    if not together:
        return False
    low, high = max(a[0], b[0]), min(a[-1], b[-1])
    n_a, n_b = (np.count_nonzero((each >= low) & (each <= high)) for each in (a, b))
    # Poisson's is wider than the hypergeometric distribution that this is
    return bool(pdtr(together, n_a * n_b / float(high - low + 1)) >= limits.APART_PROBABILITY)


def of_stretches(
    sightings: Sequence[Sighting],
    frames: Sequence[IntArray],
    origin: tuple[float, float, float],
) -> Sightings:
    """The sightings [n], at least one, as those of drives of ``PASS_S`` and one camera each, which
    sees a sign once: of two near one another that are not seen beside one another in their
    ``frames`` [n], as two tracks of one sign, the second is another drive's. ``row`` are their
    numbers. What only a map's signs inherit is not told."""
    seen = list(sightings)
    time_s, camera = np.array([(s.time_s, s.camera) for s in seen]).T
    stretch = np.floor((time_s - time_s.min()) / limits.PASS_S)
    turn, place = np.zeros(len(sightings)), np.array([s.position for s in seen])
    # places of one sign agree to no better than the extent of its face
    own = np.array([s.covariance - np.diag(s.path_sd**2) for s in seen])
    own += limits.FACE_SD_M**2 * np.eye(3)
    looks = np.column_stack([stretch, camera])
    for group in _same_rows(looks):
        for a, b in group[_near_pairs(place[group], own[group])].tolist():
            if turn[a] == turn[b] and not seen_beside(frames[a], frames[b]):
                turn[b] += 1.0
    looks = np.column_stack([looks, turn])
    drive = np.unique(looks, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort([time_s, drive])
    seen, own, time_s, drive = [seen[k] for k in order], own[order], time_s[order], drive[order]
    n = len(seen)
    lat, lon, height = from_local_ned(place[order], origin)
    per_lat, per_lon = metres_per_radian(lat, height)
    effect = np.array([s.size_effect for s in seen])
    classes, code = np.unique([s.class_name for s in seen], return_inverse=True)
    unknown, none = np.full(n, np.nan), np.full(n, "", np.object_)
    return Sightings(
        drive=drive, row=order.astype(np.int64), time_s=time_s,
        first=np.searchsorted(drive, np.arange(drive[-1] + 2)),
        lat=lat, lon=lon, height=height, per_lat=per_lat, per_lon=per_lon,
        own=np.column_stack([own[:, 1, 1], own[:, 0, 1], own[:, 0, 0]]), own_u=own[:, 2, 2],
        shared_sd=np.array([s.path_sd for s in seen])[:, [1, 0, 2]],
        facing=np.array([np.arctan2(s.facing[1], s.facing[0]) for s in seen]),
        facing_sd_rad=unknown, code=code.astype(np.int64),
        classes=tuple(classes.tolist()), id=none, confidence=np.ones(n),
        n_views=np.ones(n, np.int64),
        first_gps_s=time_s, last_gps_s=time_s, height_above_road_m=unknown,
        sd_above_road_m=unknown, size_m=unknown, side=none, status=none,
        by_size_e_m=effect[:, 1], by_size_n_m=effect[:, 0], by_size_u_m=-effect[:, 2],
    )  # fmt: skip


def _same_rows(table: FloatArray) -> list[IntArray]:
    """Numbers of the rows that are the same, ascending, of each kind of row."""
    members = Members(np.unique(table, axis=0, return_inverse=True)[1].ravel())
    return np.split(members.order, members.edges[1:-1])


def _near_pairs(place: FloatArray, own: FloatArray) -> IntArray:
    """Pairs [k, 2] of places [n, 3] that may be one by what they are off ``own`` [n, 3, 3], m^2:
    from afar a sign is placed metres off along the line of sight."""
    second, first = np.tril_indices(len(place), -1)
    apart = place[first] - place[second]
    weighted = np.linalg.solve(own[first] + own[second], apart[:, :, None])[:, :, 0]
    near = np.einsum("ki,ki->k", apart, weighted) < gate(limits.APART_PROBABILITY, 3)
    near |= np.linalg.norm(apart, axis=1) <= limits.TWICE_REACH_M
    return np.asarray(np.column_stack([first, second])[near], np.int64)
