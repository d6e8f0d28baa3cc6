"""Positions as NMEA sentences, for sources that give what a receiver would have sent."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from automap.records import Fixes, FixType, FloatArray, IntArray
from automap.timebase import gps_to_unix


@dataclass(frozen=True)
class Positions:
    """Positions as a logger kept them, one row each [n]; NaN is unknown.

    ``unix_ms`` the UTC tag, ``height_m`` above the ellipsoid, ``speed_m_s`` over ground,
    ``course_deg`` clockwise from north, ``down_m_s``, accuracies ``h_acc_m`` and ``v_acc_m``,
    ``hdop``; ``fix`` [n] is 0 for none, 2 or 3 dimensions.
    """

    unix_ms: IntArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    speed_m_s: FloatArray
    course_deg: FloatArray
    down_m_s: FloatArray
    h_acc_m: FloatArray
    v_acc_m: FloatArray
    hdop: FloatArray
    fix: IntArray

    def __len__(self) -> int:
        return len(self.unix_ms)


def unknown(n: int) -> FloatArray:
    """A column [n] of what the source does not give."""
    return np.full(n, np.nan)


def nmea_positions(positions: Positions) -> tuple[bytes, IntArray]:
    """The positions as sentences, and the byte [n] where each starts.

    RMC gives date, speed and course, PUBX,00 the position with its height above the ellipsoid,
    accuracies and vertical velocity. What is unknown stays empty.
    """
    p = positions
    parts: list[bytes] = []
    offsets = np.empty(len(p), np.int64)
    length = 0
    stamps = p.unix_ms.astype("datetime64[ms]").astype(object)
    for i, stamp in enumerate(stamps):
        clock = f"{stamp:%H%M%S}.{stamp.microsecond // 1000:03d}"
        good = p.fix[i] >= 2 and np.isfinite(p.lat_deg[i]) and np.isfinite(p.lon_deg[i])
        place = ",,,"
        if good:
            place = _place(float(p.lat_deg[i]), float(p.lon_deg[i]))
        speed, course = float(p.speed_m_s[i]), float(p.course_deg[i]) % 360.0
        state = f"G{p.fix[i]}" if good else "NF"
        epoch = sentence(
            f"GNRMC,{clock},{'A' if good else 'V'},{place},{_field(speed * 3600.0 / 1852.0, 5)},"
            f"{_field(course, 5)},{stamp:%d%m%y},,,{'A' if good else 'N'}"
        ) + sentence(
            f"PUBX,00,{clock},{place},{_field(p.height_m[i], 4)},{state},"
            f"{_field(p.h_acc_m[i], 3)},{_field(p.v_acc_m[i], 3)},{_field(speed * 3.6, 5)},"
            f"{_field(course, 5)},{_field(p.down_m_s[i], 4)},,{_field(p.hdop[i], 2)},,,,0,0"
        )
        offsets[i] = length
        length += len(epoch)
        parts.append(epoch)
    return b"".join(parts), offsets


def gga_rmc(fixes: Fixes) -> list[bytes]:
    """GGA and RMC of each epoch, as phones write them: speeds to a tenth of a knot, courses to a
    tenth of a degree, no accuracy but HDOP. Without a fix the place stays empty."""
    unix_s = gps_to_unix(fixes.gps_s)
    return [_gga(fixes, i, t) + _rmc(fixes, i, t) for i, t in enumerate(unix_s.tolist())]


_QUALITY = {FixType.DGNSS: 2, FixType.FIXED: 4, FixType.FLOAT: 5}


def _gga(fixes: Fixes, i: int, unix_s: float) -> bytes:
    stamp, place, good = _when_and_where(fixes, i, unix_s)
    quality = _QUALITY.get(FixType(int(fixes.fix_type[i])), 1) if good else 0
    separation = float(np.nan_to_num(fixes.geoid_sep_m[i]))
    height = f"{fixes.height_m[i] - separation:.2f}" if good else ""
    return sentence(
        f"GPGGA,{stamp:%H%M%S}.{stamp.microsecond // 10_000:02d},{place},{quality},"
        f"{fixes.n_sats[i]:02d},{_field(fixes.hdop[i], 2)},{height},M,{separation:.1f},M,,"
    )


def _rmc(fixes: Fixes, i: int, unix_s: float) -> bytes:
    stamp, place, good = _when_and_where(fixes, i, unix_s)
    north, east = (float(v) for v in fixes.vel_ned[i, :2])
    knots = f"{np.hypot(north, east) * 3600.0 / 1852.0:05.1f}"
    course = f"{np.degrees(np.arctan2(east, north)) % 360.0:05.1f}".replace("360.0", "000.0")
    return sentence(
        f"GPRMC,{stamp:%H%M%S}.{stamp.microsecond // 10_000:02d},{'A' if good else 'V'},{place},"
        f"{knots if good else ''},{course if good else ''},{stamp:%d%m%y},,,{'A' if good else 'N'}"
    )


def _when_and_where(fixes: Fixes, i: int, unix_s: float) -> tuple[datetime, str, bool]:
    """UTC to a hundredth of a second, latitude and longitude as sentences have them, validity."""
    whole, hundredths = divmod(round(unix_s * 100.0), 100)
    stamp = datetime.fromtimestamp(whole, UTC) + timedelta(milliseconds=10 * hundredths)
    good = bool(fixes.fix_type[i] != FixType.NONE)
    lat, lon = np.degrees(fixes.lat_rad[i]), np.degrees(fixes.lon_rad[i])
    return stamp, _place(lat, lon) if good else ",,,", good


def _place(lat_deg: float, lon_deg: float) -> str:
    sides = "N" if lat_deg >= 0.0 else "S", "E" if lon_deg >= 0.0 else "W"
    return f"{angle(lat_deg, 2)},{sides[0]},{angle(lon_deg, 3)},{sides[1]}"


def _field(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""


def angle(degrees: float, digits: int) -> str:
    """Degrees and minutes, ``ddmm.mmmmmmm``; to a tenth of a millimetre on the ground."""
    # rounded as a whole, so that minutes never show as 60
    units = round(abs(float(degrees)) * 60.0 * 10_000_000)
    minutes, fraction = divmod(units, 10_000_000)
    whole, rest = divmod(minutes, 60)
    return f"{whole:0{digits}d}{rest:02d}.{fraction:07d}"


def sentence(body: str) -> bytes:
    """A sentence with its checksum and line end."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("ascii")
