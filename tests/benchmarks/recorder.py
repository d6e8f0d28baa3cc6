"""The recorder against a replayed drive on two full lines: every byte, and when it came.

    python tests/benchmarks/recorder.py DRIVE WORK [--seconds 600] [--run]

Plays DRIVE at true speed into two pseudo-terminals at 460800 baud, both lines kept busy to
95 % with raw-data messages and comment lines between what the drive has, records them with
``automap record``, and prints whether every byte is there and how long after the feed's own
time each was stamped. ``--run`` then runs both folders and compares trajectory and signs.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import select
import shutil
import struct
import subprocess
import sys
import time
import tty
from pathlib import Path

import numpy as np

from automap.io.arrival import read_arrival
from automap.io.drive import Drive, load_drive
from automap.records import IntArray
from pipeline.record.messages import ubx_frame
from pipeline.record.pump import raise_priority
from pipeline.record.replay import Feed, Replay, copy_rest, drive_feeds
from pipeline.record.ublox_keys import RXM_RAWX

BAUD = 460_800
BYTE_NS = 1e10 / BAUD
SHARE = 0.95
PROGRAM = str(Path(sys.executable).with_name("automap"))


def busy(feed: Feed, seconds: float, filler: bytes) -> Feed:
    """The feed with ``filler`` wherever the line would be idle, for so many seconds."""
    end_ns = int(feed.t_ns[0] + seconds * 1e9)
    ends = np.append(feed.offset[1:], len(feed.data))
    next_ns = np.append(feed.t_ns[1:], max(end_ns, int(feed.t_ns[-1]) + 1))
    parts, offset, t_ns = [], [], []
    at = 0
    fill_ns = len(filler) * BYTE_NS / SHARE
    free_ns = 0.0
    for first, end, due, following in zip(feed.offset, ends, feed.t_ns, next_ns, strict=True):
        part = feed.data[first:end]
        parts.append(part)
        offset.append(at)
        t_ns.append(int(due))
        at += len(part)
        free_ns = max(free_ns, float(due)) + len(part) * BYTE_NS / SHARE
        while free_ns + fill_ns < following:
            parts.append(filler)
            offset.append(at)
            t_ns.append(int(free_ns))
            at += len(filler)
            free_ns += fill_ns
    return Feed(feed.name, b"".join(parts), np.array(offset), np.array(t_ns))


def play(drive: Path, links: Path, seconds: float) -> None:
    """The replayer's process."""
    fillers = {"gnss": ubx_frame(RXM_RAWX, bytes(480)), "imu": b"# " + b"-" * 61 + b"\n"}
    feeds = [busy(feed, seconds, fillers[feed.name]) for feed in drive_feeds(load_drive(drive))]
    for feed in feeds:
        (links / f"{feed.name}.sent").write_bytes(feed.data)
    player = Replay(feeds, links, BAUD)
    player.wait_opened()
    results, origin, start = player.play(logs=links)
    time.sleep(1.0)
    player.close()
    text = {"origin": origin, "start": start, "late_s": [r.late_s for r in results]}
    (links / "played.json").write_text(json.dumps(text))


def bare_terminal(until: str, file: Path) -> None:
    """The peer: two processes that pass the time over a pseudo-terminal, 500 times a second, and
    do nothing else. What they lose the system itself loses."""
    master, slave = os.openpty()
    tty.setraw(slave)
    if os.fork() == 0:
        raise_priority()
        late = []
        while True:
            select.select([slave], [], [])
            now = time.monotonic_ns()
            data = os.read(slave, 4096)
            if data.endswith(bytes(8)):
                np.save(file, np.array(late) * 1e-6)
                os._exit(0)
            late += [now - t for (t,) in struct.iter_unpack("<q", data[: len(data) // 8 * 8])]
    raise_priority()
    while not Path(until).exists():
        time.sleep(0.002)
        os.write(master, struct.pack("<q", time.monotonic_ns()))
    os.write(master, bytes(8))
    os.wait()


def marks(ms: np.ndarray) -> str:
    """Percentiles in words."""
    shown = ", ".join(f"{q:g} % {np.percentile(ms, q):.3f}" for q in (50, 95, 99, 99.9, 100))
    return f"{shown}; within 2 ms {np.mean(np.abs(ms) <= 2.0):.4%}"


def lateness_ms(sent: Path, received: Path) -> np.ndarray:
    """How far the recorder's time of a slice's first byte lies outside of the span in which the
    feed handed it over: positive when later, negative when earlier."""
    offset, begin, end = np.loadtxt(sent, delimiter=",", skiprows=1, dtype=np.int64).T
    arrival = read_arrival(received)
    rows, stamped = arrival.offset, arrival.t_ns
    row = np.searchsorted(rows, offset, side="right") - 1
    t_ns: IntArray = stamped[np.maximum(row, 0)]
    return np.asarray((np.maximum(t_ns - end, 0) - np.maximum(begin - t_ns, 0)) * 1e-6)


def compare(drive: Drive, recorded: Path, work: Path, shift_ns: int) -> None:
    """Run both folders; the difference of their trajectories and signs."""
    import pandas as pd

    copy_rest(drive, recorded, shift_ns)
    manifest = drive.manifest_file.read_text(encoding="utf-8")
    sections = [s for s in manifest.split("\n\n") if s.startswith("[video.")]
    with (recorded / "drive.toml").open("a", encoding="utf-8") as out:
        out.write("\n" + "\n\n".join(sections) + "\n")
    outs = []
    for folder, name in ((drive.path, "out-original"), (recorded, "out-recorded")):
        outs.append(work / name)
        command = ["nice", "-n", "10", PROGRAM, "run", str(folder), "-o", str(outs[-1])]
        print(name, "exit code", subprocess.run(command, capture_output=True).returncode)
    first, second = (pd.read_parquet(out / "trajectory.parquet") for out in outs)
    t = first["t_ns"].to_numpy() + shift_ns
    inside = (t >= second["t_ns"].iloc[0]) & (t <= second["t_ns"].iloc[-1])
    ref = np.radians(first[["lat_deg", "lon_deg"]].iloc[0].to_numpy())
    metres = [111_195.0, 111_195.0 * np.cos(ref[0]), 1.0]
    columns = ["lat_deg", "lon_deg", "height_m"]
    apart = [
        (np.interp(t, second["t_ns"], second[name]) - first[name].to_numpy())[inside] * factor
        for name, factor in zip(columns, metres, strict=True)
    ]
    distance = np.sqrt(sum(a**2 for a in apart))
    print(
        f"trajectory: {inside.sum()} of {len(t)} rows, apart rms "
        f"{np.sqrt(np.mean(distance**2)) * 100:.2f} cm, most {distance.max() * 100:.2f} cm"
    )
    signs = [json.loads((out / "signs.geojson").read_text())["features"] for out in outs]
    places = [
        np.array([f["geometry"]["coordinates"][:2] for f in s if f["geometry"]]) for s in signs
    ]
    print("signs:", len(signs[0]), "and", len(signs[1]))
    if all(map(len, places)):
        scale = np.array([metres[1], metres[0]])
        away = [float(np.min(np.linalg.norm((places[1] - p) * scale, axis=1))) for p in places[0]]
        print(
            f"nearest sign of the other map: median {np.median(away) * 100:.1f} cm, "
            f"most {max(away) * 100:.1f} cm"
        )


def main() -> None:
    """Replay, record, compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("drive", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--run", action="store_true")
    options = parser.parse_args()
    work, links = options.work, options.work / "car"
    shutil.rmtree(work, ignore_errors=True)
    links.mkdir(parents=True)
    player = multiprocessing.Process(target=play, args=(options.drive, links, options.seconds))
    player.start()
    while not (links / "imu").is_symlink() or not (links / "gnss").is_symlink():
        time.sleep(0.1)
    bare = multiprocessing.Process(
        target=bare_terminal, args=(str(links / "played.json"), work / "bare.npy")
    )
    bare.start()
    recorded = work / "recorded"
    command = [PROGRAM, "record", "-o", str(recorded), "--plain", "--rig", str(options.drive)]
    for name in ("gnss", "imu"):
        command += [f"--{name}", f"{links / name}@{BAUD}"]
    with (work / "record.txt").open("w") as log:
        recorder = subprocess.Popen(
            [*command, "--imu-format", "automap-csv"], stdout=log, stderr=log
        )
        loads = []
        memory = []
        while player.is_alive():
            time.sleep(2.0)
            loads.append(os.getloadavg()[0])
            status = Path(f"/proc/{recorder.pid}/status").read_text().split("VmRSS:")
            memory.append(int(status[1].split()[0]) / 1024 if len(status) > 1 else 0.0)
        recorder.terminate()
        print("recorder's exit code", recorder.wait())
    bare.join()
    used = os.times()
    print(
        f"load average {np.mean(loads):.1f} (most {max(loads):.1f}); recorder's memory "
        f"{memory[min(5, len(memory) - 1)]:.0f} MB early, {memory[-1]:.0f} MB at the end; "
        f"processor {used.children_user + used.children_system:.0f} s"
    )
    for name, file in (("gnss", "gnss.ubx"), ("imu", "imu.raw")):
        sent, got = (links / f"{name}.sent").read_bytes(), (recorded / file).read_bytes()
        same = "every byte there" if sent == got else "BYTES DIFFER"
        ms = lateness_ms(links / f"{name}_feed.csv", recorded / f"{name}_arrival.csv")
        print(f"{name}: {len(got)} of {len(sent)} bytes, {same}; ms after the feed: {marks(ms)}")
    print(f"bare terminal beside it, ms: {marks(np.load(work / 'bare.npy'))}")
    if options.run:
        played = json.loads((links / "played.json").read_text())
        shift = played["start"] - played["origin"]
        compare(load_drive(options.drive), recorded, work, shift)


if __name__ == "__main__":
    main()
