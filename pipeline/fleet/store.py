"""What a store of a fleet holds, and where each drive stands: all of it in files.

``drives/DIGEST/`` has ``drive.json`` (where the drive lies), results in folders of their own, and
``done.json``, written last, which says which of these counts and what it was made from; or
``aside.json`` with the reason why it is left out. ``replaced.json`` names what came in its place.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from automap.errors import ConfigError, StageError
from automap.io.atomic import plain
from automap.io.json_text import parse_json
from pipeline.fleet.places import Place, place_at
from pipeline.shared.values import mapping, number

SCHEMA = "automap.fleet/1"
DRIVES, STORE, SETTINGS = "drives", "fleet.json", "settings.json"
DRIVE, DONE, ASIDE, REPLACED = "drive.json", "done.json", "aside.json", "replaced.json"
UNKNOWN = "unknown"
"""The successor of a drive whose marker is damaged; no digest."""
_READERS = 16
"""Small files read at once: over a network each takes some tens of milliseconds."""

State = Literal["waiting", "done", "aside", "replaced"]


@dataclass(frozen=True)
class Entry:
    """A drive of the store: its ``digest``, where it lies, its size in bytes, and what its
    markers say ({} where there is none); of one whose files have changed the digest of the drive
    that came in its place (``successor``)."""

    digest: str
    path: str
    size: int
    done: dict[str, Any] = field(default_factory=dict)
    aside: dict[str, Any] = field(default_factory=dict)
    successor: str = ""

    @property
    def replaced(self) -> bool:
        """Another drive came in its place."""
        return bool(self.successor)

    @property
    def name(self) -> str:
        """As its manifest has it once it is done, else that of its folder."""
        return str(self.done.get("name") or self.path.rstrip("/").rpartition("/")[2] or self.digest)

    @property
    def lost(self) -> str:
        """Where the drive lies is not known any more: what is told of that."""
        if self.path:
            return ""
        return (
            f"{DRIVES}/{self.digest}/{DRIVE} of the store is damaged, so where this drive lies is "
            "not known; add the drive again."
        )

    def state(self, key: str | None = None) -> State:
        """Where it stands; with a ``key`` of settings, done is only what was made with these, or
        what cannot be made anew."""
        if self.replaced:
            return "replaced"
        if self.aside:
            return "aside"
        if self.done and (key is None or self.done.get("key") == key or self.lost):
            return "done"
        return "waiting"


class StoreGoneError(StageError):
    """A store that was there and is not any more."""


def result_name(key: str) -> str:
    """The folder of a drive's results that settings of this ``key`` give: the same for every
    attempt, so that what one that was killed has left is written over with the same."""
    return key[:12]


@dataclass(frozen=True)
class Store:
    """A store at a place."""

    place: Place

    @staticmethod
    def at(url: str, make: bool = False) -> Store:
        """The store at ``url``; ConfigError where there is none, unless it is to be made."""
        place = place_at(url)
        told = _object(place.read(STORE))
        if not told and make:
            taken = place.names("")
            if taken:
                raise ConfigError(
                    f"{url} holds other files ({taken[0]}) and is no store of a fleet; name a "
                    "new folder."
                )
            place.write(STORE, _json({"schema": SCHEMA}))
        elif not told:
            raise ConfigError(
                f"{url} is no store of a fleet; automap fleet add {url} DRIVE... makes one."
            )
        elif told.get("schema") != SCHEMA:
            raise ConfigError(
                f"{url} was made by another version of automap ({told.get('schema')}); use that "
                "one, or make a new store."
            )
        return Store(place)

    def present(self) -> None:
        """StoreGoneError where the store in a folder is not there any more: without its mount the
        folder is empty, and what is written then would lie on this machine's disk."""
        if self.place.folder is None:
            return
        try:
            told = _object(self.place.read(STORE))
        except OSError:
            told = {}
        if not told:
            raise StoreGoneError(
                f"{self.place.url} is not there any more: its disk or network share has gone. Make "
                "it available again and run the same command; the map in it is as it was."
            )

    def digests(self) -> list[str]:
        """Digests of all drives that were ever added."""
        return self.place.names(DRIVES)

    def entry(self, digest: str) -> Entry:
        """A drive as its files tell it."""
        there = set(self.place.names(f"{DRIVES}/{digest}"))

        def told(name: str) -> dict[str, Any]:
            return self.read(f"{DRIVES}/{digest}/{name}") if name in there else {}

        drive, done = told(DRIVE), told(DONE)
        if not isinstance(done.get("key"), str) or str(done.get("result")) not in there:
            # its files were removed, or it is damaged
            done = {}
        path, size = str(drive.get("path", "")), int(number(drive.get("bytes")) or 0)
        successor = str(told(REPLACED).get("by") or UNKNOWN) if REPLACED in there else ""
        entry = Entry(digest, path, size, done, told(ASIDE), successor)
        if DRIVE in there and entry.lost and not done and not entry.aside:
            return replace(entry, aside={"kind": "store", "error": entry.lost})
        return entry

    def entries(self, digests: Iterable[str] | None = None) -> list[Entry]:
        """Drives in the order of their digests, all or some."""
        wanted = self.digests() if digests is None else sorted(digests)
        with ThreadPoolExecutor(_READERS) as pool:
            found = pool.map(self.entry, wanted)
            # a folder without any file is what a store of objects cannot have
            return [entry for entry in found if entry.path or entry.done or entry.aside]

    def read(self, name: str) -> dict[str, Any]:
        """A JSON object; {} where it is missing or damaged."""
        return _object(self.place.read(name))

    def write(self, name: str, value: dict[str, Any]) -> None:
        """Write a JSON object."""
        self.place.write(name, _json(value))

    def mark(self, digest: str, marker: str, value: dict[str, Any]) -> None:
        """Write a marker of a drive."""
        self.present()
        self.write(f"{DRIVES}/{digest}/{marker}", value)

    def unmark(self, digest: str, marker: str) -> None:
        """Take a marker of a drive away."""
        self.present()
        self.place.remove(f"{DRIVES}/{digest}/{marker}")

    def result(self, entry: Entry) -> str:
        """Where the files of a drive that is done lie."""
        return f"{DRIVES}/{entry.digest}/{entry.done['result']}"

    def leftovers(self, entries: Sequence[Entry], key: str) -> Iterator[str]:
        """Results that no marker names, of drives that are done: attempts that were killed, and
        what was replaced; but not those of ``key``, at which a worker may be just now."""
        for entry in entries:
            if entry.done:
                kept = {entry.done["result"], result_name(key), DRIVE, DONE, ASIDE, REPLACED}
                for name in self.place.names(f"{DRIVES}/{entry.digest}"):
                    if name not in kept:
                        yield f"{DRIVES}/{entry.digest}/{name}"


def _json(value: dict[str, Any]) -> bytes:
    return (json.dumps(plain(value), indent=1, allow_nan=False) + "\n").encode()


def _object(data: bytes | None) -> dict[str, Any]:
    try:
        return mapping(parse_json((data or b"").decode("utf-8")))
    except ValueError:
        return {}
