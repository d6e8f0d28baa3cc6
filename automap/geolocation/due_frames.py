"""Frames that should show a sign, and which of them do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.effects.camera import camera_poses
from automap.effects.lens import focal_length, project
from automap.effects.limits import MOVING_SPEED
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark
from automap.geolocation.views import Views
from automap.interpolation import poses_at
from automap.records import BoolArray, Camera, Detections, FloatArray, IntArray, Trajectory


@dataclass(frozen=True)
class Searched:
    """Frames [k] of a ``camera`` that a detector looked at, ascending: their numbers, stamps as the
    path has them, and the part of each that it saw [k, 4]; whether that is ``known``."""

    camera: Camera
    frame: IntArray
    t_ns: IntArray
    region: FloatArray
    known: bool = True


def searched_frames(found: Detections, camera: Camera) -> Searched:
    """Those between the first and the last with a box; where they are not known, all that follow
    one another at the usual step of those with boxes.

    The stamps of frames without a box are interpolated.
    """
    known, first = np.unique(found.frame, return_index=True)
    looked = found.looked
    if not len(known):
        none = np.zeros(0, np.int64)
        return Searched(camera, none, none, np.zeros((0, 4)))
    if looked is None:
        frame = np.arange(known[0], known[-1] + 1, _usual_step(known))
        region = np.tile([0.0, 0.0, camera.width - 1.0, camera.height - 1.0], (len(frame), 1))
    else:
        inside = (looked.frame >= known[0]) & (looked.frame <= known[-1])
        frame, region = looked.frame[inside], looked.region[inside]
    t_ns = np.asarray(found.t_ns, np.int64)[first]
    since = np.interp(frame, known, (t_ns - t_ns[0]) * 1.0)
    late = np.int64(round(camera.time_offset_s * 1e9))
    stamps = t_ns[0] + np.rint(since).astype(np.int64) + late
    return Searched(camera, frame, stamps, region, looked is not None)


def _usual_step(frame: IntArray) -> int:
    """From a frame to the next that is looked at, by the numbers of those with boxes."""
    step = np.diff(frame)
    return max(int(np.median(step[step <= 4 * step.min()])), 1) if len(step) else 1


def usual_heights(views: Views, marks: Sequence[Landmark]) -> FloatArray:
    """Height [c], over the focal length, at which three of four signs of each camera are found:
    what hides a sign from afar, seldom more than a quarter of them, does not move it.

    Signs grow as they are driven towards; a reflex or a lorry's sign, found in pieces as large as
    any, says nothing of this, unless nothing grows.
    """
    first: list[list[float]] = [[] for _ in views.camera_names]
    grown: list[list[float]] = [[] for _ in views.camera_names]
    for mark in marks:
        row = mark.rows[np.argmin(views.t_ns[mark.rows])]
        camera, height = int(views.camera[row]), views.measured[row, 2]
        first[camera].append(float(np.exp(height)))
        if views.measured[mark.rows, 2].max() - height > math.log(limits.GROWN):
            grown[camera].append(first[camera][-1])
    told = [some or every for some, every in zip(grown, first, strict=True)]
    return np.array([np.quantile(sizes, 0.75) if sizes else np.inf for sizes in told])


def due_frames(
    views: Views, mark: Landmark, trajectory: Trajectory, searched: Searched, usual: float
) -> IntArray:
    """Places among the frames that were searched of those that should have shown a sign in its
    pass: it is wholly within the part that was searched, seen from the side it was seen from, and
    at least as large as signs usually are when they are found."""
    first, last = int(views.t_ns[mark.rows].min()), int(views.t_ns[mark.rows].max())
    around = round(limits.AFTER_S * 1e9)
    near = slice(*np.searchsorted(searched.t_ns, [first - around, last + around]).tolist())
    if near.start == near.stop:
        return np.zeros(0, np.int64)
    height = apparent_heights(views, mark, trajectory, searched, near)
    least = usual * focal_length(searched.camera)
    return np.asarray(near.start + np.flatnonzero(height >= least))


def apparent_heights(
    views: Views, mark: Landmark, trajectory: Trajectory, searched: Searched, near: slice
) -> FloatArray:
    """Height in pixels [n] of a sign in the frames ``near``; zero where it is not wholly in the
    part of the picture that was searched, or shows itself from another side than to its views."""
    camera, region = searched.camera, searched.region[near]
    poses = poses_at(trajectory, searched.t_ns[near])
    centre, C_cam_ref = camera_poses(poses, camera, views.origin)
    q = np.einsum("nij,nj->ni", C_cam_ref, mark.position - centre)
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = project(camera, q)
        height = focal_length(camera) * mark.size_m / q[:, 0]
        margin = limits.WHOLLY_IN_VIEW * height
        inside = q[:, 0] > limits.MIN_FORWARD_M
        inside &= ((pixels - region[:, :2]) > margin[:, None]).all(axis=1)
        inside &= ((region[:, 2:] - pixels) > margin[:, None]).all(axis=1)
        inside &= _aspect(mark.position, views.centre[mark.rows], centre)
    return np.where(inside, np.nan_to_num(height), 0.0)


def _aspect(
    position: FloatArray, seen_from: FloatArray, centre: FloatArray
) -> npt.NDArray[np.bool_]:
    """Whether cameras [n, 3] look at a face from directions like those it was seen from."""
    towards = [c[:, :2] - position[:2] for c in (seen_from, centre)]
    seen, now = (t / np.maximum(np.linalg.norm(t, axis=1), 1e-6)[:, None] for t in towards)
    mean = seen.mean(axis=0) / max(float(np.linalg.norm(seen.mean(axis=0))), 1e-6)
    widest = np.arccos(np.clip(seen @ mean, -1.0, 1.0)).max()
    return np.asarray(np.arccos(np.clip(now @ mean, -1.0, 1.0)) < widest + limits.LIKE_ASPECT_RAD)


@dataclass(frozen=True)
class Pattern:
    """Frames [k] that show a sign or should, in the order of time: seconds in motion and which were
    ``seen``; those that were ``due`` whether or not; the ``score`` [h] of those that were seen.
    ``known`` whether those without a box are frames that a detector is known to have searched."""

    t_s: FloatArray
    seen: BoolArray
    due: BoolArray
    score: FloatArray
    known: bool = True


def of_looks(pattern: Pattern) -> Pattern:
    """The frames from one place as one look, which shows what most of them show: a car that waits
    sees the same again, sign or not. What no look shows, clutter now and then, stays as it is."""
    look = np.cumsum(np.diff(pattern.t_s, prepend=-1.0) > 0.0) - 1
    number = np.bincount(look)
    seen = 2.0 * np.bincount(look, pattern.seen) >= number
    if not seen.any():
        return pattern
    of_boxes = look[pattern.seen]
    score = np.bincount(of_boxes, pattern.score, len(number))[seen]
    return Pattern(
        pattern.t_s[np.unique(look, return_index=True)[1]],
        seen,
        np.bincount(look, pattern.due) > 0.0,
        score / np.bincount(of_boxes, minlength=len(number))[seen],
        pattern.known,
    )


def in_motion_s(trajectory: Trajectory) -> FloatArray:
    """Seconds [n] that the vehicle has moved until each row: while it stands nothing comes between
    it and a sign that was not there."""
    moves = np.linalg.norm(trajectory.vel_ned, axis=1) > MOVING_SPEED
    step = np.diff(trajectory.t_ns) * 1e-9
    return np.concatenate([[0.0], np.cumsum(step * moves[1:])])


def pattern_of(
    views: Views,
    mark: Landmark,
    frame: IntArray,
    trajectory: Trajectory,
    looked: Searched,
    usual: float,
    moved_s: FloatArray,
) -> Pattern:
    """Of a landmark, by the ``frame`` numbers [n] of all views, the ``usual`` height in its camera
    and seconds in motion at the trajectory's rows."""
    due = due_frames(views, mark, trajectory, looked, usual)
    shown, first = np.unique(frame[mark.rows], return_index=True)
    rest = due[~np.isin(looked.frame[due], shown)]
    t_ns = np.concatenate([views.t_ns[mark.rows][first], looked.t_ns[rest]])
    order = np.argsort(t_ns, kind="stable")
    since = (t_ns[order] - trajectory.t_ns[0]) * 1.0
    t_s = np.interp(since, (trajectory.t_ns - trajectory.t_ns[0]) * 1.0, moved_s)
    seen = np.arange(len(order)) < len(shown)
    should = np.concatenate([np.isin(shown, looked.frame[due]), np.ones(len(rest), np.bool_)])
    score = views.score[mark.rows][first]
    return of_looks(Pattern(t_s, seen[order], should[order], score, looked.known))


def patterns_of(
    views: Views,
    landmarks: Sequence[Landmark],
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
) -> list[Pattern]:
    """Of each landmark; ``cameras`` are as they were found to be. From which height on a detector
    finds signs is taken from the landmarks with many views."""
    searched = [searched_frames(d, cameras[d.camera]) for d in detections]
    frame = np.concatenate([d.frame for d in detections] or [np.zeros(0, np.int64)])[views.row]
    often = [mark for mark in landmarks if len(mark.rows) >= limits.RATE_VIEWS]
    usual, moved = usual_heights(views, often or landmarks), in_motion_s(trajectory)
    of = views.camera[[mark.anchor for mark in landmarks]].tolist()
    return [
        pattern_of(views, mark, frame, trajectory, searched[k], usual[k], moved)
        for mark, k in zip(landmarks, of, strict=True)
    ]
