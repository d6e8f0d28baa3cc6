"""From grouped sightings to the signs of the map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import from_local_ned, tangent_rotation
from automap.geolocation import limits
from automap.geolocation.facing import Facing
from automap.geolocation.path_relation import Path, roads_at, side_of_path
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.sightings import Sighting, class_of
from automap.geolocation.views import Views
from automap.mapping.sureness import class_probabilities, group_probabilities
from automap.records import FloatArray, IntArray, Sign

C_ENU_NED: FloatArray = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def assemble_sign(
    views: Views,
    sightings: Sequence[Sighting],
    combined: tuple[FloatArray, FloatArray, FloatArray],
    path: Path,
    facing: Facing,
    number: int,
    rules: GeolocationRules,
    existence: float,
) -> Sign:
    """One sign from its sightings (at least one), seen from the views.

    ``combined`` its place [3] by them, the covariance [3, 3] of that and how far a sigma of its
    size moves it [3], in the local frame.
    The height above the road is the height above the path of the IMU at the point nearest in
    plan plus the given height of the IMU above the road; its sigma is that of the best pass, and
    of the IMU's height. ``facing`` as ``facing.find_facings`` found it; ``existence`` the
    probability that a sign stands there. Confidence is existence times the probability of the
    class; where the detector tells none, times the probability that at least one of the boxes is
    right, a box of score s being right with s / 2: 1 - prod(1 - s_i / 2).
    """
    position, cov_ned, moved = combined
    rows = np.sort(np.concatenate([s.landmark.rows for s in sightings]))
    lat, lon, height = (float(v) for v in from_local_ned(position, views.origin))
    to_ned_here = tangent_rotation(np.array([lat]), np.array([lon]), views.origin)[0].T
    C = C_ENU_NED @ to_ned_here
    cov_enu = C @ cov_ned @ C.T
    by_size = C @ moved

    best = min(sightings, key=lambda s: float(np.trace(s.covariance)))
    seen = views.t_ns[best.landmark.rows]
    lateral, above = roads_at(path, position, int(seen.min()), int(seen.max()))[0, 3:].tolist()
    above_road = above + rules.imu_above_road_m
    # the path's own error lifts both
    over_path = max(best.covariance[2, 2] - best.path_sd[2] ** 2, 0.0)
    # meridians converge between the local frame's origin and the sign
    looks = to_ned_here[:2, :2] @ [np.cos(facing.rad), np.sin(facing.rad)]
    size_weights = np.array([1.0 / s.landmark.covariance[3, 3] for s in sightings])
    log_sizes = np.array([s.landmark.parameters[3] for s in sightings])
    size = float(np.exp(np.sum(size_weights * log_sizes) / size_weights.sum()))

    status = _status(sightings, size, above_road, len(rows))
    class_name = class_of(sightings)
    of_class, of_group = class_beliefs(views, rows, class_name)
    wrong = 1.0 - limits.VIEW_EVIDENCE * np.clip(views.score[rows], 0.0, 1.0)
    believed = of_class if np.isfinite(of_class) else float(1.0 - np.prod(wrong))
    if status == "implausible":
        # several boxes that fit one place are of something, and its heights may all be off
        if len(rows) == 1:
            existence *= limits.IMPLAUSIBLE_CONFIDENCE
        else:
            believed *= limits.IMPLAUSIBLE_CONFIDENCE
    return Sign(
        id=f"s{number:04d}",
        class_name=class_name,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        cov_enu=0.5 * (cov_enu + cov_enu.T),
        confidence=existence * believed,
        existence=existence,
        class_probability=of_class,
        group_probability=of_group,
        n_views=len(rows),
        first_seen_ns=int(views.t_ns[rows].min()),
        last_seen_ns=int(views.t_ns[rows].max()),
        height_above_road_m=above_road,
        sd_above_road_m=float(np.hypot(np.sqrt(over_path), rules.imu_above_road_sd_m)),
        facing_rad=float(np.arctan2(looks[1], looks[0]) % (2.0 * np.pi)),
        facing_sd_rad=facing.sd_rad,
        size_m=size,
        side=side_of_path(lateral, above_road),
        path_offset_m=lateral,
        status=status,
        drives=(rules.drive,) if rules.drive else (),
        by_size_e_m=float(by_size[0]),
        by_size_n_m=float(by_size[1]),
        by_size_u_m=float(by_size[2]),
        detection_rows=np.sort(views.row[rows]),
    )


def _status(sightings: Sequence[Sighting], size: float, above_road: float, n_views: int) -> str:
    """What a user should know first: implausible, single_view, far, weak_geometry or ok."""
    low, high = limits.SIZE_LIMITS_M
    lowest, highest = limits.HEIGHT_LIMITS_M
    if not (low <= size <= high and lowest <= above_road <= highest):
        return "implausible"
    if n_views == 1:
        return "single_view"
    if min(s.landmark.depth_m for s in sightings) > limits.FAR_M:
        return "far"
    if min(s.landmark.depth_log_sd for s in sightings) > limits.WEAK_DEPTH_LOG_SD:
        return "weak_geometry"
    return "ok"


def class_beliefs(views: Views, rows: IntArray, class_name: str) -> tuple[float, float]:
    """The probabilities that a sign is of a class, and of its shape and colour: what the detector's
    tracks of its boxes tell, each once, as of the drives of a map (``mapping/sureness.py``). NaN
    where none tells them. Boxes of one class that no track has are as of one."""
    names, code = np.unique([class_name, *views.class_name[rows]], return_inverse=True)
    key = np.column_stack([views.camera[rows], views.track[rows], code[1:]])
    tracks, which = np.unique(key, axis=0, return_inverse=True)
    sign, boxes = np.zeros(len(tracks), np.int64), np.bincount(which.ravel())
    by_class, by_group = (
        np.bincount(which.ravel(), told[rows]) / boxes
        for told in (views.class_probability, views.group_probability)
    )
    of_class = class_probabilities(tracks[:, 2], by_class, sign, code[:1])
    of_group = group_probabilities(tracks[:, 2], names.tolist(), by_group, sign, code[:1])
    return float(of_class[0]), float(np.fmax(of_class, of_group)[0])
