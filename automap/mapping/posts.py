"""Which signs of a merged map are on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.earth import local_ned
from automap.geolocation.supports import support_names
from automap.records import FloatArray, Sign
from automap.records.sign_lists import changed, values_of


def with_supports(signs: Sequence[Sign], own_variance: FloatArray) -> Sequence[Sign]:
    """The signs [m] of a map, those of it (with a name) with their supports, by the same rule as
    within a drive, named after the first of their signs' names. ``own_variance`` [m] m^2 per level
    axis of what is a sign's own error: neighbours have the offsets of their drives in common."""
    ids = values_of(signs, "id")
    rows = [k for k, name in enumerate(ids) if name]
    if not rows:
        return signs
    lat, lon, height = (
        np.array(values_of(signs, name), np.float64)[rows]
        for name in ("lat_rad", "lon_rad", "height_m")
    )
    height = np.nan_to_num(height)
    origin = (float(np.median(lat)), float(np.median(lon)), float(np.median(height)))
    own, side = own_variance[rows], values_of(signs, "side")
    names = support_names(
        local_ned(lat, lon, height, origin).reshape(-1, 3),
        own[:, None, None] * np.eye(3),
        [side[k] == "overhead" for k in rows],
    )
    # by a number the post of every sign would be another one where a sign comes
    first: dict[str, str] = {}
    for k, name in zip(rows, names, strict=True):
        first[name] = min(ids[k], first.get(name, ids[k]))
    support = list(values_of(signs, "support"))
    for k, name in zip(rows, names, strict=True):
        support[k] = f"p{first[name]}"
    return changed(signs, support=support)
