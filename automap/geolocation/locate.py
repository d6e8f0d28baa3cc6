"""The whole way from detections and a trajectory to located signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation.assembly import assemble_sign
from automap.geolocation.boresight import camera_covariances
from automap.geolocation.box_noise import measured_noise
from automap.geolocation.camera_estimate import estimate_cameras, first_corrections, refit
from automap.geolocation.camera_explanation import Trial, explain_doubted
from automap.geolocation.carriers import carried_views
from automap.geolocation.class_sizes import sizes_of_others, usual_sizes
from automap.geolocation.condition import with_conditions
from automap.geolocation.due_frames import patterns_of
from automap.geolocation.existence import existence_odds, existence_of
from automap.geolocation.face_sizes import face_odds
from automap.geolocation.facing import find_facings, narrowest
from automap.geolocation.landmark import Landmark, SizePrior, fit_landmark
from automap.geolocation.left_out import no_signs, without
from automap.geolocation.pass_errors import solve_with_pass_errors
from automap.geolocation.passes import join_passes
from automap.geolocation.path_relation import make_path
from automap.geolocation.result import (
    GeolocationResult,
    nothing_observed,
    record_sign,
    warnings_of,
)
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.sightings import make_sighting
from automap.geolocation.splitting import clean_tracks
from automap.geolocation.stamp_scatter import stamp_scatter, told, tracked_or_linked
from automap.geolocation.tracking import link_views
from automap.geolocation.trajectory_adjustment import AdjustedTrajectory
from automap.geolocation.views import CameraCorrection, Views, build_views
from automap.mapping.backs import with_backs
from automap.mapping.posts import with_supports
from automap.records import Camera, Detections, IntArray, Sign, SignPoints, Trajectory
from automap.signs.backs import NO_BACK


def locate_signs(
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
    rules: GeolocationRules | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
    control: SignPoints | None = None,
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

    def locate(trial: Trial, progress: Callable[[float], None]) -> GeolocationResult:
        return _located(trajectory, trial, progress, control, stated)

    notes = [no_signs(trajectory, found, cameras[found.camera], rules) for found in detections]
    stated = Trial(detections, cameras, rules, notes)
    return explain_doubted(trajectory, stated, locate(stated, progress), locate)


def _located(
    trajectory: Trajectory,
    trial: Trial,
    progress: Callable[[float], None],
    control: SignPoints | None,
    stated: Trial,
) -> GeolocationResult:
    """All signs with what is assumed for a ``trial``; sentences are about what is ``stated``."""
    cameras, rules = trial.cameras, trial.rules
    detections = [without(*pair) for pair in zip(trial.detections, trial.notes, strict=True)]
    corrections: dict[str, CameraCorrection] = {}
    if rules.estimate_camera:
        corrections = first_corrections(trajectory, detections, cameras, rules)
    progress(0.1)
    views = build_views(trajectory, detections, cameras, rules.noise, corrections)
    usual = usual_sizes(views.class_name.tolist())
    rules = replace(rules, size=replace(rules.size, by_class={**usual, **rules.size.by_class}))
    landmarks, misfits = _find_landmarks(views, rules, lambda done: progress(0.1 + 0.4 * done))

    def views_with(stamp_sd: float) -> Views:
        noise = replace(rules.noise, stamp_sd_s=stamp_sd)
        return build_views(trajectory, detections, cameras, noise, corrections)

    def with_noise(stamp_sd: float, marks: Sequence[Landmark]) -> GeolocationRules:
        noise = replace(rules.noise, stamp_sd_s=stamp_sd)
        measured = measured_noise(views_with(stamp_sd), marks, rules.size, noise)
        return replace(rules, noise=measured)

    if rules.estimate_noise:
        stamp_sd = stamp_scatter(views, tracked_or_linked(views, landmarks), rules.size)
        if stamp_sd > 0.0:
            landmarks, misfits = _find_landmarks(views_with(stamp_sd), rules, lambda done: None)
        rules = with_noise(stamp_sd, landmarks)
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
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
        if rules.noise.stamp_sd_s > 0.0:
            # a camera that was off may have looked like stamps that are
            seen = views_with(rules.noise.stamp_sd_s)
            marks = refit(seen, [views.row[mark.rows] for mark in landmarks], rules)
            stamp_sd = stamp_scatter(views_with(0.0), tracked_or_linked(seen, marks), rules.size)
            rules = with_noise(stamp_sd, marks)
        rows = views.row
        views = build_views(trajectory, detections, cameras, rules.noise, corrections)
        landmarks = refit(views, [rows[mark.rows] for mark in landmarks], rules)
        misfits = np.flatnonzero(np.isin(views.row, rows[misfits]))

    found = {n: corrections[n].applied(c) if n in corrections else c for n, c in cameras.items()}
    notes = np.concatenate([np.zeros(0, np.object_), *trial.notes])
    observations = nothing_observed(notes, views)
    observations.note[views.row[misfits]] = "misfit"

    carried = carried_views(views, rules.size)
    for mark in landmarks:
        if carried[mark.rows].mean() > 0.5:
            observations.note[views.row[mark.rows]] = "moving"
    # how often signs are found, and boxes seen once are of signs, is told by what stands
    landmarks = [mark for mark in landmarks if carried[mark.rows].mean() <= 0.5]
    patterns = patterns_of(views, landmarks, trajectory, detections, found)
    by_chance, alike = existence_odds(patterns, [pattern.score for pattern in patterns])
    # a sign against whatever else stands there
    real = 1.0 / (1.0 / alike + 1.0 / face_odds(views, landmarks, rules.size))
    kept: list[int] = []
    odds = np.column_stack([by_chance, real]).tolist()
    for k, (mark, pattern) in enumerate(zip(landmarks, patterns, strict=True)):
        if not mark.ok:
            continue
        if existence_of([odds[k]]) < rules.min_existence:
            observations.note[views.row[mark.rows]] = "unconfirmed"
        elif len(pattern.score) == 1 and mark.depth_m > rules.max_single_view_m:
            observations.note[views.row[mark.rows]] = "too_far"
        else:
            kept.append(k)
    covariances = camera_covariances(views, cameras, corrections, rules)
    sightings = [
        make_sighting(views, mark, covariances, size)
        for mark, size in _settled(views, [landmarks[k] for k in kept], rules)
    ]
    focal = np.array([focal_length(cameras[name]) for name in views.camera_names])
    passes = join_passes(views, sightings, trajectory, control, rules.adjust_trajectory)
    sightings = passes.sightings
    rows_of = [
        np.concatenate([views.row[sightings[k].landmark.rows] for k in group])
        for group in passes.groups
    ]
    for rows, front in zip(rows_of, passes.fronts.tolist(), strict=True):
        if front != NO_BACK:
            observations.note[rows] = "back"
    count = np.array([len(rows) for rows in rows_of], np.int64)
    behind = with_backs(np.zeros_like(count), count, passes.fronts)
    adjusted = None
    if passes.adjustment is not None:
        adjusted = AdjustedTrajectory(trajectory, passes.adjustment, views.origin)
    path = make_path(trajectory, views.origin, passes.adjustment)
    numbers = np.flatnonzero(passes.fronts == NO_BACK).tolist()
    groups = [passes.groups[number] for number in numbers]
    joined = [[sightings[k] for k in group] for group in groups]
    facings, faces = find_facings(views, joined, path, narrowest(views))
    signs: list[Sign] = []
    for number, group, members, facing in zip(numbers, groups, joined, facings, strict=True):
        existence = existence_of([odds[kept[k]] for k in group])
        sign = assemble_sign(
            *(views, members, passes.placed.of(number), path, facing, len(signs) + 1),
            *(rules, existence),
        )
        signs.append(replace(sign, n_back_views=int(behind[number])))
        for k, member in zip(group, members, strict=True):
            record_sign(observations, views, member.landmark, k, sign.id, focal)
    shown = [[(sightings[k], patterns[kept[k]]) for k in group] for group in groups]
    signs = with_conditions(signs, views, shown, detections)
    own = [min(float(np.trace(m.own_cov[:2, :2])) for m in one) for one in joined]
    signs = list(with_supports(signs, 0.5 * np.array(own)))
    sentences = warnings_of(
        *(observations, notes == "", signs, corrections),
        *(stated.cameras, stated.rules.focal_sd),
    )
    sentences += told(rules.noise.stamp_sd_s, [d.t_ns for d in detections])
    unused = 0 if control is None else len(control) - len(passes.controlled)
    if control is not None and unused:
        sentences.append(
            f"{unused} of {len(control)} control signs were not seen, may as well be a neighbour, "
            "or stand where the trajectory's own error does not allow them; they were not used."
        )
    return GeolocationResult(
        signs, observations, corrections, sentences, adjusted, len(passes.controlled), rules.noise,
        faces,
    )  # fmt: skip


def _find_landmarks(
    views: Views, rules: GeolocationRules, progress: Callable[[float], None]
) -> tuple[list[Landmark], IntArray]:
    tracks = link_views(views, rules.size, rules.max_silence_s, progress=progress)
    return clean_tracks(views, tracks, rules.size, rules.max_silence_s)


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
