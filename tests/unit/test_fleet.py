"""A store of a fleet: drives on a list, tasks that may be repeated, one map and its history."""

from __future__ import annotations

import csv
import errno
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from fleet_scene import ORDER, make_drives, make_store, map_bytes, publish_made, scene
from merge_scene import to_geodetic

from automap.errors import ConfigError, InputError, StageError
from automap.export import pieces
from automap.io.map_tables import TRACKS, read_tracks
from automap.io.signs_table import read_signs
from automap.mapping.cells import cell_of, quadkey
from automap.mapping.merge import merge_drives
from automap.records import Trajectory
from pipeline.cli.root import cli
from pipeline.fleet import merge as merging
from pipeline.fleet import publish as publishing
from pipeline.fleet import task, tracks
from pipeline.fleet.add import add
from pipeline.fleet.child import begin_of, kind_of
from pipeline.fleet.contents import update_contents, wanted
from pipeline.fleet.merge import merge
from pipeline.fleet.orders import Order, keep_done, key_of, settings_of
from pipeline.fleet.retry import retry
from pipeline.fleet.status import metrics, status, summary_lines, write_status
from pipeline.fleet.store import ASIDE, DONE, Store, StoreGoneError
from pipeline.fleet.versions import current
from pipeline.merge import output
from pipeline.merge.whole import drive_essentials
from pipeline.run.registry import load_stages
from pipeline.settings.load import load_settings
from pipeline.shared.beside import Begin


def run_all(store: Store, order: Order = ORDER) -> None:
    """Every drive that waits, one after another, without Dask."""
    for entry in store.entries():
        if entry.state(order.key) == "waiting":
            publish_made(store.place.url, entry.digest, entry.path, order)


def test_drives_are_added_once_and_a_changed_one_takes_its_own_place(tmp_path: Path) -> None:
    paths = make_drives(tmp_path / "drives", range(3))
    store = Store.at(str(tmp_path / "store"), make=True)
    (tmp_path / "drives" / "notes.txt").write_text("no drive")
    (tmp_path / "drives" / "empty").mkdir()
    first = add(store, [str(tmp_path / "drives" / "*")])
    assert (len(first.new), first.known) == (3, 0)
    assert len(first.warnings) == 1
    assert "empty holds no drive.toml" in first.warnings[0]
    # what a run leaves in the folder is none of the drive
    (Path(paths[0]) / "_automap").mkdir()
    (Path(paths[0]) / "_automap" / "run.json").write_text("{}")
    assert add(store, paths).known == 3
    (Path(paths[1]) / "imu.csv").write_text("7\n")
    again = add(store, paths)
    assert (len(again.new), len(again.replaced), again.known) == (0, 1, 2)
    states = [entry.state() for entry in store.entries()]
    assert sorted(states) == ["replaced", "waiting", "waiting", "waiting"]
    # and back as it was
    (Path(paths[1]) / "imu.csv").write_text("1\n")
    assert len(add(store, paths).replaced) == 1
    waiting = [entry for entry in store.entries() if entry.state() == "waiting"]
    assert {entry.digest for entry in waiting} == set(first.new)


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


def test_the_map_is_that_of_one_merge_of_all(tmp_path: Path) -> None:
    store = make_store(tmp_path)
    run_all(store)
    made = merge(store)
    whole = merge_drives(scene()[:5])
    signs = read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")
    likely = whole.existence >= 0.5
    assert made.signs == len(signs) == likely.sum()
    assert sorted(sign.lat_rad for sign in signs) == sorted(whole.adjusted.lat[likely])
    assert made.sightings == len(whole.sightings)
    table = pq.read_table(tmp_path / "store" / "map" / "sightings.parquet")
    assert len(table) == made.sightings
    offsets = sorted(table["offset_e_m"].to_pylist())
    assert offsets == sorted(whole.adjusted.offset[:, 0])
    residual = sorted(table["residual_n_m"].to_pylist())
    s, sign, a = whole.sightings, whole.association.sign, whole.adjusted
    assert residual == pytest.approx(
        sorted((s.lat - a.lat[sign]) * s.per_lat - a.offset[:, 1]), abs=1e-6
    )
    summary = json.loads((tmp_path / "store" / "map" / "merge.json").read_text())
    assert [d["name"] for d in summary["drives"]] == [d.name for d in whole.drives]
    for row, offset, sd in zip(
        summary["drives"], whole.adjusted.drive_offset, whole.adjusted.drive_sd, strict=True
    ):
        assert row["offset_m"]["e"] == pytest.approx(offset[0], abs=1e-9)
        assert row["offset_sd_m"]["n"] == pytest.approx(sd[1], abs=1e-9)
    for name in ("signs.geojson", "map.kml", "map.gpkg", "report.html", "tracks.parquet"):
        assert (tmp_path / "store" / "map" / name).is_file()
    again = merge(store)
    assert (again.new, again.version) == (False, "000001")


def test_drives_of_one_place_come_into_cells_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By their digests alone every batch would have some of every place, and every cell a file of
    every batch."""
    store = make_store(tmp_path, range(6))
    for entry in store.entries():
        number = int((Path(entry.path) / "imu.csv").read_text())
        publish_made(store.place.url, entry.digest, entry.path, ORDER, cell=f"31{number % 2}")
    monkeypatch.setattr("pipeline.fleet.contents.BATCH", 3)
    batches = []
    monkeypatch.setattr(
        "pipeline.fleet.contents.add_drives",
        lambda cells, drives: batches.append({drive.name for drive in drives}),
    )
    kept: list[str] = []
    drives = wanted(store.entries(), [])
    update_contents(
        store, tmp_path, drives, [], lambda done: None, also=lambda key, entry: kept.append(key)
    )
    # what reads a result does with it all that there is to do
    assert sorted(kept) == sorted(drives)
    assert batches == [{scene()[k].name for k in ks} for ks in ((0, 2, 4), (1, 3, 5))]


def test_where_a_drive_began_is_told(tmp_path: Path) -> None:
    drive = scene()[0]
    assert drive.path is not None
    home = cell_of(drive.path.lat_rad[:1], drive.path.lon_rad[:1])
    assert begin_of(drive) == quadkey(int(home[0]))
    assert begin_of(replace(drive, path=None)).startswith("3")
    assert begin_of(replace(drive, lat_rad=drive.lat_rad * np.nan, path=None)) == ""


def test_what_is_written_beside_needs_nothing_that_is_written_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process begins with it as early as it can, and ends it when it does."""

    @contextmanager
    def at_once(workers: int) -> Iterator[Begin]:
        yield lambda call, /, *words: partial(lambda result: result, call(*words))

    monkeypatch.setattr(output, "MOST_PICTURED", 1)
    store = make_store(tmp_path, range(3))
    run_all(store)
    merge(store)
    last = map_bytes(store)
    shutil.rmtree(tmp_path / "store" / "maps")
    (tmp_path / "store" / "map").unlink()
    monkeypatch.setattr(publishing, "beside", at_once)
    merge(store)
    assert map_bytes(store) == last


def test_a_merge_that_is_ended_anywhere_goes_on_to_the_same_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pipeline.fleet import contents, publish, versions

    store = make_store(tmp_path)
    run_all(store)
    merge(store)
    whole = map_bytes(store)
    for place, name in (
        (contents, "add_drives"), (publish, "write_files"), (versions, "_sync"),
    ):  # fmt: skip
        for kept in ("map", "maps", "cells"):
            path = tmp_path / "store" / kept
            path.unlink() if path.is_symlink() else shutil.rmtree(path)
        with monkeypatch.context() as patch:
            patch.setattr(place, name, ended)
            with pytest.raises(KeyboardInterrupt):
                merge(store)
        assert not (tmp_path / "store" / "map").exists()
        merge(store)
        assert map_bytes(store) == whole


def test_a_map_takes_over_what_is_as_it_was_in_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "MOST_PICTURED", 1)
    monkeypatch.setattr(pieces, "USUAL", 2)
    monkeypatch.setattr(tracks, "MANY_DRIVES", 1)
    taken: list[bool] = []
    take = pieces.Index.take

    def told(self: pieces.Index, key: str) -> object:
        found = take(self, key)
        taken.extend([found is not None] if key else [])
        return found

    monkeypatch.setattr(pieces.Index, "take", told)
    store = make_store(tmp_path, range(2))
    run_all(store)
    merge(store)
    assert len(taken) > 20
    assert not any(taken)
    taken.clear()
    # the same signs, asked for in other words
    merge(store, least_existence=0.4999)
    assert all(taken)
    again = map_bytes(store)
    # as often, but from nothing
    root = tmp_path / "store"
    shutil.rmtree(root / "maps" / "000002")
    (root / "map").unlink()
    (root / "map").symlink_to(Path("maps") / "000001")
    for index in (root / "maps" / "000001").glob(".*.pieces"):
        index.unlink()
    merge(store, least_existence=0.4999)
    assert map_bytes(store) == again


@pytest.mark.parametrize(
    "stage",
    [(merging, "update_contents"), (publishing, "write_files")],
    ids=lambda stage: stage[1],
)
def test_a_share_that_goes_during_a_merge_is_told_and_its_map_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: tuple[ModuleType, str]
) -> None:
    """The mount point is an empty folder then, into which all can be written."""
    store = make_store(tmp_path, range(2))
    run_all(store)
    merge(store)
    before = map_bytes(store)
    add(store, make_drives(tmp_path / "more", range(2, 3)))
    run_all(store)
    root, share = tmp_path / "store", tmp_path / "share"
    go_on = getattr(*stage)

    def gone(*words: object, **named: object) -> object:
        root.rename(share)
        root.mkdir()
        return go_on(*words, **named)

    with monkeypatch.context() as patch:
        patch.setattr(*stage, gone)
        with pytest.raises(StoreGoneError, match="is not there any more: its disk or network sha"):
            merge(store)
    assert not (root / "map").is_symlink()
    shutil.rmtree(root)
    share.rename(root)
    assert map_bytes(store) == before
    made = merge(store)
    # no drive was taken for one whose result is damaged
    assert (made.version, made.drives) == ("000002", 3)


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


def ended(*words: object) -> None:
    raise KeyboardInterrupt


def test_new_drives_keep_names_and_are_told_as_changes(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(4))
    run_all(store)
    merge(store)
    before = read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")
    old = tmp_path / "store" / "map" / "merge.json"
    reader = old.open()
    add(store, make_drives(tmp_path / "more", range(4, 8)))
    run_all(store)
    made = merge(store)
    # who reads the older map goes on
    assert json.load(reader)["signs"] == len(before)
    assert (tmp_path / "store" / "maps" / "000001" / "map.kml").is_file()
    after = read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")
    names = {sign.id for sign in before} & {sign.id for sign in after}
    assert len(names) > 0.9 * len(before)
    assert made.comparison is not None
    kinds = [change.kind for change in made.comparison.changes]
    assert made.comparison.unchanged + kinds.count("class") == len(names) - kinds.count("moved")
    assert (tmp_path / "store" / "changes" / "000002.geojson").is_file()
    history = json.loads((tmp_path / "store" / "map" / "merge.json").read_text())["history"]
    assert [step["drives"] for step in history] == [4, 8]
    # all from nothing: the same places
    other = make_store(tmp_path / "other", range(8))
    run_all(other)
    merge(other)
    fresh = read_signs(tmp_path / "other" / "store" / "map" / "signs_raw.parquet")
    assert len(fresh) == len(after)
    off = [a.lat_rad - b.lat_rad for a, b in zip(sorted_by_place(after), sorted_by_place(fresh),
                                                 strict=True)]  # fmt: skip
    assert max(map(abs, off)) * 6.371e6 < 0.01 * 0.05


def sorted_by_place(signs: list) -> list:
    return sorted(signs, key=lambda sign: (round(sign.lat_rad, 9), round(sign.lon_rad, 9)))


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
    assert len(list(store.leftovers(store.entries()))) == 5


def status_of(store: Store, order: Order) -> dict:
    store.write("settings.json", {"settings": {}, "key": order.key})
    return status(store)[0]


def test_a_clock_that_is_off_changes_nothing_in_the_map(tmp_path: Path) -> None:
    """What a machine takes for the time stands in no file that the map is made from."""
    store = make_store(tmp_path, range(4))
    run_all(store)
    merge(store)
    right = map_bytes(store)
    (tmp_path / "store" / "map").unlink()
    shutil.rmtree(tmp_path / "store" / "maps")
    shutil.rmtree(tmp_path / "store" / "cells")
    for path in (tmp_path / "store").rglob("*"):
        if path.name == "run.json":
            record = json.loads(path.read_text())
            path.write_text(json.dumps({**record, "started": "2046-01-01T00:00:00Z"}))
        os.utime(path, (2.4e9, 2.4e9))
    merge(store)
    assert map_bytes(store) == right


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
    task = partial(publish_made, verdict=verdict)
    for entry in store.entries():
        task(store.place.url, entry.digest, entry.path, ORDER)
    merge(store)
    write_status(store)
    told, drives = status(store)
    assert told["doubtful"] == 2
    assert any("The fixes jump." in line for line in summary_lines(told, drives))
    page = (tmp_path / "store" / "status" / "status.html").read_text()
    assert "The fixes jump." in page
    lines = (tmp_path / "store" / "status" / "drives.jsonl").read_text().splitlines()
    assert [json.loads(line)["verdict"] for line in lines] == ["doubtful"] * 2
    text = (tmp_path / "store" / "status" / "automap_fleet.prom").read_text()
    assert text == metrics(told)
    assert "automap_fleet_drives_done 2\n" in text
    assert "automap_fleet_driven_km 24\n" in text


def test_a_drive_far_off_the_others_is_warned_of(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(8))
    for entry in store.entries():
        off = 5.0 if entry.path.endswith("d1") else 0.0
        publish_made(store.place.url, entry.digest, entry.path, ORDER, off)
    warnings = merge(store).warnings
    told = [text for text in warnings if "sigmas of its path" in text]
    assert [text.split(":")[0] for text in told] == [scene()[1].name]


def test_a_copy_of_a_recording_counts_once(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(2))
    run_all(store)
    first, second = store.entries()
    store.mark(second.digest, DONE, {**second.done, "recording": first.done["recording"]})
    made = merge(store)
    assert made.drives == 1
    assert any("is another copy of" in text for text in made.warnings)


def test_a_result_that_is_damaged_is_run_again(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(3))
    run_all(store)
    entry = store.entries()[0]
    (tmp_path / "store" / store.result(entry) / "signs_raw.parquet").unlink()
    made = merge(store)
    assert made.drives == 2
    assert any("left out until it is run again" in text for text in made.warnings)
    assert store.entry(entry.digest).state() == "waiting"


def test_one_merge_at_a_time(tmp_path: Path) -> None:
    from pipeline.shared.lock import locked

    store = make_store(tmp_path, range(1))
    run_all(store)
    folder = merging.cells_folder(store.place)
    folder.mkdir()
    with locked(folder), pytest.raises(ConfigError, match="another automap run is writing"):
        merge(store)
    assert current(store) == ""


def test_no_drive_done_is_no_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no drive is done"):
        merge(make_store(tmp_path, range(1)))


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
        (OSError(errno.ENOSPC, "No space left"), "io"),
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


def test_a_map_of_very_many_drives_has_tracks_and_heights_above_the_sea(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = make_store(tmp_path)
    run_all(store)
    few = merge(store)
    one = read_tracks(tmp_path / "store" / "map" / TRACKS)
    assert len(one) == few.drives == 5
    monkeypatch.setattr(tracks, "MANY_DRIVES", 3)
    (tmp_path / "store" / "map").unlink()
    merge(store)
    same = read_tracks(tmp_path / "store" / "map" / TRACKS)
    assert list(same) == list(one)
    for name, track in one.items():
        assert all(np.array_equal(v, vars(same[name])[k]) for k, v in vars(track).items())
    summary = json.loads((tmp_path / "store" / "map" / "merge.json").read_text())
    assert any("of more than 3 drives they are gigabytes" in text for text in summary["warnings"])
    # signs get their roads by tracks alone
    lat, lon, _ = to_geodetic(np.array([[0.0, -100.0, 0.0], [0.0, 700.0, 0.0]]))
    line = np.degrees(np.column_stack([lon, lat])).tolist()
    street = {"type": "Feature", "properties": {"road_id": "R1", "name": "High Street"},
              "geometry": {"type": "LineString", "coordinates": line}}  # fmt: skip
    layer = tmp_path / "roads.geojson"
    layer.write_text(json.dumps({"type": "FeatureCollection", "features": [street]}))
    told = CliRunner().invoke(
        cli, ["fleet", "merge", str(tmp_path / "store"), "--roads", str(layer)]
    )
    assert told.exit_code == 0, told.output
    rows = list(csv.DictReader((tmp_path / "store" / "map" / "sign_roads.csv").open(newline="")))
    assert len(rows) > 15
    assert {row["road_name"] for row in rows} == {"High Street"}
    with pytest.raises(InputError, match=r"--roads .*none\.gpkg cannot be read"):
        merge(store, roads=tmp_path / "none.gpkg")
    # what is kept is not read again, unless the drive has another result
    read: list[Path] = []

    def essentials(folder: Path) -> tuple[Trajectory | None, dict[str, float]]:
        read.append(folder)
        track, _ = drive_essentials(folder)
        return track, {sign.id: 20.0 for sign in read_signs(folder / "signs_raw.parquet")}

    monkeypatch.setattr(tracks, "drive_essentials", essentials)
    monkeypatch.setattr(tracks, "MOST_ROWS", sum(map(len, one.values())) // 3)
    kept = store.place.folder / "cells" / tracks.KEPT  # type: ignore[operator]
    sorted(kept.glob("*.npz"))[0].unlink()
    (tmp_path / "store" / "map").unlink()
    merge(store)
    assert len(read) == 1
    coarse = read_tracks(tmp_path / "store" / "map" / TRACKS)
    assert sum(map(len, coarse.values())) <= sum(map(len, one.values())) // 3 + 2 * len(one)
    told = [s.geoid_m for s in read_signs(tmp_path / "store" / "map" / "signs_raw.parquet")]
    assert 20.0 in told
