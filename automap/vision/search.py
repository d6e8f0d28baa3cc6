"""Run a detector over the frames of a video: choose frames, search them, follow the signs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from automap.records import (
    Camera,
    Crop,
    Detections,
    FloatArray,
    FrameTimes,
    IntArray,
    Looked,
    VideoFrame,
    usual_matrix,
)
from automap.signs.class_shares import shares_text
from automap.vision import limits
from automap.vision.camera_motion import ImageMotion, Motion, motion_on_path
from automap.vision.camera_path import CameraPath
from automap.vision.candidates import Mark, Repeated, Repeats, candidates, driven_m
from automap.vision.crops import BestCrops
from automap.vision.detector import CalibratedDetector, Detector, FoundSigns
from automap.vision.face_contrast import face_contrast
from automap.vision.frame_choice import ChoiceRules, every_frame, plan_frames
from automap.vision.parallel import Beside, detections, prefetched, worker_count
from automap.vision.searched_region import find_in, searched_region, some
from automap.vision.tracking import Tracker, TrackingRules
from automap.vision.voting import (
    PoolingRules,
    Verdict,
    View,
    mean_shares,
    rules_of,
    view_of,
    vote,
)

Progress = Callable[[float, str], None]

_REPORT_S = 0.1
"""From one report of progress to the next."""


@dataclass(frozen=True)
class SearchRules:
    """``min_score`` below which boxes are left out; ``every`` whether every frame is searched;
    ``choice`` of the frames otherwise; ``height_share`` of the picture, from its top, that is
    searched: what is lower is road and bonnet; ``windows`` whether, between two frames that are
    searched in any case, only the surroundings of their signs are, which a detector must not
    mind; ``tracking`` of the signs; ``workers`` threads, None as many as there are processors."""

    min_score: float = 0.3
    every: bool = False
    choice: ChoiceRules = field(default_factory=ChoiceRules)
    height_share: float = 1.0
    windows: bool = False
    tracking: TrackingRules = field(default_factory=TrackingRules)
    workers: int | None = None

    @property
    def hint(self) -> float:
        """The score from which a box is a reason to search the frames beside it."""
        return limits.HINT * self.min_score


@dataclass(frozen=True)
class SearchResult:
    """What a camera's video shows.

    ``detections`` with tracks, each row with the class of its track; ``crops`` the best view of
    each track; ``frames`` in the video and ``searched`` of them; ``repeated`` stretches in which
    the picture stays while the vehicle drives, whose frames were not searched.
    """

    detections: Detections
    crops: tuple[Crop, ...] = ()
    frames: int = 0
    searched: int = 0
    repeated: tuple[Repeated, ...] = ()


@dataclass
class _Rows:
    """The boxes of all frames so far."""

    frame: list[int] = field(default_factory=list)
    t_ns: list[int] = field(default_factory=list)
    box: list[npt.NDArray[np.float64]] = field(default_factory=list)
    score: list[float] = field(default_factory=list)
    view_class: list[str] = field(default_factory=list)
    track: list[int] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    contrast: list[tuple[float, str]] = field(default_factory=list)

    def add(self, picture: VideoFrame, found: FoundSigns, track: IntArray) -> None:
        for i in range(len(found)):
            self.frame.append(picture.frame)
            self.t_ns.append(picture.t_ns)
            self.box.append(np.asarray(found.box[i], np.float64))
            self.score.append(float(found.score[i]))
            self.view_class.append(found.class_name[i])
            self.track.append(int(track[i]))
            self.views.append(view_of(found, i))
            self.contrast.append(face_contrast(picture.image, self.box[-1]))

    def tracks(self) -> dict[int, list[View]]:
        """The views of each track."""
        views: dict[int, list[View]] = {}
        for track, view in zip(self.track, self.views, strict=True):
            views.setdefault(track, []).append(view)
        return views

    def verdicts(self, rules: PoolingRules) -> dict[int, Verdict]:
        """What each track is."""
        return {track: vote(seen, rules) for track, seen in self.tracks().items()}

    def detections(self, verdicts: dict[int, Verdict], camera: str, calibrated: bool) -> Detections:
        told = [verdicts[track] for track in self.track]
        shares = {track: shares_text(mean_shares(seen)) for track, seen in self.tracks().items()}
        return Detections(
            frame=np.array(self.frame, np.int64),
            t_ns=np.array(self.t_ns, np.int64),
            class_name=np.array([verdict.name for verdict in told], object),
            box=np.array(self.box, np.float64).reshape(-1, 4),
            score=np.array(self.score, np.float64),
            track=np.array(self.track, np.int64),
            camera=camera,
            view_class=np.array(self.view_class, object),
            class_probability=np.array([v.probability for v in told]) if calibrated else None,
            group_probability=np.array([v.group_probability for v in told]) if calibrated else None,
            class_shares=np.array([shares[t] for t in self.track], object) if calibrated else None,
            contrast=np.array([value for value, _ in self.contrast], np.float64),
            contrast_note=np.array([note for _, note in self.contrast], object),
        )


def nothing_found(name: str) -> SearchResult:
    """The result for the camera ``name`` where no frame can be searched."""
    return SearchResult(_Rows().detections({}, name, calibrated=False))


def search_frames(
    name: str,
    times: FrameTimes,
    pictures: Callable[[IntArray], Iterable[VideoFrame]],
    detector: Detector,
    rules: SearchRules,
    camera: Camera,
    path: CameraPath | None = None,
    progress: Progress = lambda fraction, text: None,
) -> SearchResult:
    """Search the frames of the camera ``name``.

    ``pictures`` decodes the frames of these numbers [k], in order, as far as they can be.
    ``path`` is the camera's at the frames' stamps [n], None where no trajectory is known: then
    frames are chosen by time and by change, and tracks follow the pictures. Memory does not grow
    with the length of the video, but for its list of frames and the boxes found.
    """
    rows, best = _Rows(), BestCrops(name, float(camera.matrix[0, 0]))
    if rules.every:
        plan = every_frame(times, limits.WHOLE_S if rules.windows else 0.0)
    else:
        plan = plan_frames(times, path, rules.choice)
    tracker = Tracker(camera, rules.tracking)
    motions = _Motions(camera, path)
    repeats = Repeats(driven_m(times, path))
    report = _Report(progress, len(plan))
    region: dict[int, FloatArray] = {}

    def search(mark: Mark, picture: VideoFrame, beside: Beside) -> FoundSigns:
        region[picture.frame] = searched_region(
            picture.image, rules.height_share, beside if rules.windows else None, rules.hint
        )
        return find_in(detector, picture.image, region[picture.frame])

    frames: list[int] = []
    found_in = detections(
        prefetched(candidates(pictures(plan.frame), times, plan, repeats)),
        search,
        lambda found: bool((found.score >= rules.hint).any()),
        rules.workers or worker_count(),
    )
    for candidate, found in found_in:
        picture, mark = candidate.frame, candidate.mark
        found = above(found, rules.min_score)
        motion, seconds = motions.step(picture, mark.row, len(tracker) > 0)
        track = tracker.step(motion, seconds, found)
        rows.add(picture, found, track)
        for i in range(len(found)):
            best.offer(
                picture.image, picture.frame, picture.t_ns, int(track[i]),
                found.class_name[i], found.box[i], float(found.score[i]),
            )  # fmt: skip
        frames.append(picture.frame)
        report(mark.number, len(frames))
    verdicts = rows.verdicts(rules_of(detector))
    calibrated = isinstance(detector, CalibratedDetector)
    looked = Looked(
        np.array(frames, np.int64), np.array([region[k] for k in frames]).reshape(-1, 4)
    )
    return SearchResult(
        replace(rows.detections(verdicts, name, calibrated), looked=looked),
        tuple(best.crops({track: verdict.name for track, verdict in verdicts.items()})),
        len(times),
        len(frames),
        tuple(repeats.told),
    )


def default_camera(width: int, height: int) -> Camera:
    """A pinhole of 60 degrees along the longer side, for a video of which nothing is known."""
    matrix = usual_matrix(width, height)
    zero = np.zeros(3)
    return Camera(width, height, matrix, np.zeros(5), zero, zero, 0.1, 0.0, 0.1)


def above(found: FoundSigns, min_score: float) -> FoundSigns:
    """The signs with at least this score."""
    return some(found, np.flatnonzero(found.score >= min_score))


class _Motions:
    """Motion from one searched frame to the next, by the path as far as it is known."""

    def __init__(self, camera: Camera, path: CameraPath | None) -> None:
        self._path = path
        self._image = ImageMotion(camera)
        self._before: tuple[int, int] | None = None

    def step(self, picture: VideoFrame, row: int, wanted: bool) -> tuple[Motion, float]:
        """Motion and seconds since the step before; ``wanted`` if it has to be looked for."""
        before, self._before = self._before, (row, picture.t_ns)
        seconds = 0.0 if before is None else max((picture.t_ns - before[1]) * 1e-9, 0.0)
        motion = None
        if self._path is not None and before is not None:
            motion = motion_on_path(self._path, before[0], row, seconds)
        if motion is not None:
            self._image.forget()
            return motion, seconds
        return self._image.step(picture.image, seconds, wanted), seconds


class _Report:
    """Progress by the share of the planned frames that is done."""

    def __init__(self, progress: Progress, count: int) -> None:
        self._progress, self._count = progress, max(count, 1)
        self._last = -np.inf

    def __call__(self, number: int, searched: int) -> None:
        now = time.monotonic()
        if now - self._last >= _REPORT_S:
            self._last = now
            self._progress(min((number + 1) / self._count, 1.0), f"{searched} frames searched")
