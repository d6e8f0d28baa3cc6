"""Every camera's turn and time offset: a start before any link, then from all signs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from automap.geolocation.boresight import prior_covariance, refine_correction
from automap.geolocation.camera_model import focal_length
from automap.geolocation.landmark import Landmark, fit_landmark
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import CameraCorrection, Views, build_views, map_origin
from automap.records import Camera, Detections, IntArray, Trajectory

_BORESIGHT_ROUNDS = 4
_SURE_TURN_RAD = 0.002
_SURE_TIME_S = 0.005


def first_corrections(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules,
) -> dict[str, CameraCorrection]:
    """A start for every camera whose manifest leaves its turn or stamps uncertain."""
    from automap.geolocation.epipolar import first_correction

    corrections: dict[str, CameraCorrection] = {}
    origin = map_origin(trajectory)
    for found in detections:
        camera = cameras[found.camera]
        if camera.mount_sd < _SURE_TURN_RAD and camera.time_offset_sd < _SURE_TIME_S:
            continue
        noise = np.hypot(rules.noise.pixel_sd / focal_length(camera), rules.noise.attitude_sd)
        start = first_correction(trajectory, found, camera, origin, float(noise))
        if start is not None:
            corrections[found.camera] = CameraCorrection(
                turn=start[:3],
                time_s=float(start[3]),
                covariance=prior_covariance(camera, rules.camera),
            )
    return corrections


def estimate_cameras(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    start: Mapping[str, CameraCorrection],
    landmarks: list[Landmark],
    views: Views,
    rules: GeolocationRules,
) -> dict[str, CameraCorrection]:
    """Turn and time offset of every camera, from landmarks found with the start values."""
    corrections = dict(start)
    boxes = [views.row[mark.rows] for mark in landmarks]
    for _ in range(_BORESIGHT_ROUNDS):
        before = corrections
        corrections = {
            name: refine_correction(
                *(views, landmarks, index, cameras[name], corrections.get(name)),
                *(rules.size, rules.camera),
            )
            for index, name in enumerate(views.camera_names)
        }
        if all(
            name in before and _settled(before[name], corrections[name]) for name in corrections
        ):
            break
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks = refit(views, boxes, rules)
    return corrections


def _settled(before: CameraCorrection, after: CameraCorrection) -> bool:
    """Whether a step was small against what remains uncertain."""
    step = after.values - before.values
    return bool((np.abs(step) < 0.02 * np.sqrt(np.diag(after.covariance))).all())


def refit(views: Views, boxes: Sequence[IntArray], rules: GeolocationRules) -> list[Landmark]:
    """The same landmarks, each of the detections ``boxes``, with new views."""
    place = {int(row): k for k, row in enumerate(views.row)}
    members = [np.array([place[int(r)] for r in b if int(r) in place], np.int64) for b in boxes]
    return [fit_landmark(views, np.sort(m), rules.size) for m in members if len(m)]
