"""Every camera's turn and time offset: a start before any link, then from all signs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation import limits
from automap.geolocation.boresight import prior_covariance, refine_correction
from automap.geolocation.landmark import Landmark, fit_landmark
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.time_minima import apart, likely_times
from automap.geolocation.views import CameraCorrection, Views, build_views, map_origin
from automap.records import Camera, Detections, IntArray, Trajectory

_BORESIGHT_ROUNDS, _SEARCH_ROUNDS = 4, 8
"""Steps at most, from where the camera is about known and from where it may not be."""


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
        if camera.mount_sd < limits.SURE_TURN_RAD and camera.time_offset_sd < limits.SURE_TIME_S:
            continue
        noise = np.hypot(rules.noise.pixel_sd / focal_length(camera), rules.noise.attitude_sd)
        start = first_correction(trajectory, found, camera, origin, float(noise))
        if start is not None:
            corrections[found.camera] = CameraCorrection(
                turn=start[:3],
                time_s=float(start[3]),
                covariance=prior_covariance(camera, rules),
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
    """Turn and time offset of every camera, from landmarks found with the start values.

    Where the tracks of signs fit another time offset best than the one that is nearest, it is
    taken for a start; where several explain the boxes alike the offset keeps its prior, and they
    are named in ``time_minima``.
    """
    boxes = [views.row[mark.rows] for mark in landmarks]
    # the signs' own: of a long drive all are large
    shown, members = _alone(detections, boxes)

    def descend(
        known: Mapping[str, Camera], start: Mapping[str, CameraCorrection], rounds: int
    ) -> dict[str, CameraCorrection]:
        """Gauss-Newton steps until they are small, with the priors of the cameras ``known``."""
        corrections = dict(start)
        for _ in range(rounds):
            before = corrections
            seen = build_views(trajectory, shown, cameras, rules.noise, before)
            marks = refit(seen, members, rules)
            corrections = {
                name: refine_correction(seen, marks, index, known[name], before.get(name), rules)
                for index, name in enumerate(seen.camera_names)
            }
            if all(n in before and _settled(before[n], corrections[n]) for n in known):
                break
        return corrections

    used = {name: cameras[name] for name in views.camera_names}
    found, open_ = descend(used, start, _BORESIGHT_ROUNDS), {}
    tracks = np.full(sum(map(len, shown)), -1, np.int64)
    for number, rows in enumerate(members):
        tracks[rows] = number
    ends = np.cumsum([len(record) for record in shown])[:-1]
    for record, track in zip(shown, np.split(tracks, ends), strict=True):
        name, camera = record.camera, cameras[record.camera]
        tracked, sd = replace(record, track=track), np.sqrt(found[name].covariance[3, 3])
        times = likely_times(trajectory, tracked, camera, found[name], rules)
        if len(times) > 1:
            open_[name] = tuple(sorted(times))
            used[name] = replace(camera, time_offset_sd=limits.HELD_TIME_S)
            times = (0.0,)
        if name in open_ or apart(times[0], found[name].time_s, float(sd)):
            starting = {**found, name: replace(found[name], time_s=times[0])}
            found = descend(used, starting, _SEARCH_ROUNDS)
    return found | {n: _time_as_given(found[n], cameras[n], t, rules) for n, t in open_.items()}


def _alone(
    detections: Sequence[Detections], boxes: Sequence[IntArray]
) -> tuple[list[Detections], list[IntArray]]:
    """The detections without all but some boxes, and the numbers that these have there."""
    rows = np.unique(np.concatenate([np.zeros(0, np.int64), *boxes]))
    ends = np.cumsum([0, *(len(found) for found in detections)])
    parts = np.split(rows, np.searchsorted(rows, ends[1:-1]))
    shown = [found.at(part - a) for found, part, a in zip(detections, parts, ends, strict=False)]
    return shown, [np.searchsorted(rows, each) for each in boxes]


def _time_as_given(
    correction: CameraCorrection, camera: Camera, times: tuple[float, ...], rules: GeolocationRules
) -> CameraCorrection:
    """The same with the time offset as uncertain as before any sign was seen."""
    before = prior_covariance(camera, rules)
    covariance = correction.covariance.copy()
    covariance[3], covariance[:, 3] = before[3], before[:, 3]
    return replace(correction, time_s=0.0, covariance=covariance, time_minima=times)


def _settled(before: CameraCorrection, after: CameraCorrection) -> bool:
    """Whether a step was small against what remains uncertain."""
    step = after.values - before.values
    return bool((np.abs(step) < limits.SETTLED_SIGMAS * np.sqrt(np.diag(after.covariance))).all())


def refit(views: Views, boxes: Sequence[IntArray], rules: GeolocationRules) -> list[Landmark]:
    """The same landmarks, each of the detections ``boxes``, with new views."""
    place = {int(row): k for k, row in enumerate(views.row)}
    members = [np.array([place[int(r)] for r in b if int(r) in place], np.int64) for b in boxes]
    return [fit_landmark(views, np.sort(m), rules.size) for m in members if len(m)]
