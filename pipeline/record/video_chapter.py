"""A video file that grows from front to back and can be played at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

from pipeline.record.append_file import AppendFile

_TICKS = 1000


class VideoChapter:
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
