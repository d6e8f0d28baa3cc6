"""The recorder as a user runs it: processes that are killed, full disks, ten minutes."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from automap.io.drive import Drive, load_drive
from automap.io.recording import read_recording
from pipeline.record.ports import PortSpec
from pipeline.record.recorder import Plan
from pipeline.record.replay import Replay, Terminal, copy_rest
from pipeline.record.ublox import Setup
from tests.unit.recorded_drive import (
    BAUD,
    PROGRAM,
    feed_of,
    play_in_background,
    record_command,
    recording,
    start_recorder,
    terminals,
    wait_until,
    write_drive,
)
from tests.unit.simulated_receiver import (
    PVT_KEY_UART1,
    SimulatedReceiver,
    nav_pvt,
    open_descriptors,
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals"),
]


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "drive")


def events(folder: Path) -> str:
    return (folder / "recording.log").read_text(encoding="utf-8")


def imu_lines(folder: Path) -> list[str]:
    return (folder / "imu.csv").read_text().splitlines()


def test_a_receiver_that_is_reset_is_found_and_set_again(tmp_path: Path) -> None:
    """It comes back at its first line rate with its first settings."""
    receiver = SimulatedReceiver(tmp_path / "gnss", baud=9600, chatter=True)
    receiver.start()
    out = tmp_path / "out"
    plan = Plan(gnss=PortSpec(str(tmp_path / "gnss"), 9600), setup=Setup(rate_hz=10, baud=115200))
    with recording(out, plan, factor=5.0) as recorder:
        assert wait_until(lambda: "115200 baud" in events(out))
        assert receiver.baud == 115200
        assert wait_until(lambda: recorder.snapshot().gnss.epochs > 5)
        receiver.reset()
        receiver.period_ms = 200
        assert wait_until(lambda: receiver.keys[PVT_KEY_UART1] == 1, 40.0)
        assert wait_until(lambda: receiver.baud == 115200)
        epochs = recorder.snapshot().gnss.epochs
        assert wait_until(lambda: recorder.snapshot().gnss.epochs > epochs + 5)
    receiver.stop()
    assert (out / "gnss.ubx").read_bytes() in bytes(receiver.sent)
    assert "speaks at 9600 baud now" in events(out)


@dataclass
class Running:
    """A recorder in a process of its own that is recording a replay."""

    process: subprocess.Popen[str]
    replay: Replay
    feeding: threading.Thread

    def end(self, number: int = signal.SIGINT) -> tuple[str, str]:
        """Ask it to end; what it wrote."""
        self.process.send_signal(number)
        return self.process.communicate(timeout=60)


@contextmanager
def running(drive: Path, tmp_path: Path, *more: str) -> Iterator[Running]:
    """A recorder that has 60 samples already, more to come."""
    out, links = tmp_path / "out", tmp_path / "car"
    with terminals(drive, links) as player:
        process = start_recorder(out, links, "--plain", *more)
        try:
            feeding = play_in_background(player, settle_s=0.5)
            table = out / "imu.csv"
            assert wait_until(lambda: table.exists() and len(imu_lines(out)) > 60, 60.0)
            yield Running(process, player, feeding)
        finally:
            process.kill()
            process.wait(10)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_recording_in_order(drive: Path, tmp_path: Path, number: int) -> None:
    out = tmp_path / "out"
    with running(drive, tmp_path) as run:
        text, _ = run.end(number)
    assert run.process.returncode == 0
    assert str(out) in text
    assert (out / "recording.json").exists()
    assert feed_of(run.replay, "imu").data.startswith((out / "imu.raw").read_bytes())


def test_interrupted_before_its_duration_is_over(drive: Path, tmp_path: Path) -> None:
    with running(drive, tmp_path, "--duration", "60") as run:
        run.end()
    assert run.process.returncode == 130


def test_killed_it_leaves_a_usable_drive(drive: Path, tmp_path: Path) -> None:
    """kill -9: all but the last second is there and can be read."""
    out = tmp_path / "out"
    with running(drive, tmp_path) as run:
        run.feeding.join(20)  # everything has been sent
        time.sleep(1.0)
        run.process.kill()
        run.process.wait(10)
        # the processes that read the ports end with it
        assert wait_until(lambda: not any(t.opened for t in run.replay.terminals.values()))
    assert (out / "gnss.ubx").read_bytes() == feed_of(run.replay, "gnss").data
    assert len(imu_lines(out)) == 301
    recorded = read_recording(load_drive(out))
    assert not recorded.failures
    assert recorded.fixes is not None
    assert len(recorded.fixes) == 30


def test_killed_in_the_middle_it_has_all_but_the_last_second(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with running(drive, tmp_path) as run:
        killed_ns = time.monotonic_ns()
        run.process.kill()
        run.process.wait(10)
    recorded = read_recording(load_drive(out))
    assert recorded.imu is not None
    assert not recorded.failures
    # written every tenth of a second; a second on a machine that is busy
    assert killed_ns - recorded.imu.t_ns[-1] < 1_000_000_000
    assert feed_of(run.replay, "gnss").data.startswith((out / "gnss.ubx").read_bytes())


def limit(process: subprocess.Popen[str], size: int) -> None:
    """No file of the process may grow beyond so many bytes from now on."""
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def test_a_disk_that_is_full_for_a_while_costs_nothing(drive: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands in for the disk, and is lifted later."""
    out = tmp_path / "out"
    with running(drive, tmp_path) as run:
        full = (out / "imu.raw").stat().st_size + 2000
        limit(run.process, full)
        run.feeding.join(20)
        time.sleep(1.5)
        stopped_at = (out / "imu.raw").stat().st_size
        limit(run.process, resource.RLIM_INFINITY)
        time.sleep(1.0)
        _, errors = run.end()
    assert stopped_at <= full
    assert run.process.returncode == 0
    assert "kept in memory meanwhile" in errors
    assert (out / "imu.raw").read_bytes() == feed_of(run.replay, "imu").data
    assert (out / "gnss.ubx").read_bytes() == feed_of(run.replay, "gnss").data
    assert len(imu_lines(out)) == 301


def test_a_disk_that_stays_full_is_an_error_that_leaves_the_beginning(
    drive: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with running(drive, tmp_path) as run:
        full = (out / "imu.raw").stat().st_size + 500
        limit(run.process, full)
        run.feeding.join(20)
        time.sleep(1.0)
        _, errors = run.end()
    assert run.process.returncode == 4
    assert "could not be written" in errors
    kept = (out / "imu.raw").read_bytes()
    assert feed_of(run.replay, "imu").data.startswith(kept)
    assert 0 < len(kept) <= full
    recorded = read_recording(load_drive(out))
    assert not recorded.failures


def resident_kb() -> int:
    """What this process occupies now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() // 1024


def test_memory_and_descriptors_stay_flat(tmp_path: Path) -> None:
    """A minute and a half's worth of a full line through one recorder."""
    out = tmp_path / "out"
    terminal = Terminal(tmp_path / "gnss")
    block = b"".join(nav_pvt(100 * k) for k in range(280))
    log = out / "gnss.ubx"
    with recording(out, Plan(gnss=PortSpec(str(tmp_path / "gnss"), BAUD))) as recorder:

        def send(blocks: range) -> None:
            for number in blocks:
                terminal.write(block)
                # memory is meant for a stream at its pace, not for a backlog of the test's making
                assert wait_until(lambda n=number: log.stat().st_size >= n * len(block), 60.0)

        send(range(40))
        before = resident_kb()
        descriptors = open_descriptors()
        send(range(40, 160))
        assert wait_until(lambda: log.stat().st_size == 160 * len(block))
        assert open_descriptors() == descriptors
        assert resident_kb() - before < 4_000
        ending = recorder.stop()
    terminal.close()
    assert ending.epochs == 44_800
    assert log.read_bytes() == block * 160


@pytest.mark.parametrize("name", ["kitti-20110926-0014", "kitti-20110930-0034"])
def test_a_recorded_replay_gives_the_same_map(shared_data: Path, tmp_path: Path, name: str) -> None:
    """Ten times as fast as it was driven, on two lines at 460800 baud."""
    source = shared_data / "drives" / name
    out, links = tmp_path / "recorded", tmp_path / "car"
    more = ["--speed", "10", "--feed-log"]
    player = subprocess.Popen(
        [PROGRAM, "record", "--replay", str(source), "--links", str(links), *more],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert wait_until(lambda: (links / "imu").is_symlink() and (links / "gnss").is_symlink(), 60.0)
    time.sleep(0.3)
    command = record_command(out, links, "--plain", "--rig", str(source), "--time-scale", "10")
    recorder = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    text, _ = player.communicate(timeout=300)
    assert player.returncode == 0, text
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=60)
    assert recorder.returncode == 0
    drive = load_drive(source)
    assert drive.gnss_file is not None
    assert (out / "gnss.ubx").read_bytes() == drive.gnss_file.read_bytes()
    recorded, original = (
        np.genfromtxt(folder / "imu.csv", delimiter=",", names=True, dtype=np.float64)
        for folder in (out, source)
    )
    for column in ("gx", "gy", "gz", "ax", "ay", "az"):
        np.testing.assert_array_equal(recorded[column], original[column])
    shift = int(np.median(recorded["t_ns"] - original["t_ns"]))
    stamps, theirs = (
        read_recording(load_drive(folder)).imu.t_ns
        for folder in (out, source)  # type: ignore[union-attr]
    )
    assert np.std(stamps - theirs) < 10e6  # a millisecond of the host's, ten times as fast
    add_camera(drive, out, shift)
    maps = [run_map(folder, tmp_path / f"out{i}") for i, folder in enumerate((source, out))]
    (t0, path0, signs0), (t1, path1, signs1) = maps
    inside = (t0 + shift >= t1[0]) & (t0 + shift <= t1[-1])
    assert np.mean(inside) > 0.99
    apart = [np.interp(t0[inside] + shift, t1, path1[:, k]) - path0[inside, k] for k in range(3)]
    # fixes good to 1.5 m; stamps moved by a millisecond of the recorder's time, which is ten
    # of the drive's
    assert np.sqrt(np.mean(np.sum(np.square(apart), axis=0))) < 0.15
    assert abs(len(signs0) - len(signs1)) <= 1
    nearest = [np.min(np.linalg.norm(signs1 - place, axis=1)) for place in signs0]
    assert np.median(nearest) < 0.3


def add_camera(drive: Drive, out: Path, shift: int) -> None:
    """The drive's sightings, which are no part of the replay, with their stamps moved."""
    copy_rest(drive, out, shift)
    text = drive.manifest_file.read_text(encoding="utf-8")
    sections = [section for section in text.split("\n\n") if section.startswith("[video.")]
    with (out / "drive.toml").open("a", encoding="utf-8") as manifest:
        manifest.write("\n" + "\n\n".join(sections) + "\n")


def run_map(folder: Path, out: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps [n], path [n, 3] in metres from a place of the drive, signs [k, 2] likewise."""
    import pandas as pd

    subprocess.run([PROGRAM, "run", str(folder), "-o", str(out)], check=True, capture_output=True)
    table = pd.read_parquet(out / "trajectory.parquet")
    lat0, lon0 = (
        round(float(table["lat_deg"].iloc[0]), 2),
        round(float(table["lon_deg"].iloc[0]), 2),
    )
    metre = 111_195.0, 111_195.0 * np.cos(np.radians(lat0))
    path = np.column_stack([
        (table["lat_deg"] - lat0) * metre[0], (table["lon_deg"] - lon0) * metre[1],
        table["height_m"],
    ])  # fmt: skip
    features = json.loads((out / "signs.geojson").read_text())["features"]
    places = [f["geometry"]["coordinates"] for f in features if f["geometry"]]
    signs = [((p[1] - lat0) * metre[0], (p[0] - lon0) * metre[1]) for p in places]
    return table["t_ns"].to_numpy(), path, np.array(signs).reshape(-1, 2)
