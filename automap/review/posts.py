"""Posts of signs that a reviewer put where they stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.mapping.grid import east_north
from automap.mapping.limits import POST_LIMIT_M
from automap.records import Sign


def with_posts_by_hand(signs: Sequence[Sign], before: Sequence[Sign]) -> list[Sign]:
    """The signs after a review, those that it made or moved with the posts they hang on now.

    A hand is good to a metre, so a sign that it put within POST_LIMIT_M of another one is on that
    one's post; else it has a post of its own. Maps that tell no posts are left as they are.
    """
    stood = {sign.id: (sign.lat_rad, sign.lon_rad) for sign in before}
    put = [k for k, s in enumerate(signs) if stood.get(s.id) != (s.lat_rad, s.lon_rad)]
    put = [k for k in put if np.isfinite([signs[k].lat_rad, signs[k].lon_rad]).all()]
    if not put or not any(sign.support for sign in before):
        return list(signs)
    after = list(signs)
    for k in put:
        after[k] = replace(after[k], support="")
    lat, lon = (np.array([getattr(s, n) for s in signs]) for n in ("lat_rad", "lon_rad"))
    for k in put:
        apart = np.hypot(*east_north(lat, lon, lat[k], lon[k]).T)
        apart[[not s.support for s in after]] = np.inf
        nearest = int(np.nanargmin(np.where(np.isnan(apart), np.inf, apart)))
        support = after[nearest].support
        if not apart[nearest] < POST_LIMIT_M:
            # a post keeps its name though the sign that it is named after left it
            taken = {s.support for s in after}
            own = f"p{signs[k].id}"
            support = f"{own}#2" if own in taken else own
        after[k] = replace(after[k], support=support)
    return after
