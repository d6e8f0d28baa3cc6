"""The drives that faults are put into, each with its truth: recorded ones and a simulated one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.frames import rpy_to_matrix
from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import NO_TIME, Trajectory
from tests.benchmarks.faults import pos_log
from tests.benchmarks.faults.log import Floats
from tests.benchmarks.faults.recording import Recording, part_of, read_log, read_recording

WANDER_M, WANDER_UP_M, TAU_S, WHITE_M, VELOCITY_SD = 1.0, 1.8, 60.0, 0.3, 0.07
"""Errors put on centimetre fixes: those that the KITTI drives' fixes have."""
EVERY = 4
SEED = 20250708


RTK_TURN_DEG = (180.6, 6.8, 185.4)
"""Roll, pitch, yaw from sensor to vehicle of ``rtk-car-a``, as published with it."""
TOWN_TURN_DEG = (11.0, -7.0, 100.0)
"""Those of the simulated IMU, and by how much the manifest is off, as by eye."""
TOWN_OFF_DEG = (1.0, -1.5, 2.0)


def city(folder: Path) -> Recording:
    """A drive with its truth, as recorded."""
    return read_recording(folder, read_truth_trajectory(folder / "truth" / "trajectory.csv"))


def phone(folder: Path) -> Recording:
    """Seven minutes of the half hour: standing, streets and motorway."""
    recording = city(folder)
    recording.cut(420.0)
    return recording


def rtk(folder: Path) -> Recording:
    """One of four fixes, with a receiver's errors and sigmas; all fixed ones are the truth.

    The errors are drawn as the KITTI drives' were, and the rows state them honestly.
    """
    whole = read_log(folder / "gnss.pos", None)
    recording = read_recording(folder, _truth_of(folder / "gnss.pos"))
    log = whole.take(np.arange(0, len(whole), EVERY))
    rng = np.random.default_rng(SEED)
    t, n = log.gps_s, len(log)
    north, east = (wander(rng, t, WANDER_M) + rng.normal(0.0, WHITE_M, n) for _ in range(2))
    log.now.move(north, east)
    log.now.height += wander(rng, t, WANDER_UP_M) + rng.normal(0.0, WHITE_M, n)
    log.now.add_velocity(*rng.normal(0.0, VELOCITY_SD, (2, n)), np.ones(n, bool))
    log.now.climb += rng.normal(0.0, VELOCITY_SD, n)
    sigmas = float(np.hypot(WANDER_M, WHITE_M)), float(np.hypot(WANDER_UP_M, WHITE_M))
    rows = [
        pos_log.with_sigmas(log.write(m, log.was.epoch(k), log.now.epoch(k))[0], *sigmas, 0.07)
        for k, m in enumerate(log.messages)
    ]
    told = log.now.take(np.arange(n))
    recording.state_axes(as_toml(matrix_of(RTK_TURN_DEG)))
    # times stay as they were noted: only so are they the rows' own
    recording.log = type(log)(
        [[row] for row in rows], log.arrival, told, log.write, log.gps_offset_s, log.head
    )
    return recording


def wander(rng: np.random.Generator, t: Floats, sd: float) -> Floats:
    """A first-order Gauss-Markov process [n] at the times ``t``."""
    out = rng.normal(0.0, sd, len(t))
    keep = np.exp(-np.diff(t) / TAU_S)
    for k, share in enumerate(keep):
        out[k + 1] = share * out[k] + np.sqrt(1.0 - share**2) * out[k + 1]
    return out


def _truth_of(path: Path) -> Trajectory:
    log = read_log(path, None)
    n = len(log)
    fixed = np.array([row[0].split()[pos_log.QUALITY].startswith(b"1") for row in log.messages])
    unknown = np.full((n, 3), np.nan)
    # the velocity columns are differences of positions, and of half an epoch before
    truth = Trajectory(
        t_ns=np.full(n, NO_TIME, np.int64),
        gps_s=log.gps_s,
        lat_rad=np.radians(log.was.lat),
        lon_rad=np.radians(log.was.lon),
        height_m=log.was.height,
        vel_ned=unknown,
        rpy=unknown,
        sd_pos_ned=unknown,
        sd_vel_ned=unknown,
        sd_rpy=unknown,
    )
    return part_of(truth, fixed)


def half(folder: Path) -> Recording:
    """Five minutes of a drive of eight."""
    recording = city(folder)
    recording.cut(300.0)
    return recording


def turned(folder: Path) -> Recording:
    """A simulated drive whose IMU was mounted askew, as the manifest says but for some degrees."""
    recording = city(folder)
    mounted = matrix_of(TOWN_TURN_DEG)
    rows = np.ones(len(recording.imu.lines), bool)
    for triad in "ga":
        names = [f"{triad}{axis}" for axis in "xyz"]
        read = np.column_stack([recording.imu.values(name) for name in names]) @ mounted
        for name, column in zip(names, read.T, strict=True):
            recording.imu.put(name, rows, column)
    off = tuple(a + b for a, b in zip(TOWN_TURN_DEG, TOWN_OFF_DEG, strict=True))
    recording.state_axes(as_toml(matrix_of(off)))
    return recording


def matrix_of(rpy_deg: tuple[float, ...]) -> Floats:
    """The rotation [3, 3] from sensor to vehicle by ZYX angles."""
    return np.asarray(rpy_to_matrix(np.radians(rpy_deg)))


def as_toml(matrix: Floats) -> str:
    """A matrix [3, 3] as the manifest writes it."""
    return str([[round(float(value), 5) for value in row] for row in matrix])


@dataclass(frozen=True)
class Source:
    """``read`` makes a recording, with its axes stated, of a drive's folder, which is one of the
    recordings or what ``automap simulate`` makes of ``scenario``; ``what`` says what it is."""

    read: Callable[[Path], Recording]
    what: str
    scenario: Path | None = None


DRIVES: dict[str, Source] = {
    "gsdc-mtv1": Source(
        phone, "a phone's NMEA at 1 Hz, real fixes, seven minutes of street and motorway"
    ),
    "kitti-20111003-0034": Source(
        half, "NMEA at 5 Hz with arrival times, five of eight minutes of town"
    ),
    "kitti-20110930-0033": Source(city, "UBX at 5 Hz with arrival times, three minutes of town"),
    "rtk-car-a": Source(
        rtk,
        "every fourth RTK fix, a usual receiver's errors added; coarse IMU, upside down and turned",
    ),
    "town": Source(
        turned,
        "simulated: a u-blox receiver's UBX at 5 Hz, five minutes; IMU turned by 100 deg, tilted "
        "by 13",
        Path(__file__).with_name("town.toml"),
    ),
}
"""By name, of the recorded ones also that of the folder."""
