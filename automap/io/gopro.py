"""What a GoPro keeps beside its video: IMU and positions on the camera's own clock.

Source: GoPro's gpmf-parser (README: HERO5 to HERO13, MAX). Streams are joined over the payloads
by their running count of samples (TSMP); a payload's first sample has the time STMP.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import InputError
from automap.io.gpmf import GpmfError, Stream, axis_order, concatenate, streams
from automap.records import FloatArray, IntArray

FRD_OF_CAMERA = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""C that takes the camera's X left, Y back, Z up to forward, right, down. As a MAX has it: its
Z reads +g upright, its Y +g sin(tilt) when the lens looks down."""

_EPOCH_2000 = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
_FRAME_KEYS = ("CORI", "SHUT", "ISOE")
"""Streams with one sample a frame, whose first stamp is that of the first frame."""
_HANDLER = "GoPro MET"
_COURSE_HALF_S = 0.3
"""The course at a time is that from so long before to so long after,"""
_COURSE_SPEED = 0.7
"""given above this speed, m/s."""


@dataclass
class _Channel:
    """One stream over all payloads: blocks of samples, their counts before, their stamps."""

    blocks: list[FloatArray] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    stamp_us: list[float] = field(default_factory=list)
    orin: str = ""
    orio: str = ""
    matrix: FloatArray | None = None
    seen: int = 0

    def add(self, stream: Stream, values: FloatArray, pts_us: float) -> None:
        total = stream.count("TSMP")
        before = self.seen if total is None or total < len(values) else total - len(values)
        # a running count that goes back is a new recording's; ours goes on
        before = max(before, self.seen)
        stamp = stream.count("STMP")
        self.first.append(before)
        self.stamp_us.append(pts_us if stamp is None else float(stamp))
        self.blocks.append(values)
        self.seen = before + len(values)
        for key in ("ORIN", "ORIO"):
            if key in stream.modifiers:
                setattr(self, key.lower(), stream.modifiers[key].text())

    def samples(self) -> FloatArray:
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


@dataclass(frozen=True)
class GoProPositions:
    """Positions [n]: time of the sample on the video's clock, UTC tag, degrees, height, speed
    over ground (m/s), dilution of precision, fix (0, 2, 3). ``ellipsoidal`` tells the height."""

    t_ns: IntArray
    unix_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    speed_m_s: FloatArray
    dop: FloatArray
    fix: IntArray
    ellipsoidal: bool

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass(frozen=True)
class GoProRecording:
    """All chapters of a recording; times are nanoseconds of the video's own clock, its first
    frame at zero.

    ``accel`` m/s^2 and ``gyro`` rad/s [n, 3] at ``imu_t_ns``, in forward, right, down of the
    camera when ``axes_known``, else as stored. ``positions`` is None without a receiver.
    """

    device: str
    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    axes_known: bool
    positions: GoProPositions | None
    counts: dict[str, int]
    warnings: tuple[str, ...]


def find_chapters(source: Path) -> list[Path]:
    """The files of one recording: ``source`` and the chapters that follow it in its folder.

    GoPro numbers them GX010042, GX020042 and on (GH, GS, GP and GL alike; the HERO5 begins with
    GOPR0042 and goes on with GP010042).
    """
    import re

    names = {path.name.upper(): path for path in source.parent.iterdir() if path.is_file()}
    match = re.fullmatch(r"(G[A-Z])(\d\d)(\d{4})(\..+)", source.name.upper())
    first = re.fullmatch(r"GOPR(\d{4})(\..+)", source.name.upper())
    if match:
        kind, number, video, suffix = match[1], int(match[2]), match[3], match[4]
    elif first:
        kind, number, video, suffix = "GP", 0, first[1], first[2]
    else:
        return [source]
    chapters = [source]
    while (following := f"{kind}{number + 1:02d}{video}{suffix}") in names:
        number += 1
        chapters.append(names[following])
    return chapters


def read_gopro(chapters: list[Path]) -> GoProRecording:
    """Read IMU and positions of the chapters; InputError names the file that has none."""
    warnings: list[str] = []
    parts = []
    start_us = 0.0
    for path in chapters:
        channels, device, length_us = _read_chapter(path, warnings)
        parts.append((path, channels, device, start_us, length_us))
        start_us += length_us
    imu = [_imu(path, channels, start, length) for path, channels, _, start, length in parts]
    t_ns = np.concatenate([one[0] for one in imu])
    gyro, accel = (np.concatenate([one[k] for one in imu]) for k in (1, 2))
    matrix = _camera_axes(parts[0][1]["ACCL"])
    known = matrix is not None
    if matrix is not None:
        gyro, accel = gyro @ matrix.T, accel @ matrix.T
        up = float(np.mean(accel[:, 2])) / max(float(np.mean(np.linalg.norm(accel, axis=1))), 1e-9)
        if up > -0.5:
            known = False
            warnings.append(
                f"{chapters[0]}: gravity is not along the camera's down axis, so it was mounted "
                'turned; the axes are left to be estimated (axes = "unknown")'
            )
    else:
        warnings.append(
            f"{chapters[0]}: the order of the IMU's axes is not in the file; they are left to be "
            'estimated (axes = "unknown")'
        )
    positions = [
        found
        for path, channels, _, start, length in parts
        if (found := _positions(path, channels, start, length, warnings)) is not None
    ]
    keys = ("GPS9", "GPS5", "ACCL", "GYRO")
    counts = {
        key: sum(sum(len(b) for b in c[key].blocks) for _, c, *_ in parts if key in c)
        for key in keys
    }
    return GoProRecording(
        device=parts[0][2],
        imu_t_ns=t_ns,
        gyro=gyro,
        accel=accel,
        axes_known=known,
        positions=_joined(positions) if positions else None,
        counts={key: n for key, n in counts.items() if n},
        warnings=tuple(warnings),
    )


def _read_chapter(path: Path, warnings: list[str]) -> tuple[dict[str, _Channel], str, float]:
    """The streams of a file by key, the camera's name, and the video's length in us."""
    import av

    channels: dict[str, _Channel] = {}
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
                    device = _add_payload(bytes(packet), pts_us, channels) or device
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


def _add_payload(payload: bytes, pts_us: float, channels: dict[str, _Channel]) -> str:
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
            channel = channels.setdefault(stream.key, _Channel())
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


def _frame_zero_us(channels: dict[str, _Channel]) -> float:
    """The stamp of the first frame on the clock of the samples; zero where they have none."""
    for key in _FRAME_KEYS:
        if key in channels:
            return channels[key].stamp_us[0]
    return 0.0


def _imu(
    path: Path, channels: dict[str, _Channel], start_us: float, length_us: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    accel, gyro = channels["ACCL"], channels["GYRO"]
    if accel.samples().shape[1] != 3 or gyro.samples().shape[1] != 3:
        raise InputError(f"{path}: its IMU samples have not three axes; it cannot be imported.")
    zero = _frame_zero_us(channels)
    t_accel, t_gyro = accel.times_us(zero + length_us), gyro.times_us(zero + length_us)
    readings, turns = accel.samples(), gyro.samples()
    if len(t_accel) != len(t_gyro) or np.abs(t_accel - t_gyro).max() > 50.0:
        inside = (t_accel >= t_gyro[0]) & (t_accel <= t_gyro[-1])
        t_accel, readings = t_accel[inside], readings[inside]
        turns = np.column_stack([np.interp(t_accel, t_gyro, turns[:, k]) for k in range(3)])
    if len(t_accel) < 2:
        raise InputError(f"{path}: accelerometer and gyro share no time; it cannot be imported.")
    t_ns = np.rint((t_accel - zero + start_us) * 1e3).astype(np.int64)
    return t_ns, turns, readings


def _camera_axes(channel: _Channel) -> FloatArray | None:
    """C from the stored order to forward, right, down; None where the file does not say."""
    stored = axis_order(channel.orin, "XYZ")
    return None if stored is None else FRD_OF_CAMERA @ stored


def _positions(
    path: Path,
    channels: dict[str, _Channel],
    start_us: float,
    length_us: float,
    warnings: list[str],
) -> GoProPositions | None:
    key = "GPS9" if "GPS9" in channels else "GPS5"
    if key not in channels:
        warnings.append(f"{path}: no positions; the receiver was off")
        return None
    channel = channels[key]
    values = channel.samples()
    zero = _frame_zero_us(channels)
    t_us = channel.times_us(zero + length_us)
    if key == "GPS9":
        unix = _EPOCH_2000 + values[:, 5] * 86400.0 + values[:, 6]
        dop, fix = values[:, 7], values[:, 8]
    else:
        t_us = _even(t_us, channel.numbers())
        unix = _unix_of_blocks(t_us, values[:, 5])
        dop, fix = values[:, 6], values[:, 7]
    good = (fix >= 2) & np.isfinite(unix)
    if not good.any():
        warnings.append(f"{path}: the receiver had no fix")
    ellipsoidal = channel.orin != "MSLV"
    if not ellipsoidal:
        warnings.append(
            f"{path}: heights are above the sea; they are left out, as the geoid is not in it"
        )
    return GoProPositions(
        t_ns=np.rint((t_us - zero + start_us) * 1e3).astype(np.int64),
        unix_s=unix,
        lat_deg=values[:, 0],
        lon_deg=values[:, 1],
        height_m=values[:, 2] if ellipsoidal else np.full(len(values), np.nan),
        speed_m_s=values[:, 3],
        dop=dop,
        fix=np.where(good, np.clip(fix, 0, 3), 0).astype(np.int64),
        ellipsoidal=ellipsoidal,
    )


def _even(t_us: FloatArray, number: FloatArray) -> FloatArray:
    """Times of a receiver that measures at even steps, by a straight line through them; the
    stamps of the blocks jitter with what else the camera does. As they are where they bend."""
    if len(t_us) < 10:
        return t_us
    slope, offset = np.polyfit(number - number[0], t_us - t_us[0], 1)
    line = t_us[0] + offset + slope * (number - number[0])
    return line if np.abs(line - t_us).max() < slope else t_us


def _unix_of_blocks(t_us: FloatArray, block_unix: FloatArray) -> FloatArray:
    """UTC [n]: the camera's clock, set by the median of what the blocks of positions say.

    UTC is written once a block and now and then a second old; the camera's clock is even."""
    first = np.flatnonzero(np.diff(block_unix, prepend=np.nan) != 0.0)
    known = first[np.isfinite(block_unix[first])]
    if len(known) == 0:
        return np.full(len(t_us), np.nan)
    offset = float(np.median(block_unix[known] - t_us[known] * 1e-6))
    return np.asarray(offset + t_us * 1e-6)


def course_of_positions(positions: GoProPositions) -> FloatArray:
    """Course [n] in degrees from the positions around each, NaN where the camera hardly moves.

    The camera keeps the receiver's speed and not its direction.
    """
    course = np.full(len(positions), np.nan)
    t = positions.t_ns * 1e-9
    before = np.searchsorted(t, t - _COURSE_HALF_S)
    after = np.minimum(np.searchsorted(t, t + _COURSE_HALF_S), len(t) - 1)
    lat = np.radians(positions.lat_deg)
    north = np.radians(positions.lat_deg[after] - positions.lat_deg[before])
    turn = (positions.lon_deg[after] - positions.lon_deg[before] + 180.0) % 360.0 - 180.0
    east = np.radians(turn) * np.cos(lat)
    steady = (
        (positions.speed_m_s > _COURSE_SPEED)
        & (positions.fix >= 2)
        & (positions.fix[before] >= 2)
        & (positions.fix[after] >= 2)
        & (t[after] - t[before] > 0.5 * _COURSE_HALF_S)
        & (t[after] - t[before] < 4.0 * _COURSE_HALF_S)
    )
    course[steady] = np.degrees(np.arctan2(east, north))[steady] % 360.0
    return course


def _joined(parts: list[GoProPositions]) -> GoProPositions:
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in GoProPositions.__dataclass_fields__
        if name != "ellipsoidal"
    }
    return GoProPositions(**columns, ellipsoidal=all(part.ellipsoidal for part in parts))
