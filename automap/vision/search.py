"""Run a detector over the pictures of a video."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from automap.io.drive import VideoInput
from automap.io.video import FrameTimes, VideoFrame, frame_times, iter_frames, video_chapters
from automap.records import Detections, IntArray
from automap.vision.classical import ClassicalDetector
from automap.vision.detector import Detector, FoundSigns
from automap.vision.parallel import detections, worker_count

# stamps jitter: a frame this much of a period early still counts as the next one
_EARLY = 0.3


def choose_frames(times: FrameTimes, per_second: float) -> IntArray:
    """Numbers [k] of the frames to search: evenly in time, at most ``per_second``."""
    period = 1e9 / per_second
    chosen: list[int] = []
    due = -np.inf
    for frame, t in zip(times.frame.tolist(), times.t_ns.tolist(), strict=True):
        if t >= due - _EARLY * period:
            chosen.append(frame)
            # a late frame shifts the grid, an early one does not
            due = max(due + period, t) if t < due else t + period
    return np.array(chosen, dtype=np.int64)


def search_video(
    video: VideoInput,
    per_second: float,
    min_score: float,
    warn: Callable[[str], None],
    progress: Callable[[float, str], None],
    detector: Detector | None = None,
) -> Detections:
    """Search a camera's video; ``warn`` receives a sentence for every trouble with the files."""
    chapters, troubles = video_chapters(video)
    if not chapters:
        for text in troubles:
            warn(text)
        return collect([], min_score, video.name)
    chosen = choose_frames(frame_times(video, chapters), per_second)
    return search_frames(
        iter_frames(video, chosen, warn),
        detector or ClassicalDetector(),
        min_score,
        video.name,
        len(chosen),
        progress,
        worker_count(len(chosen)),
    )


def search_frames(
    frames: Iterable[VideoFrame],
    detector: Detector,
    min_score: float,
    camera: str,
    count: int,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
    workers: int = 1,
) -> Detections:
    """Signs with at least ``min_score`` in the frames, in their order; ``count`` is for progress.

    With ``workers`` above 1 so many processes search, and the result is the same. Memory grows with
    the boxes found, not with the frames.
    """
    rows: list[tuple[int, int, FoundSigns]] = []
    for done, (picture, found) in enumerate(detections(frames, detector, workers), 1):
        if len(found):
            rows.append((picture.frame, picture.t_ns, found))
        if done % 5 == 0:
            progress(min(done / max(count, 1), 1.0), f"{done} of {count} frames")
    return collect(rows, min_score, camera)


def collect(rows: list[tuple[int, int, FoundSigns]], min_score: float, camera: str) -> Detections:
    """One record of what was found in frames given as (number, t_ns, signs)."""
    frame = [number for number, _, found in rows for _ in range(len(found))]
    t_ns = [t for _, t, found in rows for _ in range(len(found))]
    names = [name for _, _, found in rows for name in found.class_name]
    box = np.concatenate([found.box for _, _, found in rows] or [np.zeros((0, 4))])
    score = np.concatenate([found.score for _, _, found in rows] or [np.zeros(0)])
    keep = score >= min_score
    return Detections(
        frame=np.array(frame, dtype=np.int64)[keep],
        t_ns=np.array(t_ns, dtype=np.int64)[keep],
        class_name=np.array(names, dtype=object)[keep],
        box=box[keep],
        score=score[keep],
        track=np.full(int(keep.sum()), -1, dtype=np.int64),
        camera=camera,
    )
