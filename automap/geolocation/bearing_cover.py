"""The least set of objects that explains sightings: greedy choice, then improvement."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from automap.assignment import assign
from automap.geolocation import limits
from automap.geolocation.bearing_rays import BearingRules, Rays, costs, fit_point
from automap.records import FloatArray, IntArray

_ROUNDS = 10
"""Most rounds in which sightings move; they end where none does."""


def candidates(rays: Rays, rules: BearingRules) -> FloatArray:
    """Crossings of pairs of rays of different cameras, and ends of rays with depth [m, 2]."""
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
    near = limits.NEAREST_OBJECT_M
    good = (np.abs(cross) > np.sin(limits.LEAST_CROSSING)) & (along_i > near) & (along_j > near)
    good &= (along_i < rules.max_range_m) & (along_j < rules.max_range_m)
    crossings = rays.centre[i[good]] + direction[i[good]] * along_i[good, None]
    found = np.vstack([crossings, ends])
    # crossings that nearly coincide lead to the same object
    _, first = np.unique(np.round(found / limits.SAME_CANDIDATE_M), axis=0, return_index=True)
    return found[np.sort(first)]


def _best_set(
    rays: Rays, rows: IntArray, point: FloatArray, rules: BearingRules
) -> tuple[IntArray, float]:
    """Sightings that gain by belonging to a point, one per camera, and the gain."""
    gain = rules.alone_cost - costs(rays, rows, point[None], rules)[:, 0]
    order = np.argsort(-gain, kind="stable")
    order = order[gain[order] > 0.0]
    _, first = np.unique(rays.camera[rows[order]], return_index=True)
    chosen = order[np.sort(first)]
    return rows[chosen], float(gain[chosen].sum() - rules.object_cost)


def cover(rays: Rays, candidates: FloatArray, rules: BearingRules) -> tuple[FloatArray, IntArray]:
    """Greedy choice: points [m, 2] and the point of each sighting (-1 none).

    A candidate's gain can only fall as sightings are taken, so the best stays best as long as
    its gain, reckoned anew, is still above the next one's (M. Minoux, Accelerated greedy algorithms
    for maximizing submodular set functions, 1978).
    """
    import heapq

    owner = np.full(len(rays.centre), -1, np.int64)
    points: list[FloatArray] = []
    if len(candidates) == 0:
        return np.zeros((0, 2)), owner
    near = cKDTree(rays.centre).query_ball_point(candidates, rules.max_range_m)

    def evaluate(k: int) -> tuple[FloatArray, IntArray, float]:
        free = np.array(near[k], np.int64)
        free = free[owner[free] < 0]
        rows, _ = _best_set(rays, free, candidates[k], rules)
        if len(rows) == 0:
            return candidates[k], rows, -np.inf
        point = fit_point(rays, rows, candidates[k], rules)
        rows, gain = _best_set(rays, free, point, rules)
        return point, rows, gain

    queue = [
        (-_best_set(rays, np.array(rows, np.int64), candidates[k], rules)[1], k)
        for k, rows in enumerate(near)
    ]
    heapq.heapify(queue)
    while queue:
        _, k = heapq.heappop(queue)
        point, rows, gain = evaluate(k)
        if not gain > -rules.object_cost or len(rows) == 0:
            continue
        if queue and -gain > queue[0][0] + 1e-9:
            heapq.heappush(queue, (-gain, k))
            continue
        if gain <= 0.0 and not (len(rows) == 1 and np.isfinite(rays.log_depth[rows[0]])):
            continue
        owner[rows] = len(points)
        points.append(fit_point(rays, rows, point, rules))
    return np.array(points).reshape(-1, 2), owner


def reassign(
    rays: Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> tuple[FloatArray, IntArray]:
    """Move sightings to better objects, join objects that coincide, drop empty ones."""
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
            partner = assign(costs(rays, rows, points[near], rules), rules.alone_cost)
            owner[rows] = [int(near[c]) if c >= 0 else -1 for c in partner]
        points, owner = _compact(rays, points, owner, rules)
        if np.array_equal(before, owner):
            break
    return points, owner


def _compact(
    rays: Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> tuple[FloatArray, IntArray]:
    """Fit the points anew, without those that lost all sightings or fell onto another."""
    kept: list[FloatArray] = []
    renamed = np.full(len(owner), -1, np.int64)
    for k in np.argsort([-np.count_nonzero(owner == k) for k in range(len(points))], kind="stable"):
        rows = np.flatnonzero(owner == k)
        if len(rows) == 0 or (len(rows) == 1 and not np.isfinite(rays.log_depth[rows[0]])):
            continue
        point = fit_point(rays, rows, points[k], rules)
        if any(np.hypot(*(point - other)) < rules.min_distance_m for other in kept):
            continue
        renamed[rows] = len(kept)
        kept.append(point)
    return np.array(kept).reshape(-1, 2), renamed
