"""Versions of a store's map: written aside, then published in one step.

In a folder ``map`` is a link to ``maps/NNNNNN`` that is put in place of the older link; on an
object store ``map.json`` names the version. Who reads an older one goes on undisturbed: it stays
until the next but one.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from automap.io import names
from automap.io.atomic import make_folder
from pipeline.fleet.store import Store

MAP, MAPS, POINTER = "map", "maps", "map.json"
_ASIDE = ".new"


def current(store: Store) -> str:
    """The version that is published, as ``000012``; "" where there is none."""
    if store.place.folder is not None:
        link = store.place.folder / MAP
        return Path(os.readlink(link)).name if link.is_symlink() else ""
    return str(store.read(POINTER).get("version", ""))


@contextmanager
def current_map(store: Store) -> Iterator[Path | None]:
    """The folder of the published map on this machine, None where there is none."""
    version = current(store)
    if not version:
        yield None
    elif store.place.folder is not None:
        yield store.place.folder / MAPS / version
    else:
        with tempfile.TemporaryDirectory(prefix="automap-fleet-map.") as folder:
            store.place.get(f"{MAPS}/{version}", Path(folder))
            yield Path(folder)


@contextmanager
def new_map(store: Store) -> Iterator[tuple[Path, str]]:
    """A folder to write a map into, and the version that it becomes; left without an exception it
    is published."""
    before = current(store)
    version = f"{int(before or 0) + 1:06d}"
    if store.place.folder is None:
        with tempfile.TemporaryDirectory(prefix="automap-fleet-map.") as folder:
            yield Path(folder), version
            for path in sorted(p for p in Path(folder).rglob("*") if p.is_file()):
                name = path.relative_to(folder).as_posix()
                store.place.put(path, f"{MAPS}/{version}/{name}")
            store.write(POINTER, {"version": version, "map": f"{MAPS}/{version}"})
        _remove_others(store, {before, version})
        return
    root = store.place.folder
    aside, whole = root / MAPS / _ASIDE, root / MAPS / version
    shutil.rmtree(aside, ignore_errors=True)
    # of an attempt that was ended just before it was published
    shutil.rmtree(whole, ignore_errors=True)
    make_folder(aside)
    try:
        review = root / MAPS / before / names.REVIEW
        if before and review.is_file():
            # what a reviewer decided about the older map
            shutil.copyfile(review, aside / names.REVIEW)
        yield aside, version
        store.present()
        _sync(aside)
        os.rename(aside, whole)
        link = root / f".{MAP}.new"
        link.unlink(missing_ok=True)
        link.symlink_to(Path(MAPS) / version)
        os.replace(link, root / MAP)
        _sync(root)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    _remove_others(store, {before, version})


def _remove_others(store: Store, kept: set[str]) -> None:
    for name in store.place.names(MAPS):
        if name not in kept:
            store.place.remove(f"{MAPS}/{name}")


def _sync(folder: Path) -> None:
    """Files and names outlast a loss of power."""
    for path in (folder, *(folder.rglob("*") if folder.name == _ASIDE else ())):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
