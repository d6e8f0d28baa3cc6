"""Single pictures of a drive's video, decoded when the page asks for them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from automap.records import IntArray

if TYPE_CHECKING:
    from automap.io.video import Chapter, VideoInput
    from automap.records import FrameTimes, VideoFrame

WIDTH_LIMIT = 1280
"""Pictures are sent at most this wide."""
_KEPT_BYTES = 48_000_000
_STEP_LIMIT = 40
"""Frames that are sooner decoded on the way than by a jump to a key frame."""
_QUALITY = 82


class FrameReader:
    """The frames of one camera as JPEG, for several threads.

    Going forward continues where the last request ended, so that playing decodes every frame
    once; the last pictures are kept.
    """

    def __init__(self, video: VideoInput) -> None:
        self._video = video
        self._lock = threading.Lock()
        self._structure: tuple[list[Chapter], FrameTimes] | None = None
        self._frames: Iterator[VideoFrame] | None = None
        self._next = -1
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._kept_bytes = 0

    def times(self) -> tuple[IntArray, IntArray]:
        """Numbers [n] of all frames and their stamps [n] in ns, the camera's offset added."""
        with self._lock:
            _, times = self._opened()
        offset_ns = round(self._video.section.time_offset_s * 1e9)
        return times.frame, times.t_ns + offset_ns

    def jpeg(self, number: int) -> bytes | None:
        """One frame, None where it is not there or cannot be decoded."""
        with self._lock:
            if number in self._kept:
                self._kept.move_to_end(number)
                return self._kept[number]
            return self._decoded(number)

    def _opened(self) -> tuple[list[Chapter], FrameTimes]:
        from automap.io.frame_times import frame_times
        from automap.io.video import video_chapters

        if self._structure is None:
            chapters, _ = video_chapters(self._video)
            self._structure = chapters, frame_times(self._video, chapters)
        return self._structure

    def _decoded(self, number: int) -> bytes | None:
        from automap.io.video_decode import decode_frames

        chapters, times = self._opened()
        index = int(np.searchsorted(times.frame, number))
        if index >= len(times.frame) or times.frame[index] != number:
            return None
        if self._frames is None or not self._next <= number <= self._next + _STEP_LIMIT:
            self._frames = decode_frames(chapters, times, times.frame[index:])
        for frame in self._frames:
            self._next = frame.frame + 1
            if frame.frame >= number:
                # a picture that could not be decoded is not replaced by the next one
                picture = _encoded(frame.image)
                self._keep(frame.frame, picture)
                return picture if frame.frame == number else None
        self._frames = None
        return None

    def _keep(self, number: int, picture: bytes) -> None:
        self._kept[number] = picture
        self._kept_bytes += len(picture)
        while self._kept_bytes > _KEPT_BYTES and len(self._kept) > 1:
            _, oldest = self._kept.popitem(last=False)
            self._kept_bytes -= len(oldest)


def _encoded(image: np.ndarray) -> bytes:
    import cv2

    height, width = image.shape[:2]
    if width > WIDTH_LIMIT:
        size = (WIDTH_LIMIT, max(1, round(height * WIDTH_LIMIT / width)))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    good, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes() if good else b""
