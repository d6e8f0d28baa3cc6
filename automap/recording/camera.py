"""A camera or other video source: its frames as they come, with host times, as a growing video.

Pictures that come compressed (MJPEG, H.264 ...) are kept as they are, others are encoded. The
file is Matroska without an index, written front to back: what is on the disk can be played
whenever the recording stops. A source that was away goes on in a new chapter.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from automap.errors import ConfigError, InputError
from automap.recording.append_file import AppendFile
from automap.recording.clock import DeviceClock, HostClock
from automap.recording.reader import Event

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


@dataclass(frozen=True)
class Source:
    """Where pictures come from. ``paced``: a file, which has to be played at its own pace."""

    location: str
    form: str | None = None
    options: tuple[tuple[str, str], ...] = ()
    paced: bool = False
    kernel_stamps: bool = False


def parse_camera(text: str) -> tuple[str, Source]:
    """``front=/dev/video0?video_size=1280x720&framerate=30``: name and source.

    The source is a video device, a file or pipe, a URL that FFmpeg opens, or ``lavfi:`` and a
    filter graph; what follows ``?`` are FFmpeg's options of a device. Raises ConfigError.
    """
    name, mark, location = text.partition("=")
    if not mark or not location or not re.fullmatch(r"[A-Za-z][\w-]*", name):
        raise ConfigError(
            f"{text!r} names no camera; write NAME=SOURCE, such as front=/dev/video0."
        )
    if location.startswith("lavfi:"):
        return name, Source(location.removeprefix("lavfi:"), "lavfi", paced=True)
    path, _, query = location.partition("?")
    options = tuple(parse_qsl(query))
    if "://" in path:
        return name, Source(location)
    if not Path(path).exists():
        raise InputError(f"camera {name}: there is no {path}; check the name of the device.")
    mode = os.stat(path).st_mode
    if stat.S_ISCHR(mode):
        return name, Source(path, "v4l2", options, kernel_stamps=True)
    return name, Source(path, None, options, paced=stat.S_ISREG(mode))


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
        self._chapter: _Chapter | None = None
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
        except (OSError, ValueError) as error:
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
        stamps = _Stamper(self._source, self._stream, self._clock, self._halt)
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

    def _new_chapter(self, copied: bool) -> _Chapter:
        self._chapters += 1
        suffix = "" if self._chapters == 1 else f"_{self._chapters}"
        file = AppendFile(self._folder / f"{self.name}{suffix}.mkv")
        self._files.append(file)
        return _Chapter(file, self._stream, copied)

    def _close_chapter(self) -> None:
        if self._chapter is not None:
            for stamp in self._chapter.close():
                assert self._frames is not None
                self._frames.append(b"%d,%d\n" % (self._state.frames, stamp))
                self._state = replace(self._state, frames=self._state.frames + 1)
            self._chapter = None


class _Stamper:
    """Host times of frames, by what the source knows of time."""

    def __init__(
        self, source: Source, stream: Any, clock: HostClock, halt: threading.Event
    ) -> None:
        self._source = source
        self._tick_ns = float(stream.time_base) * 1e9
        self._clock = clock
        self._device = DeviceClock()
        self._halt = halt
        self._first: tuple[int, int] | None = None

    def of(self, pts: int) -> int:
        """Host time of the frame with this presentation time; waits where a file is played."""
        shown_ns = round(pts * self._tick_ns)
        if self._source.paced:
            if self._first is None:
                self._first = shown_ns, self._clock()
            due = self._first[1] + shown_ns - self._first[0]
            while (left := due - self._clock()) > 0 and not self._halt.is_set():
                time.sleep(min(left * 1e-9 / self._clock.factor, 0.2))
            return self._clock()
        now = self._clock()
        if self._source.kernel_stamps and 0 <= time.monotonic_ns() - shown_ns < 1_000_000_000:
            # the driver's own stamp of the frame, of the same clock
            return self._clock.at(shown_ns)
        return self._device.stamps([shown_ns], [now])[0]


class _Chapter:
    """One video file that grows."""

    def __init__(self, file: AppendFile, stream: Any, copied: bool) -> None:
        import av

        self._container = av.open(
            _Sink(file.append), "w", format="matroska",
            options={"flush_packets": "1", "cluster_time_limit": "500", "live": "1"},
        )  # fmt: skip
        self._copied = copied
        if copied:
            self._out: Any = self._container.add_stream_from_template(stream)
        else:
            self._out = _encoder(self._container, stream.codec_context)
        self._first_ns: int | None = None
        self._last_pts = -1
        self._waiting: dict[int, int] = {}

    def write(self, t_ns: int, packet: Any, picture: Any) -> Iterator[int]:
        """Add a frame; the stamps of those that are in the file now."""
        from fractions import Fraction

        if self._first_ns is None:
            self._first_ns = t_ns
        pts = max(round((t_ns - self._first_ns) * 1e-6), self._last_pts + 1)
        self._last_pts = pts
        self._waiting[pts] = t_ns
        base = Fraction(1, _TICKS)
        if packet is not None:
            packet.stream = self._out
            packet.time_base = base
            packet.pts = packet.dts = pts
            return self._mux([packet])
        picture.time_base, picture.pts, picture.pict_type = base, pts, 0
        return self._mux(self._out.encode(picture))

    def _mux(self, packets: list[Any]) -> Iterator[int]:
        stamps = []
        for packet in packets:
            pts = round(packet.pts * packet.time_base * _TICKS)
            self._container.mux(packet)
            if pts in self._waiting:
                stamps.append(self._waiting.pop(pts))
        return iter(stamps)

    def close(self) -> Iterator[int]:
        """End the file; the stamps of its last frames."""
        stamps = [] if self._copied else list(self._mux(self._out.encode(None)))
        self._container.close()
        return iter(stamps)


class _Sink:
    """What FFmpeg writes goes to the end of a file; it cannot go back in it."""

    def __init__(self, append: Callable[[bytes], bool]) -> None:
        self._append = append

    def write(self, data: bytes) -> int:
        """Take bytes."""
        self._append(bytes(data))
        return len(data)


def _encoder(container: Any, context: Any) -> Any:
    """H.264 at once and in good quality, or MJPEG where there is no such encoder."""
    from fractions import Fraction

    import av

    size = {"width": context.width, "height": context.height}
    try:
        av.Codec("libx264", "w")
    except (ValueError, av.FFmpegError):
        stream = container.add_stream("mjpeg", rate=30, options={"qscale": "3"})
        stream.pix_fmt = "yuvj420p"
    else:
        stream = container.add_stream(
            "libx264", rate=30,
            options={"preset": "ultrafast", "tune": "zerolatency", "crf": "20", "g": "30"},
        )  # fmt: skip
        stream.pix_fmt = "yuv420p"
    stream.width, stream.height = size["width"], size["height"]
    stream.codec_context.time_base = Fraction(1, _TICKS)
    return stream


def _reason(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error or type(error).__name__)
