"""The recorded drives that faults are put into, each with its truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from automap.io.truth_trajectory import read_truth_trajectory
from automap.records import NO_TIME, Trajectory
from tests.benchmarks.faults import pos_log
from tests.benchmarks.faults.log import Floats
from tests.benchmarks.faults.recording import Recording, part_of, read_log, read_recording

WANDER_M, WANDER_UP_M, TAU_S, WHITE_M, VELOCITY_SD = 1.0, 1.8, 60.0, 0.3, 0.07
"""Errors put on centimetre fixes: those that the KITTI drives' fixes have."""
EVERY = 4
SEED = 20250708


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


DRIVES: dict[str, Callable[[Path], Recording]] = {
    "gsdc-mtv1": phone,
    "kitti-20111003-0034": city,
    "kitti-20110930-0033": city,
    "rtk-car-a": rtk,
}
"""Reader of each by the name of its folder: NMEA at 1 Hz of a phone, NMEA at 5 Hz and UBX at 5 Hz
with arrival times, RTKLIB's table at 1 Hz."""
