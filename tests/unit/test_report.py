"""report.html: complete, offline, safe, and there whatever is missing."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from export_inputs import CLOCK, HOSTILE, fixes, sign, trajectory, write_run
from lxml import html

from automap.effects.catalogue import CATALOGUE
from automap.export.sign_columns import sign_columns
from automap.export.uncertainty import sigma_classes
from automap.io import names
from automap.io.signs_table import write_signs
from pipeline.pages.render import embedded_json
from pipeline.report.figures import distance_m, duration_text, metres_text
from pipeline.report.map_data import map_data
from pipeline.report.outages import outages
from pipeline.report.render import report_html, sign_list
from pipeline.report.sections import _unit_of
from pipeline.run.stage import StageContext
from pipeline.run.stages.report import STAGE
from pipeline.settings.report import ReportSettings
from pipeline.shared.products import RunProducts, load_products


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "out")


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


def run_stage(out: Path, name: str = "demo") -> tuple[str, StageContext]:
    work = out / "report.tmp"
    work.mkdir()
    manifest = SimpleNamespace(site=SimpleNamespace(background=""))
    drive: Any = SimpleNamespace(name=name, manifest=manifest)
    settings: Any = SimpleNamespace(report=ReportSettings())
    context = StageContext(drive=drive, out=out, work=work, settings=settings)
    STAGE.run(context)
    assert [p.name for p in work.iterdir()] == [names.REPORT]
    return (work / names.REPORT).read_text(encoding="utf-8"), context


def embedded(page: str) -> Any:
    (text,) = html.fromstring(page).xpath('//script[@id="map-data"]/text()')
    return json.loads(text)


def own_parts(page: str) -> str:
    """The page without the vendored library."""
    return re.sub(r"<script>/\* @preserve.*?</script>", "", page, flags=re.DOTALL)


def test_whole_run_shows_every_section(out: Path) -> None:
    page, context = run_stage(out)
    tree = html.fromstring(page)
    assert context.warnings == []
    assert tree.xpath("//h1/text()") == ["demo"]
    assert len(tree.xpath('//section[@class="figures"]/div')) == 5
    assert not [
        p.text for p in tree.xpath('//p[@class="absent"]') if p.getparent().tag != "noscript"
    ]
    assert len(tree.xpath("//figure/svg")) >= 14
    text = tree.text_content()
    for words in (
        "lever arm is not measured",
        "Verdict: path doubtful",
        "The sigmas of <east> are too small.",
        "GPS position north",
        "never ran",
        "pixel_sd",
        "Constant gyro offset",
    ):
        assert words in text, words
    assert len(tree.xpath('//table[@id="sign-table"]/tbody/tr')) == 12


def test_map_and_table_tell_classes_apart_that_are_said_alike(out: Path) -> None:
    page, _ = run_stage(out)
    classes = {
        row[[f["name"] for f in embedded(page)["fields"]].index("class")]
        for row in embedded(page)["signs"]["rows"]
    }
    assert set(embedded(page)["words"]) == classes


@pytest.mark.parametrize(("country", "code"), [("AU", "AU:R1-1"), ("FR", "VIENNA:B2"), (None, "")])
def test_the_list_of_signs_has_their_codes_where_there_are_any(
    country: str | None, code: str
) -> None:
    stop = replace(sign(1), class_name="regulatory--stop--g1", confidence=0.9999)
    table = sign_list(sign_columns([stop], country=country))
    row = dict(zip([label for label, _ in table["heads"]], table["rows"][0], strict=True))
    assert row.get("code", "") == code
    assert ("code" in row) == bool(code)
    # and nothing is certain
    assert row["confidence"] == "over 0.99"


@pytest.mark.parametrize(
    ("delay", "title"),
    [("0.12", "Delay from epoch to arrival"), ("null", "Arrival later than the earliest")],
)
def test_the_plot_of_arrivals_says_what_they_are_late_by(out: Path, delay: str, title: str) -> None:
    """Without the receiver's own delay arrivals tell how much later than the earliest they are."""
    clock = json.loads((out / names.SYNC).read_text())
    (out / names.SYNC).write_text(json.dumps(clock | {"output_delay_s": json.loads(delay)}))
    page, _ = run_stage(out)
    (told,) = [
        text
        for text in html.fromstring(page).xpath("//figcaption//text()")
        if "highest 2 %" in text
    ]
    assert told.strip() == f"{title} (highest 2 % cut off)"


def test_nothing_is_requested_from_the_network(out: Path) -> None:
    page, _ = run_stage(out)
    tree = html.fromstring(page)
    (policy,) = tree.xpath('//meta[@http-equiv="Content-Security-Policy"]/@content')
    assert policy.startswith("default-src 'none'")
    links = tree.xpath("//@src | //@href | //@action | //@data | //@srcset | //@poster")
    assert [link for link in links if not link.startswith("#")] == []
    assert tree.xpath("//link | //iframe | //object | //embed | //base") == []
    assert "url(" not in page.replace("url(#", "")
    assert "@import" not in page
    # the name of SVG's namespace is no address
    own = own_parts(page).replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    assert "http" not in own
    assert "sourceMappingURL" not in page


@pytest.mark.parametrize("missing", [name for name in STAGE.needs if name != names.OBSERVATIONS])
def test_any_input_may_be_missing_or_damaged(out: Path, missing: str) -> None:
    (out / missing).unlink(missing_ok=True)
    page, context = run_stage(out)
    # without its record nobody can say what else a run wrote
    assert len(context.warnings) == (missing == names.RUN)
    assert len(html.fromstring(page).xpath("//section[@id]")) >= 9
    shutil.rmtree(out / "report.tmp")
    (out / missing).parent.mkdir(exist_ok=True)
    (out / missing).write_bytes(b"{broken\n1")
    page, context = run_stage(out)
    assert any(missing in text for text in context.warnings)
    assert missing in html.fromstring(page).text_content()


def test_empty_folder_still_gives_a_page_that_says_so(tmp_path: Path) -> None:
    page, _ = run_stage(tmp_path)
    text = html.fromstring(page).text_content()
    for words in ("neither a path nor a sign", "No signs were located", "no trajectory"):
        assert words in text
    assert "map-data" not in own_parts(page).replace('getElementById("map-data")', "")


def test_hostile_text_appears_as_text_only(out: Path) -> None:
    bad = [
        sign(
            i, id=f"{HOSTILE}{i}", class_name=name, side=HOSTILE, status=HOSTILE, drives=(HOSTILE,)
        )
        for i, name in enumerate((HOSTILE, "__proto__", "constructor", "{{ 7*7 }}"))
    ]
    write_signs(out / names.SIGNS_RAW, bad)
    record = json.loads((out / names.RUN).read_text())
    record["warnings"] = [HOSTILE]
    record["settings"] = {HOSTILE: {HOSTILE: [HOSTILE]}}
    record["stages"] = {HOSTILE: {"status": HOSTILE, "reason": HOSTILE, "result": HOSTILE}}
    record["command"] = HOSTILE
    (out / names.RUN).write_text(json.dumps(record))
    page, _ = run_stage(out, HOSTILE)
    tree = html.fromstring(page.replace("\x07", "\ufffd"))
    assert tree.xpath("//img") == []
    assert len(tree.xpath("//script")) == 3
    assert not [e for e in tree.iter() if any(a.startswith("on") for a in e.attrib)]
    assert tree.xpath("//h1/text()") == [HOSTILE.replace("\x07", "\ufffd")]
    assert "{{ 7*7 }}" in tree.text_content()
    assert HOSTILE in embedded(page)["signs"]["colours"]


@pytest.mark.parametrize("value", [HOSTILE, "\u2028\u2029", "<!--<script>", {"a": ["]]>"]}])
def test_embedded_json_cannot_leave_its_script(value: object) -> None:
    text = embedded_json(value)
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == value


def test_map_positions_are_true_metres(out: Path) -> None:
    page, _ = run_stage(out)
    content = embedded(page)
    products = load_products(out)
    assert products.trajectory is not None
    path = np.array(content["path"]["points"])
    length = np.hypot(*np.diff(path, axis=0).T).sum()
    assert length == pytest.approx(distance_m(products.trajectory), rel=0.005)
    lon0, lat0 = content["origin"]
    from pymap3d import geodetic2enu

    first = sign(1)
    east, north, _ = geodetic2enu(
        np.degrees(first.lat_rad), np.degrees(first.lon_rad), 0, lat0, lon0, 0
    )
    # the page's plane bends away from the tangent plane by centimetres over a kilometre
    assert content["signs"]["xy"][0] == pytest.approx([east, north], abs=0.2)
    assert content["path"]["outages"], "the hole in the fixes is drawn"


def test_map_is_in_one_piece_over_the_date_line(tmp_path: Path) -> None:
    near = [sign(i, lon_rad=np.radians(lon)) for i, lon in enumerate((179.999, -179.999), 1)]
    content = map_data(RunProducts(tmp_path), sign_columns(near, CLOCK))
    assert content is not None
    (x0, _), (x1, _) = content["signs"]["xy"]
    assert abs(x1 - x0) == pytest.approx(0.002 * 111_320 * np.cos(np.radians(48.97)), rel=0.01)


def test_sigma_classes() -> None:
    classes, labels = sigma_classes(np.array([0.5, 1.0, 2.0, 4.0, np.nan]))
    assert classes[-1] == -1
    assert (np.diff(classes[:-1]) >= 0).all()
    assert len(labels) > max(classes)
    same, one = sigma_classes(np.full(5, 1.2))
    assert same.tolist() == [0] * 5
    assert one == ["about 1.2 m"]
    assert sigma_classes(np.full(3, np.nan))[1] == []


def test_outages_and_figures() -> None:
    path = trajectory()
    (hole,) = outages(fixes(path))
    assert hole[1] - hole[0] == pytest.approx(12.0, abs=0.01)
    assert distance_m(path) == pytest.approx(12.0 * 120, rel=0.01)
    assert [duration_text(s) for s in (12.3, 61.0, 3725.0)] == ["12 s", "1 min 01 s", "1 h 02 min"]
    assert [metres_text(v) for v in (0.012, 0.5, 12.4, 2341.0)] == [
        "1.2 cm",
        "0.50 m",
        "12 m",
        "2.34 km",
    ]


def test_numbers_without_a_meaning_do_not_stop_the_page(out: Path) -> None:
    nan = float("nan")
    empty = np.full((3, 3), nan)
    write_signs(
        out / names.SIGNS_RAW, [sign(1, cov_enu=empty, facing_rad=nan), sign(2, lat_rad=nan)]
    )
    (out / names.RUN).write_text(json.dumps({"stages": [1], "warnings": "x", "settings": None}))
    page, _ = run_stage(out)
    content = embedded(page)
    assert len(content["signs"]["rows"]) == 1
    assert content["signs"]["ellipse"][0] == [None]


def test_a_folder_name_that_is_no_utf8(out: Path) -> None:
    page, _ = run_stage(out, "caf\udce9")
    assert html.fromstring(page).xpath("//h1/text()") == ["caf?"]


def test_report_of_a_run_is_the_same_twice(out: Path) -> None:
    products = load_products(out)
    record = products.json(names.RUN)
    assert report_html(products, "a", record) == report_html(load_products(out), "a", record)


def test_errors_that_wander_have_a_unit() -> None:
    units = {
        name: _unit_of(CATALOGUE[name], ("n", "e", "d"))
        for name in ("gnss_correlated_noise", "gnss_velocity_wander")
    }
    # of the one the state counts what the receiver states of its positions
    assert units == {"gnss_correlated_noise": "stated σ", "gnss_velocity_wander": "m/s"}
    assert _unit_of(CATALOGUE["accel_bias"], ("x", "y", "z")) == "m/s^2"


def test_warnings_name_files_and_no_folder_however_the_drive_was_given(out: Path) -> None:
    record = json.loads((out / names.RUN).read_text())
    record["drive"] = {"name": "monday", "path": "/home/anna/drives/monday"}
    given = ("/home/anna/drives/monday", "drives/monday", "../drives/monday", "monday")
    record["warnings"] = [f"{folder}/gnss.ubx: 5 of 9 epochs (see monday)" for folder in given]
    (out / names.RUN).write_text(json.dumps(record))
    told = html.fromstring(run_stage(out)[0]).xpath('//section[@class="warnings"]//li/text()')
    assert "gnss.ubx: 5 of 9 epochs (see monday)" in told
    assert not [text for text in told if "drives" in text]
