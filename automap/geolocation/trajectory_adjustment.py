"""The trajectory, adjusted weakly by signs seen again and by surveyed ones.

A sign seen in two passes says how the trajectory's errors of the two differ, a control sign
what they are. The error of the position is a Gauss-Markov process with the sigma that the
trajectory reports and the time constant of satellite errors, one value a node of a few
seconds; the signs' places are eliminated (Schur complement: Triggs et al., 2000). What no
sign tells keeps its prior, so that parts of a drive without such signs stay as they were. A node
is tied to its neighbours and to those of the other passes of its signs: the equations are sparse.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import metres_per_radian, tangent_rotation
from automap.geolocation import limits
from automap.geolocation.sightings import Sighting
from automap.records import FloatArray, IntArray, Trajectory
from automap.robust import cauchy_weight
from automap.sparse_normal import Factor, factorise, least_fill

_ROUNDS = 4
"""Of the weights."""
_ROWS = 1 << 18
"""Of a long trajectory that are moved at once; a turn of axes for each is 72 bytes."""
_FLAT = 1e-9
"""Information on a place that nothing tells, 1/m^2."""


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
    from scipy.linalg import block_diag

    nodes, sd = _nodes(trajectory)
    members = {k: [sightings[m] for m in groups[k]] for k in telling}
    ties = {k: [_design(nodes, sd, m.time_s) for m in members[k]] for k in telling}
    unknowns = {k: np.concatenate([own for own, _ in ties[k]]) for k in telling}
    row, column, prior = _prior_information(nodes)
    rows, columns = [row], [column]
    for own in unknowns.values():
        rows.append(np.repeat(own, len(own)))
        columns.append(np.tile(own, len(own)))
    row, column = np.concatenate(rows), np.concatenate(columns)
    # axes of a node go together
    order = least_fill(row[row % 3 == 0] // 3, column[row % 3 == 0] // 3, len(nodes))
    order = (3 * order[:, None] + np.arange(3)).ravel()
    weights = {k: np.ones(len(groups[k])) for k in telling}
    factor: Factor
    for _ in range(_ROUNDS):
        values, right = [prior], np.zeros(len(order))
        for k in telling:
            A = block_diag(*(part for _, part in ties[k]))
            N, r = _eliminated(members[k], A, control.get(k), weights[k])
            values.append(N.ravel())
            np.add.at(right, unknowns[k], r)
        factor = factorise(row, column, np.concatenate(values), order)
        u = factor.solve(right)
        for k in telling:
            error = [part @ u[own] for own, part in ties[k]]
            weights[k] = _weights(members[k], error, control.get(k))
    posterior = np.sqrt(factor.variances()).reshape(-1, 3)
    if posterior.min() > 1.0 - limits.LEAST_ADJUSTMENT:
        return None
    return Adjustment(nodes, u.reshape(-1, 3) * sd, posterior * sd)


def _nodes(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Times [k] of the nodes and the trajectory's sigma there [k, 3]."""
    time = trajectory.t_ns * 1e-9
    count = max(int(np.ceil((time[-1] - time[0]) / limits.NODE_S)) + 1, 2)
    nodes = np.linspace(time[0], time[-1], count)
    known = np.maximum(np.nan_to_num(trajectory.sd_pos_ned), 1e-6)
    return nodes, np.column_stack([np.interp(nodes, time, known[:, k]) for k in range(3)])


def _prior_information(nodes: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Information of a unit Gauss-Markov process at the nodes, three axes alike: rows, columns
    and values of its entries."""
    n = len(nodes)
    alike = np.exp(-np.diff(nodes) / limits.PATH_CORRELATION_S)
    fresh = 1.0 / (1.0 - alike**2)
    own = np.zeros(n)
    own[0] = 1.0
    own[1:] += fresh
    own[:-1] += alike**2 * fresh
    at = np.arange(n)
    row = np.concatenate([at, at[1:], at[:-1]])
    column = np.concatenate([at, at[:-1], at[1:]])
    value = np.concatenate([own, -alike * fresh, -alike * fresh])
    axes = np.arange(3)
    row, column = ((3 * v[:, None] + axes).ravel() for v in (row, column))
    return row, column, np.repeat(value, 3)


def _design(nodes: FloatArray, sd: FloatArray, time_s: float) -> tuple[IntArray, FloatArray]:
    """The six unknowns of the two nodes about a time, and the derivative [3, 6] of the
    trajectory's error there by them."""
    right = int(np.clip(np.searchsorted(nodes, time_s), 1, len(nodes) - 1))
    share = float(np.clip((time_s - nodes[right - 1]) / (nodes[right] - nodes[right - 1]), 0, 1))
    parts = [np.diag((1.0 - share) * sd[right - 1]), np.diag(share * sd[right])]
    return np.arange(3 * right - 3, 3 * right + 3), np.hstack(parts)


def _own_information(sighting: Sighting) -> FloatArray:
    own = sighting.covariance - np.diag(sighting.path_sd**2)
    return np.asarray(np.linalg.inv(own + limits.FACE_SD_M**2 * np.eye(3)))


def _eliminated(
    members: Sequence[Sighting],
    A: FloatArray,
    control: tuple[FloatArray, FloatArray] | None,
    weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Information and right-hand side of a sign's sightings for the unknowns of the derivative
    ``A`` [3m, 6m], without its place."""
    start = members[0].position
    W = [w * _own_information(m) for w, m in zip(weight, members, strict=True)]
    z = [m.position - start for m in members]
    place: FloatArray = _FLAT * np.eye(3)
    pull = np.zeros(3)
    if control is not None:
        place = np.asarray(np.linalg.inv(control[1]), np.float64)
        pull = place @ (control[0] - start)
    parts = [A[3 * k : 3 * k + 3] for k in range(len(members))]
    N = np.sum([part.T @ w @ part for part, w in zip(parts, W, strict=True)], axis=0)
    r = np.sum([part.T @ w @ v for part, w, v in zip(parts, W, z, strict=True)], axis=0)
    cross = np.sum([part.T @ w for part, w in zip(parts, W, strict=True)], axis=0)
    place = place + np.sum(W, axis=0)
    pull = pull + np.sum([w @ v for w, v in zip(W, z, strict=True)], axis=0)
    solved = np.linalg.solve(place, np.column_stack([cross.T, pull]))
    return N - cross @ solved[:, :-1], r - cross @ solved[:, -1]


def _weights(
    members: Sequence[Sighting],
    error: Sequence[FloatArray],
    control: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """Cauchy's weights [m] of a sign's sightings, by their distance from the sign's place."""
    W = [_own_information(m) for m in members]
    z = [m.position - e for m, e in zip(members, error, strict=True)]
    N, g = np.sum(W, axis=0), np.sum([w @ v for w, v in zip(W, z, strict=True)], axis=0)
    if control is not None:
        N, g = N + np.linalg.inv(control[1]), g + np.linalg.solve(control[1], control[0])
    place = np.linalg.solve(N, g)
    square = np.array([(v - place) @ w @ (v - place) for w, v in zip(W, z, strict=True)])
    return cauchy_weight(square, limits.HALF_WEIGHT_SIGMAS)


def shift_sighting(sighting: Sighting, adjustment: Adjustment) -> Sighting:
    """The sighting as the adjusted trajectory gives it."""
    error, sd = adjustment.at(np.array([sighting.time_s]))
    position = sighting.position - error[0]
    return replace(
        sighting,
        position=position,
        landmark=replace(sighting.landmark, position=position),
        path_sd=np.minimum(sd[0], sighting.path_sd),
    )


def shift_trajectory(
    trajectory: Trajectory, adjustment: Adjustment, origin: tuple[float, float, float]
) -> Trajectory:
    """The adjusted trajectory: positions, velocities and sigmas of the positions."""
    slope = np.gradient(adjustment.error, adjustment.time_s, axis=0)
    moved = ("lat_rad", "lon_rad", "height_m", "vel_ned", "sd_pos_ned")
    out = replace(trajectory, **{name: getattr(trajectory, name).copy() for name in moved})
    for a in range(0, len(out), _ROWS):
        part = slice(a, a + _ROWS)
        time = np.asarray(out.t_ns[part] * 1e-9, np.float64)
        error, sd = adjustment.at(time)
        drift = np.column_stack([np.interp(time, adjustment.time_s, slope[:, k]) for k in range(3)])
        lat, height = out.lat_rad[part].copy(), out.height_m[part]
        C_here_origin = np.swapaxes(tangent_rotation(lat, out.lon_rad[part], origin), 1, 2)
        error, drift = (np.einsum("nij,nj->ni", C_here_origin, v) for v in (error, drift))
        per_lat, per_lon = metres_per_radian(lat, np.nan_to_num(height))
        out.lat_rad[part] -= error[:, 0] / per_lat
        lon = out.lon_rad[part] - error[:, 1] / per_lon
        out.lon_rad[part] = (lon + np.pi) % (2.0 * np.pi) - np.pi
        out.height_m[part] += error[:, 2]
        out.vel_ned[part] -= drift
        out.sd_pos_ned[part] = np.minimum(sd, out.sd_pos_ned[part])
    return out
