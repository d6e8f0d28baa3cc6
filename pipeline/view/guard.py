"""Who may ask the page's server for what.

The server listens on this machine only, but any page in the user's browser, and any user of the
machine, can reach that. So every request must carry the token of this session and be meant for
this host by name (a foreign name that was made to point here is refused), and no path leads
out of the output folder.
"""

from __future__ import annotations

import errno
import hmac
import secrets
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

HOSTS = ("127.0.0.1", "localhost")

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
"""Sent with every answer."""

REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data:"
)
"""For a page that is shown but not trusted: it runs as a stranger to this one."""


class RefusedError(Exception):
    """A request that is not answered; ``status`` is the HTTP status."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


def new_token() -> str:
    """A token that cannot be guessed."""
    return secrets.token_urlsafe(24)


def check_host(host: str | None, port: int) -> None:
    """Refuse a request for another host name or port."""
    if host not in {f"{name}:{port}" for name in HOSTS}:
        raise RefusedError(403, "this server answers on its own address only")


def check_origin(origin: str | None, port: int) -> None:
    """Refuse a request that another site's page made; a browser names the site."""
    if origin is not None and origin not in {f"http://{name}:{port}" for name in HOSTS}:
        raise RefusedError(403, "another site's page may not ask")


def checked_path(target: str, token: str) -> str:
    """The path asked for, without the token: "" for the page itself.

    The token is ``?token=`` of the page's address or the first part of the path. Refuses
    everything without it, comparing in constant time.
    """
    parts = urlsplit(target)
    first, _, rest = parts.path.lstrip("/").partition("/")
    if first == "" and not rest:
        given, path = parse_qs(parts.query).get("token", [""])[0], ""
    else:
        given, path = unquote(first), unquote(rest)
    if not hmac.compare_digest(given.encode("utf-8", "replace"), token.encode()):
        raise RefusedError(
            403, "the address lacks this session's token; take the one that was printed"
        )
    return path


def inside(folder: Path, relative: str) -> Path:
    """A file of ``folder`` by its relative path; refuses one that leads out of it, by links too."""
    if "\0" in relative or "\\" in relative or Path(relative).is_absolute():
        raise RefusedError(403, "the path leads out of the map's folder")
    root = folder.resolve()
    try:
        path = (root / relative).resolve()
        found = path.is_file()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        raise RefusedError(404, "there is no such file") from None
    if not path.is_relative_to(root):
        raise RefusedError(403, "the path leads out of the map's folder")
    if not found:
        raise RefusedError(404, "there is no such file")
    return path
