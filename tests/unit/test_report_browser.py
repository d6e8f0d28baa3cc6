"""report.html in a browser: no error, no request, a sign's card, the path's colours; its size."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from export_inputs import CLOCK, HOSTILE, fixes, sign, trajectory, write_run

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from browser import launched, violations, watched

from automap.io import names
from automap.io.manifest import VideoSection
from automap.io.signs_table import write_signs
from automap.io.tables import write_columns, write_fixes
from pipeline.report.render import report_html
from pipeline.shared.pictures import take_pictures, write_pictures
from pipeline.shared.products import load_products

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


def with_views(out: Path, signs: int, rng: np.random.Generator) -> None:
    """Put ten observations of every sign into a run, and three pictures of each beside it."""
    n = signs * 10
    start = np.repeat([CLOCK.ref_ns + k * 7_000_000_000 for k in range(1, signs + 1)], 10)
    size = np.tile(np.geomspace(12, 80, 10), signs)
    write_columns(
        out / names.OBSERVATIONS,
        {
            "camera": np.array(["front"] * n, object),
            "frame": np.arange(n),
            "t_ns": start + np.tile(np.arange(10) * 100_000_000, signs),
            "class": np.array(["stop"] * n, object),
            "x_min": np.full(n, 300.0),
            "y_min": np.full(n, 200.0),
            "x_max": 300.0 + size,
            "y_max": 200.0 + size,
            "score": np.full(n, 0.9),
            "sign_id": np.repeat([f"s{k:04d}" for k in range(1, signs + 1)], 10).astype(object),
            "residual_x_px": rng.normal(0, 1, n),
            "residual_y_px": rng.normal(0, 1, n),
            "range_m": 700.0 / size,
            "used": rng.random(n) > 0.05,
        },
    )
    products = load_products(out)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "pipeline.shared.pictures._from_video",
            lambda video, views, wanted, done: drawn(views, rng),
        )
        video = type("Video", (), {"chapters": ("front.mp4",), "section": VideoSection()})()
        write_pictures(out, take_pictures(products, {"front": video}))


def drawn(views, rng):  # type: ignore[no-untyped-def]
    """Pictures as rich in detail as those of a real street."""
    from automap.export.pictures import sign_picture
    from pipeline.shared.pictures import Picture

    pictures = []
    noise = rng.integers(0, 30, (300, 400, 3), dtype=np.uint8)
    for view in views:
        coarse = rng.integers(0, 225, (15, 20, 3), dtype=np.uint8)
        frame = cv2.add(cv2.resize(coarse, (400, 300), interpolation=cv2.INTER_CUBIC), noise)
        jpeg = sign_picture(frame, view.box)
        assert jpeg is not None
        pictures.append(Picture(view, jpeg))
    return pictures


def page_of(out: Path) -> Path:
    products = load_products(out)
    path = out / names.REPORT
    path.write_text(report_html(products, "demo", products.json(names.RUN)), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = write_run(tmp_path_factory.mktemp("run") / "out", signs=12)
    bad = sign(13, class_name=HOSTILE, status=HOSTILE)
    write_signs(out / names.SIGNS_RAW, [*(sign(i) for i in range(1, 13)), bad])
    with_views(out, 13, np.random.default_rng(5))
    return page_of(out)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as running:
        yield running


@pytest.fixture
def page(browser: Browser, report: Path) -> Iterator[Page]:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    troubles = watched(page)
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(report.as_uri())
    page.wait_for_selector("#map canvas")
    yield page
    assert troubles == []
    assert [url for url in requests if not url.startswith("data:")] == [report.as_uri()]
    page.close()


def test_a_click_on_a_sign_opens_its_card(page: Page) -> None:
    assert "Click a sign" in page.inner_text("#sign")
    # the faces overlap at this scale
    page.locator("img.leaflet-marker-icon[title*=s0005]").dispatch_event("click")
    card = page.inner_text("#sign")
    assert "s0005" in page.inner_text("#sign h3")
    for words in ("Where the error comes from", "all together", "position of the vehicle"):
        assert words in card
    assert page.locator("#sign .crops img").count() == 3
    width = page.locator("#sign .crops img").first.evaluate("image => image.naturalWidth")
    assert width > 60
    assert page.locator("#sign .residuals circle").count() >= 6


def test_everybody_can_read_it_on_a_phone_and_a_screen_by_day_and_by_night(
    browser: Browser, report: Path
) -> None:
    for width in (390, 1280):
        for scheme in ("light", "dark"):
            page = browser.new_page(
                viewport={"width": width, "height": 844}, color_scheme=scheme, bypass_csp=True
            )
            page.goto(report.as_uri())
            page.wait_for_selector("#map canvas")
            page.locator("#sign-table tbody tr").nth(2).focus()
            page.keyboard.press("Enter")
            assert violations(page) == []
            assert page.evaluate("document.documentElement.scrollWidth") == width
            # what is wider than the page can be moved by keys
            tables = page.locator(".scroll")
            assert tables.count() > 1
            assert set(tables.evaluate_all("all => all.map((one) => one.tabIndex)")) == {0}
            # sentences are lines of words, not of letters
            wide = page.locator(".scroll td:not(.short)")
            assert min(wide.evaluate_all("all => all.map((one) => one.clientWidth)")) > 120
            page.close()


def test_of_drives_on_two_continents_the_map_shows_one(
    browser: Browser, report: Path, tmp_path: Path
) -> None:
    opening = '<script type="application/json" id="map-data">'
    head, rest = report.read_text(encoding="utf-8").split(opening)
    text, tail = rest.split("</script>", 1)
    data = json.loads(text)
    here = data["path"]["points"]
    data["tracks"] = [here, [[x + 1.4e7, y] for x, y in here]]
    far = tmp_path / "far.html"
    text = json.dumps(data).replace("<", "\\u003c")
    far.write_text(head + opening + text + "</script>" + tail, encoding="utf-8")
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(far.as_uri())
    page.wait_for_selector("#map canvas")
    shown = page.locator("#map").bounding_box()
    face = page.locator("img.leaflet-marker-icon").first.bounding_box()
    assert shown is not None
    assert face is not None
    assert shown["x"] < face["x"] < shown["x"] + shown["width"]
    page.close()


def test_a_row_of_the_table_opens_it_by_keyboard(page: Page) -> None:
    page.locator("#sign-table tbody tr").nth(2).focus()
    page.keyboard.press("Enter")
    assert "s0003" in page.inner_text("#sign h3")
    assert page.locator("#sign-table tbody tr.on td").first.inner_text() == "s0003"


def test_the_path_can_be_coloured_in_four_ways(page: Page) -> None:
    choices = page.locator("#path-by option").all_inner_texts()
    assert choices == ["horizontal σ", "satellites", "time from a GPS fix", "speed"]
    seen = set()
    for key in ("sigma", "satellites", "outage", "speed"):
        page.select_option("#path-by", key)
        seen.add(page.inner_text(".swatches"))
    assert len(seen) == 4


def test_hostile_text_is_shown_as_text(page: Page) -> None:
    page.locator("#sign-table tbody tr").nth(12).focus()
    page.keyboard.press("Enter")
    assert "<img src=x onerror=alert(1)>" in page.inner_text("#sign")
    assert page.locator("#sign img[src='x']").count() == 0


def test_it_can_be_printed(page: Page) -> None:
    page.emulate_media(media="print")
    assert page.pdf().startswith(b"%PDF")
    assert not page.locator("nav").is_visible()


@pytest.mark.slow
def test_an_hour_with_two_hundred_signs_is_below_five_megabytes(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=200, seconds=3600.0)
    path = trajectory(3600.0)
    write_fixes(out / names.FIXES, fixes(path))
    with_views(out, 200, np.random.default_rng(6))
    assert pq.read_metadata(out / names.TRAJECTORY).num_rows == 180_000
    report = page_of(out)
    text = report.read_text(encoding="utf-8")
    assert text.count("data:image/jpeg") >= 200, "every sign has its picture"
    assert report.stat().st_size < 5_000_000
