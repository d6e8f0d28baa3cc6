"""A fleet of simulated drives through one town, from sensor logs and boxes to one map.

    python tests/benchmarks/fleet_town.py make FOLDER --drives 1000 --seed S
    python tests/benchmarks/fleet_town.py run FOLDER undisturbed
    python tests/benchmarks/fleet_town.py run FOLDER killed --kill-every 20
    python tests/benchmarks/fleet_town.py compare FOLDER undisturbed killed
    python tests/benchmarks/fleet_town.py judge FOLDER killed
    python tests/benchmarks/fleet_town.py workers FOLDER

``run`` has two workers of Dask with their nannies, a scheduler and ``automap fleet run``, and
merges then; with ``--kill-every`` a process of a role drawn at random is killed that often, and
the merge five times. On a machine where others compute, ``--by-processor`` counts the seconds that
each of the two workers' processes computed instead of the clock's. It prints what was done,
processor time a drive, and the memory of each role as the fleet grows; what was interrupted goes
on with the same command. ``compare`` holds two such stores against each other byte by byte,
``judge`` the map against the town and against what ``automap merge`` makes of the same drives,
``workers`` one worker against two by turns.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from automap.evaluation.sign_matching import match, points_of
from automap.frames import wrap_pi
from automap.gates import gate, sigmas
from automap.io.signs_table import read_signs
from automap.records import FloatArray, Sign, SignPoints
from pipeline.fleet.store import Store
from tests.benchmarks.fleet_town_drives import Town, make_drive
from tests.fleet_crew import MAIN, Crew, kill, start

LOOK_S = 2.0
"""Memory and processes are looked at so often; it costs a few milliseconds."""
MERGED_S = (2.0, 20.0)
"""How long a merge that is killed has had."""
SHARES = (0.1, 0.5, 1.0)
MATCH_M = 3.0
PASSED_OFTEN = 3
TOLD = "town.json"


def workers(folder: Path, drives: int) -> None:
    """Seconds by the clock of the same drives with one worker, two, two and one."""
    folder = folder.resolve()
    paths = sorted((folder / "drives").iterdir())[:drives]
    taken: dict[int, list[float]] = {1: [], 2: []}
    for number in (1, 2, 2, 1):
        store = folder / f"by-{number}"
        shutil.rmtree(store, ignore_errors=True)
        fleet("add", store, *paths)
        started = time.monotonic()
        fleet("run", store, "--workers", number, "--quiet")
        taken[number].append(time.monotonic() - started)
        shutil.rmtree(store)
        print(f"{number} workers: {taken[number][-1]:.1f} s", flush=True)
    print(f"efficiency {sum(taken[1]) / (2.0 * sum(taken[2])):.3f} with {drives} drives")


def make(folder: Path, drives: int, seed: int, jobs: int = 1) -> None:
    """The drives of a town, those that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / TOLD).write_text(json.dumps({"drives": drives, "seed": seed}))
    with ProcessPoolExecutor(jobs) as pool:
        town = Town.of(seed, drives)
        for _ in pool.map(make_drive, [town] * drives, range(drives), [folder / "drives"] * drives):
            pass


def town_of(folder: Path) -> Town:
    """The town whose drives a folder has."""
    told = json.loads((folder / TOLD).read_text())
    return Town.of(told["seed"], told["drives"])


def fleet(*words: object) -> None:
    """``automap fleet``; CalledProcessError where it fails."""
    command = [sys.executable, "-c", MAIN, "fleet", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def memory_mb(pid: int) -> tuple[float, float]:
    """What a process holds and held at most, MB; zeros where it has ended."""
    held = {"VmRSS": 0.0, "VmHWM": 0.0}
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            name, _, value = line.partition(":")
            if name in held:
                held[name] = int(value.split()[0]) / 1e3
    except OSError:
        pass
    return held["VmRSS"], held["VmHWM"]


class Work:
    """Seconds that the processes of a crew have computed, by looking at them often."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.last: dict[int, float] = {}

    def look(self, crew: Crew) -> None:
        """Add what they have computed since."""
        now = {pid: processor_s(pid) for pids in crew.processes().values() for pid in pids}
        self.seconds += sum(max(held - self.last.get(pid, 0.0), 0.0) for pid, held in now.items())
        self.last = now


def processor_s(pid: int) -> float:
    """What a process has computed, s; 0 where it has ended."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")


class Memory:
    """The memory of a crew's roles, by the share of the drives that is done."""

    def __init__(self) -> None:
        self.peak: dict[str, float] = {}
        self.now: dict[str, float] = {}
        self.at: dict[float, str] = {}

    def look(self, crew: Crew, share: float) -> None:
        """Take down what the processes hold."""
        for role, pids in crew.processes().items():
            for held, peak in map(memory_mb, pids):
                self.now[role] = held or self.now.get(role, 0.0)
                self.peak[role] = max(self.peak.get(role, 0.0), peak)
        for limit in SHARES:
            if share >= limit and limit not in self.at:
                told = [f"{r} {self.now[r]:.0f} ({self.peak[r]:.0f})" for r in sorted(self.now)]
                self.at[limit] = ", ".join(told)
                print(f"  at {100 * limit:.0f} %, MB (at most): {self.at[limit]}", flush=True)


def run(
    folder: Path, name: str, kill_every: float | None, seed: int = 1, by_processor: bool = False
) -> None:
    """Run all drives of a folder and merge them; the store lies in ``FOLDER/NAME`` then."""
    folder = folder.resolve()
    store_folder = folder / "store"
    fleet("add", store_folder, folder / "drives" / "*")
    store = Store.at(str(store_folder))
    total = len(store.digests())
    draw, killed, memory = random.Random(seed), dict[str, int](), Memory()
    crew = Crew(folder, str(store_folder))
    started, work = time.monotonic(), Work()

    def gone() -> float:
        return work.seconds / crew.size if by_processor else time.monotonic() - started

    last = 0.0
    try:
        while not crew.keep_up():
            time.sleep(LOOK_S)
            work.look(crew)
            done = sum(1 for _ in store_folder.glob("drives/*/done.json"))
            memory.look(crew, done / total)
            if kill_every is not None and gone() - last >= kill_every:
                last += kill_every
                role = crew.kill_one(draw)
                killed[role] = killed.get(role, 0) + 1
                if sum(killed.values()) % 20 == 0:
                    now = time.monotonic() - started
                    print(f"  {now:.0f} s: {done} done, killed {killed}", flush=True)
        memory.look(crew, 1.0)
    finally:
        crew.end()
    seconds = time.monotonic() - started
    for _ in range(5 if kill_every is not None else 0):
        merging = start(MAIN, folder, "fleet", "merge", str(store_folder), "--workers", "2")
        time.sleep(draw.uniform(*MERGED_S))
        kill(merging)
    fleet("merge", store_folder, "--workers", 2, "--quiet")
    entries = store.entries()
    states = [entry.state() for entry in entries]
    cost = np.array([entry.done["processor_s"] for entry in entries if entry.done])
    peak = np.array([entry.done["peak_bytes"] for entry in entries if entry.done]) / 1e6
    print(
        f"{name}: {states.count('done')} done, {states.count('aside')} aside of {total} in "
        f"{seconds:.0f} s, {work.seconds:.0f} s of processor; {cost.mean():.2f} s of it a drive "
        f"(first and last tenth {_ends(store, cost)}), at most {peak.max():.0f} MB; "
        f"killed {killed}; client ended with "
        f"{ {code: crew.codes.count(code) for code in sorted(set(crew.codes))} }",
        flush=True,
    )
    (folder / f"{name}.json").write_text(json.dumps({"memory": memory.at, "killed": killed}))
    shutil.rmtree(folder / name, ignore_errors=True)
    store_folder.rename(folder / name)


def _ends(store: Store, cost: FloatArray) -> str:
    """Mean processor time of the drives that were done first and last."""
    assert store.place.folder is not None
    when = [p.stat().st_mtime for p in sorted(store.place.folder.glob("drives/*/done.json"))]
    order, tenth = np.argsort(when), max(len(when) // 10, 1)
    return f"{cost[order[:tenth]].mean():.2f}, {cost[order[-tenth:]].mean():.2f} s"


def compare(folder: Path, one: str, other: str) -> None:
    """Files of two stores' results and maps that differ, and those that are not what the drive's
    marker says."""
    stores = [Store.at(str(folder / name)) for name in (one, other)]
    for store in stores:
        told, wrong = 0, []
        for entry in store.entries():
            for name, file in entry.done.get("files", {}).items():
                data = store.place.read(f"{store.result(entry)}/{name}") or b""
                told += 1
                if hashlib.sha256(data).hexdigest() != file["sha256"]:
                    wrong.append(f"{entry.name}/{name}")
        print(f"{store.place.url}: {told} files, not as their marker says: {wrong or 'none'}")
    entries = [{e.digest: e.done for e in store.entries()} for store in stores]
    both = sorted(set(entries[0]) & set(entries[1]))
    differing: dict[str, int] = {}
    compared = 0
    for digest in both:
        files = [done[digest].get("files", {}) for done in entries]
        for name in files[0].keys() | files[1].keys():
            compared += 1
            if files[0].get(name) != files[1].get(name):
                differing[name] = differing.get(name, 0) + 1
    print(f"{len(both)} drives, {compared} files; differing: {differing or 'none'}")
    maps = [_map_files(folder / name) for name in (one, other)]
    names = sorted(maps[0].keys() | maps[1].keys())
    off = [name for name in names if maps[0].get(name) != maps[1].get(name)]
    print(f"map: {len(names)} files; differing: {off or 'none'}")


def _map_files(store: Path) -> dict[str, bytes]:
    root = store / "map"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def judge(folder: Path, name: str) -> None:
    """The map against the town; the same drives merged at once beside it."""
    town = town_of(folder)
    store = Store.at(str(folder / name))
    entries = [entry for entry in store.entries() if entry.state() == "done"]
    numbers = [int(Path(entry.path).name[1:]) for entry in entries]
    passes = np.sum([town.passed(number) for number in numbers], axis=0)
    figures("fleet merge", town, passes, read_signs(folder / name / "map" / "signs_raw.parquet"))
    whole = folder / f"{name}-merged"
    if not whole.is_dir():
        outs = [str(folder / name / store.result(entry)) for entry in entries]
        words = [sys.executable, "-c", MAIN, "merge", *outs, "-o", str(whole), "--quiet"]
        subprocess.run(words, check=True)
    figures("automap merge", town, passes, read_signs(whole / "signs_raw.parquet"))


def figures(name: str, town: Town, passes: Any, signs: Sequence[Sign]) -> None:
    """Errors, coverage, signs missed and false."""
    lat, lon, height = town.geodetic(town.centres())
    true = SignPoints(
        lat, lon, np.array(town.city.names, np.object_)[town.city.code],
        np.full((len(lat), 2, 2), np.nan), np.zeros(len(lat)),
    )  # fmt: skip
    found = points_of(signs)
    placed = np.isfinite(found.lat_rad)
    pairs = match(found, true, MATCH_M)
    rows, owner = pairs.estimate, pairs.truth
    extra = np.setdiff1d(np.arange(len(signs)), rows)
    north, east = 6335439.0, 6378137.0  # radii of curvature on the equator
    error = np.column_stack(
        [
            (found.lon_rad[rows] - true.lon_rad[owner]) * east,
            (found.lat_rad[rows] - true.lat_rad[owner]) * north,
            [signs[k].height_m for k in rows.tolist()] - height[owner],
        ]
    )
    cov = np.array([signs[k].cov_enu for k in rows.tolist()])
    flat = cov[:, :2, :2]
    square = np.einsum("ni,ni->n", error[:, :2], np.linalg.solve(flat, error[:, :2, None])[..., 0])
    up = error[:, 2] ** 2 / cov[:, 2, 2]
    hit = np.zeros(len(lat), np.bool_)
    hit[owner] = True
    often = passes >= PASSED_OFTEN
    right = [signs[k].class_name == true.class_name[j] for k, j in zip(rows, owner, strict=True)]
    existence = np.array([sign.existence for sign in signs])
    again = len(match(points_of([signs[k] for k in extra.tolist()]), true, MATCH_M))
    distance = np.hypot(*error[:, :2].T)
    facing = np.array([[signs[k].facing_rad, signs[k].facing_sd_rad] for k in rows.tolist()])
    turn = np.abs(wrap_pi(facing[:, 0] - town.city.facing[owner]))
    print(
        f"{name}: {len(signs)} signs ({int(placed.sum())} placed), {len(rows)} of the town's; "
        f"false {len(extra) / len(signs):.4f}, {again} of {len(extra)} beside one of the town's "
        f"(stated {1 - existence.mean():.4f}); missed of "
        f"{int(often.sum())} passed {PASSED_OFTEN} times {1 - hit[often].mean():.4f}; error median "
        f"{np.median(distance):.3f} m, 95 % {np.quantile(distance, 0.95):.3f} m; inside 95 % "
        f"ellipses {np.mean(square < gate(0.05, 2)):.3f}, "
        f"heights {np.mean(up < gate(0.05, 1)):.3f}; "
        f"rms of normalised errors {np.sqrt(np.mean(square / 2)):.2f}, heights "
        f"{np.sqrt(np.mean(up)):.2f}; class right {np.mean(right):.4f}; "
        f"facing inside 95 % {np.mean(turn < sigmas(0.05) * facing[:, 1]):.3f}, off by more than "
        f"60 deg {np.mean(turn > np.radians(60.0)):.3f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("make", "run", "compare", "judge", "workers"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--drives", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--kill-every", type=float)
    parser.add_argument("--by-processor", action="store_true")
    options = parser.parse_args()
    # so that the crew ends with it
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    if options.what == "make":
        make(options.folder, options.drives, options.seed, options.jobs)
    elif options.what == "run":
        kills = options.kill_every, options.seed, options.by_processor
        run(options.folder, options.names[0], *kills)
    elif options.what == "compare":
        compare(options.folder, *options.names)
    elif options.what == "workers":
        workers(options.folder, options.drives)
    elif options.what == "judge":
        judge(options.folder, options.names[0])


if __name__ == "__main__":
    main()
