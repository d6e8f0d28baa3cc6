"""A fleet whose processes are killed at random all the time, and a week of its nights."""

from __future__ import annotations

import json
import random
import shutil
import sys
import time
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="Dask is not installed (the extra fleet)")

from automap.errors import StageError
from automap.io.signs_table import read_signs
from automap.mapping.merge import merge_drives
from pipeline.fleet.add import add
from pipeline.fleet.merge import merge
from pipeline.fleet.orders import Order
from pipeline.fleet.run import run
from pipeline.fleet.store import Store
from pipeline.fleet.task import Result
from pipeline.simulate.command import simulate
from tests.fleet_crew import MAIN, Crew, kill, start
from tests.unit.fleet_scene import ORDER, full, make_drives, map_bytes, publish_made, scene

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc"),
]

DRIVES, KILLS = 6, 14
LONGEST_S = 900.0
"""For a fleet of six drives of half a minute; a hang is a failure."""
SCENARIO = """
schema = "automap.scenario/1"
name = "half-a-minute"
seed = 1
signs = [
    { at_m = 70, sign = "warning--children--g2", offset_m = -4.0, height_m = 2.5 },
    { at_m = 120, sign = "regulatory--no-entry--g1", offset_m = 4.5, height_m = 2.3 },
    { at_m = 170, sign = "information--parking--g1", offset_m = -4.5, height_m = 2.2 },
    { at_m = 280, sign = "warning--curve-left--g2", offset_m = -4.2, height_m = 2.6 },
]
[start]
utc = "2026-03-14T09:20:00Z"
lat_deg = -35.28
lon_deg = 149.13
height_m = 580.0
heading_deg = 62.0
[gnss]
lever_arm_m = [0.4, 0.1, -1.2]
[camera]
box_sd_px = 1.0
[route]
legs = [
    { length_m = 210, speed_m_s = 13 },
    { turn_deg = 70, radius_m = 20, speed_m_s = 7 },
    { length_m = 110, speed_m_s = 13 },
]
"""


def forget(store: Store) -> None:
    """Leave of a store the list of its drives."""
    folder = store.place.folder
    assert folder is not None
    for name in ("map", "maps", "cells", "changes"):
        path = folder / name
        path.unlink() if path.is_symlink() else shutil.rmtree(path, ignore_errors=True)
    for entry in store.entries():
        for path in (folder / "drives" / entry.digest).iterdir():
            if path.name != "drive.json":
                path.unlink() if path.is_file() else shutil.rmtree(path)


def command(folder: Path, *words: str) -> int:
    return start(MAIN, folder, *words).wait(LONGEST_S)


@pytest.mark.parametrize("seed", [1])
def test_processes_that_are_killed_all_the_time_change_no_byte(seed: int, tmp_path: Path) -> None:
    """Workers, their nannies, the processes of drives, the client and the scheduler, every few
    seconds while six drives are run, and the merge after it."""
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    for k in range(DRIVES):
        simulate(tmp_path / "scenario.toml", tmp_path / "drives" / f"d{k}", seed=k + 1)
    url = str(tmp_path / "store")
    assert command(tmp_path, "fleet", "add", url, str(tmp_path / "drives" / "*")) == 0
    assert command(tmp_path, "fleet", "run", url, "--workers", "1", "--quiet") == 0
    assert command(tmp_path, "fleet", "merge", url) == 0
    store = Store.at(url)
    undisturbed = map_bytes(store)
    assert len(read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")) >= 2
    forget(store)

    draw = random.Random(seed)
    crew = Crew(tmp_path, url)
    killed: list[str] = []
    until = time.monotonic() + LONGEST_S
    try:
        while not crew.keep_up():
            assert time.monotonic() < until, f"the fleet never ended, after {killed}"
            time.sleep(draw.uniform(1.0, 5.0))
            # so many that every kind is hit; then it must come to an end by itself
            if len(killed) < KILLS and any(e.state() != "done" for e in store.entries()):
                killed += filter(None, [crew.kill_one(draw)])
    finally:
        crew.end()
    assert len(killed) >= 4
    assert {entry.state() for entry in store.entries()} == {"done"}
    for _ in range(4):
        merging = start(MAIN, tmp_path, "fleet", "merge", url, "--workers", "2")
        time.sleep(draw.uniform(0.5, 4.0))
        kill(merging)
    assert command(tmp_path, "fleet", "merge", url, "--workers", "2") == 0
    assert map_bytes(store) == undisturbed


def off(by_s: float, url: str, digest: str, path: str, order: Order) -> Result:
    """A task of a worker whose clock is off."""
    real = time.time
    try:
        time.time = lambda: real() + by_s
        return publish_made(url, digest, path, order)
    finally:
        time.time = real


def test_a_week_of_nights(tmp_path: Path) -> None:
    """Seven nights of new drives: in one the store is full, in one a worker's clock is three years
    off, in one the settings change. Map and history are those of the drives that were done."""
    store = Store.at(str(tmp_path / "store"), make=True)
    nights = [range(0, 2), *(range(k, k + 1) for k in range(2, 8))]
    order, drives, dates = ORDER, [], []
    for night, numbers in enumerate(nights):
        add(store, make_drives(tmp_path / f"night-{night}", numbers))
        task = publish_made
        if night == 2:
            with pytest.raises(StageError, match="the disk is full"):
                run(store, order, workers=2, task=full)
            assert [e.state() for e in store.entries()].count("waiting") == 1
            # nothing is lost, and nothing is new
            assert not merge(store).new
        if night == 3:
            task = partial(off, -3 * 365.25 * 86400.0)
        if night == 4:
            order = Order({}, "b" * 20, (), ORDER.memory)
        ran = run(store, order, workers=2, task=task)
        assert len(ran.done) == (numbers.stop if night == 4 else len(numbers))
        made = merge(store)
        assert (made.new, made.drives) == (True, numbers.stop)
        drives.append(made.drives)
        dates.append(made.version)
    assert dates == [f"{k:06d}" for k in range(1, 8)]
    summary = json.loads((tmp_path / "store" / "map" / "merge.json").read_text())
    assert [step["drives"] for step in summary["history"]] == drives
    assert [step["map"] for step in summary["history"]] == dates
    assert {e.done["key"] for e in store.entries()} == {order.key}
    whole = merge_drives(scene())
    signs = read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")
    likely = whole.existence >= 0.5
    assert len(signs) == summary["history"][-1]["signs"] == likely.sum()
    where = sorted(zip(whole.adjusted.lat[likely], whole.adjusted.lon[likely], strict=True))
    for sign, (lat, lon) in zip(sorted(signs, key=lambda s: s.lat_rad), where, strict=True):
        # a hundredth of the least sigma that a merged sign has
        assert max(abs(sign.lat_rad - lat), abs(sign.lon_rad - lon)) * 6.371e6 < 0.01 * 0.05
    signs_told = [step["signs"] for step in summary["history"]]
    changes = [step["changes"] for step in summary["history"][1:]]
    for after, told in zip(signs_told[1:], changes, strict=True):
        assert after == told["unchanged"] + told["class"] + told["moved"] + told["new"]
