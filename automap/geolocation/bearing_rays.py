"""Sightings as rays in the plane: what a point costs them, and the point that fits them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import local_ned
from automap.frames import wrap_pi
from automap.records import Bearings, FloatArray, IntArray

_NEWTON_STEPS = 10
"""At most; ends at a tenth of a millimetre."""


@dataclass(frozen=True)
class BearingRules:
    """``bearing_sd_rad`` where the sighting gives none; ``position_sd_m`` of a camera;
    ``depth_log_sd`` relative error of a depth; ``max_range_m`` beyond which nothing is seen;
    ``alone_cost`` what a sighting without an object costs, ``object_cost`` what an object
    costs, both in squared sigmas; ``min_distance_m`` between two objects. ``depth_offset_sd_m`` and
    ``depth_scale_log_sd`` of what all depths have in common; ``single`` whether a sighting that
    meets no other makes an object.

    A sighting has two coordinates, and 7 is the 97 % of two; 5 to 7 and object costs of 4 to 8
    serve alike in ``tests/benchmarks/bearing_scenes.py``, where they were chosen."""

    bearing_sd_rad: float = float(np.radians(2.0))
    position_sd_m: float = 1.0
    depth_log_sd: float = 0.3
    depth_offset_sd_m: float = 3.0
    depth_scale_log_sd: float = 0.3
    single: bool = False
    max_range_m: float = 40.0
    alone_cost: float = 7.0
    object_cost: float = 6.0
    min_distance_m: float = 1.0


@dataclass(frozen=True)
class Rays:
    """Sightings in the local plane: ``centre`` [n, 2] north, east; the rest as in Bearings."""

    centre: FloatArray
    bearing: FloatArray
    sd: FloatArray
    log_depth: FloatArray
    camera: IntArray


def in_plane(bearings: Bearings, rules: BearingRules, origin: tuple[float, float, float]) -> Rays:
    zero = np.zeros(len(bearings))
    centre = local_ned(bearings.lat_rad, bearings.lon_rad, zero, origin).reshape(-1, 3)[:, :2]
    _, camera = np.unique(np.round(centre, 2), axis=0, return_inverse=True)
    usable = bearings.depth_m > 0.0
    return Rays(
        centre=centre,
        bearing=bearings.bearing_rad,
        sd=np.where(np.isfinite(bearings.sd_rad), bearings.sd_rad, rules.bearing_sd_rad),
        log_depth=np.log(np.where(usable, bearings.depth_m, np.nan)),
        camera=np.asarray(camera, np.int64).reshape(-1),
    )


def costs(rays: Rays, rows: IntArray, points: FloatArray, rules: BearingRules) -> FloatArray:
    """Squared sigmas [n, m] of sightings ``rows`` [n] for points [m, 2], 0 = perfect.

    A camera that is ``position_sd_m`` off turns the bearing of a near object by more than
    that of a far one. Infinite beyond the greatest range.
    """
    offset = points[None] - rays.centre[rows, None]
    distance, turn, turn_variance, stretch, stretch_variance = _misses(rays, rows, offset, rules)
    cost = turn**2 / turn_variance + np.nan_to_num(stretch**2 / stretch_variance)
    return np.where((distance <= rules.max_range_m) & (np.abs(turn) < np.pi / 2), cost, np.inf)


def _misses(
    rays: Rays, rows: IntArray, offset: FloatArray, rules: BearingRules
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Distance [n, ...] at an ``offset`` [n, ..., 2] from each camera, how far its direction and
    the logarithm of that (NaN: no depth) are off what was measured, each with the variance."""
    alone = (slice(None), *[None] * (offset.ndim - 2))
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), 0.1)
    near = (rules.position_sd_m / distance) ** 2
    turn = wrap_pi(np.arctan2(offset[..., 1], offset[..., 0]) - rays.bearing[rows][alone])
    stretch = np.log(distance) - rays.log_depth[rows][alone]
    return distance, turn, rays.sd[rows][alone] ** 2 + near, stretch, rules.depth_log_sd**2 + near


def fit_point(rays: Rays, rows: IntArray, start: FloatArray, rules: BearingRules) -> FloatArray:
    """Least-squares point [2] of some sightings (Gauss-Newton with fixed weights a step)."""
    point = np.array(start, np.float64)
    for _ in range(_NEWTON_STEPS):
        N, g = normal_equations(rays, rows, point, rules)
        step = np.linalg.solve(N + 1e-9 * np.eye(2), g)
        length = float(np.hypot(step[0], step[1]))
        point += step * min(1.0, 5.0 / max(length, 1e-9))
        if length < 1e-4:
            break
    return point


def normal_equations(
    rays: Rays, rows: IntArray, point: FloatArray, rules: BearingRules
) -> tuple[FloatArray, FloatArray]:
    """Normal matrix [2, 2] and right-hand side [2] of a point."""
    offset = point - rays.centre[rows]
    distance, turn, turn_variance, stretch, stretch_variance = _misses(rays, rows, offset, rules)
    square = distance[:, None] ** 2
    J = np.column_stack([-offset[:, 1], offset[:, 0]]) / square
    known = np.isfinite(stretch)
    J = np.vstack([J, (offset / square)[known]])
    weight = 1.0 / np.append(turn_variance, stretch_variance[known])
    weighted = (J * weight[:, None]).T
    N, g = weighted @ J, -weighted @ np.append(turn, stretch[known])
    # without depth a single direction leaves the range open
    return N + 1e-6 * np.eye(2), g
