"""Where signs stand by all passes, and the trajectory, adjusted weakly by those seen again.

A sign seen in two passes says how the trajectory's errors of the two differ, a control sign
what they are (``path_errors.py``). What no sign tells keeps its prior, so that parts of a drive
without such signs stay as they were.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import metres_per_radian, tangent_rotation
from automap.frames import wrap_pi
from automap.geolocation import limits
from automap.geolocation.sightings import Sighting, common_effects
from automap.mapping.adjustment import stray_weights
from automap.mapping.path_errors import Equations, network, path_nodes
from automap.mapping.size_errors import split_common
from automap.records import FloatArray, Trajectory

_ROWS = 1 << 16
"""Of a long trajectory that are moved at once; to move each takes 300 bytes."""


@dataclass(frozen=True)
class Adjustment:
    """Error of the trajectory's position at ``time_s`` [k] host seconds: ``error`` [k, 3] and
    one sigma ``sd`` [k, 3] of it, m NED at the map's origin."""

    time_s: FloatArray
    error: FloatArray
    sd: FloatArray

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Error and sigma [n, 3] at other times [n]; at the ends the last ones hold."""
        return _at(time_s, self.time_s, self.error), _at(time_s, self.time_s, self.sd)


def _at(time_s: FloatArray, known_s: FloatArray, values: FloatArray) -> FloatArray:
    """Values [n, a] at times [n] between those known [k, a]."""
    return np.column_stack([np.interp(time_s, known_s, column) for column in values.T])


@dataclass(frozen=True)
class Placed:
    """Signs [m] of a drive in the local frame (NED), m: ``place`` [m, 3], ``covariance`` [m, 3, 3],
    and ``by_size`` [m, 3] how far a sigma of the sizes that they were taken for moves them."""

    place: FloatArray
    covariance: FloatArray
    by_size: FloatArray

    def of(self, number: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One of the signs."""
        return self.place[number], self.covariance[number], self.by_size[number]


def place_signs(
    trajectory: Trajectory,
    sightings: Sequence[Sighting],
    groups: Sequence[Sequence[int]],
    control: Mapping[int, tuple[FloatArray, FloatArray]],
    adjust: bool = True,
) -> tuple[Placed, Adjustment | None]:
    """The signs of ``groups`` of sightings, and, to ``adjust`` the trajectory, its error as these
    tell it.

    ``control`` gives for the number of a group its surveyed place [3] in the local frame and
    the covariance [3, 3] of that (a coordinate not surveyed has a large variance). No error
    where no sign was seen twice or surveyed, or where that tells next to nothing. What is wrong of
    a camera or of the size that a sign was taken for is common to its sightings
    (``size_errors.py``).
    """
    firsts = [sightings[group[0]] for group in groups]
    placed = Placed(
        np.array([s.position for s in firsts]).reshape(-1, 3),
        np.array([s.covariance for s in firsts]).reshape(-1, 3, 3),
        np.array([s.size_effect for s in firsts]).reshape(-1, 3),
    )
    telling = [k for k, group in enumerate(groups) if len(group) > 1 or k in control]
    if not telling or len(trajectory) < 2:
        return placed, None
    seen = [sightings[m] for k in telling for m in groups[k]]
    surveyed = [(number, *control[k]) for number, k in enumerate(telling) if k in control]
    sign = np.repeat(np.arange(len(telling)), [len(groups[k]) for k in telling])
    sign = np.append(sign, [number for number, _, _ in surveyed]).astype(np.int64)
    start = placed.place[telling]
    place = np.array([m.position for m in seen] + [place for _, place, _ in surveyed])
    alone = [m.covariance - np.diag(m.path_sd**2) + limits.FACE_SD_M**2 * np.eye(3) for m in seen]
    # a surveyed place is a sighting without the errors of path, camera and size
    none = ((0, len(surveyed)), (0, 0))
    own, common = split_common(
        np.array(alone + [covariance for _, _, covariance in surveyed]),
        np.pad(common_effects(seen), (*none, (0, 0))),
        sign,
    )
    t = np.asarray(trajectory.t_ns * 1e-9, np.float64)
    ends = np.array([np.floor(t[0] / limits.NODE_S), np.ceil(t[-1] / limits.NODE_S)])
    seen_s = np.array([m.time_s for m in seen])
    time = np.union1d(np.arange(ends[0], ends[1] + 1.0) * limits.NODE_S, seen_s)
    alike, node, between = path_nodes(time, np.array([0, len(time)]))
    sd = np.maximum(_at(time, t, np.nan_to_num(trajectory.sd_pos_ned)), 1e-6)
    at = np.searchsorted(time, seen_s)
    nodes = alike, node[np.pad(at, none[0])], between[np.pad(at, none[0])]
    parts = np.sqrt([1.0 - limits.LASTING_ERROR, limits.LASTING_ERROR])
    shared = np.pad(sd[at], none)
    equations = Equations(
        network(nodes, sign, np.tile(parts, (len(sign), 1)), shared, place - start[sign], own)
    )
    found = equations.solve(stray_weights(equations))
    placed.place[telling] = start + found.place
    placed.covariance[telling] = found.place_variances(len(telling))
    placed.covariance[telling] += common @ common.swapaxes(1, 2)
    placed.by_size[telling] = common[:, :, 0]
    unknown, between = 3 * node[:, None] + np.arange(3)[:, None], between * parts[[0, 0, 1]]
    posterior = np.sqrt(found.factor.variances_of(unknown, between[:, None]))
    if not adjust or posterior.min() > 1.0 - limits.LEAST_ADJUSTMENT:
        return placed, None
    adjustment = Adjustment(
        time, np.einsum("kp,kpa->ka", between, found.error[node]) * sd, posterior * sd
    )
    for k in set(range(len(groups))) - set(telling):
        single = shift_sighting(firsts[k], adjustment)
        placed.place[k], placed.covariance[k] = single.position, single.covariance
    return placed, adjustment


def shift_sighting(sighting: Sighting, adjustment: Adjustment) -> Sighting:
    """The sighting as the adjusted trajectory gives it."""
    error, sd = adjustment.at(np.array([sighting.time_s]))
    # the landmark stays where its views see it from, which are not moved
    return replace(
        sighting,
        position=sighting.position - error[0],
        path_sd=np.minimum(sd[0], sighting.path_sd),
    )


@dataclass(frozen=True)
class AdjustedTrajectory:
    """A ``trajectory`` less its error (None: as it is), made as it is asked for: of a long drive it
    is as large again."""

    trajectory: Trajectory
    adjustment: Adjustment | None
    origin: tuple[float, float, float]

    def pieces(self) -> Iterator[Trajectory]:
        """Stretch after stretch."""
        for a in range(0, max(len(self.trajectory), 1), _ROWS):
            part, known = self.trajectory.at(slice(a, a + _ROWS)), self.adjustment
            yield part if known is None else shifted(part, known, self.origin)


def shifted(
    trajectory: Trajectory, adjustment: Adjustment, origin: tuple[float, float, float]
) -> Trajectory:
    """The adjusted trajectory: positions, velocities and sigmas of the positions."""
    slope = np.gradient(adjustment.error, adjustment.time_s, axis=0)
    time = np.asarray(trajectory.t_ns * 1e-9, np.float64)
    error, sd = adjustment.at(time)
    drift = _at(time, adjustment.time_s, slope)
    lat, height = trajectory.lat_rad, trajectory.height_m
    C_here_origin = np.swapaxes(tangent_rotation(lat, trajectory.lon_rad, origin), 1, 2)
    error, drift = (np.einsum("nij,nj->ni", C_here_origin, v) for v in (error, drift))
    per_lat, per_lon = metres_per_radian(lat, np.nan_to_num(height))
    return replace(
        trajectory,
        lat_rad=lat - error[:, 0] / per_lat,
        lon_rad=wrap_pi(trajectory.lon_rad - error[:, 1] / per_lon),
        height_m=height + error[:, 2],
        vel_ned=trajectory.vel_ned - drift,
        sd_pos_ned=np.minimum(sd, trajectory.sd_pos_ned),
    )
