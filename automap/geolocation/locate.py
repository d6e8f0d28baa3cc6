"""The whole way from detections and a trajectory to located signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation import limits
from automap.geolocation.assembly import assemble_sign
from automap.geolocation.boresight import prior_covariance
from automap.geolocation.box_noise import measured_noise
from automap.geolocation.camera_doubt import (
    as_unknown,
    assumed,
    beyond_stated,
    doubtful,
    misfit,
    unexplained,
)
from automap.geolocation.camera_estimate import estimate_cameras, first_corrections, refit
from automap.geolocation.camera_hypotheses import Hypothesis, better_explanations
from automap.geolocation.carriers import carried_views
from automap.geolocation.class_sizes import sizes_of_others, usual_sizes
from automap.geolocation.contradiction import disagreement
from automap.geolocation.control import ControlSigns
from automap.geolocation.course_yaw import yaw_by_course
from automap.geolocation.existence import existence_probabilities
from automap.geolocation.facing import Faces, find_facings
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.merging import combine
from automap.geolocation.observations import (
    Observations,
    nothing_observed,
    record_sign,
    warnings_of,
)
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.passes import join_passes
from automap.geolocation.path_relation import make_path
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.sightings import make_sighting
from automap.geolocation.splitting import clean_tracks, join_pieces
from automap.geolocation.supports import support_numbers
from automap.geolocation.tracking import link_views
from automap.geolocation.trajectory_adjustment import AdjustedTrajectory
from automap.geolocation.views import CameraCorrection, MeasurementNoise, Views, build_views
from automap.records import Camera, Detections, IntArray, Sign, Trajectory


@dataclass(frozen=True)
class GeolocationResult:
    """Signs in the order of first sight, what became of every detection, what was found out
    about each camera, and sentences for the user; ``adjusted`` trajectory, as signs seen again and
    control signs put it right (None: not at all), ``n_control`` control signs that were used,
    ``noise`` of the boxes as it was taken, ``faces`` what was found of all faces."""

    signs: list[Sign]
    observations: Observations
    corrections: dict[str, CameraCorrection]
    warnings: list[str]
    adjusted: AdjustedTrajectory | None
    n_control: int
    noise: MeasurementNoise
    faces: Faces

    @property
    def trajectory(self) -> Trajectory | None:
        """The adjusted trajectory, made anew at each call."""
        return None if self.adjusted is None else self.adjusted.whole()


def locate_signs(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    control: ControlSigns | None = None,
) -> GeolocationResult:
    """Locate all signs of a drive.

    ``detections`` one record per camera, whose name must be in ``cameras``. Every detection
    is accounted for in the observations; what could not be used is counted in the warnings.
    ``progress`` is called with the fraction done. ``control`` surveyed signs to adjust the
    trajectory by. Where boxes contradict what is stated of a camera's turn and time offset,
    or do not fit the path, these are taken as unknown and other explanations are tried; a sentence
    says which one was taken, or that none fits: then the signs are ``doubtful``.
    """
    rules = rules or GeolocationRules()
    found = _located(
        *(trajectory, detections, cameras, rules, progress, control, cameras),
        rules.camera.focal_sd,
    )
    for name in _doubted(found, detections, cameras, rules):
        found = _explained(name, found, trajectory, detections, cameras, rules, control)
    return found


def _doubted(
    found: GeolocationResult,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules,
) -> list[str]:
    """The cameras whose boxes contradict what is stated of them, or do not fit the path."""
    focal_sd = rules.camera.focal_sd
    return [
        record.camera
        for record in detections
        if record.camera in found.corrections
        and (
            beyond_stated(found.corrections[record.camera], cameras[record.camera], focal_sd)
            or _unfit(found, detections, record.camera)
        )
    ]


def _rows_of(detections: Sequence[Detections], name: str) -> slice:
    first = 0
    for record in detections:
        if record.camera == name:
            return slice(first, first + len(record))
        first += len(record)
    return slice(0, 0)


def _unfit(found: GeolocationResult, detections: Sequence[Detections], name: str) -> bool:
    """Whether the boxes of one camera do not fit the path, or scatter as none do."""
    if min(found.noise.scales[:2]) >= limits.SCATTER_LIMITS[1]:
        return True
    rows = _rows_of(detections, name)
    seen = set(found.observations.sign_id[rows])
    signs = [sign for sign in found.signs if sign.id in seen]
    return bool(misfit(found.observations.used[rows], found.observations.note[rows], signs))


def _scatter(found: GeolocationResult) -> float:
    """How far directions of boxes are off their signs, over what the settings say."""
    return float(np.hypot(*found.noise.scales[:2]))


def _explained(
    name: str,
    found: GeolocationResult,
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules,
    control: ControlSigns | None,
) -> GeolocationResult:
    """The signs as the best explanation of what is wrong with a camera gives them; where none
    fits, those ``found`` with sigmas of a camera of which nothing is known."""
    rows = _rows_of(detections, name)
    record = next(d for d in detections if d.camera == name)
    loose = replace(rules, camera=replace(rules.camera, focal_sd=limits.DOUBTED_FOCAL))
    explanations = better_explanations(trajectory, record, cameras[name])[: limits.MOST_TRIED]
    best, what = found, ""
    for one in [Hypothesis("", record, as_unknown(cameras[name])), *explanations]:
        again = _located(
            trajectory,
            [one.found if d.camera == name else d for d in detections],
            {**cameras, name: one.camera},
            *(loose, lambda f: None, control, cameras, rules.camera.focal_sd),
        )
        more = float(again.observations.used[rows].mean() - best.observations.used[rows].mean())
        # what is open is fitted no worse; anything else must be worth its assumption
        closer = _scatter(again) < limits.CLOSER_BOXES * _scatter(best)
        if more > limits.MORE_BOXES or (more >= 0.0 and (closer or not one.what)):
            best, what = again, one.what
    if what:
        best.warnings.insert(0, assumed(name, what))
    share = float(best.observations.used[rows].mean())
    if _unfit(best, detections, name) or share < limits.FITS_SHARE:
        best.warnings.append(unexplained(name))
        seen = set(best.observations.sign_id[rows])
        nearest = [np.nanmin(best.observations.range_m[sign.detection_rows]) for sign in best.signs]
        signs = [
            doubtful(sign, float(m)) if sign.id in seen else sign
            for sign, m in zip(best.signs, nearest, strict=True)
        ]
        return replace(best, signs=signs)
    return best


def _located(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules,
    progress: Callable[[float], None],
    control: ControlSigns | None,
    stated: Mapping[str, Camera],
    focal_sd: float,
) -> GeolocationResult:
    """All signs with cameras that are known as well as ``cameras`` and ``rules`` say; sentences are
    about those ``stated``, whose focal lengths are known to the part ``focal_sd``."""
    corrections: dict[str, CameraCorrection] = {}
    if rules.estimate_camera:
        corrections = first_corrections(trajectory, detections, cameras, rules)
    progress(0.1)
    views = build_views(trajectory, detections, cameras, rules.noise, corrections)
    usual = usual_sizes(views.class_name.tolist())
    rules = replace(rules, size=replace(rules.size, by_class={**usual, **rules.size.by_class}))
    landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.1 + 0.4 * done))
    if rules.estimate_noise:
        noise = measured_noise(views, landmarks, rules.size, rules.noise)
        rules = replace(rules, noise=noise)
        views = build_views(trajectory, detections, cameras, noise, corrections)
        landmarks = [fit_landmark(views, mark.rows, rules.size) for mark in landmarks]
    if rules.estimate_camera and landmarks:
        corrections = estimate_cameras(
            trajectory, detections, cameras, corrections, landmarks, views, rules
        )
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.5 + 0.4 * done))
        corrections = estimate_cameras(
            trajectory, detections, cameras, corrections, landmarks, views, rules
        )
        rows = views.row
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks = refit(views, [rows[mark.rows] for mark in landmarks], rules)
        misfits = np.flatnonzero(np.isin(views.row, rows[misfits]))
        corrections = {
            name: replace(
                corrections[name],
                course_yaw=yaw_by_course(
                    *(views, landmarks, index, cameras[name], corrections[name]),
                    *(rules.size, rules.camera),
                ),
            )
            for index, name in enumerate(views.camera_names)
        }

    total = sum(len(d) for d in detections)
    found = {n: corrections[n].applied(c) if n in corrections else c for n, c in cameras.items()}
    observations = nothing_observed(total, views, trajectory, detections, found)
    observations.note[views.row[misfits]] = "misfit"

    exists = existence_probabilities(views, landmarks, trajectory, detections, found)
    carried = carried_views(views, rules.size)
    kept, stands = [], []
    for mark, likely in zip(landmarks, exists, strict=True):
        if not mark.ok:
            continue
        if likely < rules.min_existence:
            observations.note[views.row[mark.rows]] = "unconfirmed"
        elif carried[mark.rows].mean() > 0.5:
            observations.note[views.row[mark.rows]] = "moving"
        elif not _acceptable(mark, rules):
            observations.note[views.row[mark.rows]] = "too_far"
        else:
            kept.append(mark)
            stands.append(float(likely))
    covariances = [
        corrections[name].covariance
        if name in corrections
        else prior_covariance(cameras[name], rules.camera)
        for name in views.camera_names
    ]
    sightings = [
        make_sighting(views, mark, covariances, disagreement(views, mark, size))
        for mark, size in _settled(views, kept, rules)
    ]
    focal = np.array([focal_length(cameras[name]) for name in views.camera_names])
    passes = join_passes(views, sightings, trajectory, control, rules.adjust_trajectory)
    sightings, groups = passes.sightings, passes.groups
    for k in passes.backs:
        observations.note[views.row[sightings[k].landmark.rows]] = "back"
    adjusted = None
    if passes.adjustment is not None:
        adjusted = AdjustedTrajectory(trajectory, passes.adjustment, views.origin)
    path = make_path(trajectory, views.origin, passes.adjustment)
    joined = [[sightings[k] for k in group] for group in groups]
    facings, faces = find_facings(views, joined, path)
    signs: list[Sign] = []
    places, own = [], []
    for number, (group, members) in enumerate(zip(groups, joined, strict=True), start=1):
        combined = combine(members, adjusted is not None)
        facing = facings[number - 1]
        # each pass tells for itself that something is there
        exists_at_all = float(1.0 - np.prod([1.0 - stands[k] for k in group]))
        sign = assemble_sign(
            views, members, combined, path, facing, number, rules.assembly, exists_at_all
        )
        signs.append(sign)
        places.append(combined[0])
        own.append(min((m.own_cov for m in members), key=lambda c: float(np.trace(c))))
        for k, member in zip(group, members, strict=True):
            record_sign(observations, views, member.landmark, k, sign.id, focal)
    if signs:
        numbers = support_numbers(
            np.array(places), np.array(own), [s.side == "overhead" for s in signs]
        )
        signs = [
            replace(sign, support=f"p{number + 1:04d}")
            for sign, number in zip(signs, numbers, strict=True)
        ]
    sentences = warnings_of(observations, signs, corrections, stated, focal_sd)
    unused = 0 if control is None else len(control) - len(passes.controlled)
    if control is not None and unused:
        sentences.append(
            f"{unused} of {len(control)} control signs were not seen, or "
            "stand where the trajectory's own error does not allow them; they were not used."
        )
    return GeolocationResult(
        signs, observations, corrections, sentences, adjusted, len(passes.controlled), rules.noise,
        faces,
    )  # fmt: skip


def _find_landmarks(
    views: Views, rules: GeolocationRules, progress: Callable[[float], None]
) -> tuple[list[Landmark], IntArray]:
    tracks = link_views(views, rules.size, rules.tracking, progress=progress)
    landmarks, misfits = clean_tracks(views, tracks, rules.size, rules.tracking)
    return join_pieces(views, landmarks, rules.size, rules.tracking), misfits


def _settled(
    views: Views, landmarks: Sequence[Landmark], rules: GeolocationRules
) -> list[tuple[Landmark, SizePrior]]:
    """The landmarks with the errors of their passes and what other signs tell of their sizes."""
    alone = [solve_with_pass_errors(views, mark, rules.size) for mark in landmarks]
    return [
        (mark, size)
        if size == rules.size.of(views.class_name[mark.rows].tolist())
        else (
            solve_with_pass_errors(*(views, fit_landmark(views, mark.rows, size), size)),
            size,
        )
        for mark, size in zip(alone, sizes_of_others(views, alone, rules.size), strict=True)
    ]


def _acceptable(landmark: Landmark, rules: GeolocationRules) -> bool:
    if not landmark.ok:
        return False
    return len(landmark.rows) > 1 or landmark.depth_m <= rules.max_single_view_m
