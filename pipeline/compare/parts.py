"""Parts of a list that lie elsewhere than the rest: what is said of them and what rests on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import ecef
from automap.inventory.comparison import InventoryComparison
from automap.inventory.findings import Inventory
from automap.records import BoolArray, Sign


def displaced(
    result: InventoryComparison, signs: Sequence[Sign], listed: Inventory
) -> list[tuple[str, Sequence[int]]]:
    """A sentence for each part, and the findings that rest on any."""
    parts = result.parts
    if not parts.displaced.any():
        return []
    told = []
    for k in range(1, len(parts.way)):
        own = np.flatnonzero(parts.part == k)
        if len(own):
            east, north = parts.way[k].tolist()
            ids = [str(listed.ids[j]) for j in own.tolist()]
            told.append(
                f"{len(own)} of its entries, from {ids[0]} to {ids[-1]} in its order, are listed "
                f"{np.hypot(east, north):.1f} m from where the others' positions would put them "
                f"({-east:+.1f} m east, {-north:+.1f} m north): they may be of another source or "
                "datum, or the map is off there by more than it states. They are compared without "
                "that; nothing that rests on them, or on entries among them, is for work."
            )
    rows = _resting_on(result, signs, listed)
    return [(text, rows if k == 0 else ()) for k, text in enumerate(told)]


def _resting_on(result: InventoryComparison, signs: Sequence[Sign], listed: Inventory) -> list[int]:
    """Findings of entries of parts that lie elsewhere and of such as are listed, or stand, among
    them, and what is new among them."""
    parts = result.parts
    order = np.arange(len(listed), dtype=np.float64)[:, None]
    place = ecef(listed.lat_rad, listed.lon_rad, np.zeros(len(listed)))
    # a part may be pages of the list, or a place, or both mixed
    among = np.minimum(parts.about(order, order), parts.about(place, place)) > 0.0
    doubtful: BoolArray = parts.displaced | ((parts.part < 0) & among)
    new = [k for k, f in enumerate(result.findings) if f.listed < 0]
    found = [signs[result.findings[k].sign] for k in new]
    there = ecef(
        np.array([s.lat_rad for s in found]), np.array([s.lon_rad for s in found]),
        np.zeros(len(found)),
    )  # fmt: skip
    # one that the list lacks may be any of those about it
    new_among = parts.about(there, place) > 0.0
    rows = [k for k, f in enumerate(result.findings) if f.listed >= 0 and doubtful[f.listed]]
    return rows + [k for k, is_among in zip(new, new_among.tolist(), strict=True) if is_among]
