"""The server of the page: on this machine only, for whoever has the token."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from automap.errors import AutoMapError
from automap.io import names
from automap.io.atomic import plain
from automap.io.json_text import parse_json
from automap.io.web_tiles import MOST_ZOOM, content_type
from pipeline.pages.palette import colours_css
from pipeline.view import guard
from pipeline.view.reviewing import Reviewing
from pipeline.view.viewed_map import ViewedMap

log = logging.getLogger(__name__)

_BODY_LIMIT = 65_536
_ASSETS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
_SHOWN = {".png": "image/png", ".jpg": "image/jpeg"}
Answer = tuple[str, bytes]


class ViewServer(ThreadingHTTPServer):
    """Serves one map on 127.0.0.1; ``port`` 0 takes any free one."""

    daemon_threads = True

    def __init__(self, shown: ViewedMap, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.shown = shown
        self.reviewing = Reviewing(shown)
        self.token = guard.new_token()

    @property
    def url(self) -> str:
        """The page's address, token included."""
        return f"http://127.0.0.1:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up is no trouble; everything else goes to the log."""
        log.info("a request ended early", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version = "automap"
    sys_version = ""
    timeout = 60

    def do_GET(self) -> None:
        self._answer(self._get)

    def do_HEAD(self) -> None:
        self._answer(self._get)

    def do_POST(self) -> None:
        self._answer(self._post)

    def _answer(self, make: Callable[[str], None]) -> None:
        try:
            guard.check_host(self.headers.get("Host"), self.server.server_port)
            guard.check_origin(self.headers.get("Origin"), self.server.server_port)
            make(guard.checked_path(self.path, self.server.token))
        except guard.RefusedError as refusal:
            # what may follow an unread body is not looked at
            self.close_connection = self.close_connection or self.command == "POST"
            self._send(refusal.status, "text/plain; charset=utf-8", f"{refusal}\n".encode())
        except (ValueError, AutoMapError) as error:
            text = f"{error}\n".encode("utf-8", "replace")
            status = 400 if isinstance(error, ValueError) else 500
            self._send(status, "text/plain; charset=utf-8", text)
        except ConnectionError:
            # the browser has hung up
            raise
        except Exception as error:
            name = Path(getattr(error, "filename", None) or "").name
            what = f"{name}: {getattr(error, 'strerror', None) or type(error).__name__}"
            told = f"this cannot be shown ({what.removeprefix(': ')})\n"
            # where the system refuses there is nothing to be looked for in the program
            log.error("%s", told.strip(), exc_info=not isinstance(error, OSError))
            self._send(500, "text/plain; charset=utf-8", told.encode("utf-8", "replace"))

    def _get(self, path: str) -> None:
        shown = self.server.shown
        if path == "":
            return self._send(200, *_page(self.server.token))
        if path == "api/map":
            return self._json(shown.overview())
        if path == "api/signs":
            return self._send(200, "application/octet-stream", shown.payload)
        if path == "api/review":
            known = parse_qs(urlsplit(self.path).query).get("known", ["-1"])[0]
            return self._json(self.server.reviewing.told(_number(known, signed=True)))
        if found := re.fullmatch(r"api/sign/(\d{1,9})", path):
            return self._json(_there(self.server.reviewing.sign(int(found[1]))))
        if found := re.fullmatch(r"api/drive/(\d{1,6})", path):
            return self._json(self._drive(found[1]).overview())
        if found := re.fullmatch(r"api/boxes/(\d{1,6})/(\d{1,9})/(.+)", path):
            return self._json(self._drive(found[1]).boxes_in(found[3], int(found[2])))
        if found := re.fullmatch(r"frame/(\d{1,6})/(\d{1,9})/(.+)", path):
            reader = _there(self._drive(found[1]).readers.get(found[3]))
            return self._send(200, "image/jpeg", _there(reader.jpeg(int(found[2]))))
        if found := re.fullmatch(r"face/(.{1,300})", path):
            kept = {"Cache-Control": "max-age=86400"}
            return self._send(200, "image/png", _there(shown.face(found[1])), kept)
        if found := re.fullmatch(r"below/(\d{1,2})/(\d{1,8})/(\d{1,8})", path):
            return self._tile(*(int(number) for number in found.groups()))
        if path.startswith("out/"):
            return self._file(path.removeprefix("out/"))
        return self._send(200, *_there(_asset(path)))

    def _post(self, path: str) -> None:
        act = {
            "api/review": self.server.reviewing.add,
            "api/place": self.server.reviewing.preview,
        }.get(path)
        if act is None:
            raise guard.RefusedError(404, "there is nothing to write")
        if self.headers.get_content_type() != "application/json":
            raise guard.RefusedError(415, "send JSON")
        length = _number(self.headers.get("Content-Length") or "")
        if length > _BODY_LIMIT:
            raise guard.RefusedError(413, "that is too long")
        try:
            sent = parse_json(self.rfile.read(length))
        except ValueError:
            raise ValueError("it is no JSON") from None
        self._json(act(sent))

    def _tile(self, zoom: int, x: int, y: int) -> None:
        """A tile of the background; an empty answer where it has none."""
        below = _there(self.server.shown.background)
        there = zoom <= MOST_ZOOM and max(x, y) < 2**zoom
        data = below.tile(zoom, x, y) if there else None
        kind = None if data is None else content_type(data)
        if data is None or kind is None:
            return self._send(204, "image/png", b"")
        self._send(200, kind, data, {"Cache-Control": "max-age=86400"})

    def _drive(self, number: str) -> Any:
        drives = self.server.shown.drives
        return _there(drives[int(number)] if int(number) < len(drives) else None)

    def _file(self, relative: str) -> None:
        """A file of the map's folder: the report and pictures shown, others to be saved."""
        path = guard.inside(self.server.shown.out, relative)
        data = path.read_bytes()
        if path.name == names.REPORT:
            policy = {"Content-Security-Policy": guard.REPORT_POLICY}
            return self._send(200, _ASSETS[".html"], data, policy)
        policy = {"Content-Security-Policy": "sandbox; default-src 'none'"}
        kind = _SHOWN.get(path.suffix.lower())
        if kind is None:
            policy["Content-Disposition"] = "attachment"
        return self._send(200, kind or "application/octet-stream", data, policy)

    def _json(self, value: Any) -> None:
        data = json.dumps(plain(value), allow_nan=False, separators=(",", ":")).encode()
        self._send(200, "application/json", data)

    def _send(
        self, status: int, kind: str, data: bytes, headers: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        for name, value in {**guard.HEADERS, **(headers or {})}.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged: their addresses hold the token."""


def _there(value: Any) -> Any:
    if value is None:
        raise guard.RefusedError(404, "there is nothing of that name")
    return value


def _number(text: str, signed: bool = False) -> int:
    if not re.fullmatch(r"-?\d{1,9}" if signed else r"\d{1,9}", text):
        raise ValueError("a number is missing")
    return int(text)


def _page(token: str) -> Answer:
    kind, data = _there(_asset("index.html"))
    return kind, data.replace(b"{{token}}", token.encode())


@lru_cache(maxsize=32)
def _asset(name: str) -> Answer | None:
    """A file of the page itself, by its plain name."""
    suffix = re.fullmatch(r"[a-z_]+(\.[a-z]+)", name)
    if suffix is None or suffix[1] not in _ASSETS:
        return None
    file = resources.files("pipeline") / "view" / "page" / name
    if not file.is_file():
        return None
    colours = colours_css().encode() if suffix[1] == ".css" else b""
    return _ASSETS[suffix[1]], colours + file.read_bytes()
