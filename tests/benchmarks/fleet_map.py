"""Time and memory of writing a fleet's map, of drives made directly.

    python tests/benchmarks/fleet_map.py FOLDER [TOWNS] [TIMES] [ADDED]

Puts 100 drives a town, 1000 sightings each and with tracks, into FOLDER, merges them, and writes
their map in a process of its own; with TIMES the merged towns stand so many times beside each
other, moved east, so that a map of 10,000 drives is written without merging as many. ADDED writes
it once more against itself, as a merge with an older map does.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from merge_store import DRIVES, fill

from automap.io import names
from automap.mapping.cells import LEVEL, cell_named, quadkey
from pipeline.fleet import publish
from pipeline.fleet.older import Before
from pipeline.fleet.store import Entry
from pipeline.merge import cell_map
from pipeline.merge.cell_files import path_stamp
from pipeline.merge.cell_steps import levels_of
from pipeline.merge.cell_store import read_drives

TILES = 60
"""From one copy of ten towns to the next."""
DONE = {"result": "r", "country": "AU", "sd_m": [0.6, 0.6, 1.0], "made_with": "k", "key": "k"}


def keep_tracks(cells: Path) -> None:
    """Tracks by where the paths looked from, as they are kept of drives."""
    drives = read_drives(cells)
    wanted = ["drive", "place", "gps_s", "lat_rad", "lon_rad", "yaw_rad"]
    files = sorted((cells / "paths").glob("cell=*/*.parquet"))
    table = pa.concat_tables([pq.read_table(f, columns=wanted, partitioning=None) for f in files])
    table = table.sort_by([("drive", "ascending"), ("place", "ascending")])
    edges = np.searchsorted(table["drive"].to_numpy(), np.arange(len(drives) + 1))
    (cells / "tracks").mkdir(exist_ok=True)
    for k, key in enumerate(drives.key):
        own = table.slice(edges[k], edges[k + 1] - edges[k])
        n, zero = len(own), np.zeros((len(own), 2))
        gps_s, half = own["gps_s"].to_numpy(), np.full((n, 3), 0.5)
        np.savez(
            cells / "tracks" / f"{key}.npz", version=np.array("x-k"), geoid_m=np.array("{}"),
            t_ns=np.rint(gps_s * 1e9).astype(np.int64), gps_s=gps_s,
            lat_rad=own["lat_rad"].to_numpy(), lon_rad=own["lon_rad"].to_numpy(),
            height_m=np.full(n, 50.0), vel_ned=np.tile([10.0, 0.0, 0.0], (n, 1)),
            rpy=np.column_stack([zero, own["yaw_rad"].to_numpy()]),
            sd_pos_ned=half, sd_vel_ned=half, sd_rpy=half,
        )  # fmt: skip


def repeat(base: Path, out: Path, times: int) -> None:
    """The merged store ``base`` so many times, each time further east, with drives of its own."""
    for kind in ("drives", "placed", "covered", "paths", "tracks"):
        (out / kind).mkdir(parents=True)
    table = pa.concat_tables([pq.read_table(f) for f in sorted((base / "drives").glob("*"))])
    keys = table["key"].to_pylist()
    for k in range(times):
        first, turn = k * len(keys), k * TILES * 2.0 * np.pi / 2**LEVEL
        called = [f"{k}-{key}" for key in keys]
        changed = {
            "key": called,
            "name": [f"{name}-{k}" for name in table["name"].to_pylist()],
            "start_gps_s": table["start_gps_s"].to_numpy() + 7.0 * k,
            "cameras": table["cameras"],
        }
        pq.write_table(pa.table(changed), out / "drives" / f"{first:08d}.parquet")
        for key, new in zip(keys, called, strict=True):
            os.link(base / "tracks" / f"{key}.npz", out / "tracks" / f"{new}.npz")
        for file in sorted((base / "placed").glob("*.npz")):
            cell = cell_named(file.stem) + k * TILES
            folder = out / "paths" / f"cell={quadkey(cell)}"
            folder.mkdir()
            for part in (base / "paths" / f"cell={file.stem}").glob("*"):
                os.link(part, folder / part.name)
            found = dict(np.load(file))
            for name in ("founder", "member"):
                found[name] += first << 32
            for name in ("seen_by", "pair_drive", "drive"):
                found[name] += first
            found["lon"] += turn
            found["member_place"][:, 1] += turn
            np.savez(out / "placed" / f"{quadkey(cell)}.npz", **found)
            if (base / "covered" / file.name).exists():
                looked = dict(np.load(base / "covered" / file.name))
                looked["lon"] += turn
                looked["stamp"] = np.array(path_stamp(out, cell))
                np.savez(out / "covered" / f"{quadkey(cell)}.npz", **looked)


def write(cells: Path, out: Path, workers: int, older: Path | None = None) -> None:
    """Write the map of a store whose cells are placed, and say what it took."""

    def say(text: str) -> None:
        peak = [resource.getrusage(w).ru_maxrss / 1e6 for w in _WHO]
        used = sum(sum(resource.getrusage(w)[:2]) for w in _WHO)
        told = f"{time.monotonic() - started:8.1f} s {used:8.1f} s of processor"
        print(f"{told} {peak[0]:.3f} and {peak[1]:.3f} GB {text}", flush=True)

    started = time.monotonic()
    placed = sorted(cell_named(file.stem) for file in (cells / "placed").glob("*.npz"))
    levels, factors = levels_of(cells, placed)
    found = cell_map._whole(cells, placed, levels, factors, (0, 0, len(placed)), 0.5)
    drives = read_drives(cells)
    say(f"{len(drives)} drives, {len(found.lat)} merged signs")
    place = SimpleNamespace(url="/nowhere/town", folder=Path("/nowhere/town"))
    store: Any = SimpleNamespace(place=place, result=_result)
    entries = {key: Entry("x", "p", 1, DONE) for key in drives.key}
    before = None
    if older is not None:
        before = Before(older, "000001", json.loads((older / names.MERGE).read_text()))
    out.mkdir()
    publish.write_fleet_map(
        out, store, cells, entries, found, before, 0.5, "x", [], lambda done: say(f"{done:.2f}"),
        workers=workers,
    )  # fmt: skip
    say("written")


def _result(entry: Entry) -> str:
    return "r"


_WHO = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)


def main() -> None:
    if sys.argv[1] == "write":
        older = Path(sys.argv[5]) if len(sys.argv) > 5 else None
        write(Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]), older)
        return
    folder = Path(sys.argv[1])
    given = sys.argv[2:5]
    towns, times, added = (int(v) for v in [*given, *("10", "1", "0")[len(given) :]])
    base, cells = folder / "base", folder / "cells"
    if not base.is_dir():
        for town in range(towns):
            fill(base, town, 0, DRIVES)
        cell_map.merge_store(base)
        keep_tracks(base)
        write_once(base, folder / "first", 1)
    repeat(base, cells, times)
    write_once(cells, folder / "map", 1)
    write_once(cells, folder / "map-2", 2)
    if added:
        write_once(cells, folder / "again", 1, folder / "map")


def write_once(*words: object) -> None:
    """In a process of its own, so that its peak is told apart."""
    print(*words, flush=True)
    subprocess.run([sys.executable, __file__, "write", *map(str, words)], check=True)


if __name__ == "__main__":
    main()
