"""How large the errors of a store's drives are: from a draw of cells, once they are grouped."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from automap.io.atomic import write_json
from automap.mapping.adjustment import ErrorLevels, TileData
from automap.mapping.association import renumbered
from automap.mapping.error_levels import level_cells, level_tiles, levels_of_tiles
from automap.mapping.sightings import Sightings
from pipeline.merge.cell_files import stamp_of
from pipeline.merge.cell_parts import parts
from pipeline.merge.cell_steps import grouped
from pipeline.merge.cell_store import GROUPS, SIGHTINGS, occupied, read_drives
from pipeline.shared.values import json_object

LEVELS = "levels.json"
_FORMAT = "3"
"""What another version told is told again."""


def levels_of(folder: Path, over: Callable[..., Iterable[Any]] = map) -> ErrorLevels:
    """The levels that go with the groups as they are; cells are gone through as ``over`` does."""
    path = folder / LEVELS
    groups = f"{_FORMAT} {stamp_of([], sorted((folder / GROUPS).glob('*.npz')))}"
    told = json_object(path)
    if told.get("groups") == groups:
        return ErrorLevels(**told["levels"])
    found = _estimated(folder, over)
    write_json(path, {"groups": groups, "levels": vars(found)})
    return found


def _estimated(folder: Path, over: Callable[..., Iterable[Any]]) -> ErrorLevels:
    import pyarrow.parquet as pq

    cells = occupied(folder)
    count = [
        sum(pq.read_metadata(file).num_rows for file in parts(folder, SIGHTINGS, [cell]))
        for cell in cells.tolist()
    ]
    chosen, most = level_cells(cells, np.array(count, np.int64))
    found = over(_tiles, [folder] * len(chosen), chosen, [most] * len(chosen))
    return levels_of_tiles([tile for tiles in found for tile in tiles])


def _tiles(folder: Path, cell: int, most: int) -> list[tuple[Sightings, TileData]]:
    near, sign = grouped(folder, read_drives(folder), cell)
    rows = np.flatnonzero(sign >= 0)
    if not len(rows):
        return []
    return level_tiles(near.sightings.at(rows), renumbered(sign[rows]), cell, most)
