"""Seven nights of a fleet: 20 new drives of a town each, run and merged by the commands.

    python tests/benchmarks/fleet_week.py FOLDER [--seed S] [--each 20]

In the third night the store's file system is full (a mount of its own in FOLDER, which needs root),
in the fourth the settings change, so that all drives are run again, in the fifth the clock of one
of two workers is three years behind. Every night's exit codes, counts and map are held against
what they must be; a line says what each was. At the end the drives of the disturbed nights are run
once more in a store of their own, where their files must be the same, and the map against one from
nothing of the same results.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from automap.io.signs_table import read_signs
from pipeline.fleet.orders import current_key
from pipeline.fleet.store import Store
from tests.benchmarks.fleet_town import figures, make, town_of
from tests.fleet_crew import MAIN, Crew

NIGHTS = 7
FULL, CHANGED, LATE = 2, 3, 4
DISK_MB, LEFT_KB = 1500, 500
"""Of the store's file system, and what the full night finds of it, times its drives: a result of
these takes some 2 MB."""
BEHIND_S = 3 * 365 * 86400
OTHER = "geolocate.max_single_view_m=50.0"
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>
int clock_gettime(clockid_t clock, struct timespec *now)
{
    int (*real)(clockid_t, struct timespec *) = dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(clock, now);
    if (clock == CLOCK_REALTIME) now->tv_sec -= %d;
    return result;
}
time_t time(time_t *now)
{
    struct timespec precise;
    clock_gettime(CLOCK_REALTIME, &precise);
    if (now) *now = precise.tv_sec;
    return precise.tv_sec;
}
"""


def late_clock(folder: Path) -> dict[str, str]:
    """The environment of a process whose clock is behind."""
    source, library = folder / "clock.c", folder / "clock.so"
    source.write_text(CLOCK % BEHIND_S)
    words = ["gcc", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"]
    subprocess.run(words, check=True)
    return {"LD_PRELOAD": str(library)}


@contextmanager
def disk(folder: Path) -> Iterator[Path]:
    """A file system of its own."""
    image, mount = folder / "disk.img", folder / "disk"
    mount.mkdir(exist_ok=True)
    with image.open("wb") as file:
        file.truncate(DISK_MB << 20)
    subprocess.run(["mkfs.ext4", "-q", "-m", "0", str(image)], check=True)
    subprocess.run(["mount", "-o", "loop", str(image), str(mount)], check=True)
    try:
        yield mount
    finally:
        subprocess.run(["umount", str(mount)], check=True)
        image.unlink()


def fill(mount: Path, left: int) -> Path:
    """A file that leaves so many bytes, if there are as many."""
    filler = mount / f"filler-{left}"
    with filler.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, max(shutil.disk_usage(mount).free - left, 1))
    return filler


def fleet(*words: object, temporary: Path | None = None) -> tuple[int, str]:
    """``automap fleet``: its exit code, and the last line that it says of an error."""
    command = [sys.executable, "-c", MAIN, "fleet", *map(str, words)]
    more = {} if temporary is None else {"TMPDIR": str(temporary)}
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **more})
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def expect(what: str, found: object, wanted: object) -> None:
    """Say what does not hold, and end with 1 then."""
    if found != wanted:
        raise SystemExit(f"{what}: {found}, not {wanted}")


def week(folder: Path, seed: int, each: int) -> None:
    """All nights; SystemExit where something is not as it must be."""
    make(folder, NIGHTS * each, seed)
    paths = sorted((folder / "drives").iterdir())
    with disk(folder) as mount:
        url = mount / "store"
        for night in range(NIGHTS):
            _night(folder, mount, url, night, paths[night * each : (night + 1) * each])
        _whole(folder, url, each)


def _night(folder: Path, mount: Path, url: Path, night: int, paths: list[Path]) -> None:
    started, total = time.monotonic(), (night + 1) * len(paths)
    code, said = fleet("add", url, *paths)
    expect(f"night {night}, add", (code, said), (0, ""))
    told = ""
    if night == FULL:
        fillers, before = [fill(mount, len(paths) * LEFT_KB << 10)], os.readlink(url / "map")
        code, said = fleet("run", url, "--workers", 2, "--quiet")
        expect("run on a full disk", code, 4)
        # temporary files lie on the same disk, as on a machine that has one
        again, then = fleet("run", url, "--workers", 2, "--quiet", temporary=mount)
        expect("run with temporary files on a full disk", again, 4)
        store = Store.at(str(url))
        states = [entry.state() for entry in store.entries()]
        expect("put aside on a full disk", states.count("aside"), 0)
        said += f" / {then}"
        told = f"; full: {said!r}, {states.count('waiting')} wait"
        fillers.append(fill(mount, 1 << 16))
        code, said = fleet("merge", url, "--workers", 2, "--quiet")
        # without a new drive there is no map to write
        wanted = 4 if states.count("waiting") < len(paths) else 0
        expect("map on a full disk", (code, os.readlink(url / "map")), (wanted, before))
        told += f", merge: {said!r}"
        for filler in fillers:
            filler.unlink()
    if night == LATE:
        crew = Crew(folder, str(url), environment=late_clock(folder))
        try:
            while not crew.keep_up():
                time.sleep(1.0)
        finally:
            crew.end()
        expect("exit codes of the client", crew.codes, [0])
    else:
        more = ("--set", OTHER) if night == CHANGED else ()
        code, said = fleet("run", url, "--workers", 2, "--quiet", *more)
        expect(f"night {night}, run", code, 0)
    store = Store.at(str(url))
    keys = {entry.done.get("key") for entry in store.entries()}
    expect(f"night {night}, settings", keys, {current_key(store)})
    code, said = fleet("merge", url, "--workers", 2, "--quiet")
    expect(f"night {night}, merge", code, 0)
    summary = json.loads((url / "map" / "merge.json").read_text())
    expect(f"night {night}, drives", len(summary["drives"]), total)
    history = summary["history"]
    expect("maps", [step["map"] for step in history], [f"{k:06d}" for k in range(1, night + 2)])
    expect(
        "history",
        [step["drives"] for step in history],
        list(range(len(paths), total + 1, len(paths))),
    )
    signs = read_signs(url / "map" / "signs_raw.parquet")
    expect("signs", len(signs), history[-1]["signs"])
    changes = history[-1]["changes"]
    if changes:
        counted = sum(changes[kind] for kind in ("unchanged", "class", "moved", "new"))
        expect("changes", counted, len(signs))
        kept = history[-2]["signs"] - changes["gone"]
        here = counted - changes["new"]
        told += f"; of {history[-2]['signs']} signs {here} again, {history[-2]['signs'] - here} not"
        assert kept >= here
    print(f"night {night}: {total} drives, {len(signs)} signs, {changes}, "
          f"{time.monotonic() - started:.0f} s{told}", flush=True)  # fmt: skip


def _whole(folder: Path, url: Path, each: int) -> None:
    """The map against one from nothing, and the disturbed drives against undisturbed ones."""
    fresh = folder / "fresh"
    shutil.rmtree(fresh, ignore_errors=True)
    shutil.copytree(url / "drives", fresh / "drives")
    for name in ("fleet.json", "settings.json"):
        shutil.copyfile(url / name, fresh / name)
    expect("merge from nothing", fleet("merge", fresh, "--quiet")[0], 0)
    maps = [read_signs(at / "map" / "signs_raw.parquet") for at in (url, fresh)]
    expect("signs of a map from nothing", len(maps[1]), len(maps[0]))
    place = [
        np.array(sorted((s.lat_rad * 6.371e6, s.lon_rad * 6.371e6, s.height_m) for s in signs))
        for signs in maps
    ]
    sd = min(np.sqrt(np.diag(s.cov_enu)).min() for s in maps[0])
    off = float(np.abs(place[0] - place[1]).max())
    print(f"against a map from nothing: off by {off:.1e} m at most, the least sigma is {sd:.3f} m")
    town = town_of(folder)
    store = Store.at(str(url))
    numbers = [int(Path(entry.path).name[1:]) for entry in store.entries()]
    passes = np.sum([town.passed(number) for number in numbers], axis=0)
    figures("the week's map", town, passes, maps[0])
    again = folder / "again"
    shutil.rmtree(again, ignore_errors=True)
    paths = sorted((folder / "drives").iterdir())
    disturbed = [path for k in (FULL, LATE) for path in paths[k * each : (k + 1) * each]]
    expect("add", fleet("add", again, *disturbed)[0], 0)
    expect("run once more", fleet("run", again, "--workers", 2, "--quiet", "--set", OTHER)[0], 0)
    differing: dict[str, int] = {}
    for entry in Store.at(str(again)).entries():
        files = [entry.done["files"], store.entry(entry.digest).done["files"]]
        for name in files[0].keys() | files[1].keys():
            if files[0].get(name) != files[1].get(name):
                differing[name] = differing.get(name, 0) + 1
    print(f"the disturbed nights' {len(disturbed)} drives run once more: files that differ "
          f"{differing or 'none'}", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=20)
    options = parser.parse_args()
    week(options.folder.resolve(), options.seed, options.each)


if __name__ == "__main__":
    main()
