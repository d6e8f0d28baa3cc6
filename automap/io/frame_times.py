"""When each frame of a video was taken.

A frame's time is its own presentation time stamp in the container, never its number over a
rate. Frames count from 0 over all chapters in the order in which they are shown.
"""

from __future__ import annotations

from itertools import accumulate, pairwise

import numpy as np

from automap.io.csv_columns import read_columns
from automap.io.video import Chapter, VideoInput, video_chapters
from automap.records import FrameTimes, IntArray


def frame_times(video: VideoInput, chapters: list[Chapter] | None = None) -> FrameTimes:
    """Stamps of all frames of a camera.

    From the frames file where there is one, otherwise ``start_ns`` plus the container's
    presentation times; a later chapter starts where the one before it ends.
    """
    warnings: list[str] = []
    if chapters is None and (video.chapters and video.frames is None):
        chapters, warnings = video_chapters(video)
    if video.frames is not None:
        return _listed_times(video, chapters)
    if not chapters:
        return FrameTimes(np.zeros(0, np.int64), np.zeros(0, np.int64), tuple(warnings))
    if video.section.start_ns is None:
        warnings.append(
            f"{chapters[0].path}: neither start_ns nor a frames file says when it begins; "
            f"0 is taken, add start_ns to [video.{video.name}]"
        )
    t_ns = np.concatenate([chapter.pts_ns for chapter in chapters])
    t_ns = t_ns + np.repeat(_chapter_starts(chapters), [len(c.pts_ns) for c in chapters])
    t_ns = t_ns + (video.section.start_ns or 0)
    numbers = [
        first + np.arange(len(chapter.pts_ns), dtype=np.int64)
        for first, chapter in zip(first_frames(chapters), chapters, strict=True)
    ]
    return FrameTimes(np.concatenate(numbers), t_ns, tuple(warnings))


def first_frames(chapters: list[Chapter]) -> list[int]:
    """The number of each chapter's first frame."""
    return list(accumulate((chapter.count for chapter in chapters), initial=0))[:-1]


def _chapter_starts(chapters: list[Chapter]) -> IntArray:
    starts = [0]
    for before, chapter in pairwise(chapters):
        # some cameras restart at zero in each chapter, others let the time run on
        runs_on = int(chapter.pts_ns[0]) >= before.end_ns - 1_000_000
        starts.append(starts[-1] if runs_on else starts[-1] + before.end_ns)
    return np.array(starts, dtype=np.int64)


def _listed_times(video: VideoInput, chapters: list[Chapter] | None) -> FrameTimes:
    assert video.frames is not None
    table = read_columns(video.frames, {"frame": "int", "t_ns": "int"})
    warnings = table.warnings()
    frame, first = np.unique(table.columns["frame"], return_index=True)
    t_ns = np.asarray(table.columns["t_ns"][first], dtype=np.int64)
    if len(frame) < len(table):
        warnings.append(
            f"{video.frames}: {len(table) - len(frame)} rows repeat the number of a frame and "
            "were left out"
        )
    if np.any(np.diff(t_ns) <= 0):
        at = int(np.flatnonzero(np.diff(t_ns) <= 0)[0]) + 1
        warnings.append(
            f"{video.frames}: line {table.line(int(first[at]))}: the stamp of frame {frame[at]} "
            "is not later than that of the frame before"
        )
    n_video = sum(chapter.count for chapter in chapters) if chapters else 0
    if chapters and len(frame) != n_video:
        warnings.append(
            f"{video.frames} lists {len(frame)} frames, the video has {n_video}; frames without "
            "a stamp are left out"
        )
    return FrameTimes(frame.astype(np.int64), t_ns, tuple(warnings))
