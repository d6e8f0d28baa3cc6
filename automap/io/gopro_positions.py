"""The positions that a GoPro keeps beside its video."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from automap.io.gopro_streams import Channel, frame_zero_us
from automap.records import FloatArray, IntArray

_EPOCH_2000 = datetime(2000, 1, 1, tzinfo=UTC).timestamp()
_COURSE_HALF_S = 0.3
"""The course at a time is that from so long before to so long after,"""
_COURSE_SPEED = 0.7
"""given above this speed, m/s."""


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


def read_positions(
    path: Path,
    channels: dict[str, Channel],
    start_us: float,
    length_us: float,
    warnings: list[str],
) -> GoProPositions | None:
    """Positions of one file that begins ``start_us`` into the recording; None without any."""
    key = "GPS9" if "GPS9" in channels else "GPS5"
    if key not in channels:
        warnings.append(f"{path}: no positions; the receiver was off")
        return None
    channel = channels[key]
    values = channel.samples()
    zero = frame_zero_us(channels)
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


def join_positions(parts: list[GoProPositions]) -> GoProPositions:
    """Those of all files, one after the other."""
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in GoProPositions.__dataclass_fields__
        if name != "ellipsoidal"
    }
    return GoProPositions(**columns, ellipsoidal=all(part.ellipsoidal for part in parts))
