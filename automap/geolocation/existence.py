"""Whether a few boxes are a sign: seen, and not seen when it should have been.

A sign is in view before and after the frames in which it was found. Every frame in which it
must have been at least as large as when it was found, and have shown itself from the same side,
and was not reported, speaks against it by what the detector misses as a rule; frames in a row
speak together, since one thing may hide it in all of them. Every further box that fits speaks for
it. Bayes' rule with those two gives the probability that the sign exists (existence in the sense
of Musicki and Evans, Joint Integrated Probabilistic Data Association, IEEE T-AES 40, 2004).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.effects.camera import camera_poses
from automap.effects.lens import focal_length, project
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark
from automap.geolocation.views import Views
from automap.interpolation import poses_at
from automap.records import Camera, Detections, FloatArray, IntArray, Trajectory

_BASE_RATE_ROUNDS = 20
"""Of the expectation maximisation."""


class FrameGrid:
    """Stamps of the frames that the detector looked at, also of those without a box.

    Frames are taken to follow one another at the usual step of the frame numbers that have
    boxes; the stamps between them are interpolated.
    """

    def __init__(self, found: Detections) -> None:
        frame, first = np.unique(found.frame, return_index=True)
        t_ns = np.asarray(found.t_ns, np.int64)[first]
        step = np.diff(frame)
        near = step[step <= 4 * step.min()] if len(step) else np.ones(1)
        self.step = max(int(np.median(near)), 1)
        self._frame = frame.astype(np.float64)
        self._base = t_ns[0] if len(t_ns) else np.int64(0)
        self._since = (t_ns - self._base) * 1.0
        seconds = np.diff(t_ns) / np.maximum(step, 1) if len(step) else np.array([1e9])
        self.interval_ns = float(np.median(seconds)) * self.step

    def stamped(self, frame: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], IntArray]:
        """Those of some frames' numbers that lie between frames with boxes, and their stamps."""
        if not len(self._frame):
            return frame[:0], frame[:0]
        inside = frame[(frame >= self._frame[0]) & (frame <= self._frame[-1])]
        since = np.interp(inside, self._frame, self._since)
        return inside, np.asarray(self._base + np.rint(since).astype(np.int64))

    def count_between(self, first_ns: int, last_ns: int) -> float:
        """Frames from one stamp to a later one."""
        return (last_ns - first_ns) / max(self.interval_ns, 1.0)

    def around(self, t_ns: int, count: int) -> IntArray:
        """Stamps of ``count`` frames before and after the one at ``t_ns``, without it."""
        if len(self._frame) < 2:
            return np.zeros(0, np.int64)
        here = float(np.interp(float(t_ns - self._base), self._since, self._frame))
        numbers = here + self.step * np.concatenate([np.arange(-count, 0), np.arange(1, count + 1)])
        return self.stamped(numbers)[1]


def apparent_heights(
    position: FloatArray,
    size_m: float,
    seen_from: FloatArray,
    t_ns: IntArray,
    trajectory: Trajectory,
    camera: Camera,
    origin: tuple[float, float, float],
    region: FloatArray | None = None,
) -> FloatArray:
    """Height in pixels [n] of a sign at the frame stamps; zero where it is not wholly in view, or
    in the ``region`` [n, 4] that was searched (None: the frame), or shows itself from another side
    than to the cameras at ``seen_from`` [m, 3]."""
    if region is None:
        region = np.array([[0.0, 0.0, camera.width - 1.0, camera.height - 1.0]])
    poses = poses_at(trajectory, t_ns + np.int64(round(camera.time_offset_s * 1e9)))
    centre, C_cam_ref = camera_poses(poses, camera, origin)
    q = np.einsum("nij,nj->ni", C_cam_ref, position - centre)
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = project(camera, q)
        height = focal_length(camera) * size_m / q[:, 0]
        margin = limits.WHOLLY_IN_VIEW * height
        inside = q[:, 0] > limits.MIN_FORWARD_M
        inside &= ((pixels - region[:, :2]) > margin[:, None]).all(axis=1)
        inside &= ((region[:, 2:] - pixels) > margin[:, None]).all(axis=1)
        inside &= _aspect(position, seen_from, centre)
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


def existence_probabilities(
    views: Views,
    landmarks: Sequence[Landmark],
    trajectory: Trajectory,
    detections: Sequence[Detections],
    cameras: Mapping[str, Camera],
) -> FloatArray:
    """Probability [m] that each landmark is a sign.

    ``cameras`` are as they were found to be. The detector's rate of finding a sign is taken from
    the landmarks with many views, the share of signs among things seen once from all of these.
    """
    grids = {found.camera: FrameGrid(found) for found in detections}
    found_rate = _found_rate(views, landmarks, grids)
    log_odds_of = np.full(len(landmarks), np.inf)
    for k, mark in enumerate(landmarks):
        score = float(np.clip(views.score[mark.rows].max(), *limits.SCORE_LIMITS))
        log_odds = np.log(score / (1.0 - score)) + limits.FITTING_BOX_NATS * (len(mark.rows) - 1)
        most_missed = 2 * limits.FRAMES_AROUND
        if log_odds + most_missed * np.log1p(-limits.RATE_LIMITS[1]) > limits.SURE_NATS:
            continue
        missed = _missed(views, mark, grids, trajectory, cameras, seen_t=views.t_ns[mark.rows])
        unseen = limits.HIDDEN + (1.0 - limits.HIDDEN) * (1.0 - found_rate) ** missed
        log_odds_of[k] = log_odds + float(np.log(unseen).sum())
    single = np.array([len(mark.rows) == 1 for mark in landmarks], np.bool_)
    log_odds_of[single] += _base_rate(log_odds_of[single])
    return probability(log_odds_of)


def probability(log_odds: FloatArray) -> FloatArray:
    """Probabilities [n] that have these log odds."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))


def _base_rate(log_odds: FloatArray) -> float:
    """Shift of the log odds [n] of things seen once, by how many such things are signs.

    Where most single boxes of a drive were clearly not confirmed, the others, seen at the edge
    of the picture or last before a gap, are hardly signs either: the share of signs among them
    is found from their own odds (expectation maximisation), held at one half by a few
    imaginary ones.
    """
    share = 0.5
    for _ in range(_BASE_RATE_ROUNDS):
        shift = np.log(share / (1.0 - share))
        likely = float(probability(log_odds + shift).sum())
        share = (0.5 * limits.IMAGINARY + likely) / (limits.IMAGINARY + len(log_odds))
    return float(np.log(share / (1.0 - share)))


def _found_rate(
    views: Views, landmarks: Sequence[Landmark], grids: Mapping[str, FrameGrid]
) -> float:
    """Share of the frames between a sign's first and last box in which it was found."""
    seen = possible = 0.0
    for mark in landmarks:
        if len(mark.rows) < limits.RATE_VIEWS:
            continue
        grid = grids[views.camera_names[int(views.camera[mark.anchor])]]
        span = grid.count_between(
            int(views.t_ns[mark.rows].min()), int(views.t_ns[mark.rows].max())
        )
        seen += len(np.unique(views.frame[mark.rows])) - 1
        possible += max(span, 1.0)
    rate = seen / possible if possible else 0.5
    return float(np.clip(rate, *limits.RATE_LIMITS))


def _missed(
    views: Views,
    mark: Landmark,
    grids: Mapping[str, FrameGrid],
    trajectory: Trajectory,
    cameras: Mapping[str, Camera],
    seen_t: IntArray,
) -> IntArray:
    """Stretches [k] of frames near those with a box in which the sign was as large, in view, and
    not found: the number of frames of each."""
    name = views.camera_names[int(views.camera[mark.anchor])]
    camera, grid = cameras[name], grids[name]
    stamps = seen_t - np.int64(round(camera.time_offset_s * 1e9))  # as the frames were stamped
    times = np.unique(
        np.concatenate([grid.around(int(t), limits.FRAMES_AROUND) for t in np.unique(stamps)])
    )
    half = 0.25 * grid.interval_ns
    # neighbours of two boxes name the same frame twice
    times = times[np.abs(times[:, None] - stamps[None]).min(axis=1) > half]
    if len(times) == 0:
        return np.zeros(0, np.int64)
    times = times[np.concatenate([[True], np.diff(times) > half])]
    height = apparent_heights(
        *(mark.position, mark.size_m, views.centre[mark.rows], times, trajectory),
        *(camera, views.origin),
    )
    least = focal_length(camera) * float(np.exp(views.measured[mark.rows, 2].min()))
    due = height >= limits.LIKE_SEEN * least
    # a box between two frames, or a frame that says nothing, begins another stretch
    breaks = (np.diff(times) > 1.5 * grid.interval_ns) | ~due[1:]
    stretch = np.concatenate([[0], np.cumsum(breaks)])
    return np.asarray(np.unique(stretch[due], return_counts=True)[1], np.int64)
