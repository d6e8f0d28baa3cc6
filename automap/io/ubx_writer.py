"""UBX NAV-PVT messages, as a u-blox receiver of generation 8 and later writes them."""

from __future__ import annotations

import struct
from datetime import UTC, datetime, timedelta

import numpy as np

from automap.records import Fixes, FixType
from automap.timebase import WEEK_S, leap_seconds_at_gps

_GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
_PVT = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiiiiiIIHHIiHh")  # 92 bytes

_FLAGS = {FixType.DGNSS: 0x03, FixType.FLOAT: 0x43, FixType.FIXED: 0x83}
"""gnssFixOK, diffSoln and carrSoln of NAV-PVT; other fixes have the first alone."""


def nav_pvt(fixes: Fixes) -> list[bytes]:
    """One whole NAV-PVT message per epoch.

    u-blox's accuracy figures are radial: hAcc covers two axes, sAcc three. An epoch without
    fix repeats what stands in the record and carries fixType 0 and no gnssFixOK. Source:
    u-blox 8 / M8 receiver description, UBX-NAV-PVT.
    """
    return [frame(0x01, 0x07, _pvt_payload(fixes, i)) for i in range(len(fixes))]


def frame(kind: int, number: int, payload: bytes) -> bytes:
    """A UBX message: sync, class and number, length, payload, checksum."""
    body = struct.pack("<BBH", kind, number, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes((a, b))


def _pvt_payload(fixes: Fixes, i: int) -> bytes:
    ms = round(float(fixes.gps_s[i]) * 1e3)
    utc = _GPS_EPOCH + timedelta(milliseconds=ms)
    utc -= timedelta(seconds=float(leap_seconds_at_gps(ms * 1e-3)))
    # the calendar fields are rounded to the nearest second, nano is the signed rest
    second = utc + timedelta(microseconds=500_000)
    second = second.replace(microsecond=0)
    nano = round((utc - second).total_seconds() * 1e9)
    good = fixes.fix_type[i] >= FixType.TWO_D
    vel = np.rint(fixes.vel_ned[i] * 1e3).astype(int)
    ground = float(np.hypot(*fixes.vel_ned[i, :2]))
    heading = float(np.degrees(np.arctan2(fixes.vel_ned[i, 1], fixes.vel_ned[i, 0])) % 360.0)
    h_acc = float(np.hypot(*fixes.sd_pos_ned[i, :2])) * 1e3
    s_acc = float(np.linalg.norm(fixes.sd_vel_ned[i])) * 1e3
    head_acc = np.degrees(np.arctan2(s_acc * 1e-3, max(ground, 0.1)))
    height = float(fixes.height_m[i]) * 1e3
    return _PVT.pack(
        ms % (WEEK_S * 1000),
        second.year, second.month, second.day, second.hour, second.minute, second.second,
        0x07,  # date and time valid and fully resolved
        25,  # tAcc, ns
        nano,
        3 if good else 0,
        _FLAGS.get(FixType(int(fixes.fix_type[i])), 0x01) if good else 0x00,
        0xEA if good else 0xE2,
        int(fixes.n_sats[i]),
        round(np.degrees(fixes.lon_rad[i]) * 1e7),
        round(np.degrees(fixes.lat_rad[i]) * 1e7),
        round(height),
        round(height - float(fixes.geoid_sep_m[i]) * 1e3),
        round(h_acc),
        round(float(fixes.sd_pos_ned[i, 2]) * 1e3),
        int(vel[0]), int(vel[1]), int(vel[2]),
        round(ground * 1e3),
        round(heading * 1e5),
        round(s_acc),
        round(min(head_acc, 180.0) * 1e5),
        round(float(fixes.hdop[i]) * 160.0),  # PDOP, typically 1.6 HDOP, times 100
        0, 0, 0, 0, 0,
    )  # fmt: skip
