"""Inertial readings out of a u-blox receiver that has its own sensors (ESF-MEAS, ESF-RAW).

References: u-blox 8/M8 receiver description (UBX-13003221), 32.11.2 and 32.11.3;
ZED-F9R interface description (UBX-22010984), 3.11 for the scale of each data type.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.io.ubx import Table
from automap.records import Fixes, FloatArray, IntArray

_GYRO_TYPES = (14, 13, 5)
_ACCEL_TYPES = (16, 17, 18)
_TEMPERATURE_TYPE = 12
_GYRO_SCALE = np.pi / 180.0 / 4096.0
_ACCEL_SCALE = 1.0 / 1024.0
_TEMPERATURE_SCALE = 0.01

_MEAS_TICK_S = 1e-3
_RAW_TICK_S = 1.0 / 25_600.0
"""Nominal sensor clock of ESF-RAW; the message's own millisecond counter refines it."""

TIE_SD_S = 0.1
"""One sigma of the tie to GPS time: the receiver's output delays are unknown to some 0.1 s."""


@dataclass(frozen=True)
class ReceiverImu:
    """Readings of a receiver's own inertial sensors, in the sensor's axes.

    ``tag_s`` [n] seconds of the sensor's clock, increasing. ``gyro`` [n, 3] rad/s, ``accel``
    [n, 3] m/s^2. ``temp_c`` [n] or None. ``offset`` [n] byte offset in the log of the message.
    ``gps_s`` [n] GPS time by the place in the log among the fixes, good to ``tie_sd_s``; None
    without fixes. ``source`` is "ESF-RAW" or "ESF-MEAS".
    """

    tag_s: FloatArray
    gyro: FloatArray
    accel: FloatArray
    temp_c: FloatArray | None
    offset: IntArray
    gps_s: FloatArray | None
    tie_sd_s: float
    source: str

    def __len__(self) -> int:
        return len(self.tag_s)


def read_esf(tables: dict[str, Table], fixes: Fixes) -> tuple[ReceiverImu | None, list[str]]:
    """Inertial readings of a log and what is to be said about them.

    ESF-RAW goes before ESF-MEAS, which has the same sensors at a lower rate. Accelerometer
    readings with other time tags than the gyro's are interpolated to those; readings without
    a neighbour within three intervals are left out and counted.
    """
    warnings: list[str] = []
    for source in ("ESF-RAW", "ESF-MEAS"):
        table = tables.get(source)
        if table is None or len(table) == 0:
            continue
        missing = [
            kind for kind in (*_GYRO_TYPES, *_ACCEL_TYPES) if not np.any(table["type"] == kind)
        ]
        if missing:
            warnings.append(
                f"{source} has no readings of data type {', '.join(map(str, missing))}: "
                "not a full set of gyros and accelerometers, so it is not used as IMU"
            )
            continue
        imu, left_out = _assemble(source, table, fixes)
        if left_out:
            warnings.append(f"{source}: {left_out} readings without a counterpart are left out")
        if imu is not None:
            return imu, warnings
    return None, warnings


def _series(table: Table, tag: FloatArray, kind: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Time tags, counts and offsets of one data type, by increasing tag without repeats."""
    rows = np.flatnonzero(table["type"] == kind)
    _, first = np.unique(tag[rows], return_index=True)
    rows = rows[first]
    return tag[rows], table["value"][rows].astype(np.float64), table["offset"][rows]


def _assemble(source: str, table: Table, fixes: Fixes) -> tuple[ReceiverImu | None, int]:
    tick = _tick(table) if source == "ESF-RAW" else _MEAS_TICK_S
    # the 32-bit tag rolls over; small steps back between messages are real
    steps = np.diff(table["tag"].astype(np.uint32)).astype(np.int32)
    counts = int(table["tag"][0]) + np.concatenate([[0], np.cumsum(steps.astype(np.int64))])
    tag = counts * tick

    time, _, offset = _series(table, tag, _GYRO_TYPES[0])
    if len(time) < 2:
        return None, len(time)
    interval = float(np.median(np.diff(time)))
    near = np.ones(len(time), bool)
    columns = []
    for kind in (*_GYRO_TYPES, *_ACCEL_TYPES):
        known, value, _ = _series(table, tag, kind)
        after = np.clip(np.searchsorted(known, time), 1, max(len(known) - 1, 1))
        before = known[after - 1]
        behind = known[np.minimum(after, len(known) - 1)]
        apart = np.maximum(before - time, 0.0) + np.maximum(time - behind, 0.0)
        exact = (before == time) | (behind == time)
        near &= exact | ((apart <= 0.0) & (behind - before <= 3.0 * interval))
        columns.append(np.interp(time, known, value))
    rows = np.flatnonzero(near)
    if len(rows) == 0:
        return None, len(time)
    temp: FloatArray | None = None
    if np.any(table["type"] == _TEMPERATURE_TYPE):
        known, value, _ = _series(table, tag, _TEMPERATURE_TYPE)
        temp = np.interp(time[rows], known, value) * _TEMPERATURE_SCALE
    readings = np.stack(columns, axis=1)[rows]
    gps = _tie(counts, tick, table["offset"], fixes)
    return (
        ReceiverImu(
            tag_s=time[rows],
            gyro=readings[:, :3] * _GYRO_SCALE,
            accel=readings[:, 3:] * _ACCEL_SCALE,
            temp_c=temp,
            offset=offset[rows],
            gps_s=None if gps is None else np.asarray(gps[0] + gps[1] * time[rows], np.float64),
            tie_sd_s=TIE_SD_S,
            source=source,
        ),
        len(time) - len(rows),
    )


def _tick(table: Table) -> float:
    """Seconds per count of ESF-RAW's time tags, from the millisecond counter of its messages."""
    offset, first = np.unique(table["offset"], return_index=True)
    header = np.diff(table["header"][first].astype(np.uint32)).astype(np.int32)
    tags = np.diff(table["tag"][first].astype(np.uint32)).astype(np.int32)
    good = (header > 0) & (header < 60_000) & (tags > 0)
    if len(offset) < 3 or np.count_nonzero(good) < 0.9 * len(header):
        return _RAW_TICK_S
    return 1e-3 * float(np.sum(header[good])) / float(np.sum(tags[good]))


def _tie(
    counts: IntArray, tick: float, offset: IntArray, fixes: Fixes
) -> tuple[float, float] | None:
    """GPS time = a + b * tag, from the last reading in the log before each fix.

    Both are written soon after they were taken, so their places in the log tell their order
    in time. b is 1 unless a minute of fixes can show the drift of the sensor's clock.
    """
    place = np.searchsorted(offset, fixes.offset) - 1
    good = (place >= 0) & np.isfinite(fixes.gps_s)
    if not good.any():
        return None
    tag = counts[place[good]] * tick
    gps = fixes.gps_s[good]
    slope = 1.0
    if tag[-1] - tag[0] > 60.0:
        fitted = float(np.polyfit(tag - tag.mean(), gps - gps.mean(), 1)[0])
        if abs(fitted - 1.0) < 0.01:
            slope = fitted
    return float(np.median(gps - slope * tag)), slope
