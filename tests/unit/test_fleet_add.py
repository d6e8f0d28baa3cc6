"""Drives that are added to a store: new ones, and those that changed, moved or cannot be read."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from fleet_scene import make_drives, make_store, run_all

from pipeline.fleet.add import add
from pipeline.fleet.contents import older_results, wanted
from pipeline.fleet.places import Folder, place_at
from pipeline.fleet.retry import retry
from pipeline.fleet.status import status
from pipeline.fleet.store import Store


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


def test_drives_that_changed_places_are_none_that_changed(tmp_path: Path) -> None:
    """Numbers that move on by one: a new drive in the first one's place, and so on."""
    first, second, third = (Path(path) for path in make_drives(tmp_path / "drives", range(3)))
    store = Store.at(str(tmp_path / "store"), make=True)
    known = add(store, [str(first), str(second)]).new
    third.rename(tmp_path / "newest")
    second.rename(third)
    first.rename(second)
    (tmp_path / "newest").rename(first)
    found = add(store, [str(tmp_path / "drives" / "*")])
    assert (len(found.new), found.replaced, found.known) == (1, [], 2)
    assert [store.entry(digest).path for digest in known] == [str(second), str(third)]
    assert not any(entry.replaced for entry in store.entries())


def test_a_drive_marked_as_changed_late_is_not_there_twice(tmp_path: Path) -> None:
    """An end between the marker of the new one and that of the older one."""
    store = make_store(tmp_path, range(1))
    (older,) = store.entries()
    (Path(older.path) / "imu.csv").write_text("7\n")
    add(store, [older.path])
    store.unmark(older.digest, "replaced.json")
    assert add(store, [older.path]).known == 1
    assert store.entry(older.digest).replaced


def test_a_drive_that_cannot_be_read_leaves_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = make_drives(tmp_path / "drives", range(3))
    store = Store.at(str(tmp_path / "store"), make=True)
    usual = Folder.open

    def closed(place: Folder, name: str) -> object:
        if name == "d0/imu.csv":
            raise PermissionError(errno.EACCES, "Permission denied", name)
        return usual(place, name)

    monkeypatch.setattr(Folder, "open", closed)
    added = add(store, paths)
    assert len(added.new) == 2
    assert added.warnings == [
        f"left out: d0/imu.csv cannot be read (Permission denied); add {paths[0]} again once it "
        "can."
    ]


def test_files_behind_a_link_are_the_drives_too(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(1))
    drive = Path(store.entries()[0].path)
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "boxes.csv").write_text("1\n")
    (drive / "video").symlink_to(tmp_path / "disk")
    (drive / "here").symlink_to(drive)
    assert len(add(store, [str(drive)]).replaced) == 1
    (tmp_path / "disk" / "boxes.csv").write_text("2\n")
    assert len(add(store, [str(drive)]).replaced) == 1
    assert place_at(str(tmp_path / "drives")).files("d0") == [
        ("drive.toml", 27), ("imu.csv", 2), ("video/boxes.csv", 2),
    ]  # fmt: skip


def test_a_drive_that_changed_is_in_the_map_as_it_was_until_it_is_run(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(2))
    run_all(store)
    older = store.entries()[0]
    for text in ("", "and again\n"):
        (Path(older.path) / "notes.txt").write_text(text)
        add(store, [older.path])
        counted = wanted(store, []).values()
        assert len(counted) == 2
        assert older.digest in {entry.digest for entry in counted}
        (told,) = older_results(counted, None)
        assert told.startswith("1 of the drives have changed and are in the map as they were")
    run_all(store)
    counted = wanted(store, []).values()
    assert len(counted) == 2
    assert older.digest not in {entry.digest for entry in counted}
    assert older_results(counted, None) == []


def test_a_drive_whose_place_is_damaged_is_told_and_comes_back(tmp_path: Path) -> None:
    """One that is not done is put aside with the sentence, one that is done stays in the map."""
    store = make_store(tmp_path, range(2))
    done, other = sorted(store.entries(), key=lambda entry: entry.path)
    run_all(store)
    store.unmark(other.digest, "done.json")
    for entry in (done, other):
        store.place.write(f"drives/{entry.digest}/drive.json", b"{")
    told, lines = status(store)
    assert (told["drives"], told["done"], told["aside"]) == (2, 1, 1)
    assert "add the drive again" in told["reasons"][other.digest]
    assert [len(line["warnings"]) for line in lines if line["state"] == "done"] == [1]
    assert {entry.digest for entry in wanted(store, []).values()} == {done.digest}
    assert retry(store, []) == []
    assert add(store, [done.path, other.path]).known == 2
    after = {entry.digest: (entry.path, entry.state()) for entry in store.entries()}
    assert after == {done.digest: (done.path, "done"), other.digest: (other.path, "waiting")}
