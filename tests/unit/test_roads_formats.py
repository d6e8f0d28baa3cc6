"""Places on roads in every format, of a run and a merged map, read by somebody else's readers."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import openpyxl
import pyarrow.parquet as pq
import pyogrio
import pytest
from export_inputs import write_run

from automap.export.fields import ROAD_FIELDS
from automap.export.shapefile import short_name
from automap.io import names
from automap.io.review_json import append_action
from automap.io.signs_table import read_signs, write_signs
from automap.io.trajectory_table import read_trajectory
from automap.records import ReviewAction
from automap.signs.on_roads import road_check
from pipeline.cli.root import run_command
from pipeline.view.command import serving
from pipeline.view.snapshot import snapshot
from tests.slow_cases import others_slow

LIMIT = "regulatory--maximum-speed-limit-30--g1"
NAMES = {field.name for field in ROAD_FIELDS}
FORMS = ("geojson", "gpkg", "csv", "parquet", "kml", "kmz", "xlsx", "shapefile", "pmtiles",
         "flatgeobuf", "osm")  # fmt: skip


def beside_the_way(run: Path) -> None:
    """The signs of a run three metres to the right of its path, where it passed them."""
    track = read_trajectory(run / names.TRAJECTORY)
    signs = read_signs(run / names.SIGNS_RAW)
    for k, sign in enumerate(signs):
        row = int(np.searchsorted(track.t_ns, sign.last_seen_ns))
        yaw = track.rpy[row, 2]
        signs[k] = replace(
            sign,
            lat_rad=float(track.lat_rad[row] - 3.0 * np.sin(yaw) / 6.37e6),
            lon_rad=float(
                track.lon_rad[row] + 3.0 * np.cos(yaw) / 6.38e6 / np.cos(track.lat_rad[row])
            ),
            facing_rad=float(yaw + np.pi),
            class_name=LIMIT if k == 0 else sign.class_name,
        )
    write_signs(run / names.SIGNS_RAW, signs)


def rows_of(path: Path) -> dict[str, dict[str, Any]]:
    """Properties of a GeoJSON file's signs by their ids."""
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    return {f["properties"]["id"]: f["properties"] for f in features}


def layer(run: Path, path: Path) -> Path:
    """The way of a drive as a motorway of several parts, digitised against the drive."""
    track = pq.read_table(run / names.TRAJECTORY, columns=["lon_deg", "lat_deg"]).to_pydict()
    line = [list(place) for place in zip(track["lon_deg"], track["lat_deg"], strict=True)][::-5]
    road = {
        "type": "Feature",
        "properties": {"road_id": "A 7", "name": "=Main", "highway": "motorway", "oneway": "-1"},
        "geometry": {"type": "LineString", "coordinates": line},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [road]}))
    return path


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A run, a merged map, and the layer of their roads; all formats of both with roads."""
    root = tmp_path_factory.mktemp("roads")
    runs = [write_run(root / name, name=name) for name in ("monday", "tuesday")]
    for run in runs:
        beside_the_way(run)
    roads = layer(runs[0], root / "roads.geojson")
    merge = ["merge", *map(str, runs), "-o", str(root / "map"), "--roads", str(roads), "--quiet"]
    assert run_command(merge) == 0
    for form in FORMS:
        for out in (runs[0], root / "map"):
            path = out / f"roads.{form}"
            export = ["export", str(out), "--format", form, "-o", str(path)]
            assert run_command([*export, "--roads", str(roads)]) == 0
    return {"run": runs[0], "map": root / "map", "roads": roads}


def told(out: Path, form: str) -> list[dict[str, Any]]:
    """Fields of the signs as a reader of the format has them."""
    path = out / f"roads.{form}"
    if form in ("gpkg", "flatgeobuf", "pmtiles", "shapefile"):
        if form == "shapefile":
            path = path.rename(path.with_suffix(".shp.zip")) if path.exists() else (
                path.with_suffix(".shp.zip")
            )  # fmt: skip
        elif form != "gpkg":
            target = path.with_suffix(".fgb" if form == "flatgeobuf" else ".pmtiles")
            path = path.rename(target) if path.exists() else target
        layer_name = None if form in ("shapefile", "flatgeobuf") else "signs"
        meta, _, _, columns = pyogrio.raw.read(path, layer=layer_name)
        back = {short_name(name): name for name in NAMES} if form == "shapefile" else {}
        fields = [back.get(name, name) for name in meta["fields"]]
        return [dict(zip(fields, row, strict=True)) for row in zip(*columns, strict=True)]
    if form == "geojson":
        return [f["properties"] for f in json.loads(path.read_text())["features"]]
    if form == "parquet":
        return pq.read_table(path).to_pylist()
    if form == "csv":
        return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"), newline="")))
    if form == "xlsx":
        rows = list(openpyxl.load_workbook(path)["signs"].iter_rows(values_only=True))
        return [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]
    content = zipfile.ZipFile(path).read("doc.kml") if form == "kmz" else path.read_bytes()
    place = "{http://www.opengis.net/kml/2.2}"
    marks = ElementTree.fromstring(content).iter(f"{place}Placemark")
    # a KMZ has plain fields, which GDAL reads
    found = [
        {d.get("name"): d.text for d in m.iter(f"{place}SimpleData")}
        | {d.get("name"): d.findtext(f"{place}value") for d in m.iter(f"{place}Data")}
        for m in marks
    ]
    return [row for row in found if "class" in row]


@pytest.mark.parametrize("form", [form for form in FORMS if form != "osm"])
@pytest.mark.parametrize("kind", others_slow(["run", "map"]))
def test_every_format_has_a_signs_place_on_its_road(
    maps: dict[str, Path], kind: str, form: str
) -> None:
    expected = rows_of(maps[kind] / "roads.geojson")
    rows = {str(row["id"]): row for row in told(maps[kind], form)}
    assert set(rows) == set(expected)
    placed = 0
    for name, own in expected.items():
        row = rows[name]
        assert set(row) >= NAMES or form in ("kml", "kmz")
        for field in ROAD_FIELDS:
            value, right = row.get(field.name), own[field.name]
            if right is None:
                assert value in (None, "") or value != value
            elif field.kind == "real":
                assert float(value) == pytest.approx(right, abs=0.006)
            else:
                assert str(value).removeprefix("'") == right
        placed += own["road_id"] == "A 7"
    assert placed >= 10


@pytest.mark.parametrize("kind", ["run", "map"])
def test_places_are_right_and_a_limit_of_30_on_a_motorway_is_told_not_dropped(
    maps: dict[str, Path], kind: str
) -> None:
    rows = told(maps[kind], "geojson")
    for row in rows:
        assert row["road_side"] == ("left" if row["side"] == "right" else "right")
        assert row["road_name"] == "=Main"
        assert row["chainage_m"] > 0.0
    odd = [row for row in rows if row["road_check"]]
    assert {row["class"] for row in odd} == {LIMIT, "speed-limit-50"}
    told_odd = {row["road_check"] for row in odd if row["class"] == LIMIT}
    assert told_odd == {"a limit of 30 km/h on a motorway"}
    assert "a limit of 30 km/h on a motorway" in (maps[kind] / "roads.osm").read_text()


def test_the_merge_says_so_where_people_look(maps: dict[str, Path]) -> None:
    sentence = "unlikely on their roads"
    for name in (names.RUN, names.MERGE):
        warnings = json.loads((maps["map"] / name).read_text())["warnings"]
        assert any(sentence in text for text in warnings), name
    page = (maps["map"] / names.REPORT).read_text(encoding="utf-8")
    assert sentence in page
    assert "road_check" in page
    features = json.loads((maps["map"] / names.SIGNS_GEOJSON).read_text())["features"]
    assert {f["properties"]["road_id"] for f in features} == {"A 7"}


def test_without_a_layer_nothing_is_said_of_roads(maps: dict[str, Path], tmp_path: Path) -> None:
    for form in ("geojson", "csv", "kml", "osm"):
        path = tmp_path / f"plain.{form}"
        assert run_command(["export", str(maps["run"]), "--format", form, "-o", str(path)]) == 0
        text = path.read_text(encoding="utf-8")
        # path_offset_m is of no road
        assert not [name for name in NAMES if re.search(rf"\b{name}\b", text)], form
    path = tmp_path / "plain.gpkg"
    assert run_command(["export", str(maps["run"]), "--format", "gpkg", "-o", str(path)]) == 0
    assert not NAMES & set(pyogrio.read_info(path, layer="signs")["fields"])


def test_a_sign_that_a_reviewer_moved_has_no_place_until_the_next_export(
    maps: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = maps["map"]
    own = next(
        f
        for f in json.loads((out / names.SIGNS_GEOJSON).read_text())["features"]
        if f["properties"]["class"] == LIMIT
    )
    lon, lat = own["geometry"]["coordinates"][:2]
    move = ReviewAction(
        "a1", "2026-11-23T10:00:00Z", own["properties"]["id"], "correct", LIMIT, lon, lat,
        lon_deg=lon + 3e-5, lat_deg=lat, sd_m=0.5,
    )  # fmt: skip
    append_action(out / names.REVIEW, move)
    try:
        path = tmp_path / "moved.geojson"
        export = ["export", str(out), "--format", "geojson", "-o", str(path)]
        assert run_command(export) == 0
        assert "1 signs were moved since" in capsys.readouterr().err
        rows = rows_of(path)
        assert rows[own["properties"]["id"]]["road_id"] is None
        assert run_command([*export, "--roads", str(maps["roads"])]) == 0
        rows = rows_of(path)
        again = rows[own["properties"]["id"]]
        assert again["road_id"] == "A 7"
        assert again["offset_m"] != own["properties"]["offset_m"]
    finally:
        (out / names.REVIEW).unlink()


def test_a_layer_that_cannot_be_read(maps: dict[str, Path], tmp_path: Path) -> None:
    bad = str(tmp_path / "none.gpkg")
    assert run_command(["export", str(maps["run"]), "--format", "csv", "--roads", bad]) == 3


@pytest.mark.parametrize(
    ("class_name", "kind", "country", "odd"),
    [
        (LIMIT, "motorway", "DE", True),
        (LIMIT, "motorway_link", "DE", False),
        (LIMIT, "residential", "DE", False),
        ("regulatory--maximum-speed-limit-50--g1", "motorway", "GB", False),
        ("regulatory--maximum-speed-limit-60--g1", "motorway", "DE", False),
        ("regulatory--end-of-maximum-speed-limit-40--au", "motorway", "AU", False),
        ("regulatory--maximum-speed-limit-100--g1", "residential", "DE", True),
        ("regulatory--maximum-speed-limit-70--g1", "residential", "DE", False),
        ("regulatory--stop--g1", "motorway", None, True),
        ("regulatory--stop--g1", "primary", None, False),
        ("warning--pedestrians-crossing--g4", "Motorway", None, True),
        ("warning--railroad-crossing-with-barriers--g2", "motorway", None, True),
        ("warning--children--g2", "motorway", None, True),
        ("regulatory--no-pedestrians--g2", "motorway", None, False),
        ("warning--wild-animals--g1", "motorway", None, False),
        ("regulatory--no-stopping--g1", "motorway", None, False),
        (LIMIT, "", "DE", False),
    ],
)
def test_what_cannot_be_on_a_road(
    class_name: str, kind: str, country: str | None, odd: bool
) -> None:
    assert bool(road_check(class_name, kind, country)) == odd


def test_the_viewer_tells_a_signs_road(maps: dict[str, Path]) -> None:
    with serving(maps["map"]) as server:
        page = server.shown
        fields = {f["name"] for f in page.overview()["fields"]}
        assert fields >= NAMES
        shown = rows_of(maps["map"] / names.SIGNS_GEOJSON)
        now = snapshot(page.table, [])
        told = [page.sign(row, now) for row in range(len(page.table))]
    seen = 0
    for one in told:
        assert one is not None
        expected = {k: v for k, v in shown[one["id"]].items() if k in NAMES and v is not None}
        assert {k: v for k, v in one["values"].items() if k in NAMES} == expected
        seen += "chainage_m" in expected
    assert seen > 2
    first = told[0]
    assert first is not None
    at = first["class"], first["lon_deg"], first["lat_deg"]
    action = ReviewAction("1", "2026-01-01T00:00:00Z", first["id"], "correct", *at)
    action = replace(action, lon_deg=at[1] + 1e-4, lat_deg=at[2], sd_m=1.0)
    after = page.sign(0, snapshot(page.table, [action]))
    assert after is not None
    assert not NAMES & set(after["values"])
