"""Which signs of a merged map are on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.earth import local_ned
from automap.geolocation.supports import support_numbers
from automap.mapping.merge import Merged
from automap.records import FloatArray, Sign


def with_supports(signs: Sequence[Sign], merged: Merged) -> list[Sign]:
    """The signs [m] of a map, in the order of the merge, those of it (with a name) with their
    supports, by the same rule as within a drive."""
    rows = [k for k, sign in enumerate(signs) if sign.id]
    out = list(signs)
    if not rows:
        return out
    lat, lon, height = (
        np.array([getattr(signs[k], name) for k in rows], np.float64)
        for name in ("lat_rad", "lon_rad", "height_m")
    )
    height = np.nan_to_num(height)
    origin = (float(np.median(lat)), float(np.median(lon)), float(np.median(height)))
    own = _own_variance(merged, len(signs))[rows]
    numbers = support_numbers(
        local_ned(lat, lon, height, origin).reshape(-1, 3),
        own[:, None, None] * np.eye(3),
        [signs[k].side == "overhead" for k in rows],
    )
    for k, number in zip(rows, numbers, strict=True):
        out[k] = replace(signs[k], support=f"p{number + 1:04d}")
    return out


def _own_variance(merged: Merged, m: int) -> FloatArray:
    """Variance [m] in m^2 per level axis of what is a sign's own error: neighbours have the
    offsets of their drives in common."""
    own = 0.5 * (merged.sightings.own[:, 0] + merged.sightings.own[:, 2])
    return np.asarray(1.0 / np.bincount(merged.association.sign, 1.0 / own, m))
