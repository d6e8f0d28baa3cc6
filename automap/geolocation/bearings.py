"""Objects from finished sightings: camera position, bearing and perhaps depth; no trajectory.

Every object is a point in the plan; every sighting belongs to one object at most and every
camera position sees an object once at most. An assignment is worth the sum over its objects
of what their sightings gain against being false alarms, less the price of an object (a
likelihood form of the energy of Krylov, Kenny and Dahyot, Remote Sensing 10, 2018). Candidate
points are the crossings of pairs of rays and the ends of rays with a depth. The best
candidate is taken, its sightings leave the rest, and so on; then sightings move to the object
that explains them best until none moves. With that association the
scale that all depths share is estimated, and all is done again with the corrected depths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from automap.earth import from_local_ned, local_ned
from automap.geolocation.depth_scale import DepthScale, fit_depth_scale
from automap.records import NO_TIME, FloatArray, IntArray, Sign

_ROUNDS = 10
_SCALE_ROUNDS = 4
_SETTLED_M = 0.2
_TYPICAL_DEPTHS_M = np.array([6.0, 15.0])
_LEAST_DEPTHS = 10
_GOOD_CROSSING = 0.5
_NEWTON_STEPS = 10
_IMPOSSIBLE = 1e6


@dataclass(frozen=True)
class Bearings:
    """Sightings [n]: camera position, bearing clockwise from north, depth (NaN unknown),
    class ("" unknown), one-sigma error of the bearing (NaN unknown)."""

    lat_rad: FloatArray
    lon_rad: FloatArray
    bearing_rad: FloatArray
    depth_m: FloatArray
    class_name: npt.NDArray[np.object_]
    sd_rad: FloatArray

    def __len__(self) -> int:
        return len(self.lat_rad)


@dataclass(frozen=True)
class BearingRules:
    """``bearing_sd_rad`` where the sighting gives none; ``position_sd_m`` of a camera;
    ``depth_log_sd`` relative error of a depth; ``max_range_m`` beyond which nothing is seen;
    ``alone_cost`` what a sighting without an object costs, ``object_cost`` what an object
    costs, both in squared sigmas; ``min_distance_m`` between two objects, ``max_joined_m``
    between two that may be one. ``depth_offset_sd_m`` and ``depth_scale_log_sd`` of what all
    depths have in common; ``single`` whether a sighting that meets no other makes an object."""

    bearing_sd_rad: float = float(np.radians(2.0))
    position_sd_m: float = 1.0
    depth_log_sd: float = 0.3
    depth_offset_sd_m: float = 3.0
    depth_scale_log_sd: float = 0.3
    max_joined_m: float = 6.0
    single: bool = False
    max_range_m: float = 40.0
    alone_cost: float = 9.0
    object_cost: float = 9.0
    min_distance_m: float = 1.0


@dataclass(frozen=True)
class _Rays:
    """Sightings in the local plane: ``centre`` [n, 2] north, east; the rest as in Bearings."""

    centre: FloatArray
    bearing: FloatArray
    sd: FloatArray
    log_depth: FloatArray
    camera: IntArray


def locate_from_bearings(
    bearings: Bearings, rules: BearingRules | None = None, drive: str = ""
) -> tuple[list[Sign], IntArray]:
    """Signs, and for every sighting the index of its sign (-1 none).

    An object seen by one sighting is placed only if the sighting has a depth, and flagged
    single_view. Heights, sizes and times are unknown (NaN, NO_TIME).
    """
    rules = rules or BearingRules()
    if len(bearings) == 0:
        return [], np.zeros(0, np.int64)
    origin = (float(np.mean(bearings.lat_rad)), float(bearings.lon_rad[0]), 0.0)
    measured = _in_plane(bearings, rules, origin)
    rays, scale = measured, DepthScale()
    points, owner = np.zeros((0, 2)), np.zeros(0, np.int64)
    for _ in range(_SCALE_ROUNDS):
        rays = replace(measured, log_depth=np.log(scale.apply(np.exp(measured.log_depth))))
        points, owner = _cover(rays, _candidates(rays, rules), rules)
        points, owner = _settle(rays, points, owner, rules)
        points, owner = _joined(rays, points, owner, rules)
        before, scale = scale, _depth_scale(measured, points, owner, rules)
        change = scale.apply(_TYPICAL_DEPTHS_M) - before.apply(_TYPICAL_DEPTHS_M)
        if np.abs(change).max() < _SETTLED_M:
            break
    if not rules.single:
        points, owner = _without_single(points, owner)
    return _signs(bearings, rays, points, owner, rules, origin, drive)


def _depth_scale(
    rays: _Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> DepthScale:
    """What the depths have in common, from the objects that two bearings or more cross at."""
    counts = np.bincount(owner[owner >= 0], minlength=len(points))
    rows = np.flatnonzero((owner >= 0) & np.isfinite(rays.log_depth))
    rows = rows[counts[owner[rows]] >= 2]
    if len(rows) < _LEAST_DEPTHS:
        return DepthScale()
    without = replace(rays, log_depth=np.full(len(rays.log_depth), np.nan))
    distance, sd = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    for k in np.unique(owner[rows]):
        members = np.flatnonzero(owner == k)
        point = _fit(without, members, points[k], rules)
        N, _ = _normal(without, members, point, rules)
        cov = np.linalg.inv(N)
        own = owner[rows] == k
        offset = point - rays.centre[rows[own]]
        length = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 0.5)
        along = offset / length[:, None]
        distance[own] = length
        sd[own] = np.sqrt(np.einsum("ni,ij,nj->n", along, cov, along)) / length
    good = sd < _GOOD_CROSSING
    if good.sum() < _LEAST_DEPTHS:
        return DepthScale()
    return fit_depth_scale(
        *(np.exp(rays.log_depth[rows[good]]), distance[good]),
        np.hypot(sd[good], rules.depth_log_sd),
        *(rules.depth_offset_sd_m, rules.depth_scale_log_sd),
    )


def _without_single(points: FloatArray, owner: IntArray) -> tuple[FloatArray, IntArray]:
    """Only the objects that two sightings or more agree on."""
    counts = np.bincount(owner[owner >= 0], minlength=len(points))
    kept = np.flatnonzero(counts >= 2)
    renamed = np.full(len(points) + 1, -1, np.int64)
    renamed[kept] = np.arange(len(kept))
    return points[kept], renamed[owner]


def _in_plane(bearings: Bearings, rules: BearingRules, origin: tuple[float, float, float]) -> _Rays:
    zero = np.zeros(len(bearings))
    centre = local_ned(bearings.lat_rad, bearings.lon_rad, zero, origin).reshape(-1, 3)[:, :2]
    _, camera = np.unique(np.round(centre, 2), axis=0, return_inverse=True)
    usable = bearings.depth_m > 0.0
    return _Rays(
        centre=centre,
        bearing=bearings.bearing_rad,
        sd=np.where(np.isfinite(bearings.sd_rad), bearings.sd_rad, rules.bearing_sd_rad),
        log_depth=np.log(np.where(usable, bearings.depth_m, np.nan)),
        camera=np.asarray(camera, np.int64).reshape(-1),
    )


def _costs(rays: _Rays, rows: IntArray, points: FloatArray, rules: BearingRules) -> FloatArray:
    """Squared sigmas [n, m] of sightings ``rows`` [n] for points [m, 2], 0 = perfect.

    A camera that is ``position_sd_m`` off turns the bearing of a near object by more than
    that of a far one. Infinite beyond the greatest range.
    """
    offset = points[None] - rays.centre[rows, None]
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), 0.1)
    turn = np.arctan2(offset[..., 1], offset[..., 0]) - rays.bearing[rows, None]
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    near = rules.position_sd_m / distance
    cost = turn**2 / (rays.sd[rows, None] ** 2 + near**2)
    stretch = np.log(distance) - rays.log_depth[rows, None]
    depth_cost = stretch**2 / (rules.depth_log_sd**2 + near**2)
    cost += np.where(np.isfinite(stretch), depth_cost, 0.0)
    return np.where((distance <= rules.max_range_m) & (np.abs(turn) < np.pi / 2), cost, np.inf)


def _candidates(rays: _Rays, rules: BearingRules) -> FloatArray:
    """Crossings of pairs of rays of different cameras, and ends of rays with depth [m, 2]."""
    from scipy.spatial import cKDTree

    direction = np.column_stack([np.cos(rays.bearing), np.sin(rays.bearing)])
    known = np.isfinite(rays.log_depth) & (np.exp(rays.log_depth) <= rules.max_range_m)
    ends = rays.centre[known] + direction[known] * np.exp(rays.log_depth[known])[:, None]
    tree = cKDTree(rays.centre)
    pairs = tree.query_pairs(2.0 * rules.max_range_m, output_type="ndarray")
    pairs = pairs[rays.camera[pairs[:, 0]] != rays.camera[pairs[:, 1]]]
    i, j = pairs[:, 0], pairs[:, 1]
    cross = direction[i, 0] * direction[j, 1] - direction[i, 1] * direction[j, 0]
    apart = rays.centre[j] - rays.centre[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_i = (apart[:, 0] * direction[j, 1] - apart[:, 1] * direction[j, 0]) / cross
        along_j = (apart[:, 0] * direction[i, 1] - apart[:, 1] * direction[i, 0]) / cross
    good = (np.abs(cross) > np.sin(np.radians(3.0))) & (along_i > 0.5) & (along_j > 0.5)
    good &= (along_i < rules.max_range_m) & (along_j < rules.max_range_m)
    crossings = rays.centre[i[good]] + direction[i[good]] * along_i[good, None]
    found = np.vstack([crossings, ends])
    # crossings that nearly coincide lead to the same object
    _, first = np.unique(np.round(found / 0.5), axis=0, return_index=True)
    return found[np.sort(first)]


def _best_set(
    rays: _Rays, rows: IntArray, point: FloatArray, rules: BearingRules
) -> tuple[IntArray, float]:
    """Sightings that gain by belonging to a point, one per camera, and the gain."""
    gain = rules.alone_cost - _costs(rays, rows, point[None], rules)[:, 0]
    order = np.argsort(-gain, kind="stable")
    order = order[gain[order] > 0.0]
    _, first = np.unique(rays.camera[rows[order]], return_index=True)
    chosen = order[np.sort(first)]
    return rows[chosen], float(gain[chosen].sum() - rules.object_cost)


def _cover(rays: _Rays, candidates: FloatArray, rules: BearingRules) -> tuple[FloatArray, IntArray]:
    """Greedy choice: points [m, 2] and the point of each sighting (-1 none).

    A candidate's gain can only fall as sightings are taken, so the best stays best as long as
    its gain, reckoned anew, is still above the next one's.
    """
    import heapq

    from scipy.spatial import cKDTree

    owner = np.full(len(rays.centre), -1, np.int64)
    points: list[FloatArray] = []
    if len(candidates) == 0:
        return np.zeros((0, 2)), owner
    near = cKDTree(rays.centre).query_ball_point(candidates, rules.max_range_m)

    def reckon(k: int) -> tuple[FloatArray, IntArray, float]:
        free = np.array(near[k], np.int64)
        free = free[owner[free] < 0]
        if len(free) == 0:
            return candidates[k], free, -np.inf
        rows, _ = _best_set(rays, free, candidates[k], rules)
        if len(rows) == 0:
            return candidates[k], rows, -np.inf
        point = _fit(rays, rows, candidates[k], rules)
        rows, gain = _best_set(rays, free, point, rules)
        return point, rows, gain

    queue = []
    for k in range(len(candidates)):
        rows = np.array(near[k], np.int64)
        queue.append((-_best_set(rays, rows, candidates[k], rules)[1], k))
    heapq.heapify(queue)
    while queue:
        _, k = heapq.heappop(queue)
        point, rows, gain = reckon(k)
        if not gain > -rules.object_cost or len(rows) == 0:
            continue
        if queue and -gain > queue[0][0] + 1e-9:
            heapq.heappush(queue, (-gain, k))
            continue
        if gain <= 0.0 and not (len(rows) == 1 and np.isfinite(rays.log_depth[rows[0]])):
            continue
        owner[rows] = len(points)
        points.append(_fit(rays, rows, point, rules))
    return np.array(points).reshape(-1, 2), owner


def _fit(rays: _Rays, rows: IntArray, start: FloatArray, rules: BearingRules) -> FloatArray:
    """Least-squares point [2] of some sightings (Gauss-Newton with fixed weights a step)."""
    point = np.array(start, np.float64)
    for _ in range(_NEWTON_STEPS):
        N, g = _normal(rays, rows, point, rules)
        step = np.linalg.solve(N + 1e-9 * np.eye(2), g)
        length = float(np.hypot(step[0], step[1]))
        point += step * min(1.0, 5.0 / max(length, 1e-9))
        if length < 1e-4:
            break
    return point


def _normal(
    rays: _Rays, rows: IntArray, point: FloatArray, rules: BearingRules
) -> tuple[FloatArray, FloatArray]:
    """Normal matrix [2, 2] and right-hand side [2] of a point."""
    offset = point - rays.centre[rows]
    distance = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 0.1)
    turn = np.arctan2(offset[:, 1], offset[:, 0]) - rays.bearing[rows]
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    near = rules.position_sd_m / distance
    J = np.column_stack([-offset[:, 1], offset[:, 0]]) / distance[:, None] ** 2
    weight = 1.0 / (rays.sd[rows] ** 2 + near**2)
    N = (J * weight[:, None]).T @ J
    g = -(J * weight[:, None]).T @ turn
    stretch = np.log(distance) - rays.log_depth[rows]
    known = np.isfinite(stretch)
    K = offset[known] / distance[known, None] ** 2
    weight = 1.0 / (rules.depth_log_sd**2 + near[known] ** 2)
    N += (K * weight[:, None]).T @ K
    g += -(K * weight[:, None]).T @ stretch[known]
    # without depth a single direction leaves the range open
    return N + 1e-6 * np.eye(2), g


def _settle(
    rays: _Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> tuple[FloatArray, IntArray]:
    """Move sightings to better objects, join objects that coincide, drop empty ones."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial import cKDTree

    for _ in range(_ROUNDS):
        if len(points) == 0:
            break
        before = owner.copy()
        tree = cKDTree(points)
        for camera in np.unique(rays.camera):
            rows = np.flatnonzero(rays.camera == camera)
            near = np.array(
                tree.query_ball_point(rays.centre[rows[0]], rules.max_range_m), np.int64
            )
            alone = np.full((len(rows), len(rows)), _IMPOSSIBLE)
            np.fill_diagonal(alone, rules.alone_cost)
            cost = np.minimum(_costs(rays, rows, points[near], rules), _IMPOSSIBLE)
            boxes, columns = linear_sum_assignment(np.hstack([cost, alone]))
            owner[rows[boxes]] = [int(near[c]) if c < len(near) else -1 for c in columns]
        points, owner = _compact(rays, points, owner, rules)
        if np.array_equal(before, owner):
            break
    return points, owner


def _joined(
    rays: _Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> tuple[FloatArray, IntArray]:
    """One object for two that no camera sees apart and that one place explains as well.

    As well means at no more than the price of the object that is saved; the pair that gains
    most goes first.
    """
    from scipy.spatial import cKDTree

    def cost(rows: IntArray, point: FloatArray) -> float:
        return float(_costs(rays, rows, point[None], rules).sum())

    while len(points) > 1:
        best: tuple[float, int, int, FloatArray] | None = None
        for a, b in cKDTree(points).query_pairs(rules.max_joined_m):
            one, other = np.flatnonzero(owner == a), np.flatnonzero(owner == b)
            if np.isin(rays.camera[one], rays.camera[other]).any():
                continue
            both = np.concatenate([one, other])
            point = _fit(rays, both, 0.5 * (points[a] + points[b]), rules)
            loss = cost(both, point) - cost(one, points[a]) - cost(other, points[b])
            if loss < rules.object_cost and (best is None or loss < best[0]):
                best = (loss, min(a, b), max(a, b), point)
        if best is None:
            break
        _, kept, gone, point = best
        points[kept] = point
        points = np.delete(points, gone, axis=0)
        owner = np.where(owner == gone, kept, owner)
        owner = np.where(owner > gone, owner - 1, owner)
    return points, owner


def _compact(
    rays: _Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> tuple[FloatArray, IntArray]:
    """Fit the points anew, without those that lost all sightings or fell onto another."""
    kept: list[FloatArray] = []
    renamed = np.full(len(owner), -1, np.int64)
    for k in np.argsort([-np.count_nonzero(owner == k) for k in range(len(points))], kind="stable"):
        rows = np.flatnonzero(owner == k)
        if len(rows) == 0 or (len(rows) == 1 and not np.isfinite(rays.log_depth[rows[0]])):
            continue
        point = _fit(rays, rows, points[k], rules)
        if any(np.hypot(*(point - other)) < rules.min_distance_m for other in kept):
            continue
        renamed[rows] = len(kept)
        kept.append(point)
    return np.array(kept).reshape(-1, 2), renamed


def _signs(
    bearings: Bearings,
    rays: _Rays,
    points: FloatArray,
    owner: IntArray,
    rules: BearingRules,
    origin: tuple[float, float, float],
    drive: str,
) -> tuple[list[Sign], IntArray]:
    first = [int(np.flatnonzero(owner == k)[0]) for k in range(len(points))]
    order = np.argsort(first, kind="stable")
    index = np.full(len(owner), -1, np.int64)
    signs = []
    for number, k in enumerate(order):
        rows = np.flatnonzero(owner == k)
        index[rows] = number
        N, _ = _normal(rays, rows, points[k], rules)
        chi2 = float(_costs(rays, rows, points[k][None], rules).sum())
        terms = len(rows) + int(np.isfinite(rays.log_depth[rows]).sum())
        cov = np.linalg.inv(N) * max(1.0, chi2 / max(terms - 2, 1))
        # all cameras of one street share the receiver's error in part
        cov = cov + 0.5 * rules.position_sd_m**2 * np.eye(2)
        cov_enu = np.full((3, 3), np.nan)
        cov_enu[:2, :2] = cov[::-1, ::-1]
        lat, lon, _ = from_local_ned(np.array([*points[k], 0.0]), origin)
        towards = rays.centre[rows] - points[k]
        towards = (towards / np.maximum(np.hypot(*towards.T), 0.1)[:, None]).mean(axis=0)
        names = bearings.class_name[rows].tolist()
        known = sorted({n for n in names if n})
        sd = 0.5 * float(cov[0, 0] + cov[1, 1])
        n_cameras = len(np.unique(rays.camera[rows]))
        signs.append(
            Sign(
                id=f"s{number + 1:04d}",
                class_name=max(known, key=names.count) if known else "unknown",
                lat_rad=float(lat),
                lon_rad=float(lon),
                height_m=float("nan"),
                cov_enu=cov_enu,
                confidence=float((1.0 - 0.5**n_cameras) / np.sqrt(1.0 + sd / 9.0)),
                n_views=len(rows),
                first_seen_ns=NO_TIME,
                last_seen_ns=NO_TIME,
                height_above_road_m=float("nan"),
                facing_rad=float(np.arctan2(towards[1], towards[0]) % (2.0 * np.pi)),
                size_m=float("nan"),
                side="unknown",
                status=_status(len(rows), cov),
                drives=(drive,) if drive else (),
                detection_rows=rows.astype(np.int64),
            )
        )
    return signs, index


def _status(n_views: int, cov: FloatArray) -> str:
    if n_views == 1:
        return "single_view"
    return "weak_geometry" if float(np.linalg.eigvalsh(cov)[-1]) > 5.0**2 else "ok"
