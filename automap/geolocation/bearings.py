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

from dataclasses import replace

import numpy as np

from automap.earth import from_local_ned
from automap.geolocation import limits
from automap.geolocation.bearing_cover import candidates, cover, reassign
from automap.geolocation.bearing_rays import (
    BearingRules,
    Rays,
    costs,
    fit_point,
    in_plane,
    normal_equations,
)
from automap.geolocation.depth_scale import DepthScale, fit_depth_scale
from automap.records import NO_TIME, Bearings, FloatArray, IntArray, Sign

__all__ = ["BearingRules", "Bearings", "locate_from_bearings"]

_SCALE_ROUNDS = 4
"""At most; ends where depths have settled."""
_TYPICAL_DEPTHS_M = np.array([6.0, 15.0])


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
    measured = in_plane(bearings, rules, origin)
    rays, scale = measured, DepthScale()
    points, owner = np.zeros((0, 2)), np.zeros(0, np.int64)
    for _ in range(_SCALE_ROUNDS):
        rays = replace(measured, log_depth=np.log(scale.apply(np.exp(measured.log_depth))))
        points, owner = cover(rays, candidates(rays, rules), rules)
        points, owner = reassign(rays, points, owner, rules)
        before, scale = scale, _depth_scale(measured, points, owner, rules)
        change = scale.apply(_TYPICAL_DEPTHS_M) - before.apply(_TYPICAL_DEPTHS_M)
        if np.abs(change).max() < limits.SCALE_SETTLED_M:
            break
    if not rules.single:
        points, owner = _without_single(points, owner)
    return _signs(bearings, rays, points, owner, rules, origin, drive)


def _depth_scale(
    rays: Rays, points: FloatArray, owner: IntArray, rules: BearingRules
) -> DepthScale:
    """What the depths have in common, from the objects that two bearings or more cross at."""
    counts = np.bincount(owner[owner >= 0], minlength=len(points))
    rows = np.flatnonzero((owner >= 0) & np.isfinite(rays.log_depth))
    rows = rows[counts[owner[rows]] >= 2]
    if len(rows) < limits.LEAST_DEPTHS:
        return DepthScale()
    without = replace(rays, log_depth=np.full(len(rays.log_depth), np.nan))
    distance, sd = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    for k in np.unique(owner[rows]):
        members = np.flatnonzero(owner == k)
        point = fit_point(without, members, points[k], rules)
        N, _ = normal_equations(without, members, point, rules)
        cov = np.linalg.inv(N)
        own = owner[rows] == k
        offset = point - rays.centre[rows[own]]
        length = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), limits.NEAREST_OBJECT_M)
        along = offset / length[:, None]
        distance[own] = length
        sd[own] = np.sqrt(np.einsum("ni,ij,nj->n", along, cov, along)) / length
    good = sd < limits.GOOD_CROSSING
    if good.sum() < limits.LEAST_DEPTHS:
        return DepthScale()
    log_sd = np.hypot(sd[good], rules.depth_log_sd)
    return fit_depth_scale(np.exp(rays.log_depth[rows[good]]), distance[good], log_sd, rules)


def _without_single(points: FloatArray, owner: IntArray) -> tuple[FloatArray, IntArray]:
    """Only the objects that two sightings or more agree on."""
    counts = np.bincount(owner[owner >= 0], minlength=len(points))
    kept = np.flatnonzero(counts >= 2)
    renamed = np.full(len(points) + 1, -1, np.int64)
    renamed[kept] = np.arange(len(kept))
    return points[kept], renamed[owner]


def _signs(
    bearings: Bearings,
    rays: Rays,
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
        N, _ = normal_equations(rays, rows, points[k], rules)
        chi2 = float(costs(rays, rows, points[k][None], rules).sum())
        terms = len(rows) + int(np.isfinite(rays.log_depth[rows]).sum())
        cov = np.linalg.inv(N) * max(1.0, chi2 / max(terms - 2, 1))
        # all cameras of one street share the receiver's error in part
        cov = cov + limits.SHARED_CAMERA_VARIANCE * rules.position_sd_m**2 * np.eye(2)
        cov_enu = np.full((3, 3), np.nan)
        cov_enu[:2, :2] = cov[::-1, ::-1]
        lat, lon, _ = from_local_ned(np.array([*points[k], 0.0]), origin)
        towards = rays.centre[rows] - points[k]
        towards = (towards / np.maximum(np.hypot(*towards.T), 0.1)[:, None]).mean(axis=0)
        names = bearings.class_name[rows].tolist()
        known = sorted({n for n in names if n})
        spread = 0.5 * float(cov[0, 0] + cov[1, 1]) / limits.CONFIDENCE_SD_M**2
        wrong = (1.0 - limits.VIEW_EVIDENCE) ** len(np.unique(rays.camera[rows]))
        signs.append(
            Sign(
                id=f"s{number + 1:04d}",
                class_name=max(known, key=names.count) if known else "unknown",
                lat_rad=float(lat),
                lon_rad=float(lon),
                height_m=float("nan"),
                cov_enu=cov_enu,
                confidence=float((1.0 - wrong) / np.sqrt(1.0 + spread)),
                n_views=len(rows),
                first_seen_ns=NO_TIME,
                last_seen_ns=NO_TIME,
                height_above_road_m=float("nan"),
                facing_rad=float(np.arctan2(towards[1], towards[0]) % (2.0 * np.pi)),
                facing_sd_rad=limits.FACE_READ_SD,
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
    return "weak_geometry" if float(np.linalg.eigvalsh(cov)[-1]) > limits.WEAK_SD_M**2 else "ok"
