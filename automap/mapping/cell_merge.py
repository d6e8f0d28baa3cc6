"""The signs of a map, or of one cell of it from what lies in it and round it.

Pure functions: what they give depends on what they are given and on nothing else, so that cells can
be merged by any number of processes, and again only where something changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.mapping.adjustment import Adjusted, adjust, own_variance, rough_places
from automap.mapping.association import renumbered
from automap.mapping.attributes import Attributes, combine_attributes
from automap.mapping.cells import cell_of
from automap.mapping.existence import Chances, chances
from automap.mapping.sightings import Sightings
from automap.mapping.visibility import STRIDE, Passage, PathErrors, opportunities
from automap.records import FloatArray, IntArray

PLACE_MARGIN_M = 100.0
"""Round a cell, what its signs' places are told from: the margin of a tile (``MARGIN_M``), and how
far the sightings of one sign may lie from it."""


@dataclass(frozen=True, kw_only=True)
class PlacedSigns:
    """Signs [m]: where they are, what they inherit, and who saw them.

    ``sightings`` [n] of them and ``sign`` [n] whose each is; ``founder`` [m] the row of the first;
    ``pairs`` of signs and drives; ``own_variance`` [m] m^2 per level axis of what is a sign's own
    error. Drives have the numbers that the sightings had.
    """

    sightings: Sightings
    sign: IntArray
    founder: IntArray
    adjusted: Adjusted
    attributes: Attributes
    pairs: Chances
    own_variance: FloatArray

    def __len__(self) -> int:
        return len(self.founder)


def place_signs(
    near: Sightings,
    sign: IntArray,
    passages: Sequence[Passage],
    levels: FloatArray,
    factors: FloatArray | None = None,
    cell: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> PlacedSigns:
    """Places and attributes of all signs, or of those that stand in ``cell``.

    ``near`` [n] all sightings, or those within ``PLACE_MARGIN_M`` of the cell, and ``sign`` [n]
    whose each is (-1 nobody's); ``passages`` [d] where each drive's cameras looked, whose paths
    are thinned for a cell; ``factors`` [d, 3] of each drive on the levels.
    """
    rows = np.flatnonzero(sign >= 0)
    grouped, group = near.at(rows), renumbered(sign[rows])
    only = None if cell is None else {cell}
    whole = adjust(grouped, group, levels, progress, only, factors)
    standing = np.isfinite(whole.lat)
    rows = np.flatnonzero(standing[group]) if len(group) else np.zeros(0, np.int64)
    own = grouped.at(rows)
    place = (np.cumsum(standing) - 1)[group[rows]]
    columns = {name: getattr(whole, name)[standing] for name in ("lat", "lon", "height", "cov_enu")}
    adjusted = replace(whole, **columns, offset=whole.offset[rows])
    attributes = combine_attributes(own, place)
    stride = STRIDE if cell is None else 1
    home = cell_of(*rough_places(grouped, group))[standing] if len(group) else place
    off = PathErrors(home, place, own.drive, own.time_s, adjusted.offset[:, :2])
    views = opportunities(passages, adjusted.lat, adjusted.lon, attributes.facing_rad, stride, off)
    return PlacedSigns(
        sightings=own, sign=place, founder=np.unique(place, return_index=True)[1],
        adjusted=adjusted, attributes=attributes,
        pairs=chances(place, own.drive, views, attributes.facing_rad, own.existence),
        own_variance=own_variance(own, place),
    )  # fmt: skip
