"""The map of a store: merged whole, added to, ended anywhere, and what it takes over."""

from __future__ import annotations

import csv
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
from fleet_scene import ORDER, make_drives, make_store, map_bytes, publish_made, run_all, scene
from merge_folders import review
from merge_scene import to_geodetic

from automap.errors import ConfigError, InputError
from automap.export import pieces
from automap.io import names
from automap.io.map_tables import TRACKS, read_tracks
from automap.io.review_json import append_action
from automap.io.signs_table import read_signs
from automap.mapping.merge import merge_drives
from automap.records import ReviewAction, Trajectory
from pipeline.cli.root import cli
from pipeline.fleet import merge as merging
from pipeline.fleet import publish as publishing
from pipeline.fleet import tracks
from pipeline.fleet.add import add
from pipeline.fleet.contents import update_contents, wanted
from pipeline.fleet.merge import merge
from pipeline.fleet.store import DONE, StoreGoneError
from pipeline.fleet.versions import current
from pipeline.merge import output
from pipeline.merge.whole import drive_essentials
from pipeline.shared.beside import Begin


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
    s, sign, a = whole.sightings, whole.sign, whole.adjusted
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
    drives = wanted(store, [])
    update_contents(
        store, tmp_path, drives, [], lambda done: None, also=lambda key, entry: kept.append(key)
    )
    # what reads a result does with it all that there is to do
    assert sorted(kept) == sorted(drives)
    assert batches == [{scene()[k].name for k in ks} for ks in ((0, 2, 4), (1, 3, 5))]


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


def ended(*words: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_review_of_the_map_makes_it_anew_once(tmp_path: Path) -> None:
    """Its files and its report had kept rejected signs until a drive came."""
    store = make_store(tmp_path)
    run_all(store)
    merge(store)
    folder = tmp_path / "store" / "map"
    first = read_signs(folder / names.SIGNS_RAW)[0]
    lon, lat = (float(np.degrees(v)) for v in (first.lon_rad, first.lat_rad))
    when = "2026-11-24T10:00:00Z"
    reject = ReviewAction("a1", when, first.id, "reject", first.class_name, lon, lat)
    append_action(folder / names.REVIEW, reject)
    made = merge(store)
    assert (made.new, made.version) == (True, "000002")
    assert first.id not in (folder / names.SIGNS_GEOJSON).read_text()
    assert first.id in (folder / names.REJECTED).read_text()
    assert not merge(store).new


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


def test_a_part_of_a_recording_is_left_out(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(2))
    run_all(store)
    rows = [[48_000_000 + k, 0.87 + 1e-5 * k, 0.15, 0] for k in range(8)]
    for entry, n in zip(store.entries(), (8, 5), strict=True):
        store.mark(entry.digest, DONE, {**entry.done, "marks": rows[:n]})
    first, second = store.entries()
    told: list[str] = []
    assert [entry.path for entry in wanted(store, told).values()] == [first.path]
    assert len(told) == 1
    assert f"{second.path} is part of the recording of {first.path}" in told[0]


def test_of_copies_a_reviewed_one_counts_then_the_better_verdict(tmp_path: Path) -> None:
    store = make_store(tmp_path, range(2))
    run_all(store)
    for entry, state in zip(store.entries(), ("doubtful", "unusable"), strict=True):
        done = {**entry.done, "recording": "one", "verdict": {"state": state}}
        store.mark(entry.digest, DONE, done)
    first, second = store.entries()
    told: list[str] = []
    assert wanted(store, told) == {"one": first}
    assert f"{second.path} is another copy of {first.path}" in told[0]
    assert "better verdict (doubtful, not unusable)" in told[0]
    assert f"{first.path} (doubtful)" in told[1]
    assert store.place.folder is not None
    review(store.place.folder / store.result(second))
    told = []
    assert wanted(store, told) == {"one": second}
    assert "that which is reviewed" in told[0]
    assert f"{second.path} (unusable)" in told[1]


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


@pytest.mark.slow
def test_tracks_that_the_older_map_has_are_taken_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without opening what is kept of their drives, and the same bytes as from nothing."""
    monkeypatch.setattr(tracks, "MANY_DRIVES", 1)
    monkeypatch.setattr(tracks, "MOST_ROWS", 60)
    store = make_store(tmp_path, range(3))
    run_all(store)
    root = tmp_path / "store"
    merge(store)
    add(store, make_drives(tmp_path / "more", range(3, 4)))
    run_all(store)
    read: list[Path] = []
    read_kept = tracks._read

    def told(path: Path) -> tracks.Kept:
        read.append(path)
        return read_kept(path)

    monkeypatch.setattr(tracks, "_read", told)
    monkeypatch.setattr(tracks, "_step", lambda rows: 7)
    merge(store)
    assert len(read) == 4, "there were other rows of them"
    whole = (root / "map" / TRACKS).read_bytes()
    read.clear()
    merge(store, least_existence=0.4999)
    assert read == []
    assert (root / "map" / TRACKS).read_bytes() == whole
    # one whose result is another is read, and so are all where the file is damaged
    first = store.entries()[0]
    publish_made(store.place.url, first.digest, first.path, replace(ORDER, key="b" * 20), 5.0)
    merge(store)
    assert len(read) == 1
    assert (root / "map" / TRACKS).read_bytes() != whole
    read.clear()
    damaged = bytearray((root / "map" / TRACKS).read_bytes())
    damaged[200] ^= 1
    (root / "map" / TRACKS).write_bytes(damaged)
    merge(store, least_existence=0.4999)
    assert len(read) == 4


@pytest.mark.parametrize(
    ("rows", "step"),
    [(0, 1), (100, 1), (101, 2), (701, 8), (801, 10), (1650, 20), (2000, 20), (2001, 24)],
)
def test_tracks_of_a_fleet_that_grows_keep_their_rows_for_long(
    monkeypatch: pytest.MonkeyPatch, rows: int, step: int
) -> None:
    monkeypatch.setattr(tracks, "MOST_ROWS", 100)
    assert tracks._step(rows) == step


@pytest.mark.slow
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
        other = vars(same[name])
        assert all(np.array_equal(v, other[k], equal_nan=True) for k, v in vars(track).items())
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
