"""``automap view``: a map in the browser, from a server on this machine."""

from __future__ import annotations

import signal
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from pipeline.view.below import lay_below
from pipeline.view.opening import open_map
from pipeline.view.server import ViewServer


@contextmanager
def serving(
    out: Path, port: int = 0, background: Path | None = None, reviewer: str = ""
) -> Iterator[ViewServer]:
    """Serve the map in ``out`` while the block lasts, above ``background`` or the drive's own.

    Raises InputError when there is no map or the background cannot be shown below it, ConfigError
    when the port is taken.
    """
    shown = open_map(out)
    shown.reviewer = reviewer
    lay_below(shown, background)
    # made before the first request, so that the page has its signs at once
    _ = shown.payload
    try:
        server = ViewServer(shown, port)
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"port {port} cannot be used ({error}); choose another one or leave --port out."
        ) from error
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def view(
    out: Path,
    port: int,
    browser: bool,
    log: Callable[[str], None],
    background: Path | None = None,
    reviewer: str = "",
) -> None:
    """Serve the map until Ctrl-C or a signal to end; ``log`` receives the lines for the user."""
    ended = threading.Event()
    with _ending(ended), serving(out, port, background, reviewer) as server:
        shown = server.shown
        count = 0 if shown.signs is None else len(shown.signs)
        log(server.url)
        log(f"{shown.name}: {count} signs; Ctrl-C ends the viewer")
        for text in shown.problems:
            log(text)
        with _shown_in_browser(server.url) if browser else nullcontext():
            ended.wait()


@contextmanager
def _ending(ended: threading.Event) -> Iterator[None]:
    """Ctrl-C and SIGTERM set the event, which is how a viewer is meant to end."""

    def end(signum: int, frame: Any) -> None:
        ended.set()

    before = [(number, signal.signal(number, end)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)


@contextmanager
def _shown_in_browser(url: str) -> Iterator[None]:
    """Open the page by a file that only this user can read.

    A browser's command line can be seen by every user of the machine, the token must not be.
    """
    with tempfile.NamedTemporaryFile(
        "w", prefix="automap-view-", suffix=".html", encoding="utf-8"
    ) as file:
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={url}">')
        file.flush()
        with suppress(webbrowser.Error):
            webbrowser.open(Path(file.name).as_uri())
        yield
