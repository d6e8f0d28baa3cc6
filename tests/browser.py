"""A headless Chromium for tests of pages; tests skip where there is none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Request

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def chromium_path() -> str | None:
    """The installed Chromium, None where there is none."""
    found = os.environ.get("AUTOMAP_CHROMIUM")
    return found or shutil.which("chromium") or shutil.which("chromium-browser")


def axe_path() -> str | None:
    """The script of axe-core (npm's package), None where there is none."""
    named = os.environ.get("AUTOMAP_AXE")
    places = [named] if named else ["/usr/share/javascript/axe-core/axe.min.js"]
    places.append(str(Path(__file__).parents[1] / "node_modules" / "axe-core" / "axe.min.js"))
    return next((place for place in places if Path(place).is_file()), None)


@contextmanager
def launched() -> Iterator[Browser]:
    """A running Chromium; skips the test where none is installed or it does not start."""
    path = chromium_path()
    if path is None:
        pytest.skip("no Chromium: install Debian's package chromium, or name it AUTOMAP_CHROMIUM")
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        except Error as error:
            pytest.skip(f"{path} does not start: {error.message.splitlines()[0]}")
        try:
            yield browser
        finally:
            browser.close()


def watched(page: Page) -> list[str]:
    """A list that grows by a sentence for every error of the page and every foreign request.

    Own are the page's own address (host and port), ``data:`` and ``blob:``.
    """
    troubles: list[str] = []

    def request(url: str) -> None:
        own = page.url.split("/")[:3]
        if not url.startswith(("data:", "blob:", "file:")) and url.split("/")[:3] != own:
            troubles.append(f"request to {url}")

    def said(kind: str, text: str) -> None:
        # pixels that a test reads, again and again while a busy machine draws; no page does
        if kind in ("error", "warning") and "willReadFrequently" not in text:
            troubles.append(f"console {kind}: {text}")

    def failed(one: Request) -> None:
        # what a reload or a closed page breaks off; a server that breaks off is another error
        if one.failure != "net::ERR_ABORTED":
            troubles.append(f"failed: {one.url} {one.failure}")

    page.on("console", lambda message: said(message.type, message.text))
    page.on("pageerror", lambda error: troubles.append(f"error: {error}"))
    # the first request comes before the page has an address
    page.on("request", lambda r: None if page.url == "about:blank" else request(r.url))
    page.on("requestfailed", failed)
    return troubles


def violations(page: Page) -> list[str]:
    """What axe-core finds, where a copy of it is at hand, and what needs no program to find."""
    bare = page.evaluate(
        "[...document.querySelectorAll('button, input, select')].filter((e) => !e.hidden && "
        "e.checkVisibility() && !(e.ariaLabel || e.labels?.length || e.innerText?.trim()))"
        ".map((e) => e.outerHTML).concat([...document.querySelectorAll('section aside')]"
        ".map((e) => 'a landmark in another: ' + e.id))"
        ".concat([...document.querySelectorAll('.leaflet-marker-icon[tabindex]')]"
        ".map((e) => [e.title, e.getBoundingClientRect()])"
        ".filter(([, a], k, all) => all.slice(0, k).some(([, b]) =>"
        " Math.abs(a.x - b.x) < 24 && Math.abs(a.y - b.y) < 24))"
        ".map(([title]) => 'takes the focus and lies over another: ' + title))"
    )
    axe = axe_path()
    if axe is None:
        return [str(one) for one in bare]
    page.add_script_tag(path=axe)
    found = page.evaluate(
        "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', "
        "'best-practice']}).then((r) => r.violations.map((v) => v.id + ': ' + "
        "v.nodes.map((n) => n.html).join(' ')))"
    )
    return [str(one) for one in (*bare, *found)]
