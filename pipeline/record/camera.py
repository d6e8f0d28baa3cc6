"""A camera or other video source: its frames as they come, with host times, as a growing video.

Pictures that come compressed (MJPEG, H.264 ...) are kept as they are, others are encoded. The
file is Matroska without an index, written front to back: what is on the disk can be played
whenever the recording stops. A source that was away goes on in a new chapter.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from automap.errors import InputError
from pipeline.record.append_file import AppendFile
from pipeline.record.clock import HostClock
from pipeline.record.reader import Event
from pipeline.record.video_chapter import VideoChapter
from pipeline.record.video_source import FrameStamper, Source

_WINDOW_NS = 5_000_000_000
_RETRY_S = 1.0
_RAW = frozenset({"rawvideo", "wrapped_avframe", "bitpacked"})
_TICKS = 1000
_MIN_FREE_S = 3.0


@dataclass(frozen=True)
class CameraState:
    """A camera as seen now; ``missed`` are frames that its usual rate lets expect."""

    frames: int = 0
    rate_hz: float = 0.0
    missed: int = 0
    width: int = 0
    height: int = 0
    connected: bool = False


class Camera:
    """Records one source in a thread of its own."""

    def __init__(self, name: str, source: Source, clock: HostClock, event: Event) -> None:
        self.name = name
        self._source = source
        self._clock = clock
        self._event = event
        self._halt = threading.Event()
        self._lock = threading.Lock()
        self._state = CameraState()
        self._times: deque[int] = deque(maxlen=600)
        self._nominal_hz = 0.0
        self._input: Any = None
        self._stream: Any = None
        self._chapter: VideoChapter | None = None
        self._chapters = 0
        self._files: list[AppendFile] = []
        self._frames: AppendFile | None = None
        self._folder = Path()
        self._last_ns: int | None = None
        self._thread = threading.Thread(target=self._run, name=f"camera {name}", daemon=True)

    # ---- for the recorder

    @property
    def manifest(self) -> dict[str, Any]:
        """What the manifest says of it."""
        found: dict[str, Any] = {"frames": f"video/{self.name}_frames.csv"}
        if self._state.width:
            found |= {"width": self._state.width, "height": self._state.height}
        return found

    @property
    def files(self) -> tuple[AppendFile, ...]:
        """The files that grow."""
        return tuple(self._files)

    def connect(self) -> None:
        """Open the source for the first time; InputError when that fails."""
        try:
            self._open_input()
        except Exception as error:  # FFmpeg's errors are of many kinds
            raise InputError(
                f"camera {self.name}: {self._source.location} cannot be opened "
                f"({_reason(error)}); is it a video device, and free?"
            ) from error

    def start(self, folder: Path) -> None:
        """Begin to record into ``folder``/video."""
        self._folder = folder / "video"
        self._frames = AppendFile(self._folder / f"{self.name}_frames.csv")
        self._frames.append(b"frame,t_ns\n")
        self._files.append(self._frames)
        self._thread.start()

    def stop(self) -> None:
        """End; a source that blocks is left to itself."""
        self._halt.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=_MIN_FREE_S)
        with self._lock:
            self._close_chapter()

    def state(self, now_ns: int) -> CameraState:
        """The camera as of now."""
        recent = [t for t in list(self._times) if now_ns - t <= _WINDOW_NS]
        rate = 0.0
        if len(recent) > 1:
            rate = (len(recent) - 1) / max((recent[-1] - recent[0]) * 1e-9, 1e-3)
        return replace(self._state, rate_hz=rate, connected=self._input is not None)

    def conditions(self, now_ns: int, started_ns: int) -> dict[str, str]:
        """What is wrong now."""
        key = f"camera-{self.name}"
        if self._input is None:
            return {f"{key}-lost": f"camera {self.name} is away"}
        if now_ns - (self._last_ns or started_ns) > 2e9:
            return {f"{key}-silent": f"camera {self.name}: no frames come"}
        state = self.state(now_ns)
        if self._nominal_hz and now_ns - started_ns > 10e9:
            share = state.rate_hz / self._nominal_hz
            if share < 0.8:
                return {
                    f"{key}-rate": f"camera {self.name}: {state.rate_hz:.1f} frames a second "
                    f"instead of {self._nominal_hz:.1f} (little light, or a slow computer)"
                }
        return {}

    # ---- the thread

    def _run(self) -> None:
        while not self._halt.is_set():
            try:
                if self._input is None:
                    self._open_input()
                    self._event("note", f"camera {self.name} is back")
                self._copy()
                ended = "it ended"
            except Exception as error:  # FFmpeg's errors are of many kinds
                ended = _reason(error)
            with self._lock:
                self._close_chapter()
            self._close_input()
            if self._halt.is_set():
                return
            if ended == "it ended" and self._source.paced:
                self._event("note", f"camera {self.name}: {self._source.location} has ended")
                return
            self._event("warning", f"camera {self.name} is lost ({ended}); waiting for it")
            while self._input is None and not self._halt.wait(_RETRY_S):
                with contextlib.suppress(Exception):
                    self._open_input()
                    self._event("note", f"camera {self.name} is back")

    def _open_input(self) -> None:
        import av

        source = self._source
        container = av.open(
            source.location, format=source.form, options=dict(source.options), timeout=5.0
        )
        if not container.streams.video:
            container.close()
            raise ValueError("no moving pictures in it")
        stream = container.streams.video[0]
        rate = stream.average_rate or stream.guessed_rate
        self._nominal_hz = float(rate) if rate and float(rate) < 1000 else 0.0
        context = stream.codec_context
        self._state = replace(self._state, width=context.width, height=context.height)
        self._stream = stream
        self._input = container

    def _close_input(self) -> None:
        with contextlib.suppress(Exception):
            if self._input is not None:
                self._input.close()
        self._input = None

    def _copy(self) -> None:
        stamps = FrameStamper(self._source, self._stream, self._clock, self._halt)
        raw = self._stream.codec_context.name in _RAW or bool(
            self._stream.codec_context.has_b_frames
        )
        for packet in self._input.demux(self._stream):
            if self._halt.is_set():
                return
            if raw:
                # the empty packet at the end brings the pictures that the decoder held back
                for picture in packet.decode():
                    if picture.pts is not None:
                        self._keep(stamps.of(picture.pts), picture=picture)
            elif packet.size and packet.pts is not None:
                self._keep(stamps.of(packet.pts), packet=packet)

    def _keep(self, t_ns: int, packet: Any = None, picture: Any = None) -> None:
        """Write one frame and its time."""
        with self._lock:
            if self._halt.is_set():
                return
            if self._chapter is None:
                if packet is not None and not packet.is_keyframe:
                    return
                self._chapter = self._new_chapter(packet is not None)
            if self._last_ns is not None:
                t_ns = max(t_ns, self._last_ns + 1)
            # the picture first: a stamp without a picture would shift all after it
            for stamp in self._chapter.write(t_ns, packet, picture):
                assert self._frames is not None
                self._frames.append(b"%d,%d\n" % (self._state.frames, stamp))
                self._state = replace(self._state, frames=self._state.frames + 1)
        if self._last_ns is not None and self._nominal_hz:
            missed = round((t_ns - self._last_ns) * 1e-9 * self._nominal_hz) - 1
            self._state = replace(self._state, missed=self._state.missed + max(missed, 0))
        self._last_ns = t_ns
        self._times.append(t_ns)

    def _new_chapter(self, copied: bool) -> VideoChapter:
        self._chapters += 1
        suffix = "" if self._chapters == 1 else f"_{self._chapters}"
        file = AppendFile(self._folder / f"{self.name}{suffix}.mkv")
        self._files.append(file)
        return VideoChapter(file, self._stream, copied)

    def _close_chapter(self) -> None:
        if self._chapter is not None:
            for stamp in self._chapter.close():
                assert self._frames is not None
                self._frames.append(b"%d,%d\n" % (self._state.frames, stamp))
                self._state = replace(self._state, frames=self._state.frames + 1)
            self._chapter = None


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__)
