"""Drives put on the list of a store."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from automap.errors import InputError
from automap.io import names
from pipeline.fleet.places import Place, place_at
from pipeline.fleet.store import DRIVE, REPLACED, Store

WHOLE_BYTES, END_BYTES = 64 << 20, 1 << 20
"""A file up to so large is digested whole: logs and boxes. Of a larger one, a video, its size and
its two ends are: to read a terabyte of them over a network takes hours."""


@dataclass(frozen=True)
class Added:
    """Digests of drives that are ``new``, that take the place of another (``replaced``), how many
    were ``known``, and sentences about those left out."""

    new: list[str]
    replaced: list[str]
    known: int
    warnings: list[str]


def add(store: Store, patterns: Sequence[str]) -> Added:
    """Put drive folders on the list; nothing is read but what names them.

    ``patterns`` are folders, patterns of folders, or addresses of an object store, of which a
    last part ``*`` stands for all that is there. A drive whose files have changed since it was
    added takes its own place. Raises InputError where not one drive is found.
    """
    entries = store.entries()
    known = {entry.digest: entry for entry in entries}
    by_path = {entry.path: entry for entry in entries if not entry.replaced}
    added = Added([], [], 0, [])
    again = 0
    for path in _found(patterns, added.warnings):
        place, name = parent_of(path)
        files = [
            (file, size)
            for file, size in place.files(name)
            if not file.startswith(f"{names.DEFAULT_OUT}/")
        ]
        if not any(file == names.MANIFEST for file, _ in files):
            added.warnings.append(f"left out: {path} holds no {names.MANIFEST}.")
            continue
        digest = digest_of(place, name, files)
        older = by_path.get(path)
        if digest in known and not known[digest].replaced:
            again += 1
            if older is None and not _is_there(known[digest].path):
                # it was moved
                _write(store, digest, path, files)
            continue
        _write(store, digest, path, files)
        if digest in known:
            store.unmark(digest, REPLACED)
        if older is not None and older.digest != digest:
            store.mark(older.digest, REPLACED, {"by": digest})
            added.replaced.append(digest)
        else:
            added.new.append(digest)
        known[digest] = by_path[path] = store.entry(digest)
    if not again and not added.new and not added.replaced:
        raise InputError(added.warnings[0] if added.warnings else "no drive was named.")
    return Added(added.new, added.replaced, again, added.warnings)


def check_there(patterns: Sequence[str]) -> None:
    """Raise InputError where not one folder is found: no store is to be made for it."""
    told: list[str] = []
    if patterns and not _found(patterns, told):
        raise InputError(told[0])


def digest_of(place: Place, name: str, files: Sequence[tuple[str, int]]) -> str:
    """A drive's name in the store, from names, sizes and content of its files."""
    whole = hashlib.sha256()
    for file, size in files:
        whole.update(f"{file}\0{size}\0".encode("utf-8", "surrogateescape"))
        with place.open(f"{name}/{file}") as stream:
            if size <= WHOLE_BYTES:
                while block := stream.read(END_BYTES):
                    whole.update(block)
            else:
                whole.update(stream.read(END_BYTES))
                stream.seek(size - END_BYTES)
                whole.update(stream.read(END_BYTES))
    return whole.hexdigest()[:20]


def _write(store: Store, digest: str, path: str, files: Sequence[tuple[str, int]]) -> None:
    store.mark(digest, DRIVE, {"path": path, "bytes": sum(size for _, size in files)})


def _found(patterns: Sequence[str], warnings: list[str]) -> list[str]:
    found: list[str] = []
    for pattern in patterns:
        if "://" in pattern:
            folder, _, last = pattern.rstrip("/").rpartition("/")
            inside = place_at(folder).names("") if last == "*" else [last]
            paths = [f"{folder}/{name}" for name in inside]
        else:
            here = [pattern] if Path(pattern).exists() else sorted(glob.glob(pattern))
            whole = [Path(path) for path in here]
            whole = [path.parent if path.name == names.MANIFEST else path for path in whole]
            paths = [str(path.resolve()) for path in whole if path.is_dir()]
        if not paths:
            warnings.append(f"{pattern}: there is no such drive folder.")
        found += paths
    return list(dict.fromkeys(found))


def parent_of(path: str) -> tuple[Place, str]:
    """Where a drive lies, and its name there."""
    folder, _, name = path.rstrip("/").rpartition("/")
    return place_at(folder or "/"), name


def _is_there(path: str) -> bool:
    place, name = parent_of(path)
    return bool(place.names(name))
