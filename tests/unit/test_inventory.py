"""A map against an inventory made from the truth, with known faults put into it."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyogrio
import pytest
import shapely
from merge_folders import write_run
from merge_scene import CLASSES, Errors, Town, drive_through, street, to_geodetic
from pyogrio.raw import write
from pyproj import Transformer

from automap.export.inventory import ComparedSign, maproulette_tasks, osm_change
from automap.mapping import inventory as inventory_module
from automap.mapping.inventory import Inventory, InventoryComparison, compare_inventory
from automap.mapping.inventory_limits import DETECTION_PRIOR, STALE
from automap.mapping.sightings import DriveSigns
from automap.mapping.visibility import Opportunities
from automap.records import Sign
from automap.signs.codes import classes_of
from pipeline.cli.root import run_command

CLEAN = Errors(missed=0.02, clutter=0.0, wrong_class=0.0)
KINDS = ("matched", "new", "moved", "class", "missing")


def signs_of(drive: DriveSigns) -> list[Sign]:
    """The drive's signs as a map has them."""
    return [
        Sign(
            drive.ids[k], str(drive.class_name[k]), drive.lat_rad[k], drive.lon_rad[k],
            drive.height_m[k], drive.cov_enu[k], 0.98, 9, 0, 0, 2.0, drive.facing_rad[k], 0.6, "",
        )
        for k in range(len(drive))
    ]  # fmt: skip


@dataclass
class Faulty:
    """An inventory, the true sign of each row (-1: stands nowhere), and the faults put in."""

    inventory: Inventory
    origin: np.ndarray
    kind: np.ndarray
    deleted: set[int]


def faulty(
    rng: np.random.Generator, town: Town, sd: float = 0.3, shift: tuple[float, float] = (0.0, 0.0)
) -> Faulty:
    """5 % deleted, 5 % moved by 8 m, 3 % of another class, 4 % that stand no more."""
    n = len(town.position)
    order = rng.permutation(n)
    part = max(round(0.05 * n), 1), max(round(0.03 * n), 1)
    deleted, moved, other = np.split(order[: 2 * part[0] + part[1]], [part[0], 2 * part[0]])
    kept = np.setdiff1d(np.arange(n), deleted)
    position, names = town.position.copy(), town.class_name.copy()
    angle = rng.uniform(0.0, 2.0 * np.pi, len(moved))
    position[moved, :2] += 8.0 * np.column_stack([np.sin(angle), np.cos(angle)])
    for k in other:
        names[k] = rng.choice([c for c in CLASSES if c != names[k]])
    extra = rng.choice(n, max(round(0.04 * n), 1), replace=False)
    gone = town.position[extra] + np.array([0.0, 30.0, 0.0])
    kind = np.full(n, "matched", object)
    kind[moved], kind[other] = "moved", "class"
    at = np.vstack([position[kept], gone])
    at[:, :2] += sd * rng.standard_normal((len(at), 2)) + np.array(shift)
    lat, lon, _ = to_geodetic(at)
    inventory = Inventory(
        [f"K{k}" for k in range(len(at))],
        [str(c) for c in np.concatenate([names[kept], town.class_name[extra]])],
        lat, lon,
        np.concatenate([town.facing[kept], town.facing[extra]]),
        np.full(len(at), np.nan),
    )  # fmt: skip
    origin = np.concatenate([kept, np.full(len(extra), -1)])
    kinds = np.concatenate([kind[kept], np.full(len(extra), "missing", object)])
    return Faulty(inventory, origin, kinds, set(deleted.tolist()))


def judged(
    result: InventoryComparison, case: Faulty, truth: np.ndarray
) -> dict[str, tuple[int, int, int]]:
    """Right, told and due findings of each kind, over the true signs that the map has."""
    seen = set(truth.tolist())
    score = dict.fromkeys(KINDS, (0, 0, 0))
    for kind in KINDS:
        told = [f for f in result.findings if f.kind == kind]
        if kind == "new":
            due = len(case.deleted & seen)
            right = sum(int(truth[f.sign]) in case.deleted for f in told)
        elif kind == "missing":
            # those out of view are "not_seen"
            out = {f.listed for f in result.findings if f.kind == "not_seen"}
            rows = np.flatnonzero(case.kind == "missing").tolist()
            due = len([k for k in rows if k not in out])
            right = sum(bool(case.kind[f.listed] == "missing") for f in told)
        else:
            rows = np.flatnonzero(case.kind == kind)
            due = sum(int(case.origin[k]) in seen for k in rows)
            right = sum(
                bool(case.kind[f.listed] == kind and case.origin[f.listed] == truth[f.sign])
                for f in told
            )
        score[kind] = (right, len(told), due)
    return score


def town_and_drive(
    seed: int, length_m: float = 6000.0, errors: Errors = CLEAN
) -> tuple[np.random.Generator, Town, list[DriveSigns], np.ndarray, list[Sign]]:
    rng = np.random.default_rng(seed)
    town = street(rng, length_m, 25.0)
    path = np.array([[2.0, -60.0], [2.0, length_m + 60.0], [-2.0, length_m + 60.0], [-2.0, -60.0]])
    drive, truth = drive_through(rng, town, path, 12.0, "a", 1e9, errors)
    return rng, town, [drive], truth, signs_of(drive)


def test_faults_put_into_an_inventory_are_found() -> None:
    total = {kind: np.zeros(3) for kind in KINDS}
    for seed in range(4):
        rng, town, drives, truth, signs = town_and_drive(seed)
        case = faulty(rng, town)
        result = compare_inventory(signs, case.inventory, drives)
        for kind, score in judged(result, case, truth).items():
            total[kind] += score
    for kind in ("matched", "new", "moved", "class"):
        right, told, due = total[kind]
        assert right > 0.9 * told, (kind, total[kind])
        assert right > 0.9 * due, (kind, total[kind])


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
    assert not straight.turned
    assert turned.turned
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
    kinds = json.loads(told.out)["kinds"]
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
    assert len(change.findall("create/node")) == kinds["new"]
    tasks = (out / "maproulette.geojson").read_text(encoding="utf-8").split("\n")[:-1]
    assert len(tasks) == sum(kinds[k] for k in ("new", "moved", "class", "missing"))
    assert all(json.loads(t.lstrip("\x1e"))["features"][0]["properties"]["kind"] for t in tasks)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Moved: {kinds['moved']}" in page


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


def test_what_openstreetmap_has_is_left_to_people() -> None:
    # a modified object loses each tag that a change does not state, and a list has but some
    moved = ComparedSign(
        "moved", 0.9, "s1", "node/42", "regulatory--stop--g1", "regulatory--stop--g1", "DE:206",
        8.0, 8.0, 0.0, 0.5, 90.0, 5.0, 7.1, 50.7, 7.0, 50.7,
    )  # fmt: skip
    gone = replace(moved, kind="missing", class_name="", lon_deg=np.nan)
    new = replace(moved, kind="new", listed_id="", listed_class="", listed_code="")
    root = ElementTree.fromstring(osm_change([moved, new, gone, new], "DE"))
    assert [child.tag for child in root] == ["create"]
    assert [node.attrib["id"] for node in root.findall("create/node")] == ["-1", "-2"]
    tags = {t.attrib["k"]: t.attrib["v"] for t in root.findall("create/node[1]/tag")}
    assert tags["traffic_sign"] == "DE:206"
    assert tags["direction"] == "90"
    assert "fixme" in tags
    tasks = maproulette_tasks([moved, gone, new]).strip("\n").split("\n")
    kinds = [json.loads(task[1:])["features"][0]["properties"]["kind"] for task in tasks]
    assert kinds == ["moved", "missing", "new"]


def test_what_was_not_found_is_weighed_by_how_often_its_kind_was_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Known faces, and unknown ones to the left and to the right, each at a rate of their own; a
    sign that was passed twice unseen is the surer gone."""
    facing = np.array([0.0] * 12 + [np.nan] * 16)
    listed = len(facing)
    found = np.ones(listed, bool)
    # of twelve known one is missing, of eight on the left four, of eight on the right one
    found[[3, 12, 13, 14, 15, 20]] = False
    passes = np.ones(listed, int)
    passes[[3, 13]] = 2
    passes[[14, 27]] = 0
    sign = np.repeat(np.arange(listed), passes)
    offset = np.where(sign < 20, -3.0, 3.0)
    views = Opportunities(sign, np.zeros(len(sign), np.int64), np.zeros(len(sign)), offset)
    monkeypatch.setattr(inventory_module, "opportunities", lambda *_: views)
    monkeypatch.setattr(inventory_module, "head_on", lambda views, facing: views)
    zero = np.zeros(listed)
    inventory = Inventory(
        [str(k) for k in range(listed)], ["a"] * listed, zero, zero, facing, zero + np.nan
    )
    told, overall = inventory_module._not_found(inventory, found, [])

    def rate(hits: float, misses: float) -> float:
        """Beta, but for the usual share of stale entries among what was not found."""
        missed = max((hits + misses) * (1.0 - STALE) - hits, 0.0)
        return (hits + DETECTION_PRIOR[0]) / (hits + missed + sum(DETECTION_PRIOR))

    # what no drive had in view counts nowhere
    rates = {"known": rate(11, 1), "left": rate(4, 3), "right": rate(6, 1)}
    assert overall == pytest.approx(rate(21, 5))
    assert {f.listed for f in told} == {3, 12, 13, 14, 15, 20}
    for finding in told:
        j = finding.listed
        if passes[j] == 0:
            assert (finding.kind, finding.probability) == ("not_seen", 1.0)
            continue
        side = "known" if j < 12 else "left" if j < 20 else "right"
        gone = STALE / (STALE + (1.0 - STALE) * (1.0 - rates[side]) ** passes[j])
        assert finding.kind == ("missing" if gone > 0.5 else "unconfirmed")
        assert finding.probability == pytest.approx(max(gone, 1.0 - gone))
        assert finding.sign == -1
