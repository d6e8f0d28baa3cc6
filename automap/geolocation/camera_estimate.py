"""Every camera's turn and time offset: a start before any link, then from all signs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation import limits, time_minima
from automap.geolocation.boresight import prior_covariance, refine_correction
from automap.geolocation.landmark import Landmark, fit_landmark
from automap.geolocation.rules import GeolocationRules
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

    A time offset is looked for from several starts, by some of the signs; where several explain
    the boxes alike it keeps its prior, and the others are named in ``time_minima``.
    """
    boxes = [views.row[mark.rows] for mark in landmarks]

    def fitted(
        corrections: Mapping[str, CameraCorrection], boxes: Sequence[IntArray]
    ) -> tuple[Views, list[Landmark]]:
        """The signs of some boxes, and their views: of a long drive all are large."""
        shown, members = _alone(detections, boxes)
        seen = build_views(trajectory, shown, cameras, rules.noise, corrections)
        return seen, refit(seen, members, rules)

    def descend(
        known: Mapping[str, Camera],
        start: Mapping[str, CameraCorrection],
        rounds: int,
        boxes: Sequence[IntArray] = boxes,
    ) -> _End:
        """Gauss-Newton steps until they are small, with the priors of the cameras ``known``."""
        corrections = dict(start)
        for _ in range(rounds):
            before = corrections
            seen, marks = fitted(before, boxes)
            corrections = {
                name: refine_correction(seen, marks, index, known[name], before.get(name), rules)
                for index, name in enumerate(seen.camera_names)
            }
            if all(n in before and _settled(before[n], corrections[n]) for n in known):
                return _End(corrections, boxes, True)
        return _End(corrections, boxes, False)

    def least(ends: Sequence[_End], name: str) -> tuple[_End, tuple[float, ...]]:
        """Where a camera explains the boxes best, and the time offsets that do so as well."""
        minima = []
        for one in ends:
            found = one.corrections[name]
            at = *fitted(one.corrections, one.boxes), cameras[name], found
            minima.append((found, time_minima.cost_of(*at, rules)))
        best, times = time_minima.alike(minima)
        return ends[best], times

    used = {name: cameras[name] for name in views.camera_names}
    end = descend(used, start, _BORESIGHT_ROUNDS)
    telling = sorted((rows for rows in boxes if len(rows) >= limits.CAMERA_VIEWS), key=np.min)
    few = len(telling) <= limits.MOST_SIGNS_TRIED
    evenly = np.linspace(0, len(telling) - 1, limits.MOST_SIGNS_TRIED).astype(np.int64)
    some = boxes if few else [telling[k] for k in evenly]
    for name, camera in used.items() if telling else ():
        first = end if few else descend(used, end.corrections, _SEARCH_ROUNDS, some)
        ends = [first]
        for side in time_minima.starts(camera.time_offset_sd):
            for time_s in side:
                starting = _at_time(first.corrections, name, time_s)
                other = descend(used, starting, _SEARCH_ROUNDS, some)
                if not other.settled:
                    continue
                if not time_minima.apart(other.corrections[name], first.corrections[name]):
                    # nearer starts end there too
                    break
                ends.append(other)
        if len(ends) == 1:
            continue
        best, times = least(ends, name)
        if not few:
            # what some signs tell is held against all of them
            found = times or (best.corrections[name].time_s,)
            others = [_at_time(end.corrections, name, time_s) for time_s in found]
            ends = [end, *(descend(used, other, _SEARCH_ROUNDS) for other in others)]
            best, times = least(ends, name)
        end = best
        if times:
            held = {**used, name: replace(camera, time_offset_sd=limits.HELD_TIME_S)}
            end = descend(held, _at_time(end.corrections, name, 0.0), _SEARCH_ROUNDS)
            end.corrections[name] = _time_as_given(end.corrections[name], camera, times, rules)
    return end.corrections


@dataclass(frozen=True)
class _End:
    """Where a descent by the ``boxes`` of some signs ended, and whether it settled."""

    corrections: dict[str, CameraCorrection]
    boxes: Sequence[IntArray]
    settled: bool


def _alone(
    detections: Sequence[Detections], boxes: Sequence[IntArray]
) -> tuple[list[Detections], list[IntArray]]:
    """The detections without all but some boxes, and the numbers that these have there."""
    rows = np.unique(np.concatenate([np.zeros(0, np.int64), *boxes]))
    ends = np.cumsum([0, *(len(found) for found in detections)])
    parts = np.split(rows, np.searchsorted(rows, ends[1:-1]))
    shown = [found.at(part - a) for found, part, a in zip(detections, parts, ends, strict=False)]
    return shown, [np.searchsorted(rows, each) for each in boxes]


def _at_time(
    corrections: Mapping[str, CameraCorrection], name: str, time_s: float
) -> dict[str, CameraCorrection]:
    """The same with another time offset of one camera."""
    return {**corrections, name: replace(corrections[name], time_s=float(time_s))}


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
