"""Drives put on the list of a store."""

from __future__ import annotations

import glob
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from automap.errors import InputError
from automap.io import names
from pipeline.fleet.places import Place, place_at
from pipeline.fleet.store import DRIVE, REPLACED, Entry, Store

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
    known = {entry.digest: entry for entry in store.entries()}
    by_path: dict[str, list[str]] = {}
    for entry in known.values():
        if entry.path and not entry.replaced:
            by_path.setdefault(entry.path, []).append(entry.digest)
    added = Added([], [], 0, [])
    again = 0
    looked = _looked_at(_found(patterns, added.warnings), added.warnings)
    here = {digest for digest, _ in looked.values()}
    for path, (digest, size) in looked.items():
        listed = digest in known and not known[digest].replaced
        if not listed or _moved(known[digest], path, looked):
            store.mark(digest, DRIVE, {"path": path, "bytes": size})
        if digest in known and not listed:
            store.unmark(digest, REPLACED)
        # not one that lies under another name now
        older = [one for one in by_path.get(path, []) if one not in here]
        for one in older:
            store.mark(one, REPLACED, {"by": digest})
        if listed:
            # after an end between the two markers the older one is marked only now
            again += 1
        else:
            (added.replaced if older else added.new).append(digest)
        known[digest] = store.entry(digest)
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


def _looked_at(paths: Sequence[str], warnings: list[str]) -> dict[str, tuple[str, int]]:
    """Digests and bytes of the drives at ``paths``; a sentence on each that is none, or of which a
    file cannot be read."""
    looked: dict[str, tuple[str, int]] = {}
    for path in paths:
        place, name = parent_of(path)
        try:
            if names.MANIFEST not in place.names(name):
                warnings.append(f"left out: {path} holds no {names.MANIFEST}.")
                continue
            files = [
                (file, size)
                for file, size in place.files(name)
                if not file.startswith(f"{names.DEFAULT_OUT}/")
            ]
            looked[path] = digest_of(place, name, files), sum(size for _, size in files)
        except OSError as error:
            if place.folder is None:
                # the network, and then so will all others
                raise
            where = error.filename or path
            warnings.append(
                f"left out: {where} cannot be read ({error.strerror or error}); add {path} again "
                "once it can."
            )
    return looked


def _moved(entry: Entry, path: str, looked: Mapping[str, tuple[str, int]]) -> bool:
    """The drive is no more where the store has it, or the store has not where it is."""
    if entry.path == path:
        return False
    if entry.lost:
        return True
    if entry.path in looked:
        return looked[entry.path][0] != entry.digest
    place, name = parent_of(entry.path)
    return not place.names(name)


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
