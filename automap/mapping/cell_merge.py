"""The signs of one cell, from what lies in it and round it.

Pure functions: what they give depends on what they are given and on nothing else, so that cells can
be merged by any number of processes, and again only where something changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.mapping.adjustment import Adjusted, ErrorLevels, adjust, own_variance
from automap.mapping.association import Association, renumbered
from automap.mapping.attributes import Attributes, combine_attributes
from automap.mapping.existence import Chances, chances
from automap.mapping.sightings import Sightings
from automap.mapping.visibility import Passage, opportunities
from automap.records import FloatArray, IntArray

PLACE_MARGIN_M = 100.0
"""Round a cell, what its signs' places are told from: the margin of a tile (``MARGIN_M``), and how
far the sightings of one sign may lie from it."""


@dataclass(frozen=True)
class PlacedCell:
    """Signs [m] of a cell: where they are, what they inherit, and who saw them.

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


def place_cell(
    near: Sightings,
    sign: IntArray,
    passages: Sequence[Passage],
    cell: int,
    levels: ErrorLevels,
    factors: FloatArray | None = None,
) -> PlacedCell:
    """Places and attributes of the signs that stand in ``cell``.

    ``near`` [n] the sightings within ``PLACE_MARGIN_M`` of the cell and ``sign`` [n] whose each is
    (-1 nobody's); ``passages`` [d] where each drive's cameras looked, whose paths are thinned;
    ``factors`` [d, 3] of each drive on the levels.
    """
    rows = np.flatnonzero(sign >= 0)
    grouped, group = near.at(rows), renumbered(sign[rows])
    nothing = np.zeros((len(rows), 3))
    whole = adjust(
        grouped, Association(group, nothing, nothing), levels, only={cell}, factors=factors
    )
    standing = np.isfinite(whole.lat)
    rows = np.flatnonzero(standing[group]) if len(group) else np.zeros(0, np.int64)
    own = grouped.at(rows)
    place = (np.cumsum(standing) - 1)[group[rows]]
    columns = {name: getattr(whole, name)[standing] for name in ("lat", "lon", "height", "cov_enu")}
    adjusted = replace(whole, **columns, offset=whole.offset[rows])
    attributes = combine_attributes(own, place)
    views = opportunities(passages, adjusted.lat, adjusted.lon, attributes.facing_rad, 1)
    founder = np.unique(place, return_index=True)[1]
    return PlacedCell(
        own, place, founder, adjusted, attributes,
        chances(place, own.drive, views, own.existence), own_variance(own, place),
    )  # fmt: skip
