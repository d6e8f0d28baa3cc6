"""A store's map of before, as far as the next one is compared with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.io import names
from automap.io.map_tables import COVERAGE, SIGHTINGS, read_coverage
from automap.io.signs_table import read_sign_list
from automap.io.tables import column_by_column
from automap.mapping.changes import OlderMap
from automap.mapping.visibility import Passage
from automap.records import IntArray
from automap.records.sign_lists import values_of
from pipeline.fleet.contents import result_folder
from pipeline.fleet.store import Entry, Store
from pipeline.merge.cell_map import StoreMap
from pipeline.merge.cell_steps import members
from pipeline.merge.cell_store import Drives
from pipeline.merge.inputs import read_run

_PASSAGE = (
    names.RUN, names.SYNC, names.SIGNS_RAW, names.TRAJECTORY_ADJUSTED, names.TRAJECTORY,
    names.OBSERVATIONS,
)  # fmt: skip


@dataclass(frozen=True)
class Before:
    """The older map: its folder, version and merge.json."""

    folder: Path
    version: str
    summary: Mapping[str, Any]


@dataclass(frozen=True)
class Older:
    """The older map, its sightings [n] by their ``name`` in the cells, ascending, and the place of
    each one's sign among the map's."""

    map: OlderMap
    name: IntArray
    sign: IntArray


def read_older(before: Before, drives: Drives) -> Older:
    """The older map; its drives' numbers may have been others."""
    signs = read_sign_list(before.folder / names.SIGNS_RAW)
    number = {key: k for k, key in enumerate(drives.key)}
    place = {name: k for k, name in enumerate(values_of(signs, "id"))}
    columns = ("drive_key", "drive_row", "sign_id")
    # of ten million sightings no two columns of texts at once
    with column_by_column(before.folder / SIGHTINGS, columns) as (_, column):
        drive = _coded(column("drive_key")["drive_key"], number)
        sign = _coded(column("sign_id")["sign_id"], place)
        row = np.asarray(column("drive_row")["drive_row"].to_numpy(), np.int64)
    name = drive << 32 | row
    rows = np.flatnonzero((drive >= 0) & (sign >= 0))
    rows = rows[np.argsort(name[rows], kind="stable")]
    known = frozenset(str(drive["key"]) for drive in before.summary["drives"])
    coverage = read_coverage(before.folder / COVERAGE)
    return Older(OlderMap(signs, {}, known, coverage), name[rows], sign[rows])


def _coded(column: Any, code: Mapping[str, int]) -> IntArray:
    """A column of texts as numbers, -1 for what has none."""
    texts = column.combine_chunks().dictionary_encode()
    of_text = np.array([code.get(text, -1) for text in texts.dictionary.to_pylist()] + [-1])
    return np.asarray(of_text[texts.indices.fill_null(len(of_text) - 1).to_numpy()], np.int64)


def shared_with(older: Older, cells: Path, found: StoreMap) -> dict[tuple[int, int], int]:
    """Sightings that signs have in common with signs of the older map."""
    shared: dict[tuple[int, int], int] = {}
    if not len(older.name):
        return shared
    for cell in members(cells, found.homes):
        at = np.minimum(np.searchsorted(older.name, cell.name), len(older.name) - 1)
        same = older.name[at] == cell.name
        pairs, count = np.unique(cell.sign[same] << 32 | older.sign[at[same]], return_counts=True)
        named = zip((pairs >> 32).tolist(), (pairs & 0xFFFFFFFF).tolist(), strict=True)
        shared.update(zip(named, count.tolist(), strict=True))
    return shared


def fresh_drives(
    store: Store, entries: Mapping[str, Entry], older: Older, drives: Drives
) -> Iterator[tuple[int, Passage]]:
    """The drives that the older map did not have, one after another."""
    for number, key in enumerate(drives.key):
        if key not in older.map.drives:
            with result_folder(store, entries[key], _PASSAGE) as folder:
                yield number, read_run(folder).signs
