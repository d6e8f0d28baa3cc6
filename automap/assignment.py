"""Who belongs to whom, one to one, at the least cost in all."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.records import FloatArray, IntArray

_IMPOSSIBLE = 1e6
"""Stands for a pair that cannot be; the price of staying alone is far below it."""


def assign(cost: FloatArray, alone: npt.ArrayLike) -> IntArray:
    """The column of each row [n], -1 where the row stays alone; no column has two rows.

    ``cost`` [n, m] of the pairs (infinite or NaN where one cannot be), ``alone`` what a row
    without a column costs, one value or [n]. The sum over all rows is least (Hungarian method,
    H. W. Kuhn, Naval Research Logistics Quarterly 2, 1955).
    """
    from scipy.optimize import linear_sum_assignment

    n, m = cost.shape
    # a column of its own for every row lets it stay alone
    own = np.full((n, n), _IMPOSSIBLE)
    np.fill_diagonal(own, alone)
    possible = np.isfinite(cost)
    rows, columns = linear_sum_assignment(np.hstack([np.where(possible, cost, _IMPOSSIBLE), own]))
    partner = np.full(n, -1, np.int64)
    paired = columns < m
    partner[rows[paired]] = columns[paired]
    return partner
