"""A fleet of made drives: folders whose results are those of a scene, without any run."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from automap.mapping.sightings import DriveSigns
from pipeline.fleet.add import add
from pipeline.fleet.orders import Order
from pipeline.fleet.store import Store
from pipeline.fleet.task import Result, publish
from pipeline.shared.verdicts import doubted
from tests.unit.merge_folders import write_run
from tests.unit.merge_scene import street_scene

ORDER = Order({}, "a" * 20, (), 1 << 30)


@cache
def scene(seed: int = 3) -> list[DriveSigns]:
    return street_scene(seed, 8, length_m=600.0).drives


def make_drives(folder: Path, numbers: range) -> list[str]:
    """Drive folders, one for each number of the scene."""
    paths = []
    for k in numbers:
        path = folder / f"d{k}"
        path.mkdir(parents=True)
        (path / "drive.toml").write_text('schema = "automap.drive/1"\n')
        (path / "imu.csv").write_text(f"{k}\n")
        paths.append(str(path))
    return paths


def make_store(folder: Path, numbers: range = range(5)) -> Store:
    store = Store.at(str(folder / "store"), make=True)
    add(store, make_drives(folder / "drives", numbers))
    return store


def answer(drive: DriveSigns, number: int, **more: Any) -> dict[str, Any]:
    """What the process of a drive would say."""
    return {
        "name": drive.name,
        "recording": hashlib.sha256(str(number).encode()).hexdigest()[:16],
        "country": "AU",
        "signs": len(drive),
        "start_gps_s": drive.start_gps_s,
        "hours": 0.5,
        "km": 12.0,
        "sd_m": [0.5, 0.5, 1.0],
        "verdict": {"state": "good", "reasons": []},
        "warnings": [],
        "seconds": 60.0,
        "peak_bytes": 300_000_000,
        **more,
    }


def moved(drive: DriveSigns, north_m: float) -> DriveSigns:
    """The same with an error of its path that nobody knows of."""
    assert drive.path is not None
    by = north_m / 6.371e6
    path = replace(drive.path, lat_rad=drive.path.lat_rad + by)
    return replace(drive, lat_rad=drive.lat_rad + by, path=path)


def publish_made(
    url: str, digest: str, path: str, order: Order, north_m: float = 0.0, **more: Any
) -> Result:
    """A task that takes the drive's signs from the scene."""
    store = Store.at(url)
    if store.entry(digest).done.get("key") == order.key:
        return Result(digest, "done")
    number = int((Path(path) / "imu.csv").read_text())
    drive = moved(scene()[number], north_m)
    with tempfile.TemporaryDirectory() as folder:
        out = write_run(Path(folder) / "out", drive)
        marker = publish(store, digest, out, answer(drive, number, **more), order.key)
    return Result(digest, "done", doubtful=bool(doubted(marker)))


def map_bytes(store: Store) -> dict[str, bytes]:
    """All files of the published map."""
    assert store.place.folder is not None
    root = store.place.folder / "map"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def full(url: str, digest: str, path: str, order: Order) -> Result:
    """A task that finds the store's disk full."""
    return Result(digest, "store", f"cannot write {url}: the disk is full.")


def run_all(store: Store, order: Order = ORDER) -> None:
    """Every drive that waits, one after another, without Dask."""
    for entry in store.entries():
        if entry.state(order.key) == "waiting":
            publish_made(store.place.url, entry.digest, entry.path, order)
