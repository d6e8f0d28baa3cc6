"""Which signs of a merged map are on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.earth import local_ned
from automap.geolocation.supports import support_numbers
from automap.records import FloatArray, Sign


def with_supports(signs: Sequence[Sign], own_variance: FloatArray) -> list[Sign]:
    """The signs [m] of a map, those of it (with a name) with their supports, by the same rule as
    within a drive. ``own_variance`` [m] m^2 per level axis of what is a sign's own error:
    neighbours have the offsets of their drives in common."""
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
    own = own_variance[rows]
    numbers = support_numbers(
        local_ned(lat, lon, height, origin).reshape(-1, 3),
        own[:, None, None] * np.eye(3),
        [signs[k].side == "overhead" for k in rows],
    )
    for k, number in zip(rows, numbers, strict=True):
        out[k] = replace(signs[k], support=f"p{number + 1:04d}")
    return out
