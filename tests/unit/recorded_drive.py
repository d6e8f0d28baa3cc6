"""A small drive to play, and a recorder of it in this process or in one of its own."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from automap.io.drive import load_drive
from pipeline.record.clock import HostClock
from pipeline.record.imu_format import load_format
from pipeline.record.ports import PortSpec
from pipeline.record.recorder import Plan, Recorder
from pipeline.record.replay import Feed, Replay, drive_feeds
from tests.unit.simulated_receiver import nav_pvt

BAUD = 460_800
PROGRAM = str(Path(sys.executable).with_name("automap"))


def write_drive(folder: Path, seconds: float = 3.0) -> Path:
    """A car at rest: 100 samples and 10 fixes a second."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(1)
    t_ns = 7_000_000_000 + np.arange(int(seconds * 100)) * 10_000_000
    readings = rng.normal([0, 0, 0, 0, 0, -9.8], [1e-3] * 3 + [0.05] * 3, (len(t_ns), 6))
    rows = [
        f"{t}," + ",".join(f"{value:.6f}" for value in row)
        for t, row in zip(t_ns.tolist(), readings, strict=True)
    ]
    (folder / "imu.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n" + "\n".join(rows) + "\n")
    messages = [nav_pvt(378_000_000 + 100 * k) for k in range(int(seconds * 10))]
    (folder / "gnss.ubx").write_bytes(b"".join(messages))
    lines = [f"{100 * k},{7_070_000_000 + k * 100_000_000}" for k in range(len(messages))]
    (folder / "gnss_arrival.csv").write_text("offset,t_ns\n" + "\n".join(lines) + "\n")
    (folder / "drive.toml").write_text(
        'schema = "automap.drive/1"\nname = "rest"\n[gnss]\nlever_arm_m = [0.4, 0.1, -1.2]\n'
        '[imu]\naxes = "FLU"\n[site]\ncountry = "AU"\n'
    )
    return folder


@contextmanager
def terminals(drive: Path, links: Path) -> Iterator[Replay]:
    """The devices of a drive, not yet sending."""
    player = Replay(drive_feeds(load_drive(drive)), links, BAUD)
    try:
        yield player
    finally:
        player.close()


def plan_for(links: Path, **options: object) -> Plan:
    """A plan that records both terminals."""
    return Plan(
        gnss=PortSpec(str(links / "gnss"), BAUD),
        imu=PortSpec(str(links / "imu"), BAUD),
        imu_format=load_format("automap-csv"),
        **options,  # type: ignore[arg-type]
    )


@contextmanager
def recording(folder: Path, plan: Plan, factor: float = 1.0) -> Iterator[Recorder]:
    """A recorder in this process."""
    recorder = Recorder(folder, plan, HostClock(factor))
    recorder.start()
    try:
        yield recorder
    finally:
        if not recorder.stopped:
            recorder.stop()


def record_command(folder: Path, links: Path, *more: str) -> list[str]:
    """The command line that records both terminals."""
    ports = [f"--{name}={links / name}@{BAUD}" for name in ("gnss", "imu")]
    return [PROGRAM, "record", "-o", str(folder), *ports, "--imu-format=automap-csv", *more]


def start_recorder(folder: Path, links: Path, *more: str) -> subprocess.Popen[str]:
    """A recorder in a process of its own."""
    return subprocess.Popen(
        record_command(folder, links, *more),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def play_in_background(player: Replay, **options: object) -> threading.Thread:
    """Send everything, once somebody has opened the terminals."""

    def play() -> None:
        if player.wait_opened(30.0):
            player.play(**options)  # type: ignore[arg-type]

    thread = threading.Thread(target=play, daemon=True)
    thread.start()
    return thread


def wait_until(true: Callable[[], bool], timeout_s: float = 60.0) -> bool:
    """Whether something becomes true in time."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.02)
    return False


def feed_of(player: Replay, name: str) -> Feed:
    """The feed of one device."""
    return next(feed for feed in player.feeds if feed.name == name)
