"""The viewer's page in headless Chromium: signs reviewed by mouse, by keyboard and in two tabs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from export_inputs import sign, write_run

from automap.io import names
from automap.io.review_json import read_review
from automap.io.signs_table import write_signs
from automap.review.verdicts import verdicts
from pipeline.cli.root import run_command
from pipeline.view.command import serving
from tests.browser import launched
from tests.unit.view_page_case import on_screen, opened, saw, status, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as running:
        yield running


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
        assert "95 % radius" in page.locator("#card").inner_text()
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
