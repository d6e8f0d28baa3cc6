"""Run a detector over a camera's video files."""

from __future__ import annotations

from collections.abc import Callable

from automap.io.frame_times import frame_times
from automap.io.video import VideoInput, video_chapters
from automap.io.video_decode import decode_frames
from automap.records import Camera, IntArray
from automap.vision.camera_path import CameraPath
from automap.vision.detector import Detector
from automap.vision.search import (
    Progress,
    SearchResult,
    SearchRules,
    default_camera,
    nothing_found,
    search_frames,
)


def search_video(
    video: VideoInput,
    detector: Detector,
    rules: SearchRules,
    camera: Camera | None = None,
    path_of: Callable[[IntArray], CameraPath | None] = lambda t_ns: None,
    warn: Callable[[str], None] = lambda text: None,
    progress: Progress = lambda fraction, text: None,
) -> SearchResult:
    """Search a camera's video.

    ``path_of`` gives the camera's path at the frames' stamps [n], None where no trajectory is
    known. ``warn`` receives a sentence for every trouble with the files.
    """
    chapters, troubles = video_chapters(video)
    times = frame_times(video, chapters)
    for text in (*troubles, *times.warnings):
        warn(text)
    if not chapters or not len(times):
        return nothing_found(video.name)
    result = search_frames(
        video.name,
        times,
        lambda numbers: decode_frames(chapters, times, numbers, warn),
        detector,
        rules,
        camera or default_camera(chapters[0].width, chapters[0].height),
        path_of(times.t_ns),
        progress,
    )
    for one in result.repeated:
        first, last = ((t_ns - int(times.t_ns[0])) * 1e-9 for t_ns in (one.first_ns, one.last_ns))
        warn(
            f"The camera {video.name} shows the same picture from {first:.1f} to {last:.1f} s of "
            f"its video while the vehicle drives {one.metres:.0f} m: it hung, or saw nothing. "
            "Signs there are not found, and count as not looked for."
        )
    return result
