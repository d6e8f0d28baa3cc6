"""Towns mapped by very many drives, merged cell by cell: quality, time and memory.

    python tests/benchmarks/merge_store.py [TOWNS] [ADDED] [WORKERS] [FOLDER]

Puts the sightings of 100 drives a town, 1000 each, straight into a store of cells: 10 towns are a
million sightings, 100 towns ten million of 10,000 drives. Merges it, compares the map with the
towns, then adds ADDED drives to the last town and merges again. With FOLDER "both" as a fifth word
the added map is compared with one from nothing.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
from merge_million import (
    BLOCK_M,
    ORIGIN,
    SEEN,
    SHARED_SD,
    SIGNS_PER_BLOCK,
    City,
    along_route,
    evaluate,
    seen_signs,
)

from automap.earth import metres_per_radian
from automap.io.signs_table import COVARIANCE_COLUMNS
from automap.mapping.sightings import CameraView, DriveSigns
from automap.records import DrivePath, IntArray
from pipeline.merge.cell_map import merge_store
from pipeline.merge.cell_store import add_drives

DRIVES, EACH = 100, 1000
STEP_M = 4.0
GAP_M = 5000.0
"""From one town to the next, eastwards."""


def one_drive(
    rng: np.random.Generator, city: City, town: int, number: int
) -> tuple[DriveSigns, IntArray]:
    """A drive of a town and the true sign of each of its rows."""
    seen, truth, route, start = seen_signs(rng, city, number, EACH)
    shift = town * _gap(city)
    time_s, lat, lon, yaw = along_route(city, route, start, STEP_M).T
    n = len(truth)
    cov = np.empty((n, 3, 3))
    for name, i, j in COVARIANCE_COLUMNS:
        cov[:, i, j] = cov[:, j, i] = seen[name]
    last = np.asarray(seen["last_seen_ns"], np.float64) * 1e-9

    def column(name: str) -> np.ndarray:
        return np.asarray(seen[name], np.float64)

    return DriveSigns(
        name=f"drive-{town:03d}-{number:05d}",
        start_gps_s=start,
        ids=tuple(seen["id"]),
        class_name=np.array(seen["class"], object),
        lat_rad=column("lat_rad"),
        lon_rad=column("lon_rad") + shift,
        height_m=column("height_m"),
        cov_enu=cov,
        confidence=column("confidence"),
        n_views=np.full(n, 12),
        first_gps_s=last - 2.0,
        last_gps_s=last,
        height_above_road_m=column("height_above_road_m"),
        sd_above_road_m=np.full(n, 0.1),
        facing_rad=column("facing_rad"),
        facing_sd_rad=np.full(n, 0.15),
        size_m=column("size_m"),
        side=np.full(n, "left", object),
        status=np.full(n, "ok", object),
        path=DrivePath(time_s, lat, lon + shift, yaw, np.tile(SHARED_SD, (len(lat), 1))),
        cameras=(CameraView(0.0, 0.5),),
        key=f"{town:03d}-{number:05d}",
    ), truth


def _gap(city: City) -> float:
    east = float(metres_per_radian(ORIGIN[0], ORIGIN[2])[1])
    return (city.side * BLOCK_M + GAP_M) / east


def town_of(town: int) -> City:
    """The same for every run."""
    blocks = DRIVES * EACH / (20 * SIGNS_PER_BLOCK * SEEN)
    return City(np.random.default_rng(town), max(3, round(np.sqrt(blocks / 4))))


def fill(store: Path, town: int, first: int, count: int) -> None:
    """Put drives of a town into the store; ``seen-TOWN.npy`` counts the sightings of its signs."""
    city = town_of(town)
    rng = np.random.default_rng(1_000_000 + 1000 * town + first)
    made = [one_drive(rng, city, town, first + k) for k in range(count)]
    add_drives(store, [drive for drive, _ in made])
    path = store / f"seen-{town:03d}.npy"
    seen = np.load(path) if path.is_file() else np.zeros(len(city.position), np.int64)
    for _, truth in made:
        seen += np.bincount(truth[truth >= 0], minlength=len(seen))
    np.save(path, seen)


def merge(store: Path, workers: int, out: Path) -> None:
    """Merge the store and say what it took: this process and its workers, at most."""
    started = time.monotonic()
    found = merge_store(store, workers)
    wall = time.monotonic() - started
    own = resource.getrusage(resource.RUSAGE_SELF)
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    told = {
        "wall_s": wall,
        "processor_s": own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime,
        "peak_gb": (own.ru_maxrss + workers * others.ru_maxrss) / 1e6,
        "sightings": int(found.columns["n_drives"].sum()),
        "cells": found.cells,
        "cells_grouped": found.grouped,
        "cells_placed": found.placed,
        "signs": len(found.lat),
        "levels": found.levels.tolist(),
    }
    print(json.dumps(told))
    np.savez(
        out, lat=found.lat, lon=found.lon, cov=found.cov_enu, existence=found.existence,
        facing=found.columns["facing_rad"], key=np.array(found.founder),
    )  # fmt: skip


def run(*words: object) -> str:
    """This file in a process of its own, so that memory is told apart."""
    line = [sys.executable, __file__, *map(str, words)]
    return subprocess.run(line, check=True, stdout=subprocess.PIPE, text=True).stdout


def quality(store: Path, file: Path, towns: int) -> dict[str, float]:
    """Means over the towns of what ``merge_million`` tells of its city."""
    found = dict(np.load(file))
    likely = found["existence"] >= 0.5
    told: list[dict[str, float]] = []
    for town in range(towns):
        city = town_of(town)
        lon = found["lon"] - town * _gap(city)
        middle = ORIGIN[1] + 0.5 * (_gap(city) - GAP_M / 5.2e6)
        rows = np.flatnonzero(likely & (np.abs(lon - middle) < 0.5 * _gap(city)))
        cov = found["cov"][rows]
        table = pa.table(
            {
                "lat_rad": found["lat"][rows],
                "lon_rad": lon[rows],
                "facing_rad": found["facing"][rows],
                "cov_ee_m2": cov[:, 0, 0],
                "cov_en_m2": cov[:, 0, 1],
                "cov_nn_m2": cov[:, 1, 1],
            }
        )
        told.append(evaluate(city, table, np.load(store / f"seen-{town:03d}.npy")))
    return {name: float(np.mean([each[name] for each in told])) for name in told[0]}


def difference(one: Path, two: Path) -> dict[str, float]:
    """Two maps sign by sign, in sigmas."""
    a, b = dict(np.load(one)), dict(np.load(two))
    place = {key: k for k, key in enumerate(b["key"].tolist())}
    common = [(k, place[key]) for k, key in enumerate(a["key"].tolist()) if key in place]
    i, j = np.array(common).T
    north, east = metres_per_radian(a["lat"][i], 0.0)
    apart = np.column_stack(
        [(a["lon"][i] - b["lon"][j]) * east, (a["lat"][i] - b["lat"][j]) * north]
    )
    sd = np.sqrt(np.column_stack([a["cov"][i, 0, 0], a["cov"][i, 1, 1]]))
    off = np.abs(apart / sd).max(axis=1)
    return {
        "signs_only_in_one": float(len(a["key"]) + len(b["key"]) - 2 * len(i)),
        "largest_difference_sigmas": float(off.max()),
        "share_beyond_a_hundredth": float((off > 0.01).mean()),
        "largest_existence_difference": float(np.abs(a["existence"][i] - b["existence"][j]).max()),
    }


def show(title: str, values: dict[str, float | list[float]]) -> None:
    print(title)
    for name, value in values.items():
        figures = value if isinstance(value, list) else [value]
        print(f"  {name:<32}{' '.join(f'{figure:.5g}' for figure in figures)}", flush=True)


def main() -> None:
    if sys.argv[1:2] == ["fill"]:
        fill(Path(sys.argv[2]), *map(int, sys.argv[3:6]))
        return
    if sys.argv[1:2] == ["merge"]:
        merge(Path(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
        return
    towns, added, workers = (
        int(sys.argv[k]) if len(sys.argv) > k else usual for k, usual in ((1, 10), (2, 100), (3, 2))
    )
    with tempfile.TemporaryDirectory(dir=sys.argv[4] if len(sys.argv) > 4 else None) as folder:
        store = Path(folder) / "store"
        for town in range(towns):
            run("fill", store, town, 0, DRIVES)
        first, second, fresh = (Path(folder) / f"{name}.npz" for name in ("a", "b", "c"))
        show("from nothing", json.loads(run("merge", store, workers, first)))
        show("against the towns", quality(store, first, towns))
        run("fill", store, towns - 1, DRIVES, added)
        show(f"with {added} drives more", json.loads(run("merge", store, workers, second)))
        if sys.argv[5:6] == ["both"]:
            for name in ("groups", "placed"):
                (store / name).rename(Path(folder) / name)
            show("all from nothing", json.loads(run("merge", store, workers, fresh)))
            show("added against from nothing", difference(second, fresh))


if __name__ == "__main__":
    main()
