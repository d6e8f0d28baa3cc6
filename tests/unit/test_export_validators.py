"""Every file of a map against checks that others wrote, and the numbers in it against the run."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
import zipfile
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from export_inputs import CLOCK, sign, write_run
from lxml import etree

from automap.export.fields import SIGN_FIELDS
from automap.io import names
from automap.io.signs_table import read_signs
from pipeline.export.command import export_run
from pipeline.export.formats import FORMATS, TRAJECTORY_FORMATS
from pipeline.shared.pictures import Picture, write_pictures

SIGNS = 12
DEGREE_1CM = 1e-7
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run exported in every format, each file under its own name."""
    folder = write_run(tmp_path_factory.mktemp("run") / "out", signs=SIGNS)
    write_pictures(folder, [Picture(*picture) for picture in made_up_pictures()])
    for fmt in FORMATS:
        export_run(folder, fmt)
    return folder


def made_up_pictures():  # type: ignore[no-untyped-def]
    import cv2

    from automap.export.pictures import SignView

    for number in (1, 2):
        _, data = cv2.imencode(".jpg", np.full((40, 40, 3), 90 * number, np.uint8))
        box = np.array([10.0, 20.0, 40.0, 50.0])
        view = SignView(f"s{number:04d}", 1, "front", number, CLOCK.ref_ns, box, 0.9, 12.0)
        yield view, data.tobytes()


def true_places(out: Path) -> np.ndarray:
    signs = read_signs(out / names.SIGNS_RAW)
    return np.degrees([[s.lon_rad, s.lat_rad] for s in signs])


def lineage_of(text: str) -> dict[str, object]:
    content = json.loads(text)
    assert re.fullmatch("[0-9a-f]{16}", content["run_id"])
    assert content["software"].startswith("AutoMap ")
    assert content["drives"] == ["demo"]
    return dict(content)


@pytest.mark.parametrize(
    ("file", "layer", "count", "crs"),
    [
        (names.GPKG, "signs", SIGNS, "EPSG:4979"),
        (names.GPKG, "ellipses", SIGNS, "EPSG:4979"),
        (names.GPKG, "observations", 580, "EPSG:4979"),
        ("signs.fgb", "signs", SIGNS, "EPSG:4979"),
        (names.SIGNS_GEOJSON, "signs", SIGNS, "EPSG:4979"),
        (names.KML, "Signs", SIGNS, "EPSG:4326"),
        (names.KML, "95 % ellipses", SIGNS, "EPSG:4326"),
        ("trajectory.gpx", "waypoints", SIGNS, "EPSG:4326"),
    ],
)
def test_gdal_opens_every_layer(out: Path, file: str, layer: str, count: int, crs: str) -> None:
    import shapely
    from pyogrio import list_layers, read_info
    from pyogrio.raw import read

    assert layer in [name for name, _ in list_layers(out / file)]
    info = read_info(out / file, layer=layer, force_feature_count=True)
    assert info["features"] == count
    assert info["crs"] == crs
    if layer in ("observations",):
        return
    _, _, geometry, _ = read(out / file, layer=layer)
    shapes = shapely.from_wkb(geometry)
    if "llipses" in layer:
        # an ellipse lies around its sign
        shapes = shapely.centroid(shapes)
    found = np.column_stack([shapely.get_x(shapes), shapely.get_y(shapes)])
    # a FlatGeobuf file is in the order of its spatial index
    true = true_places(out)
    order = np.lexsort(np.round(found, 6).T), np.lexsort(np.round(true, 6).T)
    assert np.abs(found[order[0]] - true[order[1]]).max() <= DEGREE_1CM


def test_gdal_opens_the_path(out: Path) -> None:
    from pyogrio import read_info

    info = read_info(out / names.GPKG, layer="trajectory")
    assert info["geometry_type"] == "LineString Z"
    assert info["features"] > 10
    points = read_info(out / "trajectory.gpx", layer="track_points", force_feature_count=True)
    assert points["features"] == 121


def test_geojson_by_a_model_of_the_standard(out: Path) -> None:
    from geojson_pydantic import FeatureCollection

    text = (out / names.SIGNS_GEOJSON).read_text()
    collection = FeatureCollection.model_validate_json(text)
    assert len(collection.features) == SIGNS
    raw = json.loads(text)
    assert "crs" not in raw
    west, south, low, east, north, high = raw["bbox"]
    places = true_places(out)
    for feature, raw_feature, true in zip(
        collection.features, raw["features"], places, strict=True
    ):
        assert feature.id == feature.properties["id"]
        lon, lat, height = feature.geometry.coordinates
        assert -180 <= west <= lon <= east <= 180
        assert -90 <= south <= lat <= north <= 90
        assert low <= height <= high
        assert abs(lon - true[0]) <= DEGREE_1CM
        assert abs(lat - true[1]) <= DEGREE_1CM
        assert all(round(c, 7) == c for c in raw_feature["geometry"]["coordinates"][:2])
    lineage_of(json.dumps(raw["automap"]))


def test_seven_decimals_are_written(out: Path) -> None:
    text = (out / names.SIGNS_GEOJSON).read_text()
    pairs = re.findall(r'"coordinates": \[(-?\d+\.\d+), (-?\d+\.\d+)', text)
    assert len(pairs) == SIGNS
    assert {len(number.split(".")[1]) for pair in pairs for number in pair} == {7}


@pytest.fixture(scope="module")
def kml_schema() -> etree.XMLSchema:
    found = find_spec("fastkml")
    if found is None or found.origin is None:
        pytest.skip("the KML schemas come with the package fastkml, which is not installed")
    return etree.XMLSchema(etree.parse(Path(found.origin).parent / "schema" / "ogckml22.xsd"))


@pytest.fixture(scope="module")
def gx_schema() -> etree.XMLSchema:
    found = find_spec("fastkml")
    if found is None or found.origin is None:
        pytest.skip("the KML schemas come with the package fastkml, which is not installed")
    return etree.XMLSchema(etree.parse(Path(found.origin).parent / "schema" / "kml22gx.xsd"))


def test_kml_and_kmz_by_the_schemas(
    out: Path, kml_schema: etree.XMLSchema, gx_schema: etree.XMLSchema
) -> None:
    with zipfile.ZipFile(out / names.KMZ) as archive:
        assert archive.testzip() is None
        assert archive.namelist()[0] == "doc.kml"
        documents = [(out / names.KML).read_bytes(), archive.read("doc.kml")]
    for document in documents:
        root = etree.fromstring(document)
        kml_schema.assertValid(root)
        gx_schema.assertValid(root)


def test_kmz_has_every_picture_it_shows(out: Path) -> None:
    with zipfile.ZipFile(out / names.KMZ) as archive:
        root = etree.fromstring(archive.read("doc.kml"))
        held = set(archive.namelist())
        hrefs = {element.text for element in root.iter(f"{KML}href")}
        balloons = " ".join(e.text or "" for e in root.iter(f"{KML}description"))
        shown = set(re.findall(r'<img src="([^"]+)"', balloons))
        assert len(hrefs) == 3, "an icon for each class"
        assert shown == {"files/s0001-1.jpg", "files/s0002-1.jpg"}
        assert hrefs | shown | {"doc.kml"} == held
        assert all(archive.read(name).startswith(b"\x89PNG") for name in hrefs)
    modes = [p.findtext(f"{KML}altitudeMode") for p in root.iter(f"{KML}Point")]
    assert modes == ["clampToGround"] * SIGNS


def test_geoparquet_by_its_own_validator(out: Path) -> None:
    import pyarrow.parquet as pq

    validator = pytest.importorskip("geoparquet_validator")
    report = validator.check(str(out / names.SIGNS_TABLE))
    assert validator.failed(report) == []
    passed = {o["id"] for o in report["outcomes"] if o["status"] == "pass"}
    assert {"/conf/core/epoch", "/conf/covering/bbox-column-type"} <= passed
    metadata = pq.read_schema(out / names.SIGNS_TABLE).metadata
    lineage_of(metadata[b"automap"].decode())
    epoch = json.loads(metadata[b"geo"])["columns"]["geometry"]["epoch"]
    # the made-up drive is of 14 March 2026
    assert epoch == pytest.approx(2026 + 72 / 365, abs=0.01)


def test_lineage_of_the_other_files(out: Path) -> None:
    from pyogrio import read_info

    lineage_of(read_info(out / names.GPKG, layer="signs")["dataset_metadata"]["AUTOMAP"])
    lineage_of(read_info(out / "signs.fgb")["layer_metadata"]["DESCRIPTION"])
    for file in ("signs.csv", "trajectory.csv"):
        beside = json.loads((out / f"{file}-metadata.json").read_text())
        lineage_of(json.dumps(beside["automap"]))
        header = (out / file).read_text().splitlines()[0].split(",")
        assert [column["name"] for column in beside["tableSchema"]["columns"]] == header
    root = etree.fromstring((out / names.KML).read_bytes())
    data = {e.get("name"): e.findtext(f"{KML}value") for e in root.iter(f"{KML}Data")}
    assert re.fullmatch("[0-9a-f]{16}", data["run_id"])
    assert "run_id" in (out / "trajectory.gpx").read_text()


def test_nothing_of_this_computer_is_in_the_lineage(out: Path) -> None:
    for fmt, (file, _) in FORMATS.items():
        assert b"/drives/demo" not in (out / file).read_bytes(), fmt


def test_geopackage_is_whole_and_styled(out: Path) -> None:
    with closing(sqlite3.connect(out / names.GPKG)) as file:
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert file.execute("PRAGMA foreign_key_check").fetchall() == []
        styles = dict(file.execute("SELECT f_table_name, styleQML FROM layer_styles"))
        layers = {row[0] for row in file.execute("SELECT table_name FROM gpkg_geometry_columns")}
        meanings = dict(
            file.execute(
                "SELECT column_name, description FROM gpkg_data_columns WHERE table_name = 'signs'"
            )
        )
        columns = {row[1] for row in file.execute("PRAGMA table_info(signs)")}
    known = {"signs", "observations", "trajectory", "assemblies", "ellipses"}
    assert set(styles) == layers == known
    assert columns - {"fid", "geom"} == set(meanings)
    assert meanings["ce95_m"].endswith("(m)")
    classes = [e.get("value") for e in etree.fromstring(styles["signs"]).iter("category")]
    assert classes == ["give-way", "speed-limit-50", "stop", ""]
    for text in styles.values():
        root = etree.fromstring(text)
        used = {e.get("symbol") for tag in ("category", "range") for e in root.iter(tag)} or {"0"}
        assert used == {e.get("name") for e in root.iter("symbol")}


def test_every_column_is_in_the_dictionary(out: Path) -> None:
    import pyarrow.parquet as pq

    rows = list(csv.DictReader((out / names.DICTIONARY).open(newline="")))
    listed: dict[str, set[str]] = {}
    for row in rows:
        assert row["meaning"]
        for table in row["table"].split(", "):
            listed.setdefault(table, set()).add(row["column"])
    table = set(pq.read_schema(out / names.SIGNS_TABLE).names) - {"geometry", "bbox"}
    assert table == listed[names.SIGNS_TABLE]
    features = json.loads((out / names.SIGNS_GEOJSON).read_text())["features"]
    assert set(features[0]["properties"]) == listed[names.SIGNS_GEOJSON]
    for file in ("signs.csv", "trajectory.csv"):
        header = (out / file).read_text().splitlines()[0].split(",")
        described = listed[file] | (listed[names.SIGNS_GEOJSON] if file == "signs.csv" else set())
        assert set(header) == described
    assert set(pq.read_schema(out / names.TRAJECTORY).names) == listed[names.TRAJECTORY]
    index = (out / names.PICTURE_INDEX).read_text().splitlines()[0].split(",")
    assert set(index) == listed[names.PICTURE_INDEX]


KNOWN_VALUES = {"stop", "give_way", "maxspeed", "hazard", "yes"}


def test_the_review_file_by_the_tagging_rules(out: Path) -> None:
    root = etree.fromstring((out / "signs.osm").read_bytes())
    assert root.tag == "osm"
    assert root.get("version") == "0.6"
    assert root.get("upload") == "false"
    nodes = root.findall("node")
    assert len(nodes) == len(root) == SIGNS
    ids = [int(node.get("id")) for node in nodes]
    assert max(ids) < 0
    assert len(set(ids)) == SIGNS
    for node, true in zip(nodes, true_places(out), strict=True):
        assert node.get("version") is None, "a node that the server does not know has none"
        assert abs(float(node.get("lon")) - true[0]) <= DEGREE_1CM
        assert abs(float(node.get("lat")) - true[1]) <= DEGREE_1CM
        tags = {tag.get("k"): tag.get("v") for tag in node}
        assert len(tags) == len(node), "no key twice"
        for key, value in tags.items():
            assert re.fullmatch(r"[a-z_:]{1,255}", key)
            assert 0 < len(value) <= 255
            assert value == value.strip()
        value = tags["traffic_sign"]
        assert value in KNOWN_VALUES or re.fullmatch(r"[A-Z]{2}:\S+", value)
        assert 0 <= int(tags["direction"]) < 360
        assert tags["side"] in ("left", "right")
        assert ("maxspeed" in tags) == (value == "maxspeed" or "R4-1" in value)
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", tags["survey:date"])
        assert "fixme" in tags


def test_the_least_confidence_leaves_signs_out(out: Path, tmp_path: Path) -> None:
    for fmt in set(FORMATS) - set(TRAJECTORY_FORMATS):
        path, warnings = export_run(out, fmt, tmp_path / f"x.{fmt}", min_confidence=0.95)
        assert any(f"{SIGNS} of {SIGNS} signs are less sure" in text for text in warnings)
        assert path.is_file()
    assert json.loads((tmp_path / "x.geojson").read_text())["features"] == []
    path, warnings = export_run(out, "geojson", tmp_path / "all.geojson", min_confidence=0.9)
    assert len(json.loads(path.read_text())["features"]) == SIGNS
    assert not any("less sure" in text for text in warnings)


def test_csv_has_the_columns_of_the_contract(out: Path) -> None:
    rows = list(csv.DictReader(io.StringIO((out / "signs.csv").read_text(), newline="")))
    assert len(rows) == SIGNS
    places = [[float(row["lon_deg"]), float(row["lat_deg"])] for row in rows]
    assert np.abs(np.array(places) - true_places(out)).max() <= 1e-9
    assert float(rows[0]["cov_ee_m2"]) == sign(1).cov_enu[0, 0]


def test_every_field_of_a_sign_is_in_the_documentation() -> None:
    page = (Path(__file__).parents[2] / "docs" / "outputs.md").read_text(encoding="utf-8")
    columns = page.split("\n## Columns of a sign\n")[1].split("\n## ")[0]
    listed = re.findall(r"^\| `(\w+)` \|", columns, re.MULTILINE)
    assert listed == [field.name for field in SIGN_FIELDS]
