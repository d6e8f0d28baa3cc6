"""Text of a recording that means harm: it appears as text in every format, and nowhere else."""

from __future__ import annotations

import csv
import json
import zipfile
from pathlib import Path

import pytest
from export_inputs import sign, write_run
from lxml import etree, html

from automap.export.csv_text import csv_cell
from automap.io import names
from automap.io.signs_table import write_signs
from pipeline.export.command import export_run
from pipeline.export.formats import FORMATS
from pipeline.report.render import report_html
from pipeline.shared.products import load_products

TEXTS = (
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>'",
    "=cmd|' /C calc'!A0",
    "+1+1",
    "-2+3",
    "@SUM(A1)",
    "\tTAB",
    "../../../etc/passwd",
    "]]><b>",
    "$[id]",
    "%s{{7*7}}${x}",
    "'; DROP TABLE signs; --",
    "line\nbreak",
    "\u202eabc",
    "NUL\x00BEL\x07",
    "\udce9",
    "__proto__",
)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "out"
    write_run(folder, name=TEXTS[0])
    bad = [
        sign(i, id=f"{text}{i}" if i % 2 else f"{i}{text}", class_name=text, side=text,
             status=text, drives=(text, text))
        for i, text in enumerate(TEXTS[:-2] + TEXTS[-1:], start=1)
    ]  # fmt: skip
    write_signs(folder / names.SIGNS_RAW, bad)
    for fmt in FORMATS:
        export_run(folder, fmt)
    return folder


def classes() -> list[str]:
    return [*TEXTS[:-2], TEXTS[-1]]


def visible(text: str) -> str:
    """A text as formats that forbid control characters have it."""
    return "".join(c if c in "\t\n\r" or ord(c) >= 32 else "\ufffd" for c in text)


def test_nothing_is_written_outside(out: Path) -> None:
    assert {p.name for p in out.parent.iterdir()} == {"out"}
    assert not [p for p in out.rglob("*") if ".." in p.name or "\n" in p.name]


def test_json_has_the_texts(out: Path) -> None:
    features = json.loads((out / names.SIGNS_GEOJSON).read_text())["features"]
    assert [f["properties"]["class"] for f in features] == classes()
    assert features[0]["properties"]["drives"] == ", ".join([TEXTS[0]] * 2)


def test_geopackage_flatgeobuf_and_parquet_have_the_texts(out: Path) -> None:
    import pyarrow.parquet as pq
    from pyogrio.raw import read

    for file in (names.GPKG, "signs.fgb"):
        meta, _, _, fields = read(out / file, layer="signs")
        found = set(dict(zip(meta["fields"], fields, strict=True))["class"].tolist())
        assert found == {text.replace("\0", "\ufffd") for text in classes()}, file
    table = pq.read_table(out / names.SIGNS_TABLE)
    assert table.column("class").to_pylist() == classes()


def test_no_cell_of_a_spreadsheet_is_a_formula(out: Path) -> None:
    rows = list(csv.DictReader((out / "signs.csv").open(newline="", encoding="utf-8")))
    assert len(rows) == len(classes())
    for row, text in zip(rows, classes(), strict=True):
        for column in ("id", "class", "side", "status", "drives"):
            assert not row[column].startswith(("=", "+", "-", "@", "\t", "\r"))
        assert csv_cell(row["class"], back=True) == text


def documents(out: Path) -> list[bytes]:
    with zipfile.ZipFile(out / names.KMZ) as archive:
        assert not [name for name in archive.namelist() if ".." in name or name.startswith("/")]
        return [(out / names.KML).read_bytes(), archive.read("doc.kml")]


def test_balloons_show_the_texts_and_hold_no_markup_of_theirs(out: Path) -> None:
    kml = "{http://www.opengis.net/kml/2.2}"
    for document in documents(out):
        root = etree.fromstring(document)
        assert root.findtext(f".//{kml}name") == TEXTS[0]
        names_shown = [p.findtext(f"{kml}name") for p in root.iter(f"{kml}Placemark")]
        assert visible(f"{TEXTS[0]}1") in names_shown
        for balloon in root.iter(f"{kml}description"):
            assert "$[" not in balloon.text
            tree = html.fragment_fromstring(balloon.text, create_parent="div")
            assert {e.tag for e in tree.iter()} <= {"div", "h3", "table", "tr", "td", "tbody"}
        # typed in map.kml, plain in map.kmz
        values = [e.text for e in root.iter(f"{kml}SimpleData") if e.get("name") == "class"]
        plain = [e[0].text for e in root.iter(f"{kml}Data") if e.get("name") == "class"]
        values = values or plain
        assert values == [visible(text) for text in classes()]


def test_review_file_and_track_have_them_as_text(out: Path) -> None:
    nodes = etree.fromstring((out / "signs.osm").read_bytes()).findall("node")
    assert len(nodes) == len(classes())
    for node in nodes:
        assert {child.tag for child in node} == {"tag"}
        assert next(t.get("v") for t in node if t.get("k") == "traffic_sign") == "yes"
    gpx = etree.fromstring((out / "trajectory.gpx").read_bytes())
    types = [e.text for e in gpx.iter("{http://www.topografix.com/GPX/1/1}type")]
    assert types == [visible(text) for text in classes()]


def test_the_page_has_them_as_text(out: Path) -> None:
    products = load_products(out)
    page = report_html(products, TEXTS[0], products.json(names.RUN))
    tree = html.fromstring(visible(page))
    assert tree.xpath("//h1/text()") == [TEXTS[0]]
    assert tree.xpath("//img") == []
    assert len(tree.xpath("//script")) == 3
    shown = tree.xpath('//table[@id="sign-table"]//td/text()')
    assert TEXTS[1] in shown
