"""Lists that are read wrong: what is said of them, and that nothing of them is for work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from inventory_case import faulty, town_and_drive

from automap.errors import InputError
from automap.export.inventory import WORK
from automap.inventory.classes import same_face
from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import Finding, Inventory, seldom_found
from automap.io.inventory_file import InventoryFile, read_inventory
from automap.mapping.sightings import DriveSigns
from automap.records import FloatArray, Sign
from pipeline.compare.alike import moved_alike
from pipeline.compare.doubts import doubts
from pipeline.compare.listing import listed_signs, placeless, without_repeats
from tests.slow_cases import others_slow

R = 6.37e6


@cache
def street() -> tuple[list[Sign], Inventory, list[DriveSigns]]:
    rng, town, drives, _, signs = town_and_drive(21, 2500.0)
    return signs, faulty(rng, town).inventory, drives


def said(inventory: Inventory, signs: list[Sign] | None = None) -> tuple[str, list[Finding]]:
    there, _, drives = street()
    signs = signs or there
    result = compare_inventory(signs, inventory, drives)
    told, findings = doubts(result, signs, inventory, Path("list.csv"))
    return " ".join(told), findings


def for_work(findings: list[Finding], *kinds: str) -> int:
    return sum(f.sure for f in findings if f.kind in (kinds or WORK))


def shifted(metres: float) -> Callable[[Inventory], Inventory]:
    return lambda one: replace(one, lat_rad=one.lat_rad + metres / R)


def test_of_a_good_list_nothing_is_said() -> None:
    text, findings = said(street()[1])
    assert text == ""
    assert for_work(findings, "new") > 2
    assert for_work(findings, "moved") > 2
    assert for_work(findings, "class") > 1


@pytest.mark.parametrize("metres", [30.0, 60.0, 200.0, 3000.0])
def test_a_list_that_lies_elsewhere_makes_no_work(metres: float) -> None:
    text, findings = said(shifted(metres)(street()[1]))
    assert "--crs" in text
    assert for_work(findings) == 0
    assert max(f.probability for f in findings if f.kind in WORK) <= 0.5


def test_a_list_in_another_datum_by_some_metres_is_moved() -> None:
    text, findings = said(shifted(10.0)(street()[1]))
    assert "its datum may be another" in text
    assert for_work(findings, "new") > 2


@pytest.mark.parametrize("metres", others_slow([7.0, 200.0]))
@pytest.mark.parametrize("part", ["rows", "place", "every second", "a quarter of the rows"])
def test_a_part_of_a_list_that_lies_elsewhere_makes_no_work(part: str, metres: float) -> None:
    one = street()[1]
    n = len(one)
    row = np.arange(n)
    order = np.argsort(np.argsort(one.lat_rad))
    there = {
        "rows": row < n // 2, "place": order < n // 2, "every second": row % 2 == 1,
        "a quarter of the rows": (row >= n // 4) & (row < n // 2),
    }[part]  # fmt: skip
    text, findings = said(replace(one, lat_rad=one.lat_rad + there * metres / R))
    assert "may be of another source or datum" in text
    told = float(text.split(" are listed ")[1].split(" m")[0])
    assert abs(told - metres) < 1.5
    resting = [f for f in findings if f.listed >= 0 and there[f.listed] and f.kind in WORK]
    # those of which nothing tells that they are of the part, and were moved besides
    assert sum(f.sure for f in resting) <= 1
    # what was left where it is has its say, unless it stands among the others
    good = [f for f in said(one)[1] if f.listed >= 0 and not there[f.listed] and f.sure]
    same = {(f.kind, f.listed) for f in findings if f.sure}
    good = [f for f in good if f.kind in WORK]
    if part != "every second":
        assert sum((f.kind, f.listed) in same for f in good) >= 0.6 * len(good)
    # with its own distance
    found = [f for f in findings if f.kind == "matched" and there[f.listed]]
    assert abs(np.median([f.distance_m for f in found]) - metres) < 1.5


def test_directions_in_gon_are_told_and_taken_so() -> None:
    one = street()[1]
    text, findings = said(replace(one, facing_rad=(one.facing_rad % (2.0 * np.pi)) / 0.9))
    assert "in gon" in text
    # and so on a map of fifteen that look every way
    few = [
        replace(s, facing_rad=0.4 * k, facing_sd_rad=0.06) for k, s in enumerate(street()[0][:15])
    ]
    listed = Inventory(
        [s.id for s in few], [s.class_name for s in few], np.array([s.lat_rad for s in few]),
        np.array([s.lon_rad for s in few]), np.array([s.facing_rad + 0.05 for s in few]),
        np.full(15, np.nan),
    )  # fmt: skip
    assert not compare_inventory(few, listed, []).directions.gon
    gon = replace(listed, facing_rad=listed.facing_rad % (2.0 * np.pi) / 0.9)
    assert compare_inventory(few, gon, []).directions.gon
    assert not compare_inventory(
        few, replace(gon, facing_rad=np.nan * gon.facing_rad), []
    ).directions.gon
    usual = {(f.kind, f.sign, f.listed) for f in said(one)[1]}
    assert len(usual & {(f.kind, f.sign, f.listed) for f in findings}) > 0.95 * len(usual)


def test_a_list_that_lacks_nearly_all_of_the_map_is_none_that_lies_elsewhere() -> None:
    one = street()[1]
    few = list(range(0, len(one), 9))
    names = [one.class_name[k] for k in few]
    lacking = Inventory(
        [one.ids[k] for k in few], names, one.lat_rad[few], one.lon_rad[few],
        one.facing_rad[few], one.sd_m[few],
    )  # fmt: skip
    text, findings = said(lacking)
    assert text == ""
    assert for_work(findings, "new") > 20


def test_codes_of_another_catalogue_are_no_wrong_classes() -> None:
    one = street()[1]
    names = sorted(set(one.class_name))
    other = {name: names[(k + 1) % len(names)] for k, name in enumerate(names)}
    text, findings = said(replace(one, class_name=[other[n] for n in one.class_name]))
    assert "another catalogue (--country)" in text
    assert for_work(findings, "class") == 0


@pytest.mark.parametrize(
    "turned",
    [
        lambda facing: facing + 0.5 * np.pi,
        lambda facing: 0.0 * facing + 0.25,
        lambda facing: facing + np.pi * (np.arange(len(facing)) % 2),
    ],
    ids=["a quarter", "all one", "every second"],
)
def test_directions_without_meaning_are_not_used(
    turned: Callable[[FloatArray], FloatArray],
) -> None:
    one = street()[1]
    text, findings = said(replace(one, facing_rad=turned(one.facing_rad)))
    assert "contradict the map's; they are not used" in text
    assert for_work(findings, "new") <= for_work(said(one)[1], "new")
    paired = sum(f.kind in ("matched", "moved", "class") for f in findings)
    assert paired > 0.9 * sum(f.sign >= 0 for f in findings)


def test_a_few_wrong_directions_are_told_and_the_others_used() -> None:
    one = street()[1]
    facing = one.facing_rad.copy()
    facing[::5] += np.pi
    assert "check that they are degrees" in said(replace(one, facing_rad=facing))[0]


def test_accuracies_in_other_units_are_told() -> None:
    one = street()[1]
    for metres, told in ((0.4, ""), (30.0, "is it in metres?"), (300.0, "is it in metres?")):
        text, findings = said(replace(one, sd_m=np.full(len(one), metres)))
        assert told in text
        assert bool(text) == bool(told)
        # not all of it has moved
        assert sum(f.kind == "moved" for f in findings) < 0.2 * len(findings)
    assert "too poor" in said(replace(one, sd_m=np.full(len(one), 4.0)))[0]


def test_rows_of_posts_make_no_new_faces() -> None:
    signs, one, _ = street()
    # each sign has a second face below it, of which the list knows nothing
    names = ("regulatory--yield--g1", "regulatory--stop--g1")
    more = [replace(s, id=f"{s.id}b", class_name=names[s.class_name == names[0]]) for s in signs]
    both = [replace(s, support=f"post-{k % len(signs)}") for k, s in enumerate([*signs, *more])]
    text, findings = said(one, both)
    assert "a row for each post" in text
    assert for_work(findings, "new") < 0.2 * len(signs)


def read(**columns: list[str]) -> InventoryFile:
    n = len(columns["codes"])
    angle = np.array([float(v) for v in columns.get("facing", ["nan"] * n)])
    return InventoryFile(
        [f"A{k}" for k in range(n)], columns["codes"],
        np.array([float(v) for v in columns["lat"]]), np.zeros(n), angle, np.full(n, np.nan), {},
    )  # fmt: skip


def test_an_entry_twice_counts_once_if_its_direction_tells_that_it_is_one() -> None:
    told: list[str] = []
    codes, lat = ["stop", "stop", "stop", "yield"], ["0.1", "0.1", "0.1", "0.1"]
    twice = read(codes=codes, lat=lat, facing=["1", "1", "2", "1"])
    assert listed_signs(twice, None, Path("x"), told)[1] == [0, 2, 3]
    assert "one entry" not in told[0]
    assert "1 entry repeats place, class and direction of another, such as A1" in told[0]
    assert len(listed_signs(read(codes=codes, lat=lat), None, Path("x"), [])[1]) == 4


def test_an_entry_twice_without_a_direction_counts_as_often_as_the_map_has_it() -> None:
    """It may be the other side of a post. All entries twice had hidden a fifth of the signs from
    their entries, and made a detector of the rest that finds half."""
    first = street()[0][0]
    lat, codes = str(first.lat_rad), ["stop", "stop", "stop", ""]
    bare = read(codes=codes, lat=[lat] * 4)
    listed, rows = listed_signs(bare, None, Path("x"), [])
    stop = replace(first, class_name="regulatory--stop--g1", lon_rad=0.0)
    for on_map, left in (([], 1), ([stop], 1), ([stop, stop], 2), ([stop] * 5, 3)):
        told: list[str] = []
        kept, own = without_repeats(listed, rows, bare, on_map, Path("x"), told)
        assert own == [*range(left), 3]
        assert list(kept.ids) == [f"A{k}" for k in own]
        assert len(told) == (left < 3)
        assert not told or "place and class of another without a direction" in told[0]


def test_an_entry_with_several_signs_is_as_many() -> None:
    told: list[str] = []
    several = read(codes=["DE:206;DE:274-60,1040-30", "DE:205"], lat=["0.1", "0.2"])
    inventory, rows = listed_signs(several, None, Path("x"), told)
    assert rows == [0, 0, 1]
    assert list(inventory.ids) == ["A0#1", "A0#2", "A1"]
    assert inventory.class_name[1] == "regulatory--maximum-speed-limit-60--g1"
    assert "1 entry names several signs" in told[0]


def test_classes_of_a_detector_of_ones_own_are_compared_by_their_text() -> None:
    told: list[str] = []
    entries = read(codes=["my-stop", " My-Stop ", "else", "stop"], lat=["0.1", "0.2", "0.3", "0.4"])
    inventory, _ = listed_signs(entries, None, Path("x"), told, {"my-stop", "no-entry", ""})
    assert inventory.class_name == ["my-stop", "my-stop", "", "regulatory--stop--g1"]
    assert "1 sign has a code not known, such as 'else' (1)" in told[0]
    assert same_face("my-stop", "my-stop")
    assert same_face("my-stop", "my-yield") is False


def test_a_detector_knows_a_kind_that_it_found_beside_the_list() -> None:
    """One entry of its kind, not found, had been called unknown to a detector that found others."""
    rng, town, drives, _, signs = town_and_drive(21, 800.0)
    case = faulty(rng, town)
    lost = int(np.flatnonzero(case.kind == "missing")[0])
    rare = "my-own-sign"
    names = [rare if k == lost else name for k, name in enumerate(case.inventory.class_name)]
    listed = replace(case.inventory, class_name=names)
    found, in_view = np.arange(len(names)) != lost, np.ones(len(names), np.bool_)
    assert seldom_found(listed, found, in_view).tolist() == (~found).tolist()
    assert not seldom_found(listed, found, in_view, [rare]).any()
    far = replace(signs[0], id="far", class_name=rare, lat_rad=signs[0].lat_rad + 0.01)
    unknown, known = (
        next(f.probability for f in compare_inventory(on_map, listed, drives).findings
             if f.listed == lost)
        for on_map in (signs, [*signs, far])
    )  # fmt: skip
    # of an unknown kind next to nothing is said; of a known one, what is of the others
    assert unknown > 0.94
    assert known < 0.9


def test_what_is_new_may_be_an_entry_without_a_position() -> None:
    signs, one, drives = street()
    result = compare_inventory(signs, one, drives)
    lost = placeless(read(codes=["stop", "no-entry"], lat=["nan", "0.1"]), None)
    assert lost == {"regulatory--stop--g1"}
    text, findings = doubts(result, signs, one, Path("x"), lost)
    assert "without a position" in text[0]
    new = [f for f in findings if f.kind == "new"]
    assert not any(f.sure for f in new if signs[f.sign].class_name in lost)
    assert any(f.sure for f in new)


def table(path: Path, *rows: str) -> Path:
    path.write_text("\n".join(("id,class,lat,lon,facing", *rows)) + "\n")
    return path


def test_positions_that_are_none_are_told(tmp_path: Path) -> None:
    near = (np.radians([-35.28]), np.radians([149.13]))
    with pytest.raises(InputError, match=r"no degrees .*--crs"):
        read_inventory(table(tmp_path / "a.csv", "1,stop,6093901.2,693756.2,0"), near=near)
    one = read_inventory(
        table(tmp_path / "b.csv", "1,stop,0,0,0", "2,stop,-35.28,149.13,374", "3,stop,-36,149,9"),
        near=near,
    )
    text = " ".join(one.warnings)
    assert "1 of 3 entries have no usable position" in text
    assert "1 of 3 entries lie more than 10 km from the map" in text
    assert "neither degrees within 360 nor points of the compass, such as '374'" in text


@pytest.mark.parametrize(("metres", "entries"), [(7.0, 9), (11.0, 6), (5.0, 12)])
def test_few_entries_that_moved_alike_are_one_finding(metres: float, entries: int) -> None:
    """Too few, or too near, to be a part that lies elsewhere."""
    one = street()[1]
    there = (np.arange(len(one)) >= 20) & (np.arange(len(one)) < 20 + entries)
    text, findings = said(replace(one, lat_rad=one.lat_rad + there * metres / R))
    assert "moved lie off by the same way" in text
    assert one.ids[20] in text
    assert abs(float(text.split("same way, ")[1].split(" m")[0]) - metres) < 0.7
    assert not any(f.sure for f in findings if f.kind == "moved" and there[f.listed])
    # those that went their own way are for work as before
    before = sum(f.sure for f in said(one)[1] if f.kind == "moved" and not there[f.listed])
    assert sum(f.sure for f in findings if f.kind == "moved" and not there[f.listed]) == before


def test_a_stretch_that_lies_nearer_than_a_part_is_told_is_not_taken_off_in_silence() -> None:
    """What neighbours are off in common is the map's error only as far as the map's can be."""
    one = street()[1]
    order = np.argsort(np.argsort(one.lat_rad))
    there = (order >= 30) & (order < 50)
    text, findings = said(replace(one, lat_rad=one.lat_rad + there * 5.0 / R))
    assert "the map is off there by more than it states" in text
    found = [f for f in findings if f.kind == "matched" and there[f.listed]]
    assert len(found) > 10
    assert abs(np.median([f.distance_m for f in found]) - 5.0) < 1.0


def test_signs_that_moved_each_its_own_way_are_not_alike() -> None:
    rng = np.random.default_rng(3)
    told = 0
    for n in (4, 7, 15, 40) * 30:
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        ways = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)]) + rng.normal(size=(n, 2))
        told += bool(
            moved_alike([Finding("moved", k, k, 0.9, e, n, 1.0) for k, (e, n) in enumerate(ways)])
        )
    assert told == 0
    # along a street, this way and the other
    along = [8.0 if k % 3 else -8.0 for k in range(12)]
    ways = np.column_stack([along, np.zeros(12)]) + 0.5 * rng.normal(size=(12, 2))
    assert not moved_alike(
        [Finding("moved", k, k, 0.9, e, n, 1.0) for k, (e, n) in enumerate(ways)]
    )
