"""A store of sightings merged to one map, by one process or several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.mapping.existence import Chances, DetectionRates
from automap.mapping.merge import map_signs, weighed
from automap.records import FloatArray
from automap.records.sign_lists import Names, SignList
from pipeline.merge.cell_belief import kept_belief
from pipeline.merge.cell_steps import (
    group,
    levels_of,
    place,
    placed_cells,
    standing,
    turns,
    weigh,
)
from pipeline.merge.cell_store import Drives, read_drives
from pipeline.shared.beside import processes


@dataclass(frozen=True)
class StoreMap:
    """Signs [m] of a store: ``founder`` [m] keys that name them, places as ``Adjusted`` has them,
    ``existence`` [m], ``columns`` with all others, ``pairs`` of signs and drives, the ``homes``
    that hold them, in the order of the signs; ``factors`` [d, 3] of drives on the ``levels``;
    and how many cells were grouped and placed anew, of how many."""

    founder: list[str]
    lat: FloatArray
    lon: FloatArray
    height: FloatArray
    cov_enu: FloatArray
    existence: FloatArray
    columns: dict[str, Any]
    pairs: Chances
    homes: Sequence[int]
    levels: FloatArray
    factors: FloatArray
    rates: DetectionRates
    grouped: int
    placed: int
    cells: int

    def signs(self, drives: Drives) -> SignList:
        """The signs [m], still without names."""
        edges = np.concatenate([[0], np.cumsum(self.columns["n_drives"])])
        who = Names(drives.name, self.columns["seen_by"], edges)
        return map_signs(self.columns, self.existence, who)


def merge_store(
    folder: Path,
    workers: int = 1,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
    least_existence: float = 0.5,
) -> StoreMap:
    """Do what of the merge is not done yet; the same map whatever the number of processes. Signs of
    ``least_existence`` are on it."""
    if workers > 1:
        with processes(workers) as pool:
            return _merge(folder, pool.map, progress, least_existence)
    return _merge(folder, map, progress, least_existence)


def _merge(
    folder: Path,
    over: Callable[..., Iterable[Any]],
    progress: Callable[[float, str], None],
    least_existence: float,
) -> StoreMap:
    waves = turns(folder)
    cells = sum(len(wave) for wave in waves)
    grouped = 0
    done = 0
    for wave in waves:
        for changed in over(group, [folder] * len(wave), wave):
            grouped += changed
            done += 1
            progress(0.5 * done / cells, "which sightings are one sign")
    wanted = standing(folder)
    every = [folder] * len(wanted), wanted
    for done, _ in enumerate(over(weigh, *every)):
        progress(0.5 + 0.1 * done / len(wanted), "how large the errors are")
    levels, factors = levels_of(folder, wanted)
    placed = 0
    found = [levels] * len(wanted), [factors] * len(wanted)
    for done, changed in enumerate(over(place, *every, *found)):
        placed += changed
        progress(0.6 + 0.3 * done / len(wanted), "where signs stand")
    progress(0.9, "which signs are there")
    return _whole(folder, wanted, levels, factors, (grouped, placed, cells), least_existence)


def _whole(
    folder: Path,
    cells: list[int],
    levels: FloatArray,
    factors: FloatArray,
    done: tuple[int, int, int],
    least_existence: float,
) -> StoreMap:
    drives = read_drives(folder)
    columns, pairs, homes = placed_cells(folder, cells)
    rates, belief, columns["n_back_views"] = weighed(columns, pairs, drives.start_gps_s)
    belief = kept_belief(folder, homes, belief, least_existence)
    place = (columns["lat"], columns["lon"], columns["height"], columns["cov_enu"])
    keys = [
        f"{drives.key[number >> 32]}|{name}"
        for number, name in zip(
            columns["founder"].tolist(), columns["founder_id"].tolist(), strict=True
        )
    ]
    return StoreMap(keys, *place, belief, columns, pairs, cells, levels, factors, rates, *done)
