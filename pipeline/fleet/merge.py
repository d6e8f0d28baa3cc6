"""The drives of a store that are done made one map, which takes the older one's place."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap import __version__
from automap.errors import AutoMapError, InputError, StageError
from automap.io import names
from automap.io.atomic import make_folder
from automap.io.json_text import parse_json
from pipeline.fleet.contents import older_results, update_contents, version, wanted
from pipeline.fleet.orders import current_key
from pipeline.fleet.places import Place
from pipeline.fleet.store import Store
from pipeline.fleet.versions import current, current_map, new_map
from pipeline.shared.lock import locked
from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from automap.mapping.compare import Comparison

CELLS, CHANGES, HISTORY = "cells", "changes", "history.json"


@dataclass(frozen=True)
class FleetMap:
    """A merge: the ``version`` published, whether it is a ``new`` one, how many ``drives``,
    ``sightings`` and ``signs`` it has, cells of them that were merged anew, changes, warnings."""

    version: str
    new: bool
    drives: int
    sightings: int
    signs: int
    cells: tuple[int, int, int]
    comparison: Comparison | None
    warnings: list[str]
    seconds: float


def cells_folder(place: Place, scratch: Path | None = None) -> Path:
    """Where sightings by cells lie: in the store, of an object store on this machine."""
    if place.folder is not None:
        return place.folder / CELLS
    base = scratch or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "automap-fleet" / hashlib.sha256(place.url.encode()).hexdigest()[:16]


def merge(
    store: Store,
    workers: int = 1,
    least_existence: float = 0.5,
    scratch: Path | None = None,
    progress: Progress = lambda fraction, text: None,
    roads: Path | None = None,
) -> FleetMap:
    """Make the map of all drives that are done and publish it; nothing where it is that already.

    ``roads`` is a layer on which the signs get a place. What reviewers decided about the map since
    it was made makes it anew. Raises InputError where no drive is done
    or the layer is not there, ConfigError while another merge is at work.
    """
    from pipeline.fleet.older import Before
    from pipeline.fleet.publish import write_fleet_map
    from pipeline.fleet.tracks import has_tracks, keep_track
    from pipeline.merge.cell_map import merge_store

    started = time.monotonic()
    cells = make_folder(cells_folder(store.place, scratch))
    warnings: list[str] = []
    with _told(store), locked(cells):
        drives = wanted(store, warnings)
        if not drives:
            raise InputError(f"{store.place.url}: no drive is done; automap fleet run does them.")
        older = older_results(drives.values(), current_key(store))
        told = [f"{key} {version(drives[key])}" for key in sorted(drives)]
        with current_map(store) as folder:
            parts = [__version__, repr(least_existence), _digest(roads), _review(folder), *told]
            made_of = hashlib.sha256("\n".join(parts).encode()).hexdigest()
            summary = _summary(folder)
            if summary.get("made_of") == made_of:
                return FleetMap(
                    current(store), False, len(summary["drives"]), summary["sightings"],
                    summary["signs"], (0, 0, summary["cells"]), None,
                    [*older, *dict.fromkeys([*warnings, *summary["warnings"]])],
                    time.monotonic() - started,
                )  # fmt: skip
            named = update_contents(
                store, cells, drives, warnings,
                lambda done: progress(0.2 * done, "reading drives"), workers,
                partial(keep_track, store, cells) if has_tracks(store, len(drives)) else None,
            )  # fmt: skip
            drives = {key: drives[key] for key in named}
            if not drives:
                raise InputError(f"{store.place.url}: {warnings[0]}")
            found = merge_store(
                cells, workers, lambda done, text: progress(0.2 + 0.6 * done, text),
                least_existence,
            )  # fmt: skip
            before = None if folder is None else Before(folder, current(store), summary)
            with new_map(store) as (out, number):
                comparison = write_fleet_map(
                    out, store, cells, drives, found, before, least_existence, made_of, warnings,
                    lambda done: progress(0.8 + 0.2 * done, "writing"), roads, workers,
                )  # fmt: skip
                _keep_changes(store, out, number)
                summary = _summary(out)
    return FleetMap(
        number, True, len(drives), summary["sightings"], summary["signs"],
        (found.grouped, found.placed, found.cells), comparison,
        [*older, *summary["warnings"]], time.monotonic() - started,
    )  # fmt: skip


@contextmanager
def _told(store: Store) -> Iterator[None]:
    """What goes wrong because the store is gone as that."""
    try:
        yield
    except (AutoMapError, OSError):
        store.present()
        raise


def _file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _digest(roads: Path | None) -> str:
    """Of a layer of roads; "" without one."""
    if roads is None:
        return ""
    try:
        return _file_digest(roads)
    except OSError as error:
        raise InputError(
            f"--roads {roads} cannot be read ({error.strerror}); give a file of lines."
        ) from None


def _review(folder: Path | None) -> str:
    """A digest of what reviewers decided about the map, which the next one takes over."""
    try:
        return "" if folder is None else _file_digest(folder / names.REVIEW)
    except FileNotFoundError:
        return ""


def _summary(folder: Path | None) -> dict[str, Any]:
    if folder is None:
        return {}
    try:
        summary = parse_json((folder / names.MERGE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StageError(
            f"{folder / names.MERGE} cannot be read ({error}); remove the link 'map' and merge "
            "again."
        ) from None
    assert isinstance(summary, dict)
    return summary


def _keep_changes(store: Store, out: Path, number: str) -> None:
    """The list of changes outlasts the map that it led to."""
    from pipeline.merge.output import CHANGES as FILE

    store.present()
    if (out / FILE).is_file():
        store.place.put(out / FILE, f"{CHANGES}/{number}.geojson")
