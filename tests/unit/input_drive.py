"""A small drive written from formulas, for tests of ingest and check."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

START = datetime(2024, 5, 1, 10, 0, 0, tzinfo=UTC)
LEAP_S = 18
BOOT_NS = 700_000_000_000
RATE_HZ = 50
SPAN_S = 90.0
_RADIUS = 6_371_000.0


@dataclass(frozen=True)
class Motion:
    """A level drive with curves and changing speed, sampled at ``t`` [n] seconds."""

    t: np.ndarray
    north: np.ndarray
    east: np.ndarray
    speed: np.ndarray
    yaw: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray


def motion() -> Motion:
    """Speed 12 + 4 sin, turn rate 0.2 sin: readings in vehicle axes (FRD)."""
    t = np.arange(0.0, SPAN_S, 1.0 / RATE_HZ)
    speed = 12.0 + 4.0 * np.sin(0.25 * t)
    turn = 0.2 * np.sin(0.4 * t)
    yaw = 0.5 * (1.0 - np.cos(0.4 * t))
    north = np.concatenate([[0.0], np.cumsum(speed * np.cos(yaw))[:-1]]) / RATE_HZ
    east = np.concatenate([[0.0], np.cumsum(speed * np.sin(yaw))[:-1]]) / RATE_HZ
    zero = np.zeros_like(t)
    noise = np.random.default_rng(3).normal(0.0, 0.01, (len(t), 6))
    gyro = np.column_stack([zero, zero, turn]) + 0.1 * noise[:, :3]
    accel = np.column_stack([np.cos(0.25 * t), speed * turn, zero - 9.81]) + noise[:, 3:]
    return Motion(t, north, east, speed, yaw, gyro, accel)


def write_drive(folder: Path, imu_section: str = "", gnss_section: str = "") -> Path:
    """IMU at 50 Hz on a host clock, NMEA at 1 Hz with arrival times; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "drive.toml").write_text(
        f'schema = "automap.drive/1"\nname = "formula"\n[imu]\n{imu_section}\n'
        f"[gnss]\nlever_arm_m = [0.2, 0.0, -1.0]\n{gnss_section}\n"
    )
    move = motion()
    write_imu_rows(folder, move.gyro, move.accel, move.t)
    write_gnss(folder, move)
    return folder


def write_imu_rows(folder: Path, gyro: np.ndarray, accel: np.ndarray, t: np.ndarray) -> None:
    """``imu.csv`` from readings [n, 3] at ``t`` [n] s after the start."""
    rows = ["t_ns,gx,gy,gz,ax,ay,az"]
    for stamp, values in zip(t, np.hstack([gyro, accel]), strict=True):
        numbers = ",".join(f"{value:.8g}" for value in values)
        rows.append(f"{BOOT_NS + round(stamp * 1e9)},{numbers}")
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")


def write_gnss(folder: Path, move: Motion) -> None:
    """``gnss.nmea`` and ``gnss_arrival.csv``: one epoch a second, 60 ms and more behind."""
    text = ""
    arrival = ["offset,t_ns"]
    late = np.random.default_rng(4).exponential(0.01, len(move.t))
    for row in range(0, len(move.t), RATE_HZ):
        stamp = START + timedelta(seconds=float(move.t[row]))
        delay = 0.06 + late[row]
        arrival.append(f"{len(text)},{BOOT_NS + round((move.t[row] + delay) * 1e9)}")
        text += _epoch(stamp, move, row)
    (folder / "gnss.nmea").write_text(text)
    (folder / "gnss_arrival.csv").write_text("\n".join(arrival) + "\n")


def _epoch(stamp: datetime, move: Motion, row: int) -> str:
    lat = -35.0 + np.degrees(move.north[row] / _RADIUS)
    lon = 149.0 + np.degrees(move.east[row] / (_RADIUS * np.cos(np.radians(35.0))))
    place = f"{angle(-lat, 2)},S,{angle(lon, 3)},E"
    knots = move.speed[row] / 0.514444
    course = np.degrees(move.yaw[row]) % 360.0
    time = stamp.strftime("%H%M%S.00")
    rmc = f"GNRMC,{time},A,{place},{knots:.3f},{course:.2f},{stamp:%d%m%y},,,A"
    gga = f"GNGGA,{time},{place},1,12,0.8,580.0,M,20.0,M,,"
    return sentence(rmc) + sentence(gga)


def angle(degrees: float, digits: int) -> str:
    """An angle that is not negative as NMEA has it, degrees and minutes."""
    whole = int(degrees)
    return f"{whole:0{digits}d}{60.0 * (degrees - whole):010.7f}"


def sentence(body: str) -> str:
    """An NMEA sentence with its checksum."""
    checksum = 0
    for character in body.encode():
        checksum ^= character
    return f"${body}*{checksum:02X}\r\n"
