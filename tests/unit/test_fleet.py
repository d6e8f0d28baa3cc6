"""A store of many drives: its tasks, its keys and what is told of it."""

from __future__ import annotations

import errno
import json
import os
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fleet_scene import ORDER, make_drives, make_store, publish_made, run_all, scene

from automap.errors import ConfigError, InputError, StageError
from automap.mapping.cells import cell_of, quadkey
from pipeline.cli.root import cli
from pipeline.fleet import task
from pipeline.fleet.add import add
from pipeline.fleet.child import begin_of, kind_of
from pipeline.fleet.merge import merge
from pipeline.fleet.orders import Order, keep_done, key_of, settings_of
from pipeline.fleet.places import place_at
from pipeline.fleet.retry import retry
from pipeline.fleet.status import metrics, status, summary_lines, write_status
from pipeline.fleet.store import ASIDE, DONE, Store
from pipeline.run.registry import load_stages
from pipeline.settings.load import load_settings


def test_a_folder_with_other_files_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(ConfigError, match=r"holds other files \(photo.jpg\)"):
        Store.at(str(tmp_path), make=True)
    with pytest.raises(ConfigError, match="no store of a fleet; automap fleet add"):
        Store.at(str(tmp_path / "none"))


def test_a_task_that_is_repeated_changes_nothing(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(1))
    run_all(store)
    (entry,) = store.entries()
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    assert publish_made(store.place.url, entry.digest, entry.path, ORDER).kind == "done"
    assert sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")) == before


def test_a_result_without_its_marker_is_not_done(tmp_path: Path) -> None:
    """Killed before the marker, or its files removed afterwards: the drive waits."""
    store = make_store(tmp_path, range(2))
    run_all(store)
    first, second = store.entries()
    (tmp_path / "store" / "drives" / first.digest / DONE).unlink()
    shutil.rmtree(tmp_path / "store" / store.result(second))
    assert [entry.state() for entry in store.entries()] == ["waiting", "waiting"]
    run_all(store)
    assert [entry.state() for entry in store.entries()] == ["done", "done"]


def test_where_a_drive_began_is_told(tmp_path: Path) -> None:
    drive = scene()[0]
    assert drive.path is not None
    home = cell_of(drive.path.lat_rad[:1], drive.path.lon_rad[:1])
    assert begin_of(drive) == quadkey(int(home[0]))
    assert begin_of(replace(drive, path=None)).startswith("3")
    assert begin_of(replace(drive, lat_rad=drive.lat_rad * np.nan, path=None)) == ""


def test_a_result_is_not_put_into_a_store_that_is_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = make_store(tmp_path, range(1))
    (entry,) = store.entries()

    def answered(drive: Path, out: Path, scratch: Path, order: Order) -> dict[str, str]:
        out.mkdir()
        shutil.rmtree(tmp_path / "store")
        return {"name": "d0"}

    monkeypatch.setattr(task, "_supervised", answered)
    monkeypatch.setattr(Order, "settings", lambda order: None)
    result = task.run_task(store.place.url, entry.digest, entry.path, ORDER)
    assert result.kind == "store"
    assert "its disk or network share has gone" in result.error


def test_a_full_disk_is_told_with_the_file_and_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library that copies a file names both files of it, and not which of them failed."""
    (tmp_path / "report.html").write_text("all is well")

    def full(*words: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "sendfile", full)
    with pytest.raises(StageError, match=r"^cannot write .*drives/d/report.html: the disk is full"):
        place_at(str(tmp_path / "store")).put(tmp_path / "report.html", "drives/d/report.html")


@pytest.mark.parametrize("how", ["raised", "answered", "hidden"])
def test_a_machine_without_room_is_no_fault_of_a_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """The disk of temporary files is full: so says the system, the drive's process, or only the
    disk, where a library says something else."""
    store = make_store(tmp_path, range(1))
    (entry,) = store.entries()

    def answered(drive: Path, out: Path, scratch: Path, order: Order) -> dict[str, str]:
        if how == "raised":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return {"kind": "full" if how == "answered" else "data", "error": "a sentence"}

    monkeypatch.setattr(task, "_supervised", answered)
    monkeypatch.setattr(task, "_has_room", lambda folder: how != "hidden")
    monkeypatch.setattr(Order, "settings", lambda order: None)
    result = task.run_task(store.place.url, entry.digest, entry.path, ORDER)
    assert result.kind == "full"
    assert result.error.startswith(f"{entry.path}: the disk of temporary files on ")


def test_drives_that_are_not_there_are_no_damaged_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of many is gone; one that was done with other settings; all are gone, with their disk."""
    store = make_store(tmp_path, range(2))
    entry, other = store.entries()

    def answered(drive: Path, out: Path, scratch: Path, order: Order) -> dict[str, str]:
        return {"kind": "data", "error": f"{drive}: there is no such drive folder."}

    def kind() -> str:
        found = task.run_task(store.place.url, entry.digest, entry.path, ORDER)
        return found.kind

    monkeypatch.setattr(task, "_supervised", answered)
    monkeypatch.setattr(Order, "settings", lambda order: None)
    assert kind() == "data"
    shutil.rmtree(entry.path)
    assert kind() == "io"
    store.write(f"drives/{entry.digest}/older/run.json", {})
    store.mark(entry.digest, DONE, {"key": "b" * 20, "result": "older"})
    assert kind() == "away"
    store.unmark(entry.digest, DONE)
    shutil.rmtree(other.path)
    assert kind() == "away"


def test_a_status_is_not_put_into_a_store_that_is_gone(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(1))
    shutil.rmtree(tmp_path / "store")
    with pytest.raises(StageError, match="its disk or network share has gone"):
        write_status(store)
    assert not (tmp_path / "store").exists()


@pytest.mark.slow
def test_settings_that_change_between_nights(tmp_path: Path) -> None:
    """Drives done with others wait again, and until then the map has their older results; with
    --keep-done they stay."""
    store = make_store(tmp_path, range(3))
    run_all(store)
    merge(store)
    add(store, make_drives(tmp_path / "night", range(3, 5)))
    newer = Order({}, "b" * 20, (), ORDER.memory)
    assert [e.state(newer.key) for e in store.entries()] == ["waiting"] * 5
    told = status_of(store, newer)
    assert told["older_settings"] == 0
    keep_done(store, newer.key)
    assert sorted(e.state(newer.key) for e in store.entries()) == ["done"] * 3 + ["waiting"] * 2
    assert status_of(store, newer)["older_settings"] == 3
    run_all(store, newer)
    assert merge(store).drives == 5
    # the same drives once more, with the first settings: none has two results in the map
    last = Order({}, "c" * 20, (), ORDER.memory)
    run_all(store, last)
    made = merge(store)
    assert (made.drives, made.version) == (5, "000003")
    kept = {e.done["key"] for e in store.entries()}
    assert kept == {last.key}
    assert made.sightings == sum(len(drive) for drive in scene()[:5])
    # a worker may be at work on what is asked for now
    left = [len(list(store.leftovers(store.entries(), k * 20))) for k in "abc"]
    assert left == [2, 3, 5]


def status_of(store: Store, order: Order) -> dict:
    store.write("settings.json", {"settings": {}, "key": order.key})
    return status(store)[0]


def test_a_drive_that_was_put_aside_is_named_and_may_be_tried_again(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(3))
    bad = store.entries()[1]
    store.mark(bad.digest, ASIDE, {"kind": "data", "error": f"{bad.path}: line 1 is no number."})
    run_all(store)
    merge(store)
    told, drives = status(store)
    assert (told["done"], told["waiting"], told["aside"]) == (2, 0, 1)
    assert told["reasons"] == {bad.path: f"{bad.path}: line 1 is no number."}
    assert any("line 1 is no number" in line for line in summary_lines(told, drives))
    with pytest.raises(InputError, match="no such drive was put aside"):
        retry(store, [store.entries()[0].digest])
    assert [e.digest for e in retry(store, [bad.path])] == [bad.digest]
    run_all(store)
    assert status(store)[0]["map"]["not_in_it"] == 1
    assert merge(store).drives == 3


def test_doubtful_paths_and_metrics_are_told(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(2))
    verdict = {"state": "doubtful", "reasons": [{"text": "The fixes jump."}]}
    task = partial(publish_made, verdict=verdict, warnings=["no IMU recording"])
    for entry in store.entries():
        task(store.place.url, entry.digest, entry.path, ORDER)
    merge(store)
    write_status(store)
    told, drives = status(store)
    assert told["doubtful"] == 2
    assert any("The fixes jump." in line for line in summary_lines(told, drives))
    page = (tmp_path / "store" / "status" / "status.html").read_text()
    assert "The fixes jump." in page
    # of two drives of one name each is told
    assert f"{drives[0]['path']}: the path is doubtful: The fixes jump." in "\n".join(
        summary_lines(told, drives)
    )
    assert "the path is doubtful: The fixes jump." in page
    lines = (tmp_path / "store" / "status" / "drives.jsonl").read_text().splitlines()
    assert [json.loads(line)["verdict"] for line in lines] == ["doubtful"] * 2
    assert json.loads(lines[0])["warnings"] == ["no IMU recording"]
    text = (tmp_path / "store" / "status" / "automap_fleet.prom").read_text()
    assert text == metrics(told)
    assert "automap_fleet_drives_done 2\n" in text
    assert "automap_fleet_driven_km 24\n" in text


def test_a_result_that_is_damaged_is_run_again(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(3))
    run_all(store)
    entry = store.entries()[0]
    (tmp_path / "store" / store.result(entry) / "signs_raw.parquet").unlink()
    # a copy that was cut short
    cut = store.entries()[1]
    path = tmp_path / "store" / store.result(cut) / "trajectory.parquet"
    path.write_bytes(path.read_bytes()[:-9])
    made = merge(store)
    assert made.drives == 1
    assert sum("left out until it is run again" in text for text in made.warnings) == 2
    assert [e.state() for e in store.entries()] == ["waiting", "waiting", "done"]


def test_the_key_of_settings_follows_settings_versions_and_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store.at(str(tmp_path / "store"), make=True)
    usual = key_of(settings_of(store, None, ()))
    other = key_of(settings_of(store, None, ("detect.min_score=0.7",)))
    assert other != usual
    # they are the store's now
    assert key_of(settings_of(store, None, ())) == other
    stages = [s if s.name != "fuse" else changed(s) for s in load_stages()]
    monkeypatch.setattr("pipeline.fleet.orders.load_stages", lambda: stages)
    newer = key_of(settings_of(store, None, ()))
    assert newer != other
    # status counts by it: with the old one all that a newer version did was told to wait
    assert store.read("settings.json")["key"] == newer
    echo = settings_of(store, None, ()).echo()
    with pytest.raises(ConfigError, match="another version of automap"):
        Order(echo, other, (), 1).settings()


@pytest.mark.parametrize("text", ["{", "{}", '{"settings": 1, "key": "a"}'])
def test_damaged_settings_are_not_taken_for_the_usual_ones(tmp_path: Path, text: str) -> None:
    store = make_store(tmp_path, range(1))
    (tmp_path / "store" / "settings.json").write_text(text)
    with pytest.raises(ConfigError, match=r"settings.json is damaged; give the store's settings"):
        settings_of(store, None, ())
    settings_of(store, None, ("detect.min_score=0.7",))
    assert settings_of(store, None, ()).detect.min_score == 0.7


def test_where_the_files_lie_that_settings_name_is_none_of_the_key(tmp_path: Path) -> None:
    """A store that moves to another machine is done there too; what the files hold counts."""
    keys = []
    for folder, text in (("a", "one"), ("b", "one"), ("c", "other")):
        roads = tmp_path / folder / "roads.geojson"
        roads.parent.mkdir()
        roads.write_text(text)
        keys.append(key_of(load_settings(assignments=[f"export.roads={str(roads)!r}"])))
    assert keys[0] == keys[1] != keys[2]


def test_results_of_another_version_are_told_before_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = make_store(tmp_path, range(2))
    order = Order({}, key_of(settings_of(store, None, ())), (), ORDER.memory)
    run_all(store, order)
    assert merge(store).warnings == []
    assert status(store)[0]["older_version"] == 0
    stages = [s if s.name != "fuse" else changed(s) for s in load_stages()]
    monkeypatch.setattr("pipeline.fleet.orders.load_stages", lambda: stages)
    told, drives = status(store)
    assert (told["done"], told["older_version"]) == (2, 2)
    assert any("another version of automap" in line for line in summary_lines(told, drives))
    assert any(text.startswith("2 of the drives are as another") for text in merge(store).warnings)


@pytest.mark.parametrize("words", [("add", "store", "none/*"), ("run", "store", "--drives", "no")])
def test_no_store_is_made_for_drives_that_are_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["fleet", *words])
    assert result.exit_code != 0
    assert not (tmp_path / "store").exists()


def changed(stage):  # type: ignore[no-untyped-def]
    from dataclasses import replace

    return replace(stage, version=stage.version + 1)


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        (MemoryError(), "memory"),
        (OSError(errno.EIO, "Input/output error"), "io"),
        (OSError(errno.ENOSPC, "No space left"), "full"),
        (FileNotFoundError(errno.ENOENT, "No such file"), "data"),
        (ValueError("not a number"), "data"),
    ],
)
def test_what_may_pass_is_told_from_what_will_not(cause: BaseException, kind: str) -> None:
    error = StageError("a sentence")
    error.__cause__ = cause
    assert kind_of(error) == kind


def test_the_commands(tmp_path: Path) -> None:
    paths = make_drives(tmp_path / "drives", range(2))
    url = str(tmp_path / "store")
    runner = CliRunner()

    def told(*words: str) -> str:
        result = runner.invoke(cli, ["fleet", *words], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    first = told("add", url, *paths)
    assert f"{url} is a new store.\n2 drives are new" in first
    assert "is a new store" not in told("add", url, *paths)
    store = Store.at(url)
    store.write("settings.json", {"settings": {}, "key": ORDER.key})
    run_all(store)
    assert "map 000001" in told("merge", url)
    assert "is that of all 2 drives already" in told("merge", url)
    found = json.loads(told("status", url, "--json"))
    assert (found["done"], found["waiting"], found["aside"]) == (2, 0, 0)
    assert "2 drives" in told("status", url, "-o", str(tmp_path / "told"))
    assert sorted(p.name for p in (tmp_path / "told").iterdir()) == [
        "automap_fleet.prom", "drives.jsonl", "status.html",
    ]  # fmt: skip
    assert "0 drives wait again" in told("retry", url)
