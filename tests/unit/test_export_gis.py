"""GeoPackage, GeoParquet, FlatGeobuf and CSV."""

from __future__ import annotations

import csv
import io
import json
import re
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as Xml

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from export_inputs import CLOCK, HOSTILE, sign, trajectory

from automap.errors import StageError
from automap.export import geoparquet, gis, layers
from automap.export.dictionary import LAYERS
from automap.export.fields import SIGN_FIELDS
from automap.export.geopackage import complete_geopackage, lost_of
from automap.export.path import simplified_path
from automap.export.qgis_style import sign_style
from automap.export.sign_columns import sign_columns
from automap.export.sld import sign_sld

NAN = float("nan")


def columns(clock: bool = True):  # type: ignore[no-untyped-def]
    signs = [sign(i) for i in range(1, 6)]
    signs.append(sign(6, class_name=HOSTILE, size_m=NAN, height_m=NAN))
    signs.append(sign(7, lat_rad=NAN))
    return sign_columns(signs, CLOCK if clock else None)


def test_geoparquet_metadata_and_values(tmp_path: Path) -> None:
    import shapely

    path = tmp_path / "signs.parquet"
    geoparquet.write_geoparquet(path, columns())
    table = pq.read_table(path)
    geo = json.loads(table.schema.metadata[b"geo"])
    assert geo["version"] == "1.1.0"
    geometry = geo["columns"][geo["primary_column"]]
    assert geometry["encoding"] == "WKB"
    assert geometry["geometry_types"] == ["Point", "Point Z"]
    assert geometry["crs"]["id"] == {"authority": "OGC", "code": "CRS84h"}
    assert geometry["covering"]["bbox"]["xmin"] == ["bbox", "xmin"]
    points = shapely.from_wkb(table.column("geometry").to_numpy(zero_copy_only=False))
    assert points[6] is None
    assert shapely.get_z(points[0]) == sign(1).height_m
    assert points[0].x == pytest.approx(np.degrees(sign(1).lon_rad), abs=1e-12)
    box = table.column("bbox")[0].as_py()
    assert (box["xmin"], box["ymax"]) == (points[0].x, points[0].y)
    assert [name for name in table.column_names if name in {f.name for f in SIGN_FIELDS}] == [
        f.name for f in SIGN_FIELDS
    ]
    assert table.column("class")[5].as_py() == HOSTILE
    assert table.column("size_m")[5].as_py() is None
    assert table.schema.field("ce95_m").metadata[b"unit"] == b"m"
    assert table.column("first_seen")[0].as_py().isoformat() == "2026-03-14T01:20:07+00:00"


def test_geopandas_reads_the_geoparquet(tmp_path: Path) -> None:
    geopandas = pytest.importorskip("geopandas")
    path = tmp_path / "signs.parquet"
    geoparquet.write_geoparquet(path, columns())
    frame = geopandas.read_parquet(path)
    assert len(frame) == 7
    west = np.degrees(sign(1).lon_rad)
    near = geopandas.read_parquet(path, bbox=(west - 1e-6, 40, west + 1e-6, 60))
    assert "s0001" in list(near["id"])


def test_geopackage_layers(tmp_path: Path) -> None:
    from pyogrio import list_layers, read_info
    from pyogrio.raw import read

    full = trajectory()
    stamps = np.array([full.t_ns[50], full.t_ns[500], full.t_ns[-1] + 10**12])
    observations = pa.table(
        {
            "t_ns": stamps,
            "class": ["a", None, HOSTILE],
            "sign_id": ["s0001", None, "s0002"],
            "residual_px": [0.5, None, 1.0],
            "track": pa.array([1, None, 3]),
            "used": [True, False, True],
        }
    )
    path = tmp_path / "map.gpkg"
    gis.write_layers(
        path,
        [
            layers.sign_layer(columns()),
            layers.observation_layer(observations, {"": full}, CLOCK),
            layers.path_layer(simplified_path(full)),
            layers.ellipse_layer(columns()),
        ],
    )
    assert [name for name, _ in list_layers(path)] == [
        "signs",
        "observations",
        "trajectory",
        "ellipses",
    ]
    info = read_info(path, layer="signs")
    assert info["crs"] == "EPSG:4979"
    assert info["features"] == 7
    assert list(info["fields"][: len(SIGN_FIELDS)]) == [f.name for f in SIGN_FIELDS]
    meta, _, geometry, fields = read(path, layer="observations")
    values = dict(zip(meta["fields"], fields, strict=True))
    assert [g is None for g in geometry] == [False, False, True]
    assert values["t_ns"].tolist() == stamps.tolist()
    assert values["class"].tolist() == ["a", None, HOSTILE]
    assert values["used"].tolist() == [True, False, True]


def test_times_are_null_without_a_clock(tmp_path: Path) -> None:
    path = tmp_path / "signs.parquet"
    geoparquet.write_geoparquet(path, columns(clock=False))
    table = pq.read_table(path)
    assert table.column("first_seen").null_count == 7
    assert table.column("first_seen_t_ns")[0].as_py() == sign(1).first_seen_ns


def test_empty_map_in_every_format(tmp_path: Path) -> None:
    from pyogrio import read_info

    empty = sign_columns([])
    geoparquet.write_geoparquet(tmp_path / "a.parquet", empty)
    gis.write_layers(tmp_path / "a.gpkg", [layers.sign_layer(empty), layers.ellipse_layer(empty)])
    assert read_info(tmp_path / "a.gpkg", layer="ellipses")["features"] == 0
    assert pq.read_table(tmp_path / "a.parquet").num_rows == 0


def test_flatgeobuf_and_csv(tmp_path: Path) -> None:
    from pyogrio import read_info

    gis.write_layers(tmp_path / "a.fgb", [layers.sign_layer(columns())], driver="FlatGeobuf")
    assert read_info(tmp_path / "a.fgb")["driver"] == "FlatGeobuf"
    rows = list(csv.DictReader(io.StringIO(gis.signs_csv(columns()), newline="")))
    assert len(rows) == 7
    assert rows[5]["class"] == HOSTILE
    assert rows[5]["height_m"] == rows[5]["size_m"] == rows[6]["lat_deg"] == ""
    assert float(rows[0]["lat_deg"]) == pytest.approx(np.degrees(sign(1).lat_rad), abs=1e-9)


def test_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "map.gpkg"
    target.write_text("old")
    with pytest.raises(StageError, match=r"map\.gpkg"):
        gis.write_layers(target, [layers.sign_layer(columns())], driver="NoSuchDriver")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = SimpleNamespace(total=1 << 30, used=1 << 30, free=4096)
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage)
    with pytest.raises(StageError, match="the disk is full"):
        # a failure of GDAL's of whatever kind
        gis.write_layers(tmp_path / "a.gpkg", [layers.sign_layer(columns())], driver="NoSuchDriver")
    assert list(tmp_path.iterdir()) == []


def test_a_geopackage_that_lost_features_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.gpkg"
    gis.write_layers(path, [layers.sign_layer(columns())])
    count = len(layers.sign_layer(columns()))
    assert count > 0
    assert lost_of(path, {"signs": count}) == ""
    lost = f"the layer signs has {count} of {count + 1} features"
    assert lost_of(path, {"signs": count + 1}) == lost
    assert "no such table" in lost_of(path, {"ellipses": 1})
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("UPDATE gpkg_ogr_contents SET feature_count = 0")
    assert lost_of(path, {"signs": count}) == (
        f"the layer signs does not say that it has {count} features"
    )
    with closing(sqlite3.connect(path)) as file:
        file.execute("PRAGMA application_id = 0")
    assert "header" in lost_of(path, {"signs": count})
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert "damaged" in lost_of(path, {"signs": count})


def test_a_geopackage_whose_layer_lacks_what_others_have_is_not_whole(tmp_path: Path) -> None:
    """SQLite gets over one call that fails, and GDAL does not tell of it."""
    path, layer = tmp_path / "a.gpkg", layers.sign_layer(columns())
    gis.write_layers(path, [layer, replace(layer, name="more")])
    counts = {"signs": len(layer.wkb), "more": len(layer.wkb)}
    assert lost_of(path, counts) == ""
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("DROP TRIGGER trigger_insert_feature_count_more")
    lacking = "the layer more lacks trigger_insert_feature_count_*"
    assert lost_of(path, counts) == lacking


def test_a_geopackage_that_gdal_has_not_written_whole_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forgets(path: Path, *_: object) -> None:
        with closing(sqlite3.connect(path)) as file, file:
            file.execute("DELETE FROM signs WHERE fid = 1")

    monkeypatch.setattr(gis, "complete_geopackage", forgets)
    with pytest.raises(StageError, match="could not be written whole: the layer signs has"):
        gis.write_layers(tmp_path / "a.gpkg", [layers.sign_layer(columns())])
    assert not list(tmp_path.iterdir())


def test_a_geopackage_that_sqlite_cannot_finish_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "map.gpkg").mkdir()
    with pytest.raises(StageError, match=r"cannot write .*map\.gpkg \(unable to open"):
        complete_geopackage(tmp_path / "map.gpkg", [], [])


def test_every_layer_calls_its_columns_by_words_that_tell_them_apart() -> None:
    for layer, _, fields in LAYERS:
        titles = [field.title for field in fields]
        assert len(set(titles)) == len(titles), layer
        short = [t for t in titles if re.search(r"_|\b(sd|cov|ce95|msl|n)\b", t)]
        assert short == [], layer


def test_an_arrow_of_qgis_points_one_way_only() -> None:
    style = sign_style({"a--stop--g1": b"png"}, {"a--stop--g1": "#112233"})
    _, turned, *_ = Xml.fromstring(style.qml.partition("\n")[2]).iter("layer")
    shape = {o.get("name"): o.get("value") for o in turned.findall("Option/Option")}["name"]
    # an equilateral triangle looks the same after a third of a turn
    assert (turned.get("class"), shape) == ("SimpleMarker", "arrow")


def test_an_arrow_of_other_programs_begins_at_the_sign_and_turns_with_its_face() -> None:
    root = Xml.fromstring(sign_sld({"a--stop--g1": "#112233"}, {"a--stop--g1": "stop"}))
    spaces = {"s": "http://www.opengis.net/sld", "ogc": "http://www.opengis.net/ogc"}
    arrow = next(t for t in root.iterfind(".//s:TextSymbolizer", spaces) if t[0].text)
    # in the order of the schema, which has no place for a mark that points
    assert [part.tag.rpartition("}")[2] for part in arrow] == [
        "Label", "Font", "LabelPlacement", "Fill",
    ]  # fmt: skip
    assert arrow[0].text == "\N{UPWARDS ARROW}"
    anchor = arrow.find(".//s:AnchorPoint", spaces)
    assert anchor is not None
    assert [part.text for part in anchor] == ["0.5", "0"]
    assert arrow.findtext(".//s:Rotation/ogc:PropertyName", "", spaces) == "facing_deg"
    marks = {mark.text for mark in root.iterfind(".//s:WellKnownName", spaces)}
    assert marks == {"circle"}
