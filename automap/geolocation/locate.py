"""The whole way from detections and a trajectory to located signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from automap.geolocation.assembly import AssemblyRules, assemble_sign
from automap.geolocation.boresight import prior_covariance, refine_correction
from automap.geolocation.camera_model import focal_length
from automap.geolocation.landmark import Landmark, SizePrior, direction_residuals, fit_landmark
from automap.geolocation.merging import group_sightings
from automap.geolocation.path_relation import make_path
from automap.geolocation.sightings import make_sighting
from automap.geolocation.splitting import clean_tracks, join_pieces
from automap.geolocation.tracking import TrackingRules, link_views
from automap.geolocation.views import CameraCorrection, MeasurementNoise, Views, build_views
from automap.records import Camera, Detections, FloatArray, IntArray, Sign, Trajectory

_BORESIGHT_ROUNDS = 4


@dataclass(frozen=True)
class GeolocationRules:
    """All that can be set; ``max_single_view_m`` is the greatest distance, judged by the
    box's size alone, at which a sign seen once is still put on the map."""

    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    size: SizePrior = field(default_factory=SizePrior)
    tracking: TrackingRules = field(default_factory=TrackingRules)
    assembly: AssemblyRules = field(default_factory=AssemblyRules)
    estimate_camera: bool = True
    max_single_view_m: float = 60.0


@dataclass(frozen=True)
class Observations:
    """What became of every detection, in the order of the detections given.

    ``track`` [n] number of the pass in which its sign was tracked (-1 none), ``sign_id`` [n]
    ("" none), ``residual_px`` [n, 2] right and down (NaN without a sign), ``range_m`` [n]
    distance to the sign, ``used`` [n], ``note`` [n] why not ("no_pose", "no_direction",
    "misfit", "no_place", "too_far"; "" when used).
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
    views = build_views(trajectory, detections, cameras, rules.noise)
    corrections: dict[str, CameraCorrection] = {}
    landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.45 * done))
    if rules.estimate_camera and landmarks:
        corrections = _estimate_cameras(trajectory, detections, cameras, views, landmarks, rules)
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.5 + 0.5 * done))

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

    kept = [mark for mark in landmarks if _acceptable(mark, rules)]
    for mark in landmarks:
        if mark.ok and not _acceptable(mark, rules):
            fate.note[views.row[mark.rows]] = "too_far"
    covariances = [
        corrections[name].covariance if name in corrections else prior_covariance(cameras[name])
        for name in views.camera_names
    ]
    sightings = [make_sighting(views, mark, covariances) for mark in kept]
    path = make_path(trajectory, views.origin)
    focal = np.array([focal_length(cameras[name]) for name in views.camera_names])
    signs = []
    for number, group in enumerate(group_sightings(views, sightings), start=1):
        members = [sightings[k] for k in group]
        sign = assemble_sign(views, members, path, number, rules.assembly)
        signs.append(sign)
        for k, member in zip(group, members, strict=True):
            _record(fate, views, member.landmark, k, sign.id, focal)
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


def _estimate_cameras(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    views: Views,
    landmarks: list[Landmark],
    rules: GeolocationRules,
) -> dict[str, CameraCorrection]:
    """Turn and time offset of every camera, from the landmarks found without them."""
    corrections: dict[str, CameraCorrection] = {}
    boxes = [views.row[mark.rows] for mark in landmarks]
    for _ in range(_BORESIGHT_ROUNDS):
        corrections = {
            name: refine_correction(
                views, landmarks, index, cameras[name], corrections.get(name), rules.size
            )
            for index, name in enumerate(views.camera_names)
        }
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        place = {int(row): k for k, row in enumerate(views.row)}
        members = [np.array([place[int(r)] for r in b if int(r) in place], np.int64) for b in boxes]
        landmarks = [fit_landmark(views, np.sort(m), rules.size) for m in members if len(m)]
    return corrections


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
        sd = np.sqrt(np.diag(prior_covariance(cameras[name])))
        values = np.array([*correction.turn, correction.time_s])
        if (np.abs(values) > 3.0 * sd).any():
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
