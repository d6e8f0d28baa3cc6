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


def assign_near(
    rows: IntArray, columns: IntArray, cost: FloatArray, n: int, alone: float
) -> IntArray:
    """``assign`` for few of the pairs: ``cost`` [k] of those of ``rows`` and ``columns`` [k].

    The column of each of the ``n`` rows, -1 where it stays alone. Groups that share no pair are
    solved on their own, which keeps a whole city affordable.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    partner = np.full(n, -1, np.int64)
    if len(rows) == 0:
        return partner
    total = n + int(columns.max()) + 1
    links = coo_array((np.ones(len(rows)), (rows, columns + n)), shape=(total, total))
    label = connected_components(links, directed=False)[1][rows]
    order = np.argsort(label, kind="stable")
    for chosen in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        own, row = np.unique(rows[chosen], return_inverse=True)
        others, column = np.unique(columns[chosen], return_inverse=True)
        block = np.full((len(own), len(others)), np.inf)
        block[row, column] = cost[chosen]
        found = assign(block, alone)
        partner[own[found >= 0]] = others[found[found >= 0]]
    return partner
