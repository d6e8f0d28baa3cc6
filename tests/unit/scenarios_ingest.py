"""Recordings as they are read: units that only the numbers tell, clocks that run on, formats."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import AutoMapError
from tests.unit.receiver_scene import Receiver, simulated_fixes
from tests.unit.scenarios import scenario
from tests.unit.sync_scene import drive

_UNIX_S = 1_500_000_000


def _read(read: Callable[[Path], Any], text: bytes, name: str = "table.csv") -> Any:
    """What is read of a file, without the folder's name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        path.write_bytes(text)
        try:
            found = read(path)
        except AutoMapError as error:
            return str(error).replace(folder, "")
        told = {key: value for key, value in vars(found).items() if key != "path"}
        for key in ("warnings", "notes"):
            told[key] = [text.replace(folder, "") for text in told[key]]
        return told


def _lines(header: str, *columns: Any) -> bytes:
    rows = (",".join(map(str, row)) for row in zip(*columns, strict=True))
    return "\n".join([header, *rows, ""]).encode()


@scenario
def ingest_fix_tables() -> Any:
    """Speeds, courses, angles and times in each unit that a table may be in without a word."""
    from automap.io.fix_table import read_fix_table

    course = np.linspace(0.0, 359.9, 150)
    way = 12.0 * np.cumsum(np.exp(1j * np.radians(course))) / 6.371e6
    lat = np.round(48.0 + np.degrees(way.real), 7)
    lon = np.round(11.0 + np.degrees(way.imag) / np.cos(np.radians(48.0)), 7)
    t = _UNIX_S + np.arange(150)
    speed = np.full(150, 12.0)
    head = "time,lat,lon,speed,course,accuracy"
    accuracy = np.full(150, 4.0)
    cases = {
        "si": (t, lat, lon, speed, course, accuracy),
        "knots": (t, lat, lon, speed * 1.944, course, accuracy),
        "km_h": (t, lat, lon, speed * 3.6, course, accuracy),
        "gon": (t, lat, lon, speed, course / 0.9, accuracy),
        "milliseconds": (t * 1000, lat, lon, speed, course, accuracy),
        "cut": (t // 2 * 2, lat, lon, speed, course, accuracy),
        "held": (*(np.repeat(c, 3)[:150] for c in (t, lat, lon)), speed, course, accuracy),
        "back": (np.concatenate([t[:60], t[50:140]]), lat, lon, speed, course, accuracy),
        "exchanged": (t, lon + 100.0, lat, speed, course, accuracy),
        "radians": (t, np.radians(lat), np.radians(lon), speed, course, accuracy),
    }
    return {name: _read(read_fix_table, _lines(head, *case)) for name, case in cases.items()}


@scenario
def ingest_readings() -> Any:
    """Inertial readings in units that the names tell, in bursts, with rows that failed."""
    from automap.io.imu_csv import read_imu_csv

    t, gyro, accel, _ = drive(20.0, 50.0)
    t_ns = 5_000_000_000 + np.rint(t * 1e9).astype(np.int64)
    of = [*np.round(gyro, 6).T, *np.round(accel, 6).T]
    plain = "t_ns,gx,gy,gz,ax,ay,az"
    burst = t_ns[np.arange(len(t_ns)) // 10 * 10]
    failed = [np.where(np.arange(len(t)) % 97 == 5, 0.0, column) for column in of]
    cases = {
        "si": _lines(plain, t_ns, *of),
        "named": _lines(
            "time_ms,gx [deg/s],gy [deg/s],gz [deg/s],ax [g],ay [g],az [g]",
            *(t_ns // 1_000_000, *(np.degrees(c) for c in of[:3]), *(c / 9.80665 for c in of[3:])),
        ),
        "bursts": _lines(plain, burst, *of),
        "failed": _lines(plain, t_ns, *failed),
        "mixed_order": _lines(plain, t_ns.reshape(-1, 2)[:, ::-1].ravel(), *of),
        "words": _lines(plain, t_ns, *of).replace(b"\n5000000000,", b"\nbattery low,", 1),
    }
    return {name: _read(read_imu_csv, text) for name, text in cases.items()}


@scenario
def ingest_receiver_logs() -> Any:
    """What the writers of messages wrote, whole, mixed, cut off and with a damaged byte."""
    from automap.io.nmea_writer import gga_rmc
    from automap.io.receiver import read_receiver_log
    from automap.io.ubx_writer import nav_pvt

    fixes = simulated_fixes(7, Receiver(), 60.0)
    n = len(fixes)
    fixes = replace(
        fixes,
        geoid_sep_m=np.full(n, 47.5),
        hdop=np.full(n, 0.9),
        sd_pos_ned=np.full((n, 3), 2.0),
        sd_vel_ned=np.full((n, 3), 0.3),
    )
    nmea, ubx = gga_rmc(fixes), nav_pvt(fixes)
    logs = {
        "nmea": b"".join(nmea),
        "ubx": b"".join(ubx),
        "mixed": b"".join(a + b for a, b in zip(nmea, ubx, strict=False)),
        "cut": b"".join(ubx)[:-37],
        "damaged": b"".join(nmea[:20]).replace(b"E", b"W", 1) + b"".join(nmea[20:]),
    }
    return {name: _read(read_receiver_log, log, "gnss.log") for name, log in logs.items()}
