"""Files of inventories in all their forms, and the page and files of a comparison with one."""

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
from inventory_case import Faulty, faulty, town_and_drive
from merge_folders import write_run
from pyogrio.raw import write
from pyproj import Transformer

from automap.errors import InputError
from automap.export.inventory import ComparedSign, maproulette_tasks, osm_change
from automap.export.inventory_style import comparison_styles
from automap.inventory.findings import (
    Inventory,
)
from automap.io.inventory_file import read_inventory
from automap.io.vector_layer import read_layer
from automap.signs.codes import classes_of
from pipeline.cli.root import run_command
from pipeline.compare.command import KINDS
from pipeline.compare.listing import listed_signs
from pipeline.compare.report import _entry
from tests.slow_cases import others_slow


@pytest.mark.parametrize(
    ("text", "country", "expected"),
    [
        ("274-60", "DE", "regulatory--maximum-speed-limit-60--g1"),
        ("Zeichen 274-56", None, "regulatory--maximum-speed-limit-60--g1"),
        ("DE:274-60,1040-30", None, "regulatory--maximum-speed-limit-60--g1"),
        ("DE:274[60]", None, "regulatory--maximum-speed-limit-60--g1"),
        ("R4-1 (60)", "AU", "regulatory--maximum-speed-limit-60--g1"),
        ("R4-1(60)", None, "regulatory--maximum-speed-limit-60--g1"),
        ("StVO 274(60)", None, "regulatory--maximum-speed-limit-60--g1"),
        ("R2-1[50]", "US", "regulatory--maximum-speed-limit-50--g1"),
        ("R5-1", "US", "regulatory--no-entry--g1"),
        ("VIENNA:B2", "FR", "regulatory--stop--g1"),
        ("VIENNA:C3I", "FR", "regulatory--no-pedestrians--g2"),
        ("VIENNA:C14[60]", "FR", "regulatory--maximum-speed-limit-60--g1"),
        # there it forbids a turn
        ("B2", "FR", None),
        ("give_way", None, "regulatory--yield--g1"),
        ("regulatory--stop--g1", "DE", "regulatory--stop--g1"),
        ("", "DE", ""),
        ("999-99", "DE", None),
    ],
)
def test_codes_are_classes(text: str, country: str | None, expected: str | None) -> None:
    assert classes_of([text], country) == [expected]


def test_a_name_of_several_classes_is_told_with_them(tmp_path: Path) -> None:
    path, warnings = tmp_path / "list.csv", list[str]()
    path.write_text("id,class,lat,lon\n1,VIENNA:D2,1,2\n2,roundabout,1,2\n3,none,1,2\n")
    listed_signs(read_inventory(path), "AU", path, warnings)
    unknown, several = warnings
    assert "1 sign has a code not known, such as 'none' (1)" in unknown
    assert "2 signs have codes of several classes" in several
    for told in (
        "'VIENNA:D2', which may be regulatory--keep-right or regulatory--keep-left (1)",
        "'roundabout', which may be ",
        "regulatory--roundabout",
        "warning--roundabout",
        "Write the class",
    ):
        assert told in several
    assert classes_of(["warning--roundabout"], "AU") != [None]


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


@pytest.mark.parametrize(
    "form", others_slow(["csv", "gpkg", "shp", "geojson", "swapped.geojson", "parquet"], 3)
)
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
    assert layers == {"comparison", "shifts", "layer_styles"}
    assert pyogrio.read_info(out / "comparison.gpkg", layer="comparison")["features"] == len(rows)
    change = ElementTree.parse(out / "comparison.osc").getroot()
    assert len(change.findall("create/node")) == sure["new"]
    tasks = (out / "maproulette.geojson").read_text(encoding="utf-8").split("\n")[:-1]
    assert len(tasks) == sum(sure[k] for k in ("new", "moved", "class", "missing"))
    assert all(json.loads(t.lstrip("\x1e"))["features"][0]["properties"]["kind"] for t in tasks)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Moved: {sure['moved']}" in page
    assert all(row["code"] and f" {row['code']} <small>" in page for row in rows if row["id"]
               and row["kind"] in ("new", "moved", "class"))  # fmt: skip


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
        ("l.csv", "id,lat,lon\n1,-35.28,149.13\n", ["--country", "Australia"], 2, "ISO 3166"),
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
    assert _entry(moved, {}, {}, {})["distance"] == "8.0 ± 0.5 E"
    assert _entry(replace(moved, kind="class"), {}, {}, {})["distance"] == "8.0 ± 0.5"
    # of what no drive had in view nothing is said, and not how surely
    unseen = replace(moved, kind="not_seen", class_name="")
    assert [_entry(r, {}, {}, {})["probability"] for r in (moved, unseen)] == ["0.90", ""]
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


def _utm_list(path: Path, rows: list[tuple[str, str]]) -> None:
    lines = [f"ST-{k};274-60;{x};{y};90" for k, (x, y) in enumerate(rows)]
    head = "Lfd. Nr.;VZ-Nummer;Rechtswert;Hochwert;Ausrichtung"
    path.write_text("\n".join([head, *lines]), encoding="latin-1")


def test_a_german_list_is_read_by_its_own_names_and_metres_of_any_kind(tmp_path: Path) -> None:
    """Degrees among metres, a zone ahead of eastings and turned rows lie on the map too."""
    lon, lat = np.array([8.401, 8.402, 8.403, 8.404]), np.array([49.01, 49.011, 49.012, 49.013])
    east, north = Transformer.from_crs("OGC:CRS84", "EPSG:25832", always_xy=True).transform(
        lon, lat
    )
    _utm_list(
        tmp_path / "list.csv",
        [
            (f"{east[0]:.2f}".replace(".", ","), f"{north[0]:.2f}".replace(".", ",")),
            (f"{lon[1]:.7f}", f"{lat[1]:.7f}"),
            (f"32{east[2]:.2f}", f"{north[2]:.2f}"),
            (f"{north[3]:.2f}", f"{east[3]:.2f}"),
        ],
    )
    near = np.radians(lat), np.radians(lon)
    read = read_inventory(tmp_path / "list.csv", crs="EPSG:25832", near=near)
    np.testing.assert_allclose(np.degrees(read.lat_rad), lat, atol=2e-7)
    np.testing.assert_allclose(np.degrees(read.lon_rad), lon, atol=2e-7)
    assert read.columns == {
        "id": "Lfd. Nr.", "class": "VZ-Nummer", "x": "Rechtswert", "y": "Hochwert",
        "facing": "Ausrichtung",
    }  # fmt: skip
    assert read.unread == ()
    told = " ".join(read.warnings)
    for what in ("1 of 4 entries are the other way round", "are degrees", "number of the zone"):
        assert what in told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("lat,lon,code,sd\n1,2,R1-1,good\n1,2,R1-2,0.4\n", "accuracies of 1 entries"),
        ("lat,lon,code,sd\n1,2,R1-1,0\n", "such as '0'"),
        ("lat,lon,code\n1,2,\n1,2,R1-2\n", "code is empty in 1 of 2"),
    ],
)
def test_what_a_list_leaves_open_is_told(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "list.csv"
    path.write_text(text, encoding="utf-8")
    read = read_inventory(path)
    assert told in " ".join(read.warnings)
    assert len(read) == text.count("\n") - 1


def test_signs_that_do_not_stand_by_their_status_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text(
        "id,Latitude (WGS84),GPS_LON,code,Status\na,1,2,R1-1,Active\nb,1,2,R1-2,Removed 2025\n"
        "c,1,2,R1-1,planned\nd,1,2,R1-1,Planned replacement\ne,1,2,R1-1,\n"
    )
    read = read_inventory(path)
    assert read.ids == ["a", "d", "e"]
    assert len(read.lat_rad) == len(read.sd_m) == 3
    assert any("2 of 5 entries do not stand" in text for text in read.warnings)
    path.write_text("id,lat,lon,code\n")
    with pytest.raises(InputError, match="holds no entries"):
        read_inventory(path)


def test_the_number_of_a_limit_stands_in_a_column_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "list.csv"
    path.write_text("lat,lon,code,value\n1,2,R4-1,50.0\n1,2,R4-1,60 km/h\n1,2,R4-1,\n1,2,R1-1,40\n")
    assert read_inventory(path).codes == ["R4-1[50]", "R4-1[60]", "R4-1", "R1-1"]


def test_which_of_several_layers_is_meant_is_not_guessed(tmp_path: Path) -> None:
    path, points = tmp_path / "all.gpkg", shapely.to_wkb(shapely.points([2.0, 2.1], [1.0, 1.0]))
    line = shapely.to_wkb(np.array([shapely.LineString([(2, 1), (2, 2)])], object))

    def add(layer: str, kind: str, wkb: np.ndarray) -> None:
        names = [np.array(["R1-1"] * len(wkb), object)]
        write(path, geometry=wkb, field_data=names, fields=["code"], driver="GPKG", layer=layer,
              geometry_type=kind, crs="EPSG:4326", append=path.exists())  # fmt: skip

    add("roads", "LineString", line)
    add("signs", "Point", points)
    assert len(read_inventory(path)) == 2
    assert len(read_layer(path, shape="LineString")) == 1
    add("poles", "Point", points[:1])
    with pytest.raises(InputError, match=r"layers signs, poles.*--layer"):
        read_inventory(path)
    assert len(read_inventory(path, layer="poles")) == 1


def test_a_workbook_that_is_called_a_table_is_told(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_bytes(b"PK\x03\x04 and so on")
    with pytest.raises(InputError, match="is a spreadsheet"):
        read_inventory(tmp_path / "list.csv")


def test_a_place_elsewhere_is_not_brought_to_the_map(tmp_path: Path) -> None:
    _utm_list(tmp_path / "list.csv", [("456000.0", "5429000.0"), ("600000.0", "5600000.0")])
    near = np.radians([49.01]), np.radians([8.4])
    read = read_inventory(tmp_path / "list.csv", crs="EPSG:25832", near=near)
    assert np.degrees(read.lat_rad[1]) == pytest.approx(50.54, abs=0.02)
    assert any("more than 10 km from the map" in text for text in read.warnings)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig"])
def test_columns_of_degrees_have_umlauts(tmp_path: Path, encoding: str) -> None:
    """As spreadsheets write them: of the code page, as Unicode text, with a mark before it."""
    (tmp_path / "list.csv").write_text("Nr;Zeichen;Breite;Länge\n1;206;49,5;8,5\n", encoding)
    read = read_inventory(tmp_path / "list.csv")
    assert np.degrees([read.lat_rad[0], read.lon_rad[0]]) == pytest.approx([49.5, 8.5])


def test_qgis_tells_the_kinds_of_a_comparison_apart() -> None:
    points, _ = comparison_styles()
    root = ElementTree.fromstring(points.qml.partition("\n")[2])
    assert {c.get("value") for c in root.iter("category")} == set(KINDS)
    colours = [o.get("value") for o in root.iter("Option") if o.get("name") == "color"]
    assert len(set(colours)) == len(colours) == len(KINDS)
