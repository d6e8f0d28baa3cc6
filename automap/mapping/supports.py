"""Which signs hang on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from automap.mapping import limits
from automap.records import FloatArray


def support_numbers(
    position: FloatArray, own_cov: FloatArray, overhead: Sequence[bool]
) -> list[int]:
    """Number of the support of each sign, counted from 0 in the order of the signs.

    ``position`` [n, 3] NED, m; ``own_cov`` [n, 3, 3] what is not common to neighbours (the
    trajectory's error is). Two signs share a post when they are as near in plan as faces on a
    post are, up to their own uncertainty; two over the road share a gantry.
    """
    n = len(position)
    if n == 0:
        return []
    pairs = cKDTree(position[:, :2]).query_pairs(limits.GANTRY_REACH_M, output_type="ndarray")
    i, j = pairs.T
    over = np.asarray(overhead, np.bool_)
    variance = 0.5 * np.trace(own_cov[:, :2, :2], axis1=1, axis2=2)
    reach = limits.POST_REACH_M + np.sqrt(variance[i] + variance[j])
    apart = np.hypot(*(position[i, :2] - position[j, :2]).T)
    together = (over[i] & over[j]) | (apart < np.minimum(reach, limits.POST_LIMIT_M))
    links = coo_array((np.ones(together.sum()), (i[together], j[together])), shape=(n, n))
    label = connected_components(links, directed=False)[1].tolist()
    number = {k: index for index, k in enumerate(dict.fromkeys(label))}
    return [number[k] for k in label]
