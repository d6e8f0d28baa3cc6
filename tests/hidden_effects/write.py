"""A drive folder of the contract from simulated records."""

from __future__ import annotations

import struct
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.gnss import GnssRecord
from tests.hidden_effects.imu import ImuRecord
from tests.hidden_effects.motion import State
from tests.hidden_effects.nmea import nmea_log

GPS_EPOCH = datetime(1980, 1, 6)
WEEK_S = 604800
LEAP_S = 18
GEOID_M = 0.0
"""The receiver states heights above the ellipsoid: the places lie all over the Earth, whose geoid
this package does not know."""


def write_drive(
    folder: Path,
    gps0: int,
    imu: ImuRecord,
    gnss: GnssRecord,
    lever_arm: Array,
    truth: State | None = None,
    video: str = "",
) -> None:
    """Write ``drive.toml``, ``imu.csv``, ``gnss.ubx`` (of a recorded receiver ``gnss.nmea``) and
    ``truth/trajectory.csv``.

    ``gps0`` is GPS time, s, at the recording's zero; IMU stamps are of GPS time. ``video`` is
    added to the manifest as it is.
    """
    folder.mkdir(parents=True, exist_ok=True)
    t_ns = gps0 * 10**9 + np.rint(imu.stamp * 1e9).astype(np.int64)
    _write_csv(
        folder / "imu.csv",
        "t_ns,gx,gy,gz,ax,ay,az,temp_c",
        "%d,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.2f",
        t_ns,
        np.column_stack([imu.gyro, imu.accel, imu.temp_c]),
    )
    log = "gnss.ubx" if gnss.hdop is None else "gnss.nmea"
    write_log = ubx_log if gnss.hdop is None else nmea_log
    (folder / log).write_bytes(write_log(gnss, gps0))
    arm = ", ".join(f"{value:.4f}" for value in lever_arm)
    (folder / "drive.toml").write_text(
        'schema = "automap.drive/1"\n'
        '[imu]\nfile = "imu.csv"\naxes = "FRD"\ntime = "gps_ns"\n'
        f'[gnss]\nfile = "{log}"\nlever_arm_m = [{arm}]\n{video}',
        encoding="utf-8",
    )
    if truth is not None:
        (folder / "truth").mkdir(exist_ok=True)
        degrees = np.degrees(np.column_stack([truth.lat, truth.lon]))
        _write_csv(
            folder / "truth" / "trajectory.csv",
            "t_ns,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg",
            "%d,%.11f,%.11f" + ",%.6f" * 7,
            gps0 * 10**9 + np.rint(truth.t * 1e9).astype(np.int64),
            np.column_stack([degrees, truth.height, truth.vel_ned, np.degrees(truth.rpy)]),
        )


def _write_csv(path: Path, header: str, form: str, t_ns: np.ndarray, values: Array) -> None:
    line = form + "\n"
    rows = zip(t_ns.tolist(), values.tolist(), strict=True)
    text = "".join([line % (stamp, *row) for stamp, row in rows])
    path.write_text(header + "\n" + text, encoding="utf-8")


def ubx_log(gnss: GnssRecord, gps0: int) -> bytes:
    """NAV-PVT, NAV-HPPOSLLH and NAV-COV of every fix.

    Reference: u-blox F9 HPG 1.32 interface description, UBX-22008968.
    """
    out = []
    lat, lon = np.degrees(gnss.lat), np.degrees(gnss.lon)
    for k, tag in enumerate(gnss.tag.tolist()):
        tow = round((gps0 % WEEK_S + tag) * 1000.0) % (WEEK_S * 1000)
        out.append(_pvt(gnss, k, tow, gps0 + tag, lat[k], lon[k]))
        out.append(_high_precision(gnss, k, tow, lat[k], lon[k]))
        out.append(_covariance(gnss, k, tow))
    return b"".join(out)


def _message(number: int, payload: bytes) -> bytes:
    body = struct.pack("<BBH", 0x01, number, len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes((a, b))


def _accuracy(gnss: GnssRecord, k: int) -> tuple[float, float, float]:
    """Horizontal radius, vertical, speed."""
    north, east, down = gnss.sd_pos[k]
    return float(np.hypot(north, east)), float(down), float(np.linalg.norm(gnss.sd_vel[k]))


def _pvt(gnss: GnssRecord, k: int, tow: int, gps_s: float, lat: float, lon: float) -> bytes:
    utc = GPS_EPOCH + timedelta(seconds=gps_s - LEAP_S)
    second = utc.replace(microsecond=0)
    north, east, down = (round(1000.0 * v) for v in gnss.vel[k])
    ground = round(1000.0 * float(np.hypot(gnss.vel[k, 0], gnss.vel[k, 1])))
    course = round(1e5 * float(np.degrees(np.arctan2(gnss.vel[k, 1], gnss.vel[k, 0])) % 360.0))
    horizontal, vertical, speed = _accuracy(gnss, k)
    height = round(1000.0 * gnss.height[k])
    payload = struct.pack(
        "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHHIihH",
        tow,
        second.year,
        second.month,
        second.day,
        second.hour,
        second.minute,
        second.second,
        0x37,
        20,
        utc.microsecond * 1000,
        3,
        0x01,
        0xE0,
        18,
        round(lon * 1e7),
        round(lat * 1e7),
        height,
        height - round(1000.0 * GEOID_M),
        max(1, round(1000.0 * horizontal)),
        max(1, round(1000.0 * vertical)),
        north,
        east,
        down,
        ground,
        course,
        max(1, round(1000.0 * speed)),
        100000,
        120,
        0,
        0,
        0,
        0,
        0,
    )
    return _message(0x07, payload)


def _high_precision(gnss: GnssRecord, k: int, tow: int, lat: float, lon: float) -> bytes:
    whole, rest = [], []
    for angle in (lon, lat):
        coarse = round(angle * 1e7)
        whole.append(coarse)
        rest.append(round(angle * 1e9 - coarse * 100))
    for metres in (gnss.height[k], gnss.height[k] - GEOID_M):
        coarse = round(metres * 1e3)
        whole.append(coarse)
        rest.append(round(metres * 1e4 - coarse * 10))
    horizontal, vertical, _ = _accuracy(gnss, k)
    payload = struct.pack(
        "<BHBI4i4b2I",
        0,
        0,
        0,
        tow,
        *whole,
        *rest,
        max(1, round(1e4 * horizontal)),
        max(1, round(1e4 * vertical)),
    )
    return _message(0x14, payload)


def _covariance(gnss: GnssRecord, k: int, tow: int) -> bytes:
    pos, vel = gnss.sd_pos[k] ** 2, gnss.sd_vel[k] ** 2
    values = []
    for north, east, down in (pos, vel):
        values += [north, 0.0, 0.0, east, 0.0, down]
    return _message(0x36, struct.pack("<IBBB9x12f", tow, 0, 1, 1, *values))
