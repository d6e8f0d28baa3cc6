"""The whole way from detections and a trajectory to located signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from automap.geolocation.assembly import AssemblyRules, assemble_sign
from automap.geolocation.boresight import CameraPriors, prior_covariance, refine_correction
from automap.geolocation.box_noise import measured_noise
from automap.geolocation.camera_model import focal_length
from automap.geolocation.existence import existence_probabilities
from automap.geolocation.landmark import Landmark, SizePrior, direction_residuals, fit_landmark
from automap.geolocation.merging import combine, group_sightings
from automap.geolocation.pass_errors import settle
from automap.geolocation.path_relation import make_path
from automap.geolocation.sightings import make_sighting
from automap.geolocation.splitting import clean_tracks, join_pieces
from automap.geolocation.supports import support_numbers
from automap.geolocation.tracking import TrackingRules, link_views
from automap.geolocation.views import (
    CameraCorrection,
    MeasurementNoise,
    Views,
    build_views,
    map_origin,
)
from automap.records import Camera, Detections, FloatArray, IntArray, Sign, Trajectory

_BORESIGHT_ROUNDS = 4
_SURE_TURN_RAD = 0.002
_SURE_TIME_S = 0.005


@dataclass(frozen=True)
class GeolocationRules:
    """All that can be set; ``max_single_view_m`` is the greatest distance, judged by the
    box's size alone, at which a sign seen once is still put on the map; ``min_existence`` the
    least probability of existence (seen, and missed when it should have been seen) of a sign
    on the map."""

    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    size: SizePrior = field(default_factory=SizePrior)
    tracking: TrackingRules = field(default_factory=TrackingRules)
    assembly: AssemblyRules = field(default_factory=AssemblyRules)
    camera: CameraPriors = field(default_factory=CameraPriors)
    estimate_camera: bool = True
    estimate_noise: bool = True
    max_single_view_m: float = 60.0
    min_existence: float = 0.5


@dataclass(frozen=True)
class Observations:
    """What became of every detection, in the order of the detections given.

    ``track`` [n] number of the pass in which its sign was tracked (-1 none), ``sign_id`` [n]
    ("" none), ``residual_px`` [n, 2] right and down (NaN without a sign), ``range_m`` [n]
    distance to the sign, ``used`` [n], ``note`` [n] why not ("no_pose", "no_direction",
    "misfit", "no_place", "too_far", "unconfirmed"; "" when used).
    """

    track: IntArray
    sign_id: npt.NDArray[np.object_]
    residual_px: FloatArray
    range_m: FloatArray
    used: npt.NDArray[np.bool_]
    note: npt.NDArray[np.object_]


@dataclass(frozen=True)
class GeolocationResult:
    """Signs in the order of first sight, the fate of every detection, what was found out
    about each camera, and sentences for the user."""

    signs: list[Sign]
    observations: Observations
    corrections: dict[str, CameraCorrection]
    warnings: list[str]


def locate_signs(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> GeolocationResult:
    """Locate all signs of a drive.

    ``detections`` one record per camera, whose name must be in ``cameras``. Every detection
    is accounted for in the observations; what could not be used is counted in the warnings.
    ``progress`` is called with the fraction done.
    """
    rules = rules or GeolocationRules()
    corrections: dict[str, CameraCorrection] = {}
    if rules.estimate_camera:
        corrections = _first_corrections(trajectory, detections, cameras, rules)
    progress(0.1)
    views = build_views(trajectory, detections, cameras, rules.noise, corrections)
    landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.1 + 0.4 * done))
    if rules.estimate_noise:
        noise = measured_noise(views, landmarks, rules.size, rules.noise)
        rules = replace(rules, noise=noise)
        views = build_views(trajectory, detections, cameras, noise, corrections)
        landmarks = [fit_landmark(views, mark.rows, rules.size) for mark in landmarks]
    if rules.estimate_camera and landmarks:
        corrections = _estimate_cameras(
            trajectory, detections, cameras, corrections, landmarks, views, rules
        )
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.5 + 0.4 * done))
        corrections = _estimate_cameras(
            trajectory, detections, cameras, corrections, landmarks, views, rules
        )
        rows = views.row
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks = _refit(views, [rows[mark.rows] for mark in landmarks], rules)
        misfits = np.flatnonzero(np.isin(views.row, rows[misfits]))

    total = sum(len(d) for d in detections)
    fate = Observations(
        track=np.full(total, -1, np.int64),
        sign_id=np.full(total, "", np.object_),
        residual_px=np.full((total, 2), np.nan),
        range_m=np.full(total, np.nan),
        used=np.zeros(total, np.bool_),
        note=np.full(total, "no_place", np.object_),
    )
    fate.note[_rows_without_view(views, total)] = "no_direction"
    fate.note[_rows_without_pose(trajectory, detections, cameras, corrections)] = "no_pose"
    fate.note[views.row[misfits]] = "misfit"

    exists = existence_probabilities(views, landmarks, trajectory, detections, cameras, corrections)
    kept, probability = [], []
    for mark, likely in zip(landmarks, exists, strict=True):
        if not mark.ok:
            continue
        if likely < rules.min_existence:
            fate.note[views.row[mark.rows]] = "unconfirmed"
        elif not _acceptable(mark, rules):
            fate.note[views.row[mark.rows]] = "too_far"
        else:
            kept.append(mark)
            probability.append(float(likely))
    covariances = [
        corrections[name].covariance
        if name in corrections
        else prior_covariance(cameras[name], rules.camera)
        for name in views.camera_names
    ]
    kept = [settle(views, mark, rules.size) for mark in kept]
    sightings = [make_sighting(views, mark, covariances) for mark in kept]
    path = make_path(trajectory, views.origin)
    focal = np.array([focal_length(cameras[name]) for name in views.camera_names])
    signs: list[Sign] = []
    places, own = [], []
    for number, group in enumerate(group_sightings(views, sightings), start=1):
        members = [sightings[k] for k in group]
        sign = assemble_sign(views, members, path, number, rules.assembly)
        signs.append(sign)
        places.append(combine(members)[0])
        own.append(min((m.own_cov for m in members), key=lambda c: float(np.trace(c))))
        for k, member in zip(group, members, strict=True):
            _record(fate, views, member.landmark, k, sign.id, focal)
    if signs:
        numbers = support_numbers(
            np.array(places), np.array(own), [s.side == "overhead" for s in signs]
        )
        signs = [
            replace(sign, support=f"p{number + 1:04d}")
            for sign, number in zip(signs, numbers, strict=True)
        ]
    return GeolocationResult(signs, fate, corrections, _warnings(fate, corrections, cameras))


def _find_landmarks(
    views: Views, rules: GeolocationRules, progress: Callable[[float], None]
) -> tuple[list[Landmark], IntArray]:
    tracks = link_views(views, rules.size, rules.tracking, progress=progress)
    landmarks, misfits = clean_tracks(views, tracks, rules.size, rules.tracking)
    return join_pieces(views, landmarks, rules.size, rules.tracking), misfits


def _acceptable(landmark: Landmark, rules: GeolocationRules) -> bool:
    if not landmark.ok:
        return False
    return len(landmark.rows) > 1 or landmark.depth_m <= rules.max_single_view_m


def _first_corrections(
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


def _estimate_cameras(
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
        landmarks = _refit(views, boxes, rules)
    return corrections


def _settled(before: CameraCorrection, after: CameraCorrection) -> bool:
    """Whether a step was small against what remains uncertain."""
    step = after.values - before.values
    return bool((np.abs(step) < 0.02 * np.sqrt(np.diag(after.covariance))).all())


def _refit(views: Views, boxes: Sequence[IntArray], rules: GeolocationRules) -> list[Landmark]:
    """The same landmarks, each of the detections ``boxes``, with new views."""
    place = {int(row): k for k, row in enumerate(views.row)}
    members = [np.array([place[int(r)] for r in b if int(r) in place], np.int64) for b in boxes]
    return [fit_landmark(views, np.sort(m), rules.size) for m in members if len(m)]


def _rows_without_view(views: Views, total: int) -> IntArray:
    return np.setdiff1d(np.arange(total), views.row)


def _rows_without_pose(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    corrections: Mapping[str, CameraCorrection],
) -> IntArray:
    from automap.interpolation import poses_at

    missing, first = [], 0
    for found in detections:
        correction = corrections.get(found.camera)
        offset = cameras[found.camera].time_offset_s + (correction.time_s if correction else 0.0)
        poses = poses_at(trajectory, found.t_ns + np.int64(round(offset * 1e9)))
        missing.append(first + np.flatnonzero(~(poses.covered & np.isfinite(poses.rpy[:, 2]))))
        first += len(found)
    return np.concatenate(missing) if missing else np.zeros(0, np.int64)


def _record(
    fate: Observations, views: Views, mark: Landmark, track: int, sign_id: str, focal: FloatArray
) -> None:
    rows = views.row[mark.rows]
    fate.track[rows] = track
    fate.sign_id[rows] = sign_id
    residual = direction_residuals(views, mark)
    fate.residual_px[rows] = residual * focal[views.camera[mark.rows], None]
    fate.range_m[rows] = np.linalg.norm(views.centre[mark.rows] - mark.position, axis=1)
    fate.used[rows] = True
    fate.note[rows] = ""


def _warnings(
    fate: Observations,
    corrections: Mapping[str, CameraCorrection],
    cameras: Mapping[str, Camera],
) -> list[str]:
    reasons = {
        "no_pose": "lie outside the trajectory or in a long gap of it",
        "no_direction": "have no direction (no height, or outside the lens model)",
        "misfit": "fit no sign's other views",
        "no_place": "belong to no place in front of the camera",
        "unconfirmed": "show things that were not seen again when they should have been",
        "too_far": "were seen once only and too far away to be placed",
    }
    sentences = []
    for note, text in reasons.items():
        n = int(np.count_nonzero(fate.note == note))
        if n:
            advice = ""
            if note == "no_pose" and n == len(fate.note):
                advice = " Check the clock of the frames: time and start_ns in [video], t_ns."
            sentences.append(
                f"{n} of {len(fate.note)} detections {text}; they were left out.{advice}"
            )
    for name, correction in corrections.items():
        camera = cameras[name]
        sd = np.array([camera.mount_sd] * 3 + [camera.time_offset_sd])
        if (np.abs(correction.values[:4]) > 3.0 * np.maximum(sd, 1e-9)).any():
            turn = ", ".join(f"{v:.2f}" for v in np.degrees(correction.turn))
            sentences.append(
                f"camera {name} seems turned by ({turn}) deg in roll, pitch, yaw and its frames "
                f"{correction.time_s:+.3f} s off, more than the manifest's sigmas allow; check "
                "mount_rpy_deg and time_offset_s."
            )
    return sentences


def with_drive(rules: GeolocationRules, name: str) -> GeolocationRules:
    """The same rules with the drive's name for the signs."""
    return replace(rules, assembly=replace(rules.assembly, drive=name))
