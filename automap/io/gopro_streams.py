"""The streams that a GoPro keeps beside its video, joined over the payloads.

Source: GoPro's gpmf-parser (README: HERO5 to HERO13, MAX). Streams are joined by their running
count of samples (TSMP); a payload's first sample has the time STMP.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.gpmf import GpmfError, Stream, concatenate, streams
from automap.records import FloatArray

_FRAME_KEYS = ("CORI", "SHUT", "ISOE")
"""Streams with one sample a frame, whose first stamp is that of the first frame."""
_HANDLER = "GoPro MET"


@dataclass
class Channel:
    """One stream over all payloads: blocks of samples, their counts before, their stamps.

    ``orin`` is the order and sense of the stored axes, empty where the file does not say.
    """

    blocks: list[FloatArray] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    stamp_us: list[float] = field(default_factory=list)
    orin: str = ""
    seen: int = 0

    def add(self, stream: Stream, values: FloatArray, pts_us: float) -> None:
        """Append the samples of one payload, [n, columns]; ``pts_us`` where it has no stamp."""
        total = stream.count("TSMP")
        before = self.seen if total is None or total < len(values) else total - len(values)
        # a running count that goes back is a new recording's; ours goes on
        before = max(before, self.seen)
        stamp = stream.count("STMP")
        self.first.append(before)
        self.stamp_us.append(pts_us if stamp is None else float(stamp))
        self.blocks.append(values)
        self.seen = before + len(values)
        if "ORIN" in stream.modifiers:
            self.orin = stream.modifiers["ORIN"].text()

    def samples(self) -> FloatArray:
        """All samples [n, columns]."""
        return concatenate(self.blocks)

    def numbers(self) -> FloatArray:
        """Running number [n] of each sample; gaps are samples that were lost."""
        return concatenate(
            [first + np.arange(len(b)) for first, b in zip(self.first, self.blocks, strict=True)]
        )

    def times_us(self, end_us: float) -> FloatArray:
        """Time [n] of each sample: even between the stamps of the payloads, and after the last
        at the rate of the whole."""
        at = np.array(self.first, np.float64)
        stamps = np.array(self.stamp_us)
        if len(at) < 2:
            length = max(len(self.blocks[0]), 1)
            step = max(end_us - stamps[0], 0.0) / length
            return np.asarray(stamps[0] + step * np.arange(len(self.blocks[0])))
        step = (stamps[-1] - stamps[0]) / max(at[-1] - at[0], 1.0)
        at = np.append(at, self.seen)
        stamps = np.append(stamps, stamps[-1] + step * (self.seen - at[-2]))
        return np.asarray(np.interp(self.numbers(), at, stamps))


def read_streams(path: Path, warnings: list[str]) -> tuple[dict[str, Channel], str, float]:
    """The streams of a file by key, the camera's name, and the video's length in us."""
    import av

    channels: dict[str, Channel] = {}
    device = ""
    damaged = 0
    try:
        with av.open(str(path)) as container:
            stream = _metadata_stream(path, container)
            length_us = _length_us(container)
            for packet in container.demux(stream):
                if not packet.size:
                    continue
                pts_us = float((packet.pts or 0) * packet.time_base) * 1e6
                try:
                    device = add_payload(bytes(packet), pts_us, channels) or device
                except GpmfError:
                    damaged += 1
    except (av.error.FFmpegError, OSError, ValueError) as error:
        text = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{path} cannot be read as a video ({text}); copy it from the camera again."
        ) from error
    for key in ("ACCL", "GYRO"):
        if key not in channels:
            raise InputError(
                f"{path}: its metadata hold no {key} samples; only GoPro's with an IMU "
                "(HERO5 and later, MAX) can be imported."
            )
    if damaged:
        warnings.append(f"{path}: {damaged} damaged blocks of metadata were left out")
    return channels, device, length_us


def _metadata_stream(path: Path, container: Any) -> Any:
    for stream in container.streams.data:
        if _HANDLER in stream.metadata.get("handler_name", ""):
            return stream
    raise InputError(
        f"{path} holds no GoPro metadata (a track called {_HANDLER}); give the file as the camera "
        "wrote it, editors leave that track out."
    )


def _length_us(container: Any) -> float:
    video = container.streams.video
    if video and video[0].duration is not None:
        return float(video[0].duration * video[0].time_base) * 1e6
    return float(container.duration or 0)


def add_payload(payload: bytes, pts_us: float, channels: dict[str, Channel]) -> str:
    """Add the samples of one block of metadata to the channels; returns the camera's name."""
    device = ""
    for name, stream in streams(payload):
        device = device or name
        if stream.key in ("ACCL", "GYRO", "GPS5", "GPS9", *_FRAME_KEYS):
            values = stream.scaled()
            if len(values) == 0:
                continue
            if stream.key == "GPS5":
                values = _with_epoch(stream, values)
            elif stream.key == "GPS9":
                values = _padded(values, 9)
            channel = channels.setdefault(stream.key, Channel())
            channel.add(stream, values, pts_us)
            if stream.key.startswith("GPS") and "GPSA" in stream.modifiers:
                channel.orin = stream.modifiers["GPSA"].text()
    return device


def _padded(values: FloatArray, columns: int) -> FloatArray:
    if values.shape[1] < columns:
        raise GpmfError("a position with too few values")
    return values[:, :columns]


def _with_epoch(stream: Stream, values: FloatArray) -> FloatArray:
    """GPS5 samples [n, 8]: the five values, UTC of the block, dilution of precision, fix."""
    values = _padded(values, 5)
    unix = np.nan
    if "GPSU" in stream.modifiers:
        text = stream.modifiers["GPSU"].text()
        try:
            whole = datetime.strptime(text[:12], "%y%m%d%H%M%S").replace(tzinfo=UTC)
            unix = whole.timestamp() + float(f"0{text[12:] or '.0'}")
        except ValueError:
            unix = np.nan
    dop, fix = stream.number("GPSP"), stream.number("GPSF")
    rest = [unix, np.nan if dop is None else dop * 0.01, 3.0 if fix is None else fix]
    return np.column_stack([values, np.tile(rest, (len(values), 1))])


def frame_zero_us(channels: dict[str, Channel]) -> float:
    """The stamp of the first frame on the clock of the samples; zero where they have none."""
    for key in _FRAME_KEYS:
        if key in channels:
            return channels[key].stamp_us[0]
    return 0.0
