"""The pictures of a video, each found by its presentation time.

Stretches that nobody asked for are passed over by jumps to key frames.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import numpy.typing as npt

from automap.io.frame_times import first_frames, frame_times
from automap.io.video import Chapter, VideoInput, open_video, video_chapters, video_stream
from automap.records import FrameTimes, Image, IntArray, VideoFrame

_JUMP = 8
"""Frames that must be spared for a jump to a key frame to be worth emptying the decoder."""


def iter_frames(
    video: VideoInput,
    select: Collection[int] | npt.NDArray[np.int64] | None = None,
    warn: Callable[[str], None] = lambda text: None,
) -> Iterator[VideoFrame]:
    """Decode the frames of a camera in order, all of them or those numbered in ``select``.

    Memory stays flat. Frames that cannot be decoded or have no stamp are left out; ``warn``
    receives one sentence for each trouble.
    """
    chapters, warnings = video_chapters(video)
    times = frame_times(video, chapters)
    for text in (*warnings, *times.warnings):
        warn(text)
    yield from decode_frames(chapters, times, select, warn)


def decode_frames(
    chapters: list[Chapter],
    times: FrameTimes,
    select: Collection[int] | npt.NDArray[np.int64] | None = None,
    warn: Callable[[str], None] = lambda text: None,
) -> Iterator[VideoFrame]:
    """As ``iter_frames``, for chapters whose structure and stamps are known already.

    What nobody asked for costs little: stretches between two key frames without a wanted
    frame are passed over, and in the others pictures that no other picture refers to.
    """
    wanted = times.frame
    if select is not None:
        wanted = np.intersect1d(wanted, np.asarray(list(select), dtype=np.int64))
    for first, chapter in zip(first_frames(chapters), chapters, strict=True):
        last = first + len(chapter.pts_ns)
        numbers = wanted[(wanted >= first) & (wanted < last)]
        if len(numbers):
            for number, image in _decode(chapter, numbers - first, warn):
                stamps, _ = times.at([first + number])
                yield VideoFrame(first + number, int(stamps[0]), image)


def _decode(
    chapter: Chapter, numbers: IntArray, warn: Callable[[str], None]
) -> Iterator[tuple[int, Image]]:
    """Frames of a chapter by number, each found by its presentation time."""
    delivered = 0
    with open_video(chapter.path) as container:
        stream = video_stream(container, chapter.path)
        stream.thread_type = "AUTO"
        for i, run in enumerate(_runs(chapter, numbers)):
            _go_to(container, stream, chapter, int(run[0]), fresh=i == 0)
            for number, image in _decode_run(container, stream, chapter, run):
                delivered += 1
                yield number, image
    if delivered < len(numbers):
        warn(
            f"{chapter.path}: {len(numbers) - delivered} of {len(numbers)} frames could not be "
            "decoded; copy the file again from the camera if you can"
        )


def _runs(chapter: Chapter, numbers: IntArray) -> list[IntArray]:
    """The numbers [k] in stretches, each of which is best reached by a jump to a key frame."""
    if len(chapter.keys) < 2:
        return [numbers]
    key_of = np.searchsorted(chapter.keys[:, 0], chapter.pts_ns[numbers], "right") - 1
    key_number = np.searchsorted(chapter.pts_ns, chapter.keys[key_of.clip(min=0), 0])
    jumps = (key_of[1:] >= 0) & (key_number[1:] - numbers[:-1] > _JUMP)
    return np.split(numbers, np.flatnonzero(jumps) + 1)


def _go_to(container: Any, stream: Any, chapter: Chapter, number: int, fresh: bool) -> None:
    """Continue at the key frame before a frame; a ``fresh`` container is at the first one."""
    import av

    before = int(np.searchsorted(chapter.keys[:, 0], chapter.pts_ns[number], "right"))
    if before > (1 if fresh else 0):
        # a file without an index is read on from where it is
        with suppress(av.FFmpegError):
            # containers look for decoding times, which run ahead of what is shown
            container.seek(int(chapter.keys[before - 1, 1]), stream=stream, backward=True)


def _decode_run(
    container: Any, stream: Any, chapter: Chapter, numbers: IntArray
) -> Iterator[tuple[int, Image]]:
    """The wanted frames of one stretch, decoded from where the container stands."""
    import av

    tick = float(stream.time_base) * 1e9
    wanted = set(numbers.tolist())
    last = int(numbers[-1])
    broken = 0
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
            if packet is None:
                return
            needed = packet.pts is None or _number(chapter, packet.pts, tick) in wanted
            # set for each packet: a picture that others refer to is decoded all the same
            stream.codec_context.skip_frame = "DEFAULT" if needed else "NONREF"
            decoded = packet.decode()
        except av.FFmpegError:
            broken += 1
            if broken > len(chapter.pts_ns) + 100:
                return
            continue
        for picture in decoded:
            number = None if picture.pts is None else _number(chapter, picture.pts, tick)
            if number is None:
                continue
            if number in wanted:
                wanted.discard(number)
                yield number, picture.to_ndarray(format="bgr24")
            if number >= last:
                return


def _number(chapter: Chapter, pts: int, tick: float) -> int | None:
    """The frame that is shown at a presentation time in ticks of the container."""
    stamp = round(pts * tick)
    number = int(np.searchsorted(chapter.pts_ns, stamp - 1))
    if number >= len(chapter.pts_ns) or abs(int(chapter.pts_ns[number]) - stamp) > 1:
        return None
    return number
