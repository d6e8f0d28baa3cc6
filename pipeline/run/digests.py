"""Content digests of files, remembered by size, times and inode so that each is read once."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from automap.io.atomic import write_json
from automap.io.json_text import parse_json

CACHE_FILE = ".digests.json"


class DigestCache:
    """SHA-256 of files; kept in OUT between runs, but only ever a shortcut to the content."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / CACHE_FILE
        self._known: dict[str, list[Any]] = {}
        self._changed = False
        try:
            stored = parse_json(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(stored, dict):
            self._known = {k: v for k, v in stored.items() if isinstance(v, list) and len(v) == 2}

    def digest(self, path: Path) -> str | None:
        """Hexadecimal digest of the file's content, None when there is no such file."""
        try:
            stat = path.stat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        if path.is_dir():
            return None
        identity = [stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino]
        name = str(path.absolute())
        known = self._known.get(name)
        if known is not None and known[0] == identity:
            return str(known[1])
        with path.open("rb") as stream:
            value = hashlib.file_digest(stream, "sha256").hexdigest()
        self._known[name] = [identity, value]
        self._changed = True
        return value

    def save(self) -> None:
        """Write what was learnt, leaving out files that are gone."""
        if self._changed:
            # of a name that cannot be it says no, where Path fails
            write_json(self._file, {k: v for k, v in self._known.items() if os.path.exists(k)})
            self._changed = False
