"""The viewer's page in headless Chromium: by mouse, by keyboard, in two tabs, with any text."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from export_inputs import HOSTILE, sign, write_run
from view_maps import write_large_map

from automap.io import names
from automap.io.detections_table import write_detections
from automap.io.review_json import read_review
from automap.io.signs_table import write_signs
from automap.mapping.review import verdicts
from automap.records import Detections
from pipeline.cli.root import run_command
from pipeline.view.command import serving
from tests.browser import launched, watched

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
        page.fill("#class-name", "yield")
        page.click("#save-class")
        page.wait_for_selector(".badge.corrected")
        page.fill("#note", "behind a tree")
        page.click("#save-note")
        page.wait_for_selector("#history li:nth-child(2)")
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
    assert (found["s0005"]["class"], found["s0005"]["status"]) == ("yield", "corrected")


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
        page.keyboard.type("no-entry")
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
    assert found["s0002"].class_name == "no-entry"
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
                "(id) => document.querySelector('#card .hint')?.textContent === id",
                f"{text}{k}",
            )
            page.keyboard.press("t")
            page.keyboard.type(bad)
            page.keyboard.press("Enter")
            page.wait_for_selector("#history li")
        assert page.locator("img").count() == 0
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
