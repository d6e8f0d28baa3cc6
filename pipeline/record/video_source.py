"""Where a camera's pictures come from, and at which host time each was taken."""

from __future__ import annotations

import os
import re
import stat
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from automap.errors import ConfigError, InputError
from pipeline.record.clock import DeviceClock, HostClock


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


class FrameStamper:
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
