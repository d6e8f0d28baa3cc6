"""The trajectory, adjusted weakly by signs seen again and by surveyed ones.

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
from automap.geolocation.sightings import Sighting
from automap.mapping.path_errors import Equations, Network, path_nodes
from automap.records import FloatArray, Trajectory
from automap.robust import cauchy_weight

_ROUNDS = 3
"""Of the weights."""
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
        columns = [
            np.column_stack([np.interp(time_s, self.time_s, values[:, k]) for k in range(3)])
            for values in (self.error, self.sd)
        ]
        return columns[0], columns[1]


def adjust_trajectory(
    trajectory: Trajectory,
    sightings: Sequence[Sighting],
    groups: Sequence[Sequence[int]],
    control: Mapping[int, tuple[FloatArray, FloatArray]],
) -> Adjustment | None:
    """The trajectory's error from ``groups`` of sightings, each of one sign.

    ``control`` gives for the number of a group its surveyed place [3] in the local frame and
    the covariance [3, 3] of that (a coordinate not surveyed has a large variance). None where
    no sign was seen twice or surveyed, or where that tells next to nothing.
    """
    telling = [k for k, group in enumerate(groups) if len(group) > 1 or k in control]
    if not telling or len(trajectory) < 2:
        return None
    members = [(sightings[m], number) for number, k in enumerate(telling) for m in groups[k]]
    seen, sign = [sighting for sighting, _ in members], np.array([n for _, n in members])
    surveyed = [(number, *control[k]) for number, k in enumerate(telling) if k in control]
    seen_s, t = np.array([m.time_s for m in seen]), trajectory.t_ns * 1e-9
    ends = np.array([np.floor(t[0] / limits.NODE_S), np.ceil(t[-1] / limits.NODE_S)])
    time = np.union1d(np.arange(ends[0], ends[1] + 1.0) * limits.NODE_S, seen_s)
    alike, node, between = path_nodes(time, np.array([0, len(time)]))
    known = (np.maximum(np.nan_to_num(column), 1e-6) for column in trajectory.sd_pos_ned.T)
    sd = np.column_stack([np.interp(time, t, column) for column in known])
    lasting = limits.LASTING_ERROR
    between = between * np.sqrt([1.0 - lasting, 1.0 - lasting, lasting])
    start = np.array([sightings[groups[k][0]].position for k in telling])
    own = [m.covariance - np.diag(m.path_sd**2) + limits.FACE_SD_M**2 * np.eye(3) for m in seen] + [
        covariance for _, _, covariance in surveyed
    ]
    sign = np.concatenate([sign, [number for number, _, _ in surveyed]]).astype(np.int64)
    place = np.array([m.position for m in seen] + [place for _, place, _ in surveyed])
    # a surveyed place is a sighting without the path's errors
    at = np.append(np.searchsorted(time, seen_s), np.zeros(len(surveyed), np.int64))
    certain = np.arange(len(sign)) >= len(seen)
    shared = np.where(certain[:, None], 0.0, sd[at])[:, None] * between[at][:, :, None]
    information = np.linalg.inv(np.array(own))
    network = Network(alike, node[at], sign, shared, place - start[sign], information)
    equations = Equations(network)

    def weigh(square: FloatArray) -> FloatArray:
        return np.where(certain, 1.0, cauchy_weight(square, limits.HALF_WEIGHT_SIGMAS))

    found = equations.solve(equations.weights(weigh, _ROUNDS))
    unknown = 3 * node[:, None] + np.arange(3)[:, None]
    posterior = np.sqrt(found.factor.variances_of(unknown, between[:, None]))
    if posterior.min() > 1.0 - limits.LEAST_ADJUSTMENT:
        return None
    error = np.einsum("kp,kpa->ka", between, found.error[node])
    return Adjustment(time, error * sd, posterior * sd)


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
    drift = np.column_stack([np.interp(time, adjustment.time_s, slope[:, k]) for k in range(3)])
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
