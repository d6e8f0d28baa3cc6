"""How a camera's video turns against its path, as far as pictures and a path are there."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from automap.errors import InputError
from automap.io.video import VideoInput
from automap.records import Camera, IntArray, PictureTurns

if TYPE_CHECKING:
    from automap.vision.camera_path import CameraPath


def video_turns(
    video: VideoInput, camera: Camera | None, path_of: Callable[[IntArray], CameraPath | None]
) -> PictureTurns:
    """What the bends of a video say of its stamps and its picture; nothing where it cannot be
    read, which the search for signs tells of."""
    from automap.io.frame_times import frame_times
    from automap.io.video import video_chapters
    from automap.io.video_decode import decode_frames
    from automap.vision.picture_turns import picture_turns

    if camera is None or not video.chapters:
        return PictureTurns(0)
    try:
        chapters, _ = video_chapters(video)
        times = frame_times(video, chapters)
        return picture_turns(
            camera,
            path_of,
            times.t_ns,
            times.frame,
            lambda numbers: decode_frames(chapters, times, numbers),
        )
    except InputError:
        return PictureTurns(0)


def at_corrected(
    path_of: Callable[[IntArray], CameraPath | None], turns: PictureTurns
) -> Callable[[IntArray], CameraPath | None]:
    """The camera's path at stamps as the bends say they are."""
    return path_of if turns.as_stated else lambda t_ns: path_of(turns.corrected(t_ns))
