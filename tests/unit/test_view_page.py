"""The viewer's page in headless Chromium: by mouse, by keyboard, in two tabs, with any text."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import backgrounds
import numpy as np
import pytest
from export_inputs import HOSTILE, sign, write_run
from PIL import Image
from view_maps import write_large_map

from automap.io import names
from automap.io.detections_table import write_detections
from automap.io.review_json import read_review
from automap.io.signs_table import write_signs
from automap.mapping.review import verdicts
from automap.records import Detections
from pipeline.cli.root import run_command
from pipeline.view.command import serving
from tests.browser import launched, violations, watched

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "data" / "sample-drive"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as running:
        yield running


def opened(browser: Browser, url: str) -> tuple[Page, list[str]]:
    """The page once its paths are loaded, and the list of its troubles."""
    page = browser.new_page(viewport={"width": 1400, "height": 860})
    troubles = watched(page)
    page.goto(url)
    page.wait_for_selector("html[data-paths]")
    return page, troubles


def until(page: Page, expression: str, argument: object = None) -> None:
    """Wait until an expression of the page is true; its policy forbids the usual way."""
    deadline = time.monotonic() + 30
    while not page.evaluate(expression, argument):
        assert time.monotonic() < deadline, expression
        page.wait_for_timeout(30)


def status(out: Path) -> dict[str, str]:
    """What the file on disk says of each sign."""
    return {name: v.status for name, v in verdicts(read_review(out / names.REVIEW)).items()}


def on_screen(page: Page, row: int) -> tuple[float, float]:
    """Where a sign stands in the window, the map having been zoomed to it."""
    x, y = page.evaluate(
        """(row) => { const map = automapMap, s = automapState.signs;
        map.centre(s.x[row], s.y[row], 20);
        const box = map.canvas.getBoundingClientRect();
        return [box.left + map.sx(s.x[row]), box.top + map.sy(s.y[row])]; }""",
        row,
    )
    return float(x), float(y)


def test_a_sign_is_clicked_judged_and_still_so_after_a_reload(
    browser: Browser, tmp_path: Path
) -> None:
    out = write_run(tmp_path / "out", signs=6)
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        assert page.locator("#tally").inner_text() == "6 signs, 0 reviewed"
        page.mouse.click(*on_screen(page, 2))
        page.wait_for_selector("#accept")
        assert "s0003" in page.locator("#card").inner_text()
        assert "ce95" in page.locator("#card").inner_text()
        page.click("#reject")
        page.wait_for_selector(".badge.rejected")
        page.mouse.click(*on_screen(page, 4))
        until(page, "document.querySelector('#card').innerText.includes('s0005')")
        page.click("#class-button")
        page.fill("#picker-search", "yield")
        page.click("#picker-list li:first-child")
        page.wait_for_selector(".badge.corrected")
        page.fill("#note", "behind a tree")
        page.click("#save-note")
        page.wait_for_selector("#history li:nth-child(2)")
        # the picker's pictures, or a reload breaks them off
        page.wait_for_load_state("networkidle")
        page.reload()
        page.wait_for_selector("html[data-paths]")
        assert page.locator("#tally").inner_text() == "6 signs, 2 reviewed"
        page.select_option("#review-filter", "corrected")
        until(page, "document.querySelector('#tally').innerText.startsWith('1 of 6')")
        page.close()
    assert status(out) == {"s0003": "rejected", "s0005": "corrected"}
    assert troubles == []
    assert run_command(["export", str(out), "--format", "geojson"]) == 0
    features = json.loads((out / names.SIGNS_GEOJSON).read_text())["features"]
    found = {f["id"]: f["properties"] for f in features}
    assert "s0003" not in found
    assert (found["s0005"]["class"], found["s0005"]["status"]) == (
        "regulatory--yield--g1",
        "corrected",
    )


def test_everything_by_keyboard(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=4)
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        press = page.keyboard.press
        press("?")
        assert page.locator("#help").is_visible()
        assert page.locator("#keys dt").count() >= 15
        press("Escape")
        press("n")
        until(page, "document.querySelector('#card').innerText.includes('s0001')")
        press("a")
        page.wait_for_selector(".badge.accepted")
        press("z")
        until(page, "!document.querySelector('.badge')")
        press("x")
        page.wait_for_selector(".badge.rejected")
        press("u")
        until(page, "document.querySelector('#card').innerText.includes('s0002')")
        press("c")
        page.keyboard.type("no entry")
        press("Enter")
        page.wait_for_selector(".badge.corrected")
        press("n")
        until(page, "document.querySelector('#card').innerText.includes('s0003')")
        press("m")
        for key in ("Shift+ArrowRight", "Shift+ArrowRight", "ArrowUp"):
            press(key)
        press("Enter")
        page.wait_for_selector(".badge.corrected")
        press("t")
        page.keyboard.type("moved, n a x")
        press("Enter")
        until(page, "document.querySelectorAll('#history li').length === 2")
        press("m")
        press("ArrowUp")
        press("Escape")
        press("f")
        assert not page.locator("#filters").is_visible()
        press("p")
        until(page, "document.querySelector('#card').innerText.includes('s0002')")
        page.close()
    assert troubles == []
    found = verdicts(read_review(out / names.REVIEW))
    assert {name: v.status for name, v in found.items()} == {
        "s0001": "rejected",
        "s0002": "corrected",
        "s0003": "corrected",
    }
    assert found["s0002"].class_name == "regulatory--no-entry--g1"
    assert found["s0003"].note == "moved, n a x"
    from pymap3d import geodetic2enu

    third = sign(3)
    east, north, _ = geodetic2enu(
        found["s0003"].lat_deg,
        found["s0003"].lon_deg,
        0,
        np.degrees(third.lat_rad),
        np.degrees(third.lon_rad),
        0,
    )
    # Web Mercator's metre is the sphere's: a third of a percent off
    assert (east, north) == pytest.approx((2.0, 0.1), abs=0.01)


@pytest.mark.slow
def test_a_sign_is_dragged_to_its_place(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3)
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        page.mouse.click(*on_screen(page, 1))
        page.wait_for_selector("#move")
        before = page.evaluate("[automapMap.x, automapMap.y]")
        page.click("#move")
        scale = page.evaluate("automapMap.pxPerM")
        x, y = on_screen(page, 1)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y - 60, steps=5)
        page.mouse.up()
        page.keyboard.press("Enter")
        page.wait_for_selector(".badge.corrected")
        page.close()
    verdict = verdicts(read_review(out / names.REVIEW))["s0002"]
    assert verdict.lat_deg is not None
    north = (verdict.lat_deg - np.degrees(sign(2).lat_rad)) * 111_250
    assert north == pytest.approx(60 / scale, rel=0.02)
    assert before is not None
    assert troubles == []


@pytest.mark.slow
def test_two_tabs_see_each_other_and_lose_nothing(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=4)
    with serving(out) as server:
        (one, first), (two, second) = opened(browser, server.url), opened(browser, server.url)
        one.keyboard.press("n")
        one.wait_for_selector("#accept")
        one.keyboard.press("a")
        one.wait_for_selector(".badge.accepted")
        two.keyboard.press("p")
        two.wait_for_selector("#accept")
        two.keyboard.press("x")
        two.wait_for_selector(".badge.rejected")
        for page in (one, two):
            until(page, "document.querySelector('#tally').innerText.includes('2 reviewed')")
            page.close()
    assert status(out) == {"s0001": "accepted", "s0004": "rejected"}
    assert first == second == []


@pytest.mark.slow
def test_a_decision_that_cannot_be_kept_is_said(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2)
    with serving(out) as server:
        page, _ = opened(browser, server.url)
        page.keyboard.press("n")
        page.wait_for_selector("#accept")
        (out / names.REVIEW).write_text("{broken")
        page.keyboard.press("a")
        until(page, "document.querySelector('#hint').innerText.startsWith('Not saved')")
        assert page.locator(".badge").count() == 0
        page.close()


@pytest.mark.slow
def test_filters(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=9)
    signs = [
        sign(i, confidence=i / 10, drives=(("monday", "tuesday")[i % 2],)) for i in range(1, 10)
    ]
    write_signs(out / names.SIGNS_RAW, signs)

    def shown(page: Page) -> set[str]:
        return set(
            page.evaluate(
                "[...automapState.signs.ids.keys()].filter((i) => automapState.signs.shown[i])"
                ".map((i) => automapState.signs.ids[i])"
            )
        )

    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        page.fill("#confidence", "0.5")
        assert shown(page) == {f"s000{i}" for i in range(5, 10)}
        page.fill("#confidence", "0")
        page.get_by_label("monday").uncheck()
        assert shown(page) == {f"s000{i}" for i in (1, 3, 5, 7, 9)}
        page.get_by_label("monday").check()
        page.click("#drives-none")
        assert shown(page) == set()
        page.click("#drives-all")
        page.click("#classes-none")
        assert shown(page) == set()
        page.fill("#class-search", "give")
        page.click("#classes-all")
        assert shown(page) == {"s0001", "s0004", "s0007"}
        page.close()
    assert troubles == []


def test_hostile_text_is_text(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2, name=HOSTILE)
    bad = "<img src=x onerror=alert(1)>"
    names_ = (HOSTILE, bad, "__proto__", "../../etc/passwd", "{{token}}")
    write_signs(
        out / names.SIGNS_RAW,
        [
            sign(i, id=f"{text}{i}", class_name=text, side=text, status=text, drives=(text,))
            for i, text in enumerate(names_)
        ],
    )
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        dialogs: list[str] = []
        page.on("dialog", lambda dialog: dialogs.append(dialog.message))
        assert page.locator("#title").inner_text() == HOSTILE.replace("\x07", "\x07")
        for k, text in enumerate(names_):
            page.keyboard.press("n")
            until(
                page,
                "(id) => document.querySelector('#head .hint')?.textContent === id",
                f"{text}{k}",
            )
            page.keyboard.press("t")
            page.keyboard.type(bad)
            page.keyboard.press("Enter")
            page.wait_for_selector("#history li")
        assert page.locator("img:not([src*='/face/'])").count() == 0
        assert page.locator("script").count() == 1
        page.close()
    assert dialogs == []
    assert troubles == []


@pytest.mark.slow
def test_a_hundred_thousand_signs(browser: Browser, tmp_path: Path) -> None:
    out = write_large_map(tmp_path / "map", 100_000)
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        counts = page.evaluate("automapMap.drawn.map((d) => d.count ?? 1)")
        # far out, discs hold all of them
        assert sum(counts) == 100_000
        assert len(counts) < 1000
        page.mouse.move(600, 400)
        for _ in range(6):
            page.mouse.wheel(0, -400)
        page.keyboard.press("n")
        page.wait_for_selector("#accept")
        page.keyboard.press("a")
        page.wait_for_selector(".badge.accepted")
        page.click("#fit")
        until(page, "automapMap.drawn.length > 10")
        big = page.evaluate(
            "automapMap.drawn.reduce((a, b) => (b.count ?? 1) > (a.count ?? 1) ? b : a)"
        )
        left, top = page.evaluate(
            "(({left, top}) => [left, top])(automapMap.canvas.getBoundingClientRect())"
        )
        before = page.evaluate("automapMap.k")
        page.mouse.click(left + big["sx"], top + big["sy"])
        until(page, f"automapMap.k > 2 * {before}")
        page.close()
    assert status(out) == {"s000000": "accepted"}
    assert troubles == []


@pytest.mark.slow
def test_video_boxes_and_time(browser: Browser, tmp_path: Path) -> None:
    if not (SAMPLE / "video" / "front.mp4").is_file():
        pytest.skip("data/sample-drive has no video here")
    out = write_run(tmp_path / "out", signs=2)
    record = json.loads((out / names.RUN).read_text())
    record["drive"]["path"] = str(SAMPLE)
    (out / names.RUN).write_text(json.dumps(record))
    (out / names.OBSERVATIONS).unlink()
    start = 1_254_396_461_263
    write_detections(
        out / names.DETECTIONS,
        [
            Detections(
                frame=np.array([30, 40]),
                t_ns=np.array([start + 3_000_000_000, start + 4_000_000_000]),
                class_name=np.array(["stop", "stop"], object),
                box=np.array([[100.0, 100, 160, 160], [200, 100, 280, 180]]),
                score=np.array([0.9, 0.8]),
                track=np.array([1, 1]),
                camera="front",
            )
        ],
    )
    with serving(out) as server:
        page, troubles = opened(browser, server.url)
        until(page, "document.querySelector('#video-note').innerText.startsWith('frame ')")
        assert page.evaluate("document.querySelector('#frame').width") == 1280
        note = page.locator("#video-note").inner_text()
        page.keyboard.press(">")
        until(page, f"document.querySelector('#video-note').innerText !== {note!r}")
        page.evaluate(
            "automapState.drives.get(0).then((d) => {"
            "const s = document.querySelector('#time');"
            "s.value = d.cameras[0].t[d.cameras[0].frame.indexOf(40)];"
            "s.dispatchEvent(new Event('input')); })"
        )
        until(page, "document.querySelector('#video-note').innerText === 'frame 40, 1 box'")
        # the box is drawn into the picture in the colour of a box without a sign
        pixel = page.evaluate(
            "[...document.querySelector('#frame').getContext('2d')"
            ".getImageData(240, 180, 1, 1).data]"
        )
        assert pixel[:3] == pytest.approx([154, 165, 177], abs=30)
        page.keyboard.press(" ")
        until(page, "!document.querySelector('#video-note').innerText.startsWith('frame 40,')")
        page.keyboard.press(" ")
        page.close()
    assert troubles == []


def saw(page: Page, name: str) -> None:
    """Wait until the card is that of a sign."""
    until(page, "(id) => document.querySelector('#head .hint')?.textContent === id", name)


def test_signs_are_added_turned_raised_and_made_one(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=3)
    with serving(out, reviewer="Anna") as server:
        page, troubles = opened(browser, server.url)
        press = page.keyboard.press
        x, y = on_screen(page, 1)
        page.click("#add")
        page.mouse.click(x + 90, y + 40)
        page.wait_for_selector("#save-add:enabled")
        page.click("#add-class")
        page.fill("#picker-search", "274-70")
        press("Enter")
        until(page, "document.querySelector('#add-class').innerText.includes('70')")
        press("Escape")
        page.click("#add")
        page.mouse.click(x + 90, y + 40)
        page.wait_for_selector("#save-add:enabled")
        page.click("#save-add")
        page.fill("#picker-search", "two way")
        press("ArrowDown")
        press("Enter")
        page.wait_for_selector(".badge.added")
        assert page.locator("#tally").inner_text() == "4 signs, 1 reviewed"
        press("r")
        press("Shift+ArrowRight")
        press("ArrowRight")
        press("Enter")
        until(page, "document.querySelector('#facing')?.value === '11'")
        press("h")
        page.keyboard.type("2.75")
        press("Enter")
        until(page, "document.querySelectorAll('#history li').length === 3")
        page.fill("#reviewer", "Ben")
        page.mouse.click(*on_screen(page, 0))
        saw(page, "s0001")
        press("j")
        page.mouse.click(*on_screen(page, 2))
        until(page, "document.querySelector('#tally').innerText === '3 signs, 2 reviewed'")
        press("z")
        until(page, "document.querySelector('#tally').innerText === '4 signs, 1 reviewed'")
        press("z")
        until(page, "document.querySelector('#hint').innerText.includes('nothing of yours')")
        assert page.evaluate("document.querySelector('#progress').value") == 1
        page.close()
    assert troubles == []
    found = verdicts(read_review(out / names.REVIEW))
    (made,) = [v for v in found.values() if v.created]
    assert (made.status, made.reviewer) == ("added", "Anna")
    assert (made.facing_deg, made.height_above_road_m) == (11.0, 2.75)
    assert "two-way" in (made.class_name or "")
    assert not found.get("s0001") or found["s0001"].status == ""


def test_the_doubtful_come_first_and_disputes_are_shown(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=4)
    beliefs = {1: 0.9, 2: 0.3, 3: 0.8, 4: 0.95}
    signs = [sign(i, confidence=0.95, existence=e, status="ok") for i, e in beliefs.items()]
    write_signs(out / names.SIGNS_RAW, [*signs, sign(5, confidence=0.95, status="far")])
    with serving(out, reviewer="Anna") as server:
        page, troubles = opened(browser, server.url)
        press = page.keyboard.press
        for name in ("s0005", "s0002"):
            press("d")
            saw(page, name)
            press("a")
            page.wait_for_selector(".badge.accepted")
        page.select_option("#order", "doubt")
        page.locator("#canvas").focus()
        press("u")
        saw(page, "s0003")
        press("n")
        saw(page, "s0001")
        page.fill("#reviewer", "Ben")
        press("Escape")
        press("p")
        press("p")
        saw(page, "s0002")
        press("x")
        until(page, "document.querySelector('#head .warn')?.innerText.includes('Anna')")
        page.select_option("#review-filter", "disputed")
        until(page, "document.querySelector('#tally').innerText.startsWith('1 of 5')")
        page.locator("#canvas").focus()
        press("x")
        until(page, "!document.querySelector('#head .warn')")
        page.close()
    assert troubles == []


@pytest.mark.parametrize("kind", ["tif", "mbtiles", "geojson"])
def test_a_background_lies_below_the_map(browser: Browser, tmp_path: Path, kind: str) -> None:
    writers: dict[str, Callable[[Path], Path]] = {
        "tif": backgrounds.write_geotiff,
        "mbtiles": backgrounds.write_mbtiles,
        "geojson": backgrounds.write_roads,
    }
    out = write_run(tmp_path / "out", signs=2)
    with serving(out, background=writers[kind](tmp_path / f"below.{kind}")) as server:
        page, troubles = opened(browser, server.url)
        page.evaluate(
            "automapMap.centre(...[(8.474 + 180) / 360, 0.5 - Math.asinh(Math.tan("
            "48.975 * Math.PI / 180)) / (2 * Math.PI)], 3)"
        )
        until(page, "[...automapMap.below.tiles.values()].some((tile) => tile)")
        page.wait_for_timeout(300)
        wanted = backgrounds.colour(8.474, 48.975).tolist()
        if kind == "geojson":
            wanted = [120, 130, 140]
        assert middle(page) == pytest.approx(wanted, abs=14)
        page.keyboard.press("b")
        page.wait_for_timeout(100)
        assert middle(page) != pytest.approx(wanted, abs=14)
        page.close()
    assert troubles == []


def middle(page: Page) -> list[int]:
    """The colour in the middle of the map."""
    box = page.locator("#canvas").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    shot = page.screenshot(clip={"x": round(x) - 1, "y": round(y) - 1, "width": 2, "height": 2})
    pixel = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))[0, 0]
    return [int(v) for v in pixel]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 390])
def test_the_page_is_accessible(
    browser: Browser, tmp_path: Path, width: int, scheme: Literal["light", "dark"]
) -> None:
    out = write_run(tmp_path / "out", signs=4)
    background = backgrounds.write_geotiff(tmp_path / "a.tif")
    with serving(out, background=background) as server:
        context = browser.new_context(
            viewport={"width": width, "height": 844}, color_scheme=scheme, bypass_csp=True
        )
        page = context.new_page()
        troubles = watched(page)
        page.goto(server.url)
        page.wait_for_selector("html[data-paths]")
        assert violations(page) == []
        page.keyboard.press("n")
        page.wait_for_selector("#accept")
        page.keyboard.press("a")
        page.wait_for_selector(".badge.accepted")
        assert violations(page) == []
        page.keyboard.press("c")
        until(page, "document.querySelector('#picker').open")
        assert violations(page) == []
        page.keyboard.press("Escape")
        until(page, "!document.querySelector('#picker').open")
        # keys belong to the search field until it has lost the focus
        until(page, "document.activeElement.id !== 'picker-search'")
        page.keyboard.press("i")
        page.wait_for_selector("#leave-add")
        assert violations(page) == []
        page.keyboard.press("Escape")
        page.keyboard.press("f")
        assert violations(page) == []
        context.close()
    assert troubles == []


def test_a_phone_has_map_decisions_and_time_at_once(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=4)
    with serving(out) as server:
        context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
        page = context.new_page()
        troubles = watched(page)
        page.goto(server.url)
        page.wait_for_selector("html[data-paths]")
        assert not page.locator("#filters").is_visible()
        page.touchscreen.tap(*on_screen(page, 2))
        page.wait_for_selector("#accept")
        boxes = {}
        for name in ("map", "side", "accept", "reject", "time"):
            box = page.locator(f"#{name}").bounding_box()
            assert box is not None
            boxes[name] = box
        free = boxes["map"]["height"] + boxes["side"]["height"]
        assert boxes["side"]["height"] <= 0.5 * free
        assert free > 0.75 * 844
        for name in ("accept", "reject"):
            assert boxes[name]["height"] >= 24
            assert boxes[name]["x"] + boxes[name]["width"] <= 390
            assert boxes[name]["y"] + boxes[name]["height"] <= boxes["side"]["y"] + 150
        assert boxes["time"]["width"] >= 200
        wide = "[...document.querySelectorAll('body *')].filter((e) => e.checkVisibility() && "
        wide += "e.getBoundingClientRect().right > 391 && !e.closest('.actions')).map((e) => e.id)"
        assert page.evaluate(wide) == []
        widths = "[innerWidth, document.documentElement.clientWidth, document.body.scrollWidth]"
        assert page.evaluate(widths) == [390, 390, 390]
        page.locator("#accept").tap()
        page.wait_for_selector(".badge.accepted")
        page.locator("#move").tap()
        page.locator("#mode-keep").tap()
        page.wait_for_selector(".badge.corrected")
        # what has the focus is reached in the order in which it is seen
        page.locator("#accept").focus()
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.id") == "reject"
        context.close()
    assert troubles == []
    assert status(out) == {"s0003": "corrected"}
