"""Which sightings are one sign, cell by cell.

Each cell is looked at with a halo round it, wide enough that the offsets of the drives in it are
as good as with the whole map. A cell keeps the signs that its own sightings belong to. Cells that
touch are looked at one after another in an order fixed by their place, and take of what lies in
their halo only what those before them left, so that every sighting is in one sign of one cell.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from automap.mapping.adjustment import offsets_of
from automap.mapping.association import associate, renumbered
from automap.mapping.cells import cell_of, colour_of, meets, squares
from automap.mapping.limits import HALO_M, ROUNDS, SETTLED_SHARE
from automap.mapping.sightings import Sightings
from automap.records import BoolArray, IntArray


def joined_signs(near: Sightings) -> IntArray:
    """The signs [n] of the sightings ``near`` [n].

    Each drive that founds signs gives the map a frame of its own, and where two of these meet no
    offset of a third fits both: so each drive is laid over the map of all others again, now placed
    by all drives together, until hardly a sign is of other sightings than before. Of signs that
    were founded twice one is left then.
    """
    sign = associate(near)
    for _ in range(ROUNDS):
        before, sign = sign, associate(near, sign, offsets_of(near, sign))
        # where a sign is of several of before, or one of before is several now, pairs are more
        pairs = len(np.unique(np.column_stack([before, sign]), axis=0))
        if pairs <= (1.0 + SETTLED_SHARE) * (1 + min(before.max(initial=-1), sign.max(initial=-1))):
            break
    return sign


def group_cell(near: Sightings, own: BoolArray, free: BoolArray) -> IntArray:
    """The signs [n] of one cell (-1: in none of it), from the sightings ``near`` [n] it: those of
    it, ``own`` [n], and of its halo. ``free`` [n] are in no sign of another cell yet."""
    found = joined_signs(near)
    return np.where(free & np.isin(found, found[own & free]), found, -1)


def associate_by_cells(
    sightings: Sightings, progress: Callable[[float], None] = lambda fraction: None
) -> IntArray:
    """The signs [n] of all sightings; neither their order nor that of the cells matters."""
    n = len(sightings)
    sign = np.full(n, -1, np.int64)
    home = cell_of(sightings.lat, sightings.lon)
    around = squares(sightings.lat, sightings.lon, HALO_M)
    count, done = 0, 0
    for k in sorted(np.unique(home).tolist(), key=lambda k: (colour_of(k), k)):
        rows = np.flatnonzero(meets(k, around))
        own = home[rows] == k
        found = group_cell(sightings.at(rows), own, sign[rows] < 0)
        given = found >= 0
        sign[rows[given]] = count + found[given]
        count += int(found.max()) + 1
        done += int(own.sum())
        progress(done / n)
    return renumbered(sign)
