"""Small recordings of RTKLIB."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from import_sources import FIX_NS, N_FIX, N_IMU, SPEED, force, gyro, place


def write_rtklib(folder: Path, carriage_returns_lost: bool = False) -> Path:
    """An RTKLIB recording: a u-blox log, IMU lines and their tags."""
    from automap.io.ubx_writer import nav_pvt
    from automap.records import Fixes
    from automap.timebase import unix_to_gps

    folder.mkdir(parents=True)
    n = N_FIX
    places = np.array([place(i) for i in range(n)])
    three = np.ones((n, 3))
    half = SPEED * np.sqrt(0.5)
    fixes = Fixes(
        gps_s=unix_to_gps(FIX_NS * 1e-9),
        lat_rad=np.radians(places[:, 0]),
        lon_rad=np.radians(places[:, 1]),
        height_m=places[:, 2],
        vel_ned=np.tile([half, half, 0.0], (n, 1)),
        sd_pos_ned=three,
        sd_vel_ned=three * 0.1,
        fix_type=np.full(n, 3),
        n_sats=np.full(n, 12),
        hdop=np.ones(n),
        geoid_sep_m=np.full(n, 20.0),
        offset=np.zeros(n, np.int64),
        arrival_ns=np.zeros(n, np.int64),
    )
    messages = nav_pvt(fixes)
    (folder / "gnss.ubx").write_bytes(b"".join(messages))
    ends = np.cumsum([len(m) for m in messages])
    ticks = np.arange(n) * 200 + 70
    _write_tag(folder / "gnss.ubx.tag", 1000, ticks, ends)
    lines = [
        ",".join(f"{v / 9.80665:.5f}" for v in force(i))
        + ","
        + ",".join(f"{np.degrees(v):.4f}" for v in gyro(i))
        + f",{50_000 + 10 * i}\r\n"
        for i in range(N_IMU)
    ]
    ends = np.cumsum([len(line) for line in lines])
    _write_tag(folder / "imu.csv.tag", 1000, np.arange(N_IMU) * 10 + 5 + np.arange(N_IMU) % 7, ends)
    text = "".join(lines)
    text = text.replace("\r", "") if carriage_returns_lost else text
    (folder / "imu.csv").write_bytes(text.encode())
    return folder


def _write_tag(path: Path, tick: int, ticks: np.ndarray, ends: np.ndarray) -> None:
    head = b"TIMETAG RTKLIB EX".ljust(60, b"\0") + struct.pack("<I", tick)
    head += struct.pack("<Id", 1_700_000_000, 0.25)
    rows = b"".join(struct.pack("<II", int(t), int(e)) for t, e in zip(ticks, ends, strict=True))
    path.write_bytes(head + rows)
