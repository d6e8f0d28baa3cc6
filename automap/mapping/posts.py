"""Which signs of a merged map are on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import local_ned
from automap.mapping.supports import support_numbers
from automap.records import FloatArray, Sign
from automap.records.sign_lists import changed, numbers_of, values_of


def with_supports(signs: Sequence[Sign], own_variance: FloatArray) -> Sequence[Sign]:
    """The signs [m] of a map, those of it (with a name) with their supports, by the same rule as
    within a drive, named after the first of their signs' names. ``own_variance`` [m] m^2 per level
    axis of what is a sign's own error: neighbours have the offsets of their drives in common."""
    ids = values_of(signs, "id")
    rows = [k for k, name in enumerate(ids) if name]
    if not rows:
        return signs
    lat, lon, height = (v[rows] for v in numbers_of(signs, "lat_rad", "lon_rad", "height_m"))
    height = np.nan_to_num(height)
    origin = (float(np.median(lat)), float(np.median(lon)), float(np.median(height)))
    own, side = own_variance[rows], values_of(signs, "side")
    numbers = support_numbers(
        local_ned(lat, lon, height, origin).reshape(-1, 3),
        own[:, None, None] * np.eye(3),
        [side[k] == "overhead" for k in rows],
    )
    # by a number the post of every sign would be another one where a sign comes
    first: dict[int, str] = {}
    for k, number in zip(rows, numbers, strict=True):
        first[number] = min(ids[k], first.get(number, ids[k]))
    support = list(values_of(signs, "support"))
    for k, number in zip(rows, numbers, strict=True):
        support[k] = f"p{first[number]}"
    return changed(signs, support=support)
