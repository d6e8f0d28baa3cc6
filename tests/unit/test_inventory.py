"""A map against an inventory made from the truth, with known faults put into it."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyogrio
import pytest
import shapely
from inventory_case import KINDS, Faulty, faulty, judged, merged_town, town_and_drive
from merge_folders import write_run
from merge_scene import USUAL, to_geodetic
from pyogrio.raw import write
from pyproj import Transformer

from automap.export.inventory import ComparedSign, maproulette_tasks, osm_change
from automap.io.inventory_file import read_inventory
from automap.mapping.inventory import compare_inventory
from automap.mapping.inventory_findings import (
    Finding,
    Inventory,
    class_belief,
    mark_sure,
    new_signs,
)
from automap.mapping.inventory_missing import counts, standing
from automap.mapping.visibility import Opportunities
from automap.records import Sign, Trajectory
from automap.signs.codes import classes_of
from pipeline.cli.root import run_command
from pipeline.compare.report import _entry
from pipeline.merge.inputs import even_path


def test_faults_put_into_an_inventory_are_found() -> None:
    """By three merged drives that overlook, misread and imagine signs: of each kind that is told
    for sure, and of each that is due, nine of ten."""
    total = {kind: np.zeros(3) for kind in KINDS}
    for seed in range(3):
        rng, town, drives, truth, signs = merged_town(seed, 3, 4000.0, USUAL)
        case = faulty(rng, town)
        result = compare_inventory(signs, case.inventory, drives)
        for kind, score in judged(result, case, truth, sure=True).items():
            total[kind] += score
    for kind, (right, told, due) in total.items():
        assert due > 10, kind
        # of some twenty, one by chance
        assert right > 0.9 * told - 1.0, (kind, total[kind])
        assert right > 0.9 * due - 1.0, (kind, total[kind])


def test_one_drive_says_less_but_nothing_false() -> None:
    """Nor does it hold back what it knows: of new signs and other classes, four of five."""
    right = told = due = 0
    for seed in range(3):
        rng, town, drives, truth, signs = town_and_drive(seed, 4000.0, USUAL)
        case = faulty(rng, town)
        result = compare_inventory(signs, case.inventory, drives)
        # seen once, a sign may be gone or have been overlooked
        assert {f.kind for f in result.findings if f.sign < 0} <= {"unconfirmed", "not_seen"}
        score = judged(result, case, truth, sure=True)
        right += sum(score[kind][0] for kind in KINDS if kind != "matched")
        told += sum(score[kind][1] for kind in KINDS if kind != "matched")
        due += sum(score[kind][2] for kind in ("new", "class", "moved"))
        lost = [f for f in result.findings if f.kind == "unconfirmed"]
        assert {f.more_drives for f in lost} <= {1, 2, 3}
    assert told > 20
    assert right > 0.88 * told
    assert right > 0.8 * due


def test_what_is_for_work_is_right_nine_times_of_ten_and_never_less_likely_than_not() -> None:
    def sure(*told: float) -> list[bool]:
        return [f.sure for f in mark_sure([Finding("new", k, -1, p) for k, p in enumerate(told)])]

    assert sure(0.99, 0.82, 0.98) == [True, True, True]  # 2.79 of 3 are expected to be right
    assert sure(0.7, 0.99, 0.95) == [False, True, True]  # 2.64 would be
    assert sure(*[0.999] * 9, 0.4) == [True] * 9 + [False]
    assert sure(0.89) == [False]
    # one kind does not lend to another
    both = mark_sure([Finding("new", 0, -1, 0.99), Finding("class", 1, 1, 0.85)])
    assert [f.sure for f in both] == [True, False]


def test_a_sign_that_may_be_a_moved_and_misread_one_is_not_surely_new() -> None:
    """It stands 8 m from a listed sign that nobody found, and shows something else."""
    rng, town, drives, truth, signs = town_and_drive(4, 2000.0)
    case = faulty(rng, town)
    result = compare_inventory(signs, case.inventory, drives)
    moved = next(f for f in result.findings if f.kind == "moved")
    shown = signs[moved.sign].class_name
    other = next(c for c in (signs[0].class_name, "regulatory--stop--g1") if c != shown)
    misread = [replace(s, class_name=other) if s is signs[moved.sign] else s for s in signs]
    result = compare_inventory(misread, case.inventory, drives)
    by_sign = {f.sign: f for f in result.findings}
    assert by_sign[moved.sign].kind == "new"
    deleted = [f for f in result.findings if f.kind == "new" and f.sign != moved.sign]
    assert all(f.probability > 0.95 for f in deleted)
    assert by_sign[moved.sign].probability < 0.9
    assert len(truth) == len(signs)


def test_a_sign_that_is_not_listed_is_doubted_the_more_the_fuller_the_list_is() -> None:
    def probability(listed: int) -> float:
        signs = [sign_at(k, 0.97) for k in range(listed + 1)]
        return new_signs(signs, np.array([listed]))[0].probability

    full, sparse = probability(2000), probability(2)
    assert full < 0.7 < sparse
    # and one that the map is sure of is believed in any case
    sure = [sign_at(k, 0.999) for k in range(64)]
    assert all(f.probability > 0.98 for f in new_signs(sure, np.arange(4)))


def test_a_map_that_believes_too_much_is_found_out_by_the_list() -> None:
    """Of its signs believed to 0.6 one in ten is listed, of the others nearly all."""
    signs = [sign_at(k, 0.998) for k in range(200)] + [sign_at(k, 0.6) for k in range(200, 220)]
    unknown = np.r_[np.arange(10), np.arange(202, 220)]
    told = [f.probability for f in new_signs(signs, unknown)]
    assert min(told[:10]) > 0.9
    # two of twenty are listed, and of twenty real ones nineteen would be
    assert max(told[10:]) < 0.2


@pytest.mark.parametrize(("signs", "listed"), [(18, 2), (400, 20)])
@pytest.mark.parametrize("belief", [0.9, 0.99])
def test_a_list_that_lacks_nearly_all_is_no_reason_to_doubt_the_map(
    signs: int, listed: int, belief: float
) -> None:
    there = [sign_at(k, belief) for k in range(signs)]
    told = new_signs(there, np.arange(listed, signs))
    assert min(f.probability for f in told) > 0.85


def sign_at(number: int, exists: float) -> Sign:
    return Sign(
        f"s{number}", "a", 0.0, 0.0, 0.0, np.eye(3), exists, 9, 0, 0, 2.0, 0.0, 0.6, "",
        existence=exists,
    )  # fmt: skip


def test_two_drives_of_three_that_agree_are_surer_than_two_thirds() -> None:
    alone = replace(sign_at(0, 0.99), confidence=0.66)
    assert class_belief(alone) == pytest.approx(0.66 / 0.99)
    three = replace(alone, drives=("a", "b", "c"))
    assert 0.9 < class_belief(three) < 0.999
    against = replace(three, confidence=0.33)
    assert class_belief(against) < 0.1


def test_the_inventorys_shift_and_accuracy_come_from_the_data() -> None:
    rng, town, drives, _, signs = town_and_drive(11)
    case = faulty(rng, town, sd=0.8, shift=(1.6, -1.1))
    result = compare_inventory(signs, case.inventory, drives)
    # found minus listed is the opposite of what the list is off, up to the drive's own 0.55 m
    assert np.hypot(*(result.shift_m - [-1.6, 1.1])) < 1.0
    assert 0.6 < result.sd_m < 1.1


def test_accuracy_that_an_inventory_states_decides_what_has_moved() -> None:
    rng, town, drives, _, signs = town_and_drive(5)
    inventory = faulty(rng, town).inventory
    moved = []
    for sd in (0.3, 5.0):
        stated = replace(inventory, sd_m=np.full(len(inventory), sd))
        result = compare_inventory(signs, stated, drives)
        moved.append(sum(f.kind == "moved" for f in result.findings))
    assert moved[0] > 8
    assert moved[1] < moved[0] / 4


def test_directions_of_traffic_are_noticed() -> None:
    rng, town, drives, _, signs = town_and_drive(6)
    inventory = faulty(rng, town).inventory
    straight = compare_inventory(signs, inventory, drives)
    inventory = replace(inventory, facing_rad=inventory.facing_rad + np.pi)
    turned = compare_inventory(signs, inventory, drives)
    assert not straight.directions.turned
    assert turned.directions.turned
    assert [f.kind for f in turned.findings] == [f.kind for f in straight.findings]


def test_a_sign_that_no_drive_had_in_view_is_not_missing() -> None:
    _, town, drives, _, signs = town_and_drive(7)
    lat, lon, _ = to_geodetic(town.position + np.array([400.0, 0.0, 0.0]))
    n = len(lat)
    inventory = Inventory(
        [str(k) for k in range(n)], [""] * n, lat, lon, np.full(n, np.nan), np.full(n, np.nan)
    )
    kinds = {f.kind for f in compare_inventory(signs, inventory, drives).findings}
    assert kinds == {"new", "not_seen"}


@pytest.mark.parametrize(
    ("text", "country", "expected"),
    [
        ("274-60", "DE", "regulatory--maximum-speed-limit-60--g1"),
        ("Zeichen 274-56", None, "regulatory--maximum-speed-limit-60--g1"),
        ("DE:274-60,1040-30", None, "regulatory--maximum-speed-limit-60--g1"),
        ("DE:274[60]", None, "regulatory--maximum-speed-limit-60--g1"),
        ("R4-1 (60)", "AU", "regulatory--maximum-speed-limit-60--g1"),
        ("R2-1[50]", "US", "regulatory--maximum-speed-limit-50--g1"),
        ("R5-1", "US", "regulatory--no-entry--g1"),
        ("B2", "FR", "regulatory--stop--g1"),
        ("give_way", None, "regulatory--yield--g1"),
        ("regulatory--stop--g1", "DE", "regulatory--stop--g1"),
        ("", "DE", ""),
        ("999-99", "DE", None),
    ],
)
def test_codes_are_classes(text: str, country: str | None, expected: str | None) -> None:
    assert classes_of([text], country) == [expected]


def test_an_old_catalogue_shows_in_its_other_numbers() -> None:
    assert classes_of(["274-60", "274-56"], "DE")[0] == "regulatory--maximum-speed-limit-100--g1"


def test_openstreetmaps_word_for_limits_is_read_with_its_number(tmp_path: Path) -> None:
    """As nodes come from Overpass, and as our own export writes them without a national code."""
    path = tmp_path / "extract.csv"
    path.write_text(
        "@id,traffic_sign,maxspeed,lat,lon\nnode/1,maxspeed,50,1,2\nnode/2,maxspeed,35 mph,1,2\n"
        "node/3,stop,50,1,2\nnode/4,maxspeed,,1,2\nnode/5,AU:R4-1[40],60,1,2\n"
    )
    limit = "regulatory--maximum-speed-limit-{}--g1".format
    assert classes_of(read_inventory(path).codes, "AU") == [
        limit(50), None, "regulatory--stop--g1", None, limit(40)
    ]  # fmt: skip


CODES = {
    "regulatory--stop--g1": "R1-1", "regulatory--yield--g1": "R1-2",
    "regulatory--maximum-speed-limit-50--g1": "R4-1[50]",
    "regulatory--maximum-speed-limit-60--g1": "R4-1[60]",
    "information--parking--g1": "parking", "warning--children--g2": "W6-3",
}  # fmt: skip


@pytest.fixture(scope="module")
def run_and_case(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Faulty]:
    rng, town, drives, _, _ = town_and_drive(3, 2000.0)
    return write_run(tmp_path_factory.mktemp("map") / "run", drives[0]), faulty(rng, town)


def write_list(path: Path, inventory: Inventory, form: str) -> list[str]:
    """The inventory in one of many forms; returns the options that it needs."""
    lon, lat = np.degrees(inventory.lon_rad), np.degrees(inventory.lat_rad)
    codes = [CODES[name] for name in inventory.class_name]
    facing = np.degrees(inventory.facing_rad)
    if form == "csv":
        east, north = Transformer.from_crs(4326, 28355, always_xy=True).transform(lon, lat)
        lines = [
            f"{name};{code};{x:.2f};{y:.2f};{f:.0f}".replace(".", ",")
            for name, code, x, y, f in zip(inventory.ids, codes, east, north, facing, strict=True)
        ]
        path.write_text("Schild;Kennung;RW;HW;Richtung\n" + "\n".join(lines), encoding="utf-8")
        return ["--columns", "id=Schild,class=Kennung", "--crs", "EPSG:28355"]
    if form == "swapped.geojson":
        lon, lat = lat, lon
    crs = "EPSG:4326"
    if form == "shp":
        lon, lat = Transformer.from_crs(4326, 28355, always_xy=True).transform(lon, lat)
        crs = "EPSG:28355"
    wkb = shapely.to_wkb(shapely.points(lon, lat))
    if form == "parquet":
        table = pa.table({"ref": inventory.ids, "code": codes, "bearing": facing, "geometry": wkb})
        column = {"encoding": "WKB", "geometry_types": ["Point"]}
        geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
        pq.write_table(table.replace_schema_metadata({"geo": json.dumps(geo)}), path)
        return []
    driver = {"shp": "ESRI Shapefile", "gpkg": "GPKG"}.get(form, "GeoJSON")
    fields = [np.array(inventory.ids, object), np.array(codes, object), facing]
    write(
        path, geometry=wkb, field_data=fields, fields=["ref", "code", "bearing"], driver=driver,
        geometry_type="Point", crs=crs,
    )  # fmt: skip
    return []


@pytest.mark.parametrize("form", ["csv", "gpkg", "shp", "geojson", "swapped.geojson", "parquet"])
def test_every_form_of_inventory_gives_the_same(
    run_and_case: tuple[Path, Faulty], tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, case = run_and_case
    path, out = tmp_path / f"list.{form}", tmp_path / "out"
    options = write_list(path, case.inventory, form)
    words = ["compare", str(folder), str(path), "-o", str(out), "--country", "AU", "--json"]
    assert run_command([*words, *options]) == 0
    told = capsys.readouterr()
    summary = json.loads(told.out)
    kinds, sure = summary["kinds"], summary["sure"]
    assert kinds["matched"] > 40
    assert kinds["moved"] >= 3
    assert kinds["class"] >= 1
    assert ("other way round" in told.err) == (form == "swapped.geojson")
    rows = list(csv.DictReader((out / "comparison.csv").open(encoding="utf-8", newline="")))
    assert sum(kinds.values()) == len(rows)
    layers = {str(name) for name, _ in pyogrio.list_layers(out / "comparison.gpkg")}
    assert layers == {"comparison", "shifts"}
    assert pyogrio.read_info(out / "comparison.gpkg", layer="comparison")["features"] == len(rows)
    change = ElementTree.parse(out / "comparison.osc").getroot()
    assert len(change.findall("create/node")) == sure["new"]
    tasks = (out / "maproulette.geojson").read_text(encoding="utf-8").split("\n")[:-1]
    assert len(tasks) == sum(sure[k] for k in ("new", "moved", "class", "missing"))
    assert all(json.loads(t.lstrip("\x1e"))["features"][0]["properties"]["kind"] for t in tasks)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Moved: {sure['moved']}" in page


@pytest.mark.parametrize(
    ("name", "text", "options", "code", "told"),
    [
        ("none.csv", None, [], 3, "no such file"),
        ("a.csv", "id,code\n1,R1-1\n", [], 3, "no columns of positions"),
        ("b.csv", "id,x,y\n1,690000,6090000\n", [], 3, "--crs EPSG"),
        ("c.csv", "id,lat,lon\n1,-35.28,149.13\n", ["--columns", "class=VZ"], 2, "VZ"),
        ("d.csv", "id,lat,lon\n1,-35.28,149.13\n", ["--columns", "klass=id"], 2, "klass"),
        ("e.csv", "id,lat,lon\n1,-35.28,149.13\n", ["--crs", "EPSG:0"], 3, "EPSG:0"),
        ("f.csv", "", [], 3, "empty"),
        ("g.gpkg", "no database", [], 3, "cannot be read"),
        ("h.parquet", "no table", [], 3, "no Parquet"),
        ("i.geojson", '{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},'
         '"geometry":{"type":"LineString","coordinates":[[149,-35],[149,-36]]}}]}', [], 3, "lines"),
        ("j.csv", "id,lat,lon,code\n1,-35.28,149.13,ZZ9\n", [], 0, "'ZZ9'"),
        ("k.csv", "id,lat,lon,code\n1,51.0,7.0,R1-1\n", [], 0, "near the map"),
    ],
)  # fmt: skip
def test_a_broken_inventory_is_told_in_a_sentence(
    run_and_case: tuple[Path, Faulty], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    name: str, text: str | None, options: list[str], code: int, told: str,
) -> None:  # fmt: skip
    path = tmp_path / name
    if text is not None:
        path.write_text(text, encoding="utf-8")
    words = ["compare", str(run_and_case[0]), str(path), "-o", str(tmp_path / "out"), *options]
    assert run_command(words) == code
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
    assert (tmp_path / "out").exists() == (code == 0)


def test_the_page_tells_the_stated_accuracy_and_no_folder(
    run_and_case: tuple[Path, Faulty], tmp_path: Path
) -> None:
    path = tmp_path / "list.csv"
    path.write_text("id,lat,lon,code,sd\n1,-35.28,149.13,ZZ9,0.3\n", encoding="utf-8")
    out = tmp_path / "out"
    assert run_command(["compare", str(run_and_case[0]), str(path), "-o", str(out), "--quiet"]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "list.csv: 1 sign has a code not known" in page
    assert str(tmp_path) not in page
    assert "0.30 m" in page
    assert "as stated" in page
    # a run's folder is called _automap, whatever the drive is
    name = json.loads((run_and_case[0] / "run.json").read_text(encoding="utf-8"))["drive"]["name"]
    assert f"<h1>{name}</h1>" in page


def test_what_openstreetmap_has_is_left_to_people() -> None:
    # a modified object loses each tag that a change does not state, and a list has but some
    moved = ComparedSign(
        "moved", 0.9, "yes", "s1", "node/42", "regulatory--stop--g1", "regulatory--stop--g1",
        "DE:206", 8.0, 8.0, 0.0, 0.5, 90.0, 5.0, 7.1, 50.7, 7.0, 50.7,
    )  # fmt: skip
    assert _entry(moved, {}, {})["distance"] == "8.0 ± 0.5 E"
    assert _entry(replace(moved, kind="class"), {}, {})["distance"] == "8.0 ± 0.5"
    gone = replace(moved, kind="missing", class_name="", lon_deg=np.nan)
    new = replace(moved, kind="new", listed_id="", listed_class="", listed_code="")
    doubtful = replace(new, sure="no")
    root = ElementTree.fromstring(osm_change([moved, new, gone, new, doubtful], "DE"))
    assert [child.tag for child in root] == ["create"]
    assert [node.attrib["id"] for node in root.findall("create/node")] == ["-1", "-2"]
    tags = {t.attrib["k"]: t.attrib["v"] for t in root.findall("create/node[1]/tag")}
    assert tags["traffic_sign"] == "DE:206"
    assert tags["direction"] == "90"
    assert "fixme" in tags
    tasks = maproulette_tasks([moved, gone, new, doubtful]).strip("\n").split("\n")
    kinds = [json.loads(task[1:])["features"][0]["properties"]["kind"] for task in tasks]
    assert kinds == ["moved", "missing", "new"]


def test_what_was_not_found_is_weighed_by_how_often_its_kind_was_found() -> None:
    """Signs passed by one to four drives of which each sees a standing one at a rate of its own:
    of those called gone with probability p the part p is."""
    rng = np.random.default_rng(4)
    stated, true = [], []
    for _ in range(6):
        n = 3000
        tries = rng.integers(0, 5, n)
        there = rng.random(n) > 0.05
        rate = rng.beta(6.0 * 0.85, 6.0 * 0.15, n)
        hits = np.where(there, rng.binomial(tries, rate), 0)
        known = standing(tries, hits, np.zeros(n, np.int64))
        assert np.isnan(known.gone[tries == 0]).all()
        assert (known.gone[hits > 0] == 0.0).all()
        assert known.rate == pytest.approx(0.85, abs=0.04)
        many = (hits == 0) & (tries > 1)
        stated.append(known.gone[many])
        true.append(~there[many])
    p, gone = np.concatenate(stated), np.concatenate(true)
    for low, high in ((0.0, 0.75), (0.75, 0.9), (0.9, 1.0)):
        part = (p >= low) & (p < high)
        assert part.sum() > 100
        assert gone[part].mean() == pytest.approx(p[part].mean(), abs=0.07)


def test_a_glimpse_is_no_look() -> None:
    """Of signs in view from a few metres alone nothing is known, so that a miss says little."""
    tries, hits = np.full(60, 3), np.full(60, 3)
    hits[[0, 59]] = 0
    group = np.zeros(60, np.int64)
    group[-3:] = 1
    known = standing(tries, hits, group, [(8.0, 1.5), (1.0, 1.0)])
    assert known.gone[0] > 0.9
    assert known.gone[59] < 0.7
    assert known.more_drives[0] == 0 < known.more_drives[59]
    # so many more that miss it, and not one less, make it surely gone
    more = int(known.more_drives[59])
    for number, least in ((more - 1, False), (more, True)):
        passed = tries.copy()
        passed[59] += number
        # further misses tell a little of the others' rate too
        gone = standing(passed, hits, group, [(8.0, 1.5), (1.0, 1.0)]).gone[59]
        assert (gone > 0.88) == least or abs(gone - 0.9) < 0.03


def test_a_slow_drive_has_a_sign_in_view_no_longer_than_a_fast_one() -> None:
    way = np.concatenate(
        [np.arange(0.0, 50.0, 0.5), np.full(200, 50.0), np.arange(50.0, 101.0, 25)]
    )
    lat, lon, height = to_geodetic(np.column_stack([0.0 * way, way, 0.0 * way]))
    three = np.zeros((len(way), 3))
    stamps = np.arange(len(way), dtype=np.int64)
    path = even_path(
        Trajectory(stamps, stamps * 1.0, lat, lon, height, three, three, three, three, three)
    )
    assert len(path) == 26
    assert np.diff(path.lat_rad)[:-1] * 6.36e6 == pytest.approx(4.0, abs=0.05)


def test_signs_of_unknown_facing_have_rates_of_their_own() -> None:
    tries = np.full(90, 2)
    hits = np.full(90, 2)
    group = np.repeat([0, 1, 2], 30)
    # those on the left look away from every drive, half of the time
    hits[30:45] = 0
    hits[0] = hits[60] = 0
    gone = standing(tries, hits, group).gone
    assert gone[0] > 0.8
    assert gone[60] == pytest.approx(gone[0], abs=0.05)
    assert gone[30] < gone[0] - 0.15


def test_drives_that_had_a_sign_in_view_are_counted() -> None:
    sign, drive = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 0, 1, 0])
    none = np.zeros(5)
    seen_by = [frozenset({1}), None, frozenset({5}), frozenset({0})]
    tries, hits = counts(Opportunities(sign, drive, none, none, sign), 4, seen_by)
    assert tries.tolist() == [2, 2, 1, 0]
    # a sign that was found was seen, whoever of those in view it was
    assert hits.tolist() == [1, 0, 1, 0]


def test_what_all_signs_of_a_map_are_off_in_common_is_no_doubt_of_one_that_was_moved() -> None:
    """A map that is off by some metres as a whole states that of each of its signs."""
    rng, town, drives, _, signs = town_and_drive(5)
    case = faulty(rng, town)
    wide = [replace(s, cov_enu=s.cov_enu + 2.5**2 * np.eye(3)) for s in signs]
    moved = set(np.flatnonzero(case.kind == "moved").tolist())
    result = compare_inventory(wide, case.inventory, drives)
    told = {f.listed for f in result.findings if f.kind == "moved" and f.sure}
    assert len(told & moved) > 0.9 * len(moved) - 1
    assert len(told & moved) > 0.9 * len(told) - 1
    assert np.median([f.sd_m for f in result.findings if f.kind == "matched"]) < 1.5


def test_a_pair_is_doubted_where_another_pairing_explains_as_much() -> None:
    """Two signs on one corner and one entry between them that may be either of them."""

    def at(number: int, east_m: float) -> Sign:
        there = sign_at(number, 0.999)
        return replace(there, lon_rad=east_m / 6.378e6, cov_enu=0.25 * np.eye(3))

    names = ["regulatory--stop--g1"] * 12
    far = [replace(at(k, 0.0), lat_rad=k * 1e-5) for k in range(1, 11)]
    signs = [replace(s, class_name=names[0]) for s in [*far, at(11, -0.6), at(12, 0.6)]]
    signs[-2:] = [replace(s, class_name="regulatory--yield--g1") for s in signs[-2:]]
    place = [(s.lat_rad, s.lon_rad) for s in far] + [(0.0, 0.0)]
    n = len(place)
    inventory = Inventory(
        [str(k) for k in range(n)], [*names[:10], "regulatory--yield--g1"],
        np.array([p[0] for p in place]), np.array([p[1] for p in place]),
        np.full(n, np.nan), np.full(n, np.nan),
    )  # fmt: skip
    findings = compare_inventory(signs, inventory, []).findings
    between = next(f for f in findings if f.listed == n - 1)
    other = next(f for f in findings if f.kind == "new")
    assert between.probability == pytest.approx(0.5, abs=0.05)
    assert other.probability == pytest.approx(0.5, abs=0.1)
    assert min(f.probability for f in findings if f not in (between, other)) > 0.95
