"""Receiver messages made for the tests, byte by byte."""

from __future__ import annotations

import struct

import numpy as np

from automap import timebase as tb
from automap.io.ubx_layouts import LAYOUTS

WEEK = 2300
TOW = 300_000.0
GPS = float(tb.week_to_gps(WEEK, TOW))


def ubx(key: int, payload: bytes) -> bytes:
    body = struct.pack("<BBH", key >> 8, key & 255, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes([a, b])


def sentence(text: str) -> bytes:
    check = 0
    for byte in text.encode():
        check ^= byte
    return f"${text}*{check:02X}\r\n".encode()


def message(name: str, **fields: float) -> bytes:
    """A UBX message of integer fields, the others zero."""
    layout = LAYOUTS[name]
    payload = np.zeros(1, np.dtype([(field, "<" + kind) for field, kind, _ in layout.fields]))
    for field, value in fields.items():
        payload[field] = value
    return ubx(layout.key, payload.tobytes())


def calendar(gps_s: float) -> tuple[int, int, int, int, int, float]:
    utc = float(tb.gps_to_utc(gps_s))
    date = (np.datetime64("1980-01-06") + int(utc // 86400)).astype(object)
    day = utc % 86400
    return date.year, date.month, date.day, int(day // 3600), int(day // 60 % 60), day % 60


def pvt(gps_s: float, **fields: float) -> bytes:
    """NAV-PVT with a 3D fix unless told otherwise."""
    year, month, day, hour, minute, second = calendar(gps_s)
    values: dict[str, float] = {
        "iTOW": round(gps_s % tb.WEEK_S * 1e3),
        "year": year,
        "month": month,
        "day": day,
        "hour": hour,
        "min": minute,
        "second": int(second),
        "nano": round(second % 1 * 1e9),
        "valid": 7,
        "fixType": 3,
        "flags": 1,
        "numSV": 9,
        "lon": 1_500_000_000,
        "lat": -350_000_000,
        "height": 100_000,
        "hMSL": 80_000,
        "hAcc": 1_000,
        "vAcc": 2_000,
        "velN": 1_000,
        "velE": 2_000,
        "velD": -300,
        "sAcc": 173,
    }
    return message("NAV-PVT", **(values | fields))


def clock(gps_s: float) -> str:
    _, _, _, hour, minute, second = calendar(gps_s)
    return f"{hour:02d}{minute:02d}{second:05.2f}"


def gga(gps_s: float, quality: int = 1, position: str = "3500.0000,S,15000.0000,E") -> bytes:
    return sentence(f"GPGGA,{clock(gps_s)},{position},{quality},08,0.9,80.0,M,20.0,M,,")


def rmc(
    gps_s: float,
    status: str = "A",
    speed: str = "10.0",
    course: str = "90.0",
    date: str | None = None,
) -> bytes:
    year, month, day, *_ = calendar(gps_s)
    told = f"{day:02d}{month:02d}{year % 100:02d}" if date is None else date
    return sentence(
        f"GPRMC,{clock(gps_s)},{status},3500.0000,S,15000.0000,E,{speed},{course},{told},,,A"
    )


def zda(gps_s: float) -> bytes:
    year, month, day, *_ = calendar(gps_s)
    return sentence(f"GPZDA,{clock(gps_s)},{day:02d},{month:02d},{year},00,00")
