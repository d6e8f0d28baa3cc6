"""Drives of a fleet on Dask: retries, what is put aside, and processes that are killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="Dask is not installed (the extra fleet)")

from fleet_scene import ORDER, full, make_drives, make_store, map_bytes, publish_made

from automap.errors import ConfigError, StageError
from pipeline.fleet.add import add
from pipeline.fleet.merge import merge
from pipeline.fleet.orders import Order
from pipeline.fleet.run import fitting_workers, order_for, run
from pipeline.fleet.store import Store
from pipeline.fleet.task import Result, run_task
from pipeline.settings.load import load_settings
from tests.unit.fake_stages import make_drive

ROOT = Path(__file__).parents[2]


def tried(
    marks: Path, kind: str, good_after: int, url: str, digest: str, path: str, order: Order
) -> Result:
    """A task that fails so often with ``kind`` before it does its work."""
    with (marks / digest).open("a") as file:
        file.write(f"{order.memory}\n")
    if len((marks / digest).read_text().splitlines()) <= good_after:
        return Result(digest, kind, f"{path}: {kind}.")
    return publish_made(url, digest, path, order)


def slowly(url: str, digest: str, path: str, order: Order) -> Result:
    """A task that takes a while."""
    time.sleep(0.7)
    return publish_made(url, digest, path, order)


def more_slowly(url: str, digest: str, path: str, order: Order) -> Result:
    """A task that is not done before another process has seen that one is."""
    time.sleep(1.5)
    return slowly(url, digest, path, order)


def run_slowly(url: str, scheduler: str = "", task: Callable[..., Result] = slowly) -> None:
    """What ``automap fleet run`` does, in a process of its own, with slow tasks."""
    run(Store.at(url), ORDER, scheduler or None, 2, task=task)


def memories(marks: Path, store: Store) -> list[int]:
    (entry,) = store.entries()
    return [int(line) for line in (marks / entry.digest).read_text().split()]


def test_the_drives_of_a_store_are_run_and_merged(tmp_path: Path) -> None:
    store = make_store(tmp_path)
    told: list[float] = []
    ran = run(
        store, ORDER, workers=2, task=publish_made, progress=lambda done, text: told.append(done)
    )
    assert (len(ran.done), ran.aside, ran.doubtful) == (5, {}, [])
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1.0)
    assert merge(store).drives == 5
    assert run(store, ORDER, task=publish_made).done == []


def test_the_largest_drives_are_begun_first(tmp_path: Path) -> None:
    """One that came last would be run while all other workers have nothing to do."""
    paths = make_drives(tmp_path / "drives", range(5))
    for k, path in enumerate(paths):
        (Path(path) / "notes.txt").write_text("long " * (k * 3 % 5))
    store = Store.at(str(tmp_path / "store"), make=True)
    add(store, paths)
    done = run(store, ORDER, workers=1, task=publish_made).done
    sizes = [store.entry(digest).size for digest in done]
    assert len(sizes) == 5
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize(
    ("kind", "after", "tries", "good"),
    [("io", 2, 3, True), ("io", 9, 3, False), ("data", 9, 1, False), ("lost", 4, 5, True),
     ("away", 9, 3, False),
     ("lost", 99, 10, False), ("memory", 1, 2, True), ("memory", 9, 3, False)],
)  # fmt: skip
def test_what_may_pass_is_tried_again_and_bad_data_never(
    tmp_path: Path, kind: str, after: int, tries: int, good: bool
) -> None:
    store = make_store(tmp_path, range(1))
    marks = tmp_path / "marks"
    marks.mkdir()
    ran = run(store, ORDER, workers=1, task=partial(tried, marks, kind, after))
    memory = memories(marks, store)
    assert len(memory) == tries
    assert memory[1:] == [2 * ORDER.memory if kind == "memory" else ORDER.memory] * (tries - 1)
    (entry,) = store.entries()
    left = "waiting" if kind == "away" else "aside"
    assert entry.state() == ("done" if good else left)
    told = ran.away if kind == "away" else ran.aside
    assert list(told.values()) == ([] if good else [f"{entry.path}: {kind}."])
    assert len(ran.aside) + len(ran.away) + len(ran.done) == 1


def test_a_machine_without_room_for_temporary_files_puts_no_drive_aside(tmp_path: Path) -> None:
    """It is tried again, as another drive may have taken the room for a moment; then the run
    ends."""
    store = make_store(tmp_path, range(1))
    marks = tmp_path / "marks"
    marks.mkdir()
    with pytest.raises(StageError, match=r": full\. What is done stays"):
        run(store, ORDER, workers=1, task=partial(tried, marks, "full", 9))
    assert len(memories(marks, store)) == 3
    assert {entry.state() for entry in store.entries()} == {"waiting"}
    assert len(run(store, ORDER, workers=1, task=partial(tried, marks, "full", 4)).done) == 1


def test_a_full_store_puts_no_drive_aside(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(3))
    with pytest.raises(StageError, match=r"the disk is full\. What is done stays"):
        run(store, ORDER, workers=1, task=full)
    assert {entry.state() for entry in store.entries()} == {"waiting"}
    assert len(run(store, ORDER, workers=1, task=publish_made).done) == 3


def test_a_scheduler_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = make_store(tmp_path, range(1))
    monkeypatch.setattr("pipeline.fleet.run.PATIENCE", "0.5s")
    with pytest.raises(ConfigError, match="no scheduler answers there"):
        run(store, ORDER, "tcp://127.0.0.1:9")


@pytest.mark.slow
def test_damaged_drives_are_put_aside_with_their_sentence(tmp_path: Path) -> None:
    """In real processes: a log that is none, and a manifest that is none."""
    paths = [str(make_drive(tmp_path / name, "t_ns,what\n1,2\n")) for name in ("log", "toml")]
    (tmp_path / "toml" / "drive.toml").write_text("schema = [")
    store = Store.at(str(tmp_path / "store"), make=True)
    add(store, paths)
    ran = run(store, order_for(store, load_settings(), 3 << 30), workers=2)
    assert len(ran.aside) == 2
    reasons = sorted(ran.aside.values())
    assert str(tmp_path / "log") in reasons[0]
    assert "drive.toml" in reasons[1]
    assert {e.aside["kind"] for e in store.entries()} == {"data"}
    assert {e.aside["tries"] for e in store.entries()} == {1}


def test_a_drive_takes_no_more_memory_than_stated(tmp_path: Path) -> None:
    store = Store.at(str(tmp_path / "store"), make=True)
    add(store, [str(make_drive(tmp_path / "drive"))])
    order = order_for(store, load_settings(), 20 << 20)
    (entry,) = store.entries()
    result = run_task(store.place.url, entry.digest, entry.path, order)
    assert result.kind == "memory"
    assert "more than the 0.0 GB of memory" in result.error


def test_another_version_is_no_fault_of_the_drive(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(1))
    order = replace(order_for(store, load_settings(), 1 << 30), key="b" * 20)
    with pytest.raises(ConfigError, match="another version of automap"):
        run(store, order, workers=1)
    assert [entry.state() for entry in store.entries()] == ["waiting"]


def test_workers_fit_the_machine() -> None:
    assert fitting_workers(1) == len(os.sched_getaffinity(0))
    assert fitting_workers(1 << 60) == 1


def start(code: str, folder: Path) -> subprocess.Popen[bytes]:
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "unit")]),
    }
    return subprocess.Popen(
        [sys.executable, "-c", code], env=environment, cwd=folder,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def wait_for(store: Store, count: int) -> None:
    until = time.monotonic() + 120.0
    while sum(e.state() == "done" for e in store.entries()) < count:
        assert time.monotonic() < until, "nothing was done"
        time.sleep(0.05)


def forget_map(store: Store) -> None:
    import shutil

    assert store.place.folder is not None
    (store.place.folder / "map").unlink()
    for name in ("maps", "cells"):
        shutil.rmtree(store.place.folder / name)


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_to_the_same_map(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(6))
    code = f"import test_fleet_dask as t; t.run_slowly({store.place.url!r})"
    child = start(code, tmp_path)
    wait_for(store, 2)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert any(entry.state() == "waiting" for entry in store.entries())
    run(store, ORDER, workers=2, task=publish_made)
    merge(store)
    killed = map_bytes(store)
    forget_map(store)
    for entry in store.entries():
        # from nothing
        store.place.remove(f"drives/{entry.digest}/done.json")
    run(store, ORDER, workers=1, task=publish_made)
    merge(store)
    assert map_bytes(store) == killed


def test_an_interrupt_ends_a_run_cleanly(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(6))
    code = (
        "import test_fleet_dask as t\n"
        "from pipeline.shared.interrupts import interruptible\n"
        "interruptible()\n"
        "try:\n"
        f"    t.run_slowly({store.place.url!r}, task=t.more_slowly)\n"
        "except KeyboardInterrupt:\n"
        "    raise SystemExit(130)\n"
    )
    child = start(code, tmp_path)
    wait_for(store, 1)
    child.send_signal(signal.SIGINT)
    assert child.wait(60) == 130
    done = sum(entry.state() == "done" for entry in store.entries())
    assert 1 <= done < 6


def test_an_interrupt_that_was_lost_in_a_library_ends_a_run_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = make_store(tmp_path, range(3))
    told = threading.Event()
    monkeypatch.setattr("pipeline.fleet.run.told_to_end", told)
    with pytest.raises(KeyboardInterrupt):
        run(store, ORDER, workers=1, task=slowly, progress=lambda done, text: told.set())
    assert sum(entry.state() == "done" for entry in store.entries()) < 3


@contextmanager
def cluster(
    folder: Path, workers: int
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]], Callable[[], subprocess.Popen[bytes]]]]:
    """A scheduler's address, its workers, and what begins another one."""
    file = folder / "scheduler.json"
    scheduler = start(
        "from distributed.cli.dask_scheduler import main; main(["
        f"'--scheduler-file', {str(file)!r}, '--port', '0', '--host', '127.0.0.1', "
        "'--no-dashboard'], standalone_mode=False)",
        folder,
    )
    working = (
        "from distributed.cli.dask_worker import main; main(["
        f"'--scheduler-file', {str(file)!r}, '--nthreads', '1', '--no-dashboard', '--no-nanny'], "
        "standalone_mode=False)"
    )
    children = [start(working, folder) for _ in range(workers)]
    try:
        until = time.monotonic() + 120.0
        while not file.is_file() and time.monotonic() < until:
            time.sleep(0.1)
        yield json.loads(file.read_text())["address"], children, lambda: start(working, folder)
    finally:
        for child in (*children, scheduler):
            child.kill()
            child.wait()


@pytest.mark.slow
def test_workers_that_are_killed_change_nothing(tmp_path: Path) -> None:
    """A scheduler of its own with two workers, one of which is killed again and again."""
    store = make_store(tmp_path, range(8))
    with cluster(tmp_path, 2) as (address, children, another):
        code = f"import test_fleet_dask as t; t.run_slowly({store.place.url!r}, {address!r})"
        client = start(code, tmp_path)
        for count in (1, 3, 5):
            wait_for(store, count)
            victim = children.pop(0)
            victim.kill()
            victim.wait()
            children.append(another())
        assert client.wait(240) == 0
    assert {entry.state() for entry in store.entries()} == {"done"}
    merge(store)
    killed = map_bytes(store)
    forget_map(store)
    for entry in store.entries():
        store.place.remove(f"drives/{entry.digest}/done.json")
    run(store, ORDER, workers=1, task=publish_made)
    merge(store)
    assert map_bytes(store) == killed


@pytest.mark.slow
def test_the_end_of_a_worker_does_not_count_against_drives_that_wait(tmp_path: Path) -> None:
    """The only worker is killed after each drive. Whoever began four times in vain is put aside
    here, but drives that waited all the while did not begin."""
    store = make_store(tmp_path, range(8))
    with cluster(tmp_path, 1) as (address, children, another):
        code = (
            "import test_fleet_dask as t\n"
            "from pipeline.fleet import run\n"
            "run.LOST = 1\n"
            f"t.run_slowly({store.place.url!r}, {address!r})"
        )
        client = start(code, tmp_path)
        for count in range(1, 7):
            wait_for(store, count)
            children[0].kill()
            children[0].wait()
            children[0] = another()
        assert client.wait(240) == 0
    assert [entry.state() for entry in store.entries()] == ["done"] * 8


def test_nobody_else_can_reach_what_runs_the_drives(tmp_path: Path) -> None:
    """Servers of a cluster on this machine listen to this machine alone."""
    import psutil

    def listening() -> set[tuple[str, int]]:
        found = psutil.Process().net_connections("tcp")
        return {(c.laddr.ip, c.laddr.port) for c in found if c.status == psutil.CONN_LISTEN}

    store, before = make_store(tmp_path, range(1)), listening()
    during: set[tuple[str, int]] = set()
    run(store, ORDER, workers=1, task=publish_made, progress=lambda *_: during.update(listening()))
    assert during - before
    assert {address for address, _ in during - before} == {"127.0.0.1"}
