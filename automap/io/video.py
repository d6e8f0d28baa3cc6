"""Video files through PyAV: what they hold, chapters in order, damage survived."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import InputError
from automap.records import IntArray

if TYPE_CHECKING:
    from automap.io.manifest import VideoSection

_MISSING_S = 0.5


@dataclass(frozen=True)
class VideoInput:
    """The files of one camera: chapters in order, frame stamps, external detections."""

    name: str
    section: VideoSection
    chapters: tuple[Path, ...] = ()
    frames: Path | None = None
    detections: Path | None = None


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


def read_chapter(path: Path) -> Chapter:
    """Read the structure of a video file without decoding its pictures.

    A truncated file gives the frames that are there and a warning. Raises InputError when
    it is missing, no video, or has no frames.
    """
    import av

    warnings: list[str] = []
    with open_video(path) as container:
        stream = video_stream(container, path)
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
        turned = _turned_deg(path)
        if turned:
            warnings.append(
                f"{path} says that its pictures are to be turned by {turned} deg to be upright; "
                "they are searched as they are stored, where signs lie on their side or stand on "
                f"their head. Write it upright with 'ffmpeg -i {path.name} upright.mp4' and name "
                "that file"
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


def _turned_deg(path: Path) -> int:
    """By how much the first picture of a file is to be turned before it is shown, deg; 0 where the
    file does not say so or no picture can be decoded."""
    import av

    with open_video(path) as container:
        try:
            frame = next(container.decode(video_stream(container, path)), None)
        except av.FFmpegError:
            return 0
    return 0 if frame is None else int(frame.rotation)


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

    with open_video(path) as container:
        stream = video_stream(container, path)
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
            with open_video(path) as container:
                context = video_stream(container, path).codec_context
                return int(context.width), int(context.height)
        except InputError:
            continue
    return None


def open_video(path: Path) -> Any:
    """The container of a video file; InputError when it is missing or unreadable."""
    import av

    try:
        return av.open(str(path))
    except FileNotFoundError:
        raise InputError(f"{path} is missing.") from None
    except (PermissionError, IsADirectoryError) as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check the file.") from None
    except (av.FFmpegError, OSError, UnicodeDecodeError) as error:
        # names in a garbled header are no text
        why = getattr(error, "strerror", None) or error
        raise InputError(
            f"{path} is no readable video ({why}); if the recording was "
            "interrupted, its index was never written: repair it or record again."
        ) from error


def video_stream(container: Any, path: Path) -> Any:
    """The first stream of moving pictures; a cover image is not one. InputError without any."""
    for stream in container.streams.video:
        cover = int(getattr(stream, "disposition", 0) or 0) & 0x400
        # a stream of pictures in no known form has no decoder
        if not cover and stream.codec_context is not None:
            return stream
    raise InputError(f"{path} holds no video stream; check that it is the camera's file.")
