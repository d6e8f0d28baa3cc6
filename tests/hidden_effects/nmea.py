"""A recorded receiver's log: GGA and RMC of every fix, with the digits of the recording."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from tests.hidden_effects.gnss import GnssRecord
from tests.hidden_effects.real_receiver import KNOT

GPS_EPOCH = datetime(1980, 1, 6)
LEAP_S = 18


def nmea_log(gnss: GnssRecord, gps0: int) -> bytes:
    """GGA and RMC of all fixes; ``gps0`` GPS time, s, at zero of ``gnss.tag``."""
    assert gnss.hdop is not None
    speed = np.hypot(gnss.vel[:, 0], gnss.vel[:, 1]) / KNOT
    course = np.degrees(np.arctan2(gnss.vel[:, 1], gnss.vel[:, 0])) % 360.0
    out = []
    for k, tag in enumerate(gnss.tag.tolist()):
        utc = GPS_EPOCH + timedelta(seconds=gps0 + tag - LEAP_S)
        clock, day = utc.strftime("%H%M%S.") + f"{utc.microsecond // 10_000:02d}", utc
        place = f"{_angle(gnss.lat[k], 2, 'NS')},{_angle(gnss.lon[k], 3, 'EW')}"
        height = f"{gnss.height[k]:.2f},M,0.0,M"
        turn = 0.0 if speed[k] == 0.0 else course[k]
        out.append(_line(f"GPGGA,{clock},{place},1,,{gnss.hdop[k]:.2f},{height},0.0,0000"))
        moves = f"{speed[k]:05.1f},{turn:05.1f}"
        out.append(_line(f"GPRMC,{clock},A,{place},{moves},{day.strftime('%d%m%y')},,,A"))
    return "".join(out).encode("ascii")


def _angle(value: float, digits: int, sides: str) -> str:
    minutes = round(abs(float(np.degrees(value))) * 60.0 * 1e6)
    whole, rest = divmod(minutes, 60 * 10**6)
    return f"{whole:0{digits}d}{rest / 1e6:09.6f},{sides[0] if value >= 0.0 else sides[1]}"


def _line(body: str) -> str:
    check = 0
    for byte in body.encode("ascii"):
        check ^= byte
    return f"${body}*{check:02X}\r\n"
