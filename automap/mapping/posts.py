"""Which signs hang on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from automap.earth import local_ned
from automap.mapping import limits
from automap.records import FloatArray, Sign
from automap.records.sign_lists import changed, numbers_of, values_of


def with_supports(signs: Sequence[Sign], own_variance: FloatArray) -> Sequence[Sign]:
    """The signs [m] of a drive or a map, those of it (with a name) with their supports, named after
    the first of their signs' names. ``own_variance`` [m] m^2 per level axis of what is a sign's own
    error: neighbours have the offsets of their drives in common."""
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
        own,
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


def support_numbers(
    position: FloatArray, own_variance: FloatArray, overhead: Sequence[bool]
) -> list[int]:
    """Number of the support of each sign, counted from 0 in the order of the signs.

    ``position`` [n, 3] NED, m; ``own_variance`` [n] m^2 per level axis of what is not common to
    neighbours (the trajectory's error is). Two signs share a post when they are as near in plan as
    faces on a post are, up to their own uncertainty; two over the road share a gantry.
    """
    n = len(position)
    if n == 0:
        return []
    pairs = cKDTree(position[:, :2]).query_pairs(limits.GANTRY_REACH_M, output_type="ndarray")
    i, j = pairs.T
    over = np.asarray(overhead, np.bool_)
    reach = limits.POST_REACH_M + np.sqrt(own_variance[i] + own_variance[j])
    apart = np.hypot(*(position[i, :2] - position[j, :2]).T)
    together = (over[i] & over[j]) | (apart < np.minimum(reach, limits.POST_LIMIT_M))
    links = coo_array((np.ones(together.sum()), (i[together], j[together])), shape=(n, n))
    label = connected_components(links, directed=False)[1].tolist()
    number = {k: index for index, k in enumerate(dict.fromkeys(label))}
    return [number[k] for k in label]
