"""Video through PyAV: exact presentation times, chapters in order, damage survived.

A frame's time is its own presentation time stamp in the container, never its number over a
rate. Frames count from 0 over all chapters in the order in which they are shown.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from automap.errors import InputError
from automap.io.csv_columns import read_columns
from automap.records import IntArray

if TYPE_CHECKING:
    from automap.io.drive import VideoInput

Image = npt.NDArray[np.uint8]

_MISSING_S = 0.5
_JUMP = 8
"""Frames that must be spared for a jump to a key frame to be worth emptying the decoder."""


@dataclass(frozen=True)
class Chapter:
    """One video file.

    ``pts_ns`` [n] presentation times of its frames in the order shown, in the container's
    own time; ``end_ns`` the time at which the last frame ends. ``count`` is the number of
    frames that the file promises, more than n when it was cut short. ``keys`` [k, 2] are the
    key frames: presentation time in ns, decoding time in the container's ticks.
    """

    path: Path
    width: int
    height: int
    pts_ns: IntArray
    end_ns: int
    codec: str
    count: int
    keys: IntArray
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class FrameTimes:
    """Stamps of the frames of one camera.

    ``frame`` [n] increasing numbers, ``t_ns`` [n] in the clock that the manifest names for
    this video.
    """

    frame: IntArray
    t_ns: IntArray
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, frame: npt.ArrayLike) -> tuple[IntArray, npt.NDArray[np.bool_]]:
        """Stamps [k] of frame numbers [k], and which of them are known."""
        wanted = np.asarray(frame, dtype=np.int64)
        if not len(self.frame):
            return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), bool)
        index = np.searchsorted(self.frame, wanted).clip(max=len(self.frame) - 1)
        return self.t_ns[index], self.frame[index] == wanted


@dataclass(frozen=True)
class VideoFrame:
    """A decoded picture: number over all chapters, stamp, BGR image [height, width, 3]."""

    frame: int
    t_ns: int
    image: Image


def read_chapter(path: Path) -> Chapter:
    """Read the structure of a video file without decoding its pictures.

    A truncated file gives the frames that are there and a warning. Raises InputError when
    it is missing, no video, or has no frames.
    """
    import av

    warnings: list[str] = []
    with _open(path) as container:
        stream = _video_stream(container, path)
        tick = float(stream.time_base) * 1e9
        stamps: list[int] = []
        keys: list[tuple[int, int]] = []
        undated = 0
        last_end = 0
        size = path.stat().st_size
        try:
            for packet in container.demux(stream):
                if packet.size == 0 or packet.is_discard:
                    continue
                if packet.pts is None:
                    undated += 1
                    continue
                if packet.pos is not None and packet.pos + packet.size > size:
                    warnings.append(f"{path} ends in the middle of a frame; it was cut short")
                    break
                stamps.append(packet.pts)
                if packet.is_keyframe and packet.dts is not None:
                    keys.append((round(packet.pts * tick), packet.dts))
                last_end = max(last_end, packet.pts + (packet.duration or 0))
        except av.FFmpegError as error:
            warnings.append(f"{path} is damaged ({error.strerror}); read up to there")
        if undated:
            warnings.append(f"{path}: {undated} frames without a presentation time left out")
        pts = np.unique(np.array(stamps, dtype=np.int64))
        if len(pts) == 0:
            raise InputError(f"{path} holds no video frames; copy it again from the camera.")
        if len(pts) < len(stamps):
            warnings.append(
                f"{path}: {len(stamps) - len(pts)} frames share a presentation time with another"
            )
        promised = stream.frames
        if promised and promised > len(stamps) + undated and not warnings:
            warnings.append(
                f"{path} promises {promised} frames and holds {len(stamps)}; it was cut short"
            )
        elif not promised and container.duration:
            said, held = container.duration * 1e-6, (last_end - int(pts[0])) * tick * 1e-9
            if said - held > max(_MISSING_S, 0.02 * said):
                warnings.append(
                    f"{path} promises {said:.1f} s and holds {held:.1f} s; it was cut short"
                )
        return Chapter(
            path=path,
            width=int(stream.codec_context.width),
            height=int(stream.codec_context.height),
            pts_ns=np.rint(pts * tick).astype(np.int64),
            end_ns=round(max(last_end, int(pts[-1])) * tick),
            codec=str(stream.codec_context.name),
            count=max(len(pts), promised),
            keys=np.array(sorted(keys), dtype=np.int64).reshape(-1, 2),
            warnings=tuple(warnings),
        )


@dataclass(frozen=True)
class VideoHeader:
    """What a video file says of itself, read without going through its frames.

    ``created_s`` is its creation time, UNIX seconds, NaN when absent; ``first_frame`` whether
    the first picture could be decoded.
    """

    width: int
    height: int
    codec: str
    duration_s: float
    frames: int
    created_s: float
    first_frame: bool


def read_header(path: Path) -> VideoHeader:
    """The header of a video file of any length, at once; InputError when it is unreadable."""
    import av

    with _open(path) as container:
        stream = _video_stream(container, path)
        duration = container.duration * 1e-6 if container.duration else float("nan")
        created = container.metadata.get("creation_time", "")
        header: dict[str, Any] = {
            "width": int(stream.codec_context.width),
            "height": int(stream.codec_context.height),
            "codec": str(stream.codec_context.name),
            "frames": int(stream.frames),
        }
        try:
            first_frame = next(container.decode(stream), None) is not None
        except av.FFmpegError:
            first_frame = False
    try:
        created_s = datetime.fromisoformat(created.replace("Z", "+00:00")).timestamp()
    except ValueError:
        created_s = float("nan")
    return VideoHeader(**header, duration_s=duration, created_s=created_s, first_frame=first_frame)


def video_chapters(video: VideoInput) -> tuple[list[Chapter], list[str]]:
    """The readable chapters of a camera in order, and a sentence for every trouble."""
    chapters: list[Chapter] = []
    warnings: list[str] = []
    for number, path in enumerate(video.chapters):
        try:
            chapter = read_chapter(path)
        except InputError as error:
            warnings.append(str(error).rstrip("."))
            left = len(video.chapters) - number - 1
            if left:
                warnings.append(
                    f"{path}: the number of its frames is unknown, so the {left} after it are "
                    "left out too; name the readable ones alone, with their own start_ns"
                )
            break
        warnings += chapter.warnings
        if chapters and (chapter.width, chapter.height) != (chapters[0].width, chapters[0].height):
            warnings.append(
                f"{path} has {chapter.width}x{chapter.height} pixels, the first chapter "
                f"{chapters[0].width}x{chapters[0].height}; it and those after it are left out"
            )
            break
        chapters.append(chapter)
    return chapters, warnings


def image_size(paths: Collection[Path]) -> tuple[int, int] | None:
    """Width and height of the first readable video, None when there is none."""
    for path in paths:
        try:
            with _open(path) as container:
                context = _video_stream(container, path).codec_context
                return int(context.width), int(context.height)
        except InputError:
            continue
    return None


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
        for first, chapter in zip(_first_frames(chapters), chapters, strict=True)
    ]
    return FrameTimes(np.concatenate(numbers), t_ns, tuple(warnings))


def _first_frames(chapters: list[Chapter]) -> list[int]:
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
    for first, chapter in zip(_first_frames(chapters), chapters, strict=True):
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
    with _open(chapter.path) as container:
        stream = _video_stream(container, chapter.path)
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


def _open(path: Path) -> Any:
    import av

    try:
        return av.open(str(path))
    except FileNotFoundError:
        raise InputError(f"{path} is missing.") from None
    except (av.FFmpegError, OSError) as error:
        raise InputError(
            f"{path} is no readable video ({error.strerror or error}); if the recording was "
            "interrupted, its index was never written: repair it or record again."
        ) from error


def _video_stream(container: Any, path: Path) -> Any:
    """The first stream of moving pictures; a cover image is not one."""
    for stream in container.streams.video:
        if not int(getattr(stream, "disposition", 0) or 0) & 0x400:
            return stream
    raise InputError(f"{path} holds no video stream; check that it is the camera's file.")
