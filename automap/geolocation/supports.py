"""Which signs hang on one post or gantry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.geolocation import limits
from automap.records import FloatArray


def support_numbers(
    position: FloatArray, own_cov: FloatArray, overhead: Sequence[bool]
) -> list[int]:
    """Number of the support of each sign, counted from 0 in the order of the signs.

    ``position`` [n, 3] NED, m; ``own_cov`` [n, 3, 3] what is not common to neighbours (the
    trajectory's error is). Two signs share a post when they are as near in plan as faces on a
    post are, up to their own uncertainty; two over the road share a gantry.
    """
    from scipy.spatial import cKDTree

    n = len(position)
    owner = list(range(n))

    def root(k: int) -> int:
        while owner[k] != k:
            k = owner[k]
        return k

    if n > 1:
        for i, j in sorted(cKDTree(position[:, :2]).query_pairs(limits.GANTRY_REACH_M)):
            apart = float(np.hypot(*(position[i, :2] - position[j, :2])))
            if overhead[i] and overhead[j]:
                together = True
            else:
                spread = np.trace((own_cov[i] + own_cov[j])[:2, :2]) / 2.0
                together = apart < min(
                    limits.POST_REACH_M + float(np.sqrt(spread)), limits.POST_LIMIT_M
                )
            if together:
                a, b = root(i), root(j)
                owner[max(a, b)] = min(a, b)
    first = [root(k) for k in range(n)]
    number = {k: index for index, k in enumerate(dict.fromkeys(first))}
    return [number[k] for k in first]
