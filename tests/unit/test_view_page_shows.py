"""What the viewer's page shows in headless Chromium: any text, many signs, video, on a phone."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import backgrounds
import numpy as np
import pyarrow.parquet as pq
import pytest
from export_inputs import HOSTILE, sign, write_run
from PIL import Image
from view_maps import write_large_map

from automap.io import names
from automap.io.detections_table import write_detections
from automap.io.observations_table import write_observations
from automap.io.signs_table import write_signs
from automap.records import Detections
from pipeline.view.command import serving
from tests.browser import launched, violations, watched
from tests.slow_cases import others_slow
from tests.unit.view_page_case import on_screen, opened, saw, status, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


ROOT = Path(__file__).parents[2]


SAMPLE = ROOT / "data" / "sample-drive"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as running:
        yield running


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
    write_observations(
        out / names.OBSERVATIONS,
        pq.read_table(out / names.DETECTIONS),
        {"sign_id": np.array(["s0001", ""], object), "used": np.array([True, False])},
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
        # the card shows what was seen, of the frame that has the sign
        assert page.locator("#seen:visible").count() == 0
        page.keyboard.press("n")
        page.wait_for_selector("#seen:visible")
        assert page.locator("#seen").get_attribute("aria-label") == "As seen in frame 30"
        shown = page.evaluate(
            "[...document.querySelector('#seen').getContext('2d').getImageData(64, 64, 1, 1).data]"
        )
        assert shown[3] == 255
        # what is chosen no longer leaves no ticks on the line of time
        ticks = "document.querySelector('#marks').getContext('2d')"
        ticks = f"{ticks}.getImageData(0, 0, innerWidth, 9).data.some(Boolean)"
        assert page.evaluate(ticks)
        page.keyboard.press("Escape")
        until(page, f"!{ticks}")
        page.keyboard.press("n")
        page.keyboard.press("n")
        until(page, "document.querySelector('#seen')?.hidden ?? true")
        page.close()
    assert troubles == []


@pytest.mark.parametrize("kind", others_slow(["mbtiles", "geojson", "tif"], fast=2))
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


@pytest.mark.parametrize(
    ("width", "scheme"),
    others_slow([(390, "light"), (1400, "dark"), (1400, "light"), (390, "dark")], fast=2),
)
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


def test_a_tablet_shows_its_whole_head_and_the_map(browser: Browser, tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=2)
    with serving(out) as server:
        context = browser.new_context(viewport={"width": 720, "height": 900})
        page = context.new_page()
        page.goto(server.url)
        page.wait_for_selector("html[data-paths]")
        beyond = "[...document.querySelectorAll('header *')].filter((e) => e.checkVisibility() && "
        beyond += "e.getBoundingClientRect().right > innerWidth).map((e) => e.id)"
        assert page.evaluate(beyond) == []
        assert page.evaluate("document.getElementById('title').clientWidth") > 20
        box = page.locator("#map").bounding_box()
        assert box is not None
        assert box["width"] > 0.5 * 720
        context.close()


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
        # no key is needed to go on
        page.locator("#next").tap()
        saw(page, "s0004")
        page.locator("#previous").tap()
        saw(page, "s0003")
        # what has the focus is reached in the order in which it is seen
        page.locator("#accept").focus()
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.id") == "reject"
        context.close()
    assert troubles == []
    assert status(out) == {"s0003": "corrected"}
