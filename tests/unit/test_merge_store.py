"""A store merged cell by cell: the map of all drives at once, whatever came when."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import shapely
from merge_scene import street_scene
from test_merge_cells import at_edge, moved

from automap.mapping.merge import merge_drives
from automap.mapping.sightings import DriveSigns
from pipeline.merge import cell_parts, cell_steps
from pipeline.merge.cell_map import merge_store
from pipeline.merge.cell_steps import group, turns
from pipeline.merge.cell_store import Drives, Near, add_drives, occupied, read_drives


def drives_of(seed: int, count: int) -> list[DriveSigns]:
    return at_edge(street_scene(seed, count, length_m=2000.0), np.pi)


@pytest.mark.slow
def test_a_store_is_merged_as_all_drives_at_once(tmp_path: Path) -> None:
    # what drives say of existence is one of the columns
    drives = [replace(d, existence=d.confidence**0.1) for d in drives_of(1, 7)]
    add_drives(tmp_path, drives[3:])
    add_drives(tmp_path, drives[:3])
    found = merge_store(tmp_path)
    whole = merge_drives(drives)
    assert sorted(found.founder) == sorted(whole.founders)
    order = [list(found.founder).index(key) for key in whole.founders]
    assert np.array_equal(found.levels, whole.levels)
    assert np.array_equal(found.lat[order], whole.adjusted.lat)
    assert np.array_equal(found.lon[order], whole.adjusted.lon)
    assert np.array_equal(found.cov_enu[order], whole.adjusted.cov_enu)
    assert found.existence[order] == pytest.approx(whole.existence, abs=1e-12)
    assert found.rates.overall == pytest.approx(whole.rates.overall, abs=1e-12)
    signs = found.signs(read_drives(tmp_path))
    for k, sign in zip(order, whole.signs, strict=True):
        assert signs[k].class_name == sign.class_name
        assert signs[k].drives == sign.drives
        assert signs[k].facing_rad == sign.facing_rad
        assert signs[k].last_seen_ns == sign.last_seen_ns
        assert signs[k].confidence == pytest.approx(sign.confidence, abs=1e-12)


def test_drives_of_a_store_of_earlier_times_say_nothing_of_existence(tmp_path: Path) -> None:
    drives = drives_of(1, 4)
    add_drives(tmp_path, drives[:2])
    for path in (tmp_path / "sightings").glob("cell=*/*.parquet"):
        pq.write_table(pq.read_table(path, partitioning=None).drop_columns(["existence"]), path)
    told = [replace(d, existence=np.full(len(d), 0.95)) for d in drives[2:]]
    add_drives(tmp_path, told)
    found, whole = merge_store(tmp_path), merge_drives([*drives[:2], *told])
    order = [found.founder.index(key) for key in whole.founders]
    assert found.existence[order] == pytest.approx(whole.existence, abs=1e-12)


def test_drives_that_come_later_give_the_map_of_all_from_nothing(tmp_path: Path) -> None:
    """Bit for bit, in any order of coming, whatever levels came before."""
    drives = drives_of(2, 8)
    one, two = tmp_path / "one", tmp_path / "two"
    add_drives(one, drives[2:6])
    merge_store(one)
    add_drives(one, [drives[7], drives[0]])
    merge_store(one)
    add_drives(one, [drives[1], drives[6]])
    found = merge_store(one)
    add_drives(two, drives)
    whole = merge_store(two)
    assert sorted(found.founder) == sorted(whole.founder)
    order = [found.founder.index(key) for key in whole.founder]
    assert np.array_equal(found.levels, whole.levels)
    assert np.array_equal(found.lat[order], whole.lat)
    assert found.existence[order] == pytest.approx(whole.existence, abs=0.01)


def test_what_is_far_from_a_new_drive_is_not_touched(tmp_path: Path) -> None:
    near, far = (
        [replace(moved(d, -0.6, lon), key=f"{lon}-{k}") for k, d in enumerate(drives)]
        for lon, drives in ((0.5, street_scene(3, 6).drives), (0.6, street_scene(4, 6).drives))
    )
    add_drives(tmp_path, [*near, *far[:5]])
    first = merge_store(tmp_path)
    assert first.grouped == first.cells
    again = merge_store(tmp_path)
    assert (again.grouped, again.placed) == (0, 0)
    add_drives(tmp_path, far[5:])
    after = merge_store(tmp_path)
    here = [k for k, key in enumerate(first.founder) if key.startswith("0.5")]
    names = [after.founder.index(first.founder[k]) for k in here]
    assert len(here) > 20
    assert 0 < after.grouped < after.cells
    if np.array_equal(after.levels, first.levels):
        assert np.array_equal(after.lat[names], first.lat[here])


@pytest.mark.slow
def test_two_processes_give_the_map_of_one(tmp_path: Path) -> None:
    drives = drives_of(5, 5)
    maps = []
    for name, workers in (("one", 1), ("two", 2)):
        add_drives(tmp_path / name, drives)
        maps.append(merge_store(tmp_path / name, workers))
    assert maps[0].founder == maps[1].founder
    assert np.array_equal(maps[0].lat, maps[1].lat)
    assert np.array_equal(maps[0].existence, maps[1].existence)


def test_a_step_that_was_interrupted_is_done_again(tmp_path: Path) -> None:
    add_drives(tmp_path, drives_of(6, 5))
    whole = merge_store(tmp_path)
    for kind in ("groups", "placed"):
        sorted((tmp_path / kind).glob("*.npz"))[0].unlink()
    again = merge_store(tmp_path)
    assert (again.grouped, again.placed) == (1, 1)
    assert np.array_equal(again.lat, whole.lat)


def test_a_merge_that_ended_before_the_levels_goes_on_as_if_it_had_not(tmp_path: Path) -> None:
    add_drives(tmp_path, drives_of(6, 5))
    for wave in turns(tmp_path):
        for cell in wave:
            assert group(tmp_path, cell)
    found = merge_store(tmp_path)
    assert found.grouped == 0
    whole = merge_drives(drives_of(6, 5))
    assert np.array_equal(found.levels, whole.levels)
    assert sorted(found.lat) == sorted(whole.adjusted.lat)


def test_what_an_interrupted_attempt_left_is_no_part_of_the_map(tmp_path: Path) -> None:
    drives = drives_of(8, 5)
    add_drives(tmp_path, [moved(street_scene(9, 1).drives[0], 0.2, 0.3)])
    (tmp_path / "drives" / "00000000.parquet").unlink()
    add_drives(tmp_path, drives)
    assert sorted(merge_store(tmp_path).founder) == sorted(merge_drives(drives).founders)


def test_a_damaged_step_is_done_again(tmp_path: Path) -> None:
    add_drives(tmp_path, drives_of(6, 4))
    whole = merge_store(tmp_path)
    for kind in ("groups", "placed"):
        path = sorted((tmp_path / kind).glob("*.npz"))[0]
        path.write_bytes(path.read_bytes()[:200])
    assert np.array_equal(merge_store(tmp_path).lat, whole.lat)


def test_the_sightings_of_a_cell_are_geoparquet_for_anybody(tmp_path: Path) -> None:
    """Points where the sightings are, as another program's reader finds them."""
    drives = drives_of(7, 3)
    add_drives(tmp_path, drives)
    count = 0
    for path in (tmp_path / "sightings").glob("cell=*/*.parquet"):
        table = pq.read_table(path)
        told = json.loads(table.schema.metadata[b"geo"])
        assert told["primary_column"] == "geometry"
        points = shapely.from_wkb(table["geometry"].to_numpy(zero_copy_only=False))
        assert np.allclose(shapely.get_x(points), np.degrees(table["lon"].to_numpy()))
        assert np.allclose(shapely.get_y(points), np.degrees(table["lat"].to_numpy()))
        count += len(table)
    assert count == sum(len(drive) for drive in drives)


@pytest.mark.slow
def test_many_files_of_a_cell_are_packed_and_nothing_else_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor where packing was ended before the older files were removed."""
    drives = drives_of(2, 6)
    for drive in drives:
        add_drives(tmp_path / "loose", [drive])
    whole = merge_store(tmp_path / "loose")
    store = tmp_path / "packed"
    add_drives(store, drives[:1])
    old = sorted(store.glob("sightings/cell=*/*.parquet"))[0]
    # of a version that did not know of it
    pq.write_table(pq.read_table(old, partitioning=None).drop_columns(["seen_share"]), old)
    monkeypatch.setattr(cell_parts, "MOST_PARTS", 2)
    for drive in drives[1:4]:
        add_drives(store, [drive])
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", ended)
        with pytest.raises(KeyboardInterrupt):
            add_drives(store, [drives[4]])
    found = {path.name for path in store.glob("*/cell=*/*.parquet")}
    assert {"00000000-00000002.parquet", "00000000-00000004.parquet", "00000003.parquet"} <= found
    assert len(merge_store(store).founder) > 20
    add_drives(store, [drives[5]])
    made = merge_store(store)
    assert made.founder == whole.founder
    assert np.array_equal(made.lat, whole.lat)
    assert np.array_equal(made.existence, whole.existence)
    assert max(len(list(cell.iterdir())) for cell in store.glob("*/cell=*")) <= 2


def ended(*words: object, **named: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.slow
def test_what_a_cell_has_from_other_files_is_read_once_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files that are packed, and drives that pass beyond the margin of a cell, change nothing in
    it, and are no reason to read all that is in it at every merge to come."""
    drives = drives_of(2, 4)
    for drive in drives:
        add_drives(tmp_path, [drive])
    merge_store(tmp_path)
    monkeypatch.setattr(cell_parts, "MOST_PARTS", 2)
    for cell in occupied(tmp_path).tolist():
        cell_parts.pack(tmp_path, "sightings", cell)
    read: list[int] = []
    read_near = cell_steps.read_near

    def told(folder: Path, drives: Drives, cell: int, *margins: float) -> Near:
        read.append(cell)
        return read_near(folder, drives, cell, *margins)

    monkeypatch.setattr(cell_steps, "read_near", told)
    again = merge_store(tmp_path)
    assert (again.grouped, again.placed) == (0, 0)
    assert read
    read.clear()
    merge_store(tmp_path)
    assert read == []
