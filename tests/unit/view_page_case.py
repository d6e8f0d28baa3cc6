"""The viewer's page in headless Chromium: opened, waited for, looked at."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from automap.io import names
from automap.io.review_json import read_review
from automap.review.verdicts import verdicts
from tests.browser import watched

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


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


def saw(page: Page, name: str) -> None:
    """Wait until the card is that of a sign."""
    until(page, "(id) => document.querySelector('#head .hint')?.textContent === id", name)
