"""Workbook, Shapefile and tiles, each opened by somebody else's reader."""

from __future__ import annotations

import csv
import gzip
import io
import zipfile
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np
import openpyxl
import pyogrio
import pytest
from export_inputs import HOSTILE, sign, write_run
from pmtiles.reader import MmapSource, Reader, all_tiles

from automap.export.fields import SIGN_FIELDS
from automap.export.pictures import SignView
from automap.export.shapefile import LEGEND, LONGEST_NAME, short_name
from automap.export.tiles import MOST_ZOOM
from automap.io import names
from automap.io.signs_table import read_signs, write_signs
from pipeline.cli.root import run_command
from pipeline.shared.pictures import Picture, write_pictures

SIGNS = 12


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = write_run(tmp_path_factory.mktemp("run") / "out", signs=SIGNS)
    signs = read_signs(out / names.SIGNS_RAW)
    nan = float("nan")
    signs[3] = sign(4, lat_rad=nan, lon_rad=nan, height_m=nan)
    signs[4] = sign(5, class_name=HOSTILE, note="=1+1", size_m=nan)
    signs[5] = sign(6, note="ä" * 400)
    write_signs(out / names.SIGNS_RAW, signs)
    box = np.array([10.0, 10.0, 50.0, 90.0])
    view = SignView("s0002", 1, "front", 3, signs[1].last_seen_ns, box, 0.9, 9.0)
    _, jpeg = cv2.imencode(".jpg", np.full((80, 40, 3), 90, np.uint8))
    write_pictures(out, [Picture(view, jpeg.tobytes())])
    for form in ("xlsx", "shapefile", "pmtiles"):
        assert run_command(["export", str(out), "--format", form]) == 0
    return out


def test_a_workbook_has_every_column_typed_and_the_pictures_in_their_rows(run: Path) -> None:
    book = openpyxl.load_workbook(run / "signs.xlsx")
    sheet = book["signs"]
    head = [cell.value for cell in sheet[1]]
    assert head == ["picture", "lon_deg", "lat_deg", "height_m", *(f.name for f in SIGN_FIELDS)]
    assert sheet.max_row == SIGNS + 1
    second = dict(zip(head, (cell.value for cell in sheet[3]), strict=True))
    true = sign(2)
    assert second["lat_deg"] == pytest.approx(np.degrees(true.lat_rad), abs=1e-9)
    assert second["facing_sd_deg"] == pytest.approx(np.degrees(true.facing_sd_rad))
    assert isinstance(second["first_seen"], datetime)
    (picture,) = sheet._images
    assert picture.anchor._from.row == 2
    meanings = {row[0].value: row[2].value for row in book["columns"].iter_rows(min_row=2)}
    assert meanings["ce95_m"].startswith("radius")
    lineage = {row[0].value: row[1].value for row in book["map"].iter_rows()}
    assert lineage["drives"] == "demo"
    assert not [text for text in lineage.values() if text.startswith(("[", "{"))]


def test_texts_of_a_recording_are_texts_in_a_workbook(run: Path) -> None:
    sheet = openpyxl.load_workbook(run / "signs.xlsx")["signs"]
    head = [cell.value for cell in sheet[1]]
    note, size = sheet[6][head.index("note")], sheet[6][head.index("size_m")]
    assert (note.value, note.data_type) == ("=1+1", "s")
    assert size.value is None
    assert sheet[5][head.index("lat_deg")].value is None


def test_a_shapefile_keeps_all_columns_under_names_that_its_legend_explains(run: Path) -> None:
    short = [short_name(f.name) for f in SIGN_FIELDS]
    assert len(set(short)) == len(short)
    assert max(map(len, short)) <= LONGEST_NAME
    path = run / "signs.shp.zip"
    meta, _, geometry, columns = pyogrio.raw.read(path)
    assert list(meta["fields"]) == short
    assert len(geometry) == SIGNS
    assert sum(wkb is None for wkb in geometry) == 1
    values = dict(zip(short, columns, strict=True))
    assert values["facing_sd"][0] == pytest.approx(np.degrees(sign(1).facing_sd_rad), rel=1e-6)
    assert values["first_seen"][0].endswith("Z")
    assert values["note"][5] == "ä" * 127
    with zipfile.ZipFile(path) as archive:
        legend = list(csv.DictReader(io.TextIOWrapper(archive.open(LEGEND), encoding="utf-8")))
    assert {row["column"]: row["name"] for row in legend}["facing_sd"] == "facing_sd_deg"


def test_tiles_hold_every_located_sign_and_the_path(run: Path) -> None:
    with (run / "signs.pmtiles").open("rb") as file:
        source = MmapSource(file)
        reader = Reader(source)
        layers = {layer["id"] for layer in reader.metadata()["vector_layers"]}
        assert layers == {"signs", "trajectory"}
        assert reader.header()["max_zoom"] == MOST_ZOOM
        for _, tile in all_tiles(source):
            assert len(gzip.decompress(tile)) > 0
    meta, _, _, columns = pyogrio.raw.read(run / "signs.pmtiles", layer="signs")
    ids = columns[list(meta["fields"]).index("id")]
    assert sorted(set(ids)) == sorted({f"s{k:04d}" for k in range(1, SIGNS + 1)} - {"s0004"})


def test_the_same_map_is_the_same_file(run: Path) -> None:
    for form, name in (("xlsx", "signs.xlsx"), ("shapefile", "signs.shp.zip")):
        before = (run / name).read_bytes()
        assert run_command(["export", str(run), "--format", form]) == 0
        assert (run / name).read_bytes() == before


def test_a_map_without_signs_is_empty_in_each(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=0)
    for form in ("xlsx", "shapefile", "pmtiles"):
        assert run_command(["export", str(out), "--format", form]) == 0
