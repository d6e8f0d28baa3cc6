"""Which sightings are one sign, cell by cell.

Each cell is looked at with a halo round it, wide enough that the offsets of the drives in it are
as good as with the whole map. A cell keeps the signs that its own sightings belong to. Cells that
touch are looked at one after another in an order fixed by their place, and take of what lies in
their halo only what those before them left, so that every sighting is in one sign of one cell.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from automap.mapping.association import Association, associate, renumbered
from automap.mapping.cells import cell_of, colour_of, groups, touched
from automap.mapping.duplicates import join_duplicates
from automap.mapping.limits import HALO_M
from automap.mapping.sightings import Sightings
from automap.records import BoolArray


def group_cell(near: Sightings, own: BoolArray, free: BoolArray) -> Association:
    """The signs of one cell, from the sightings ``near`` [n] it: those of it, ``own`` [n], and of
    its halo. ``free`` [n] are in no sign of another cell yet.

    Sightings that get no sign of this cell have -1; offsets are good for its own.
    """
    found = join_duplicates(near, associate(near))
    mine = np.zeros(found.n_signs, np.bool_)
    mine[found.sign[own & free]] = True
    sign = np.where(free & mine[found.sign], found.sign, -1)
    return Association(sign, found.offset, found.offset_var)


def associate_by_cells(
    sightings: Sightings, progress: Callable[[float], None] = lambda fraction: None
) -> Association:
    """Group all sightings into signs; neither their order nor that of the cells matters."""
    n = len(sightings)
    sign = np.full(n, -1, np.int64)
    offset, offset_var = np.zeros((n, 3)), np.zeros((n, 3))
    home = cell_of(sightings.lat, sightings.lon)
    row, cell = touched(sightings.lat, sightings.lon, HALO_M)
    occupied = set(np.unique(home).tolist())
    waiting = [(k, at) for k, at in groups(cell) if k in occupied]
    waiting.sort(key=lambda item: (colour_of(item[0]), item[0]))
    count, done = 0, 0
    for k, at in waiting:
        rows = row[at]
        own = home[rows] == k
        found = group_cell(sightings.at(rows), own, sign[rows] < 0)
        given = found.sign >= 0
        sign[rows[given]] = count + found.sign[given]
        count += found.n_signs
        offset[rows[own]], offset_var[rows[own]] = found.offset[own], found.offset_var[own]
        done += int(own.sum())
        progress(done / n)
    return Association(renumbered(sign), offset, offset_var)
