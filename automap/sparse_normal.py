"""Sparse normal equations: the solution, and the variances without the rest of the covariance.

A matrix of a chain of unknowns that a few measurements tie across is nearly empty, and so is its
factor when the unknowns are taken in the order of least fill (minimum degree). The factor is
L D L' (T. A. Davis, Algorithm 849, ACM TOMS 31, 2005); the variances come out of it by Takahashi's
recursion (Erisman and Tinney, Communications of the ACM 18, 1975), which computes the inverse only
where the factor has entries. Time and memory grow with these, not with the square of the unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.jit import kernel_with
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class Factor:
    """L D L' of a matrix whose unknowns are taken in ``order`` [n]: columns of L below the
    diagonal as ``start`` [n + 1], ``row`` and ``value`` [z], and ``pivot`` [n]."""

    order: IntArray
    start: IntArray
    row: IntArray
    value: FloatArray
    pivot: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """The solution [n] for a right-hand side [n]."""
        out = np.empty(len(self.order))
        out[self.order] = _solve(self.start, self.row, self.value, self.pivot, right[self.order])
        return out

    def inverse_at(self, row: IntArray, column: IntArray) -> FloatArray:
        """Entries [z] of the inverse where the matrix has entries, or on its diagonal."""
        place = np.empty(len(self.order), np.int64)
        place[self.order] = np.arange(len(self.order))
        diagonal, below = _inverse(self.start, self.row, self.value, self.pivot)
        at = place[row], place[column]
        return np.asarray(_entries(self.start, self.row, diagonal, below, *at), np.float64)

    def variances_of(self, index: IntArray, weight: FloatArray) -> FloatArray:
        """Variances [...] of weighted sums of unknowns ``index`` [..., s], without the rest of the
        inverse; ``weight`` fits ``index``, a negative index is none."""
        place = np.empty(len(self.order) + 1, np.int64)
        place[self.order] = np.arange(len(self.order))
        place[-1] = -1
        wanted = np.ascontiguousarray(place[np.maximum(index, -1)])
        weight = np.require(np.broadcast_to(weight, wanted.shape), None, ("C", "W"))
        shape, s = wanted.shape[:-1], wanted.shape[-1]
        found = _variances_of(
            self.start, self.row, self.value, self.pivot, wanted.reshape(-1, s),
            weight.reshape(-1, s),
        )  # fmt: skip
        return np.asarray(found.reshape(shape))


def factorise(row: IntArray, column: IntArray, value: FloatArray, order: IntArray) -> Factor:
    """Factor of a symmetric positive definite matrix [n, n] of entries [z] (whole, both triangles;
    those of one place are added), eliminated in ``order`` [n]."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    row, column = np.ascontiguousarray(row), np.ascontiguousarray(column)
    start, rows, values, pivot = _factorise(*_upper(row, column, value, place))
    return Factor(order, start, rows, values, pivot)


def least_fill(row: IntArray, column: IntArray, n: int) -> IntArray:
    """An order [n] in which to eliminate unknowns tied in pairs [z], with little fill."""
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    # any matrix of this pattern that has pivots on its diagonal
    each, degree = np.arange(n), np.bincount(row, minlength=n)
    at = np.append(row, each), np.append(column, each)
    value = np.append(np.full(len(row), -1.0), 1.0 + degree)
    found = splu(
        coo_array((value, at), shape=(n, n)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(found.perm_c).astype(np.int64)


@kernel_with(nogil=True)
def _upper(
    row: IntArray, column: IntArray, value: FloatArray, place: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """The upper triangle in the order of elimination, by columns; entries of one place stay so."""
    n = len(place)
    start = np.zeros(n + 1, np.int64)
    for k in range(len(row)):
        if place[row[k]] <= place[column[k]]:
            start[place[column[k]] + 1] += 1
    start[:] = np.cumsum(start)
    end = start[:-1].copy()
    rows, values = np.empty(start[n], np.int64), np.empty(start[n])
    for k in range(len(row)):
        i, j = place[row[k]], place[column[k]]
        if i <= j:
            rows[end[j]], values[end[j]] = i, value[k]
            end[j] += 1
    return start, rows, values


@kernel_with(nogil=True)
def _factorise(  # type: ignore[no-untyped-def]
    start, row, value
):
    """Up-looking factor of the upper triangle given by columns: first where it has entries (by the
    elimination tree), then which."""
    n = len(start) - 1
    parent = np.full(n, -1, np.int64)
    flag = np.full(n, -1, np.int64)
    count = np.zeros(n, np.int64)
    for k in range(n):
        flag[k] = k
        for p in range(start[k], start[k + 1]):
            i = row[p]
            while flag[i] != k:
                if parent[i] == -1:
                    parent[i] = k
                count[i] += 1
                flag[i] = k
                i = parent[i]
    first = np.zeros(n + 1, np.int64)
    first[1:] = np.cumsum(count)
    rows = np.zeros(first[n], np.int64)
    values = np.zeros(first[n])
    pivot = np.zeros(n)
    filled = np.zeros(n, np.int64)
    work = np.zeros(n)
    pattern = np.zeros(n, np.int64)
    flag[:] = -1
    for k in range(n):
        top = n
        flag[k] = k
        for p in range(start[k], start[k + 1]):
            i = row[p]
            work[i] += value[p]
            length = 0
            while flag[i] != k:
                pattern[length] = i
                length += 1
                flag[i] = k
                i = parent[i]
            while length > 0:
                top -= 1
                length -= 1
                pattern[top] = pattern[length]
        pivot[k] = work[k]
        work[k] = 0.0
        for s in range(top, n):
            i = pattern[s]
            own = work[i]
            work[i] = 0.0
            end = first[i] + filled[i]
            for p in range(first[i], end):
                work[rows[p]] -= values[p] * own
            share = own / pivot[i]
            pivot[k] -= share * own
            rows[end] = k
            values[end] = share
            filled[i] += 1
    return first, rows, values, pivot


@kernel_with(nogil=True)
def _solve(
    start: IntArray, row: IntArray, value: FloatArray, pivot: FloatArray, right: FloatArray
) -> FloatArray:
    n = len(pivot)
    x = right.copy()
    for j in range(n):
        for p in range(start[j], start[j + 1]):
            x[row[p]] -= value[p] * x[j]
    for j in range(n - 1, -1, -1):
        x[j] /= pivot[j]
        for p in range(start[j], start[j + 1]):
            x[j] -= value[p] * x[row[p]]
    return x


@kernel_with(nogil=True)
def _inverse(
    start: IntArray, row: IntArray, value: FloatArray, pivot: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The diagonal [n] and what lies below it where the factor has entries [z], from the last
    column to the first: what a column needs of the inverse lies in columns after it."""
    n = len(pivot)
    diagonal = np.zeros(n)
    below = np.zeros(len(row))
    of = np.zeros(n)
    share = np.zeros(n)
    mark = np.full(n, -1, np.int64)
    for j in range(n - 1, -1, -1):
        for p in range(start[j], start[j + 1]):
            mark[row[p]] = j
            of[row[p]] = 0.0
            share[row[p]] = value[p]
        for p in range(start[j], start[j + 1]):
            k = row[p]
            of[k] -= value[p] * diagonal[k]
            for q in range(start[k], start[k + 1]):
                i = row[q]
                if mark[i] == j:
                    of[i] -= value[p] * below[q]
                    of[k] -= share[i] * below[q]
        diagonal[j] = 1.0 / pivot[j]
        for p in range(start[j], start[j + 1]):
            below[p] = of[row[p]]
            diagonal[j] -= value[p] * below[p]
    return diagonal, below


@kernel_with(nogil=True)
def _entries(
    start: IntArray,
    row: IntArray,
    diagonal: FloatArray,
    below: FloatArray,
    a: IntArray,
    b: IntArray,
) -> FloatArray:
    result = np.zeros(len(a))
    for k in range(len(a)):
        column, wanted = min(a[k], b[k]), max(a[k], b[k])
        if column == wanted:
            result[k] = diagonal[column]
            continue
        for p in range(start[column], start[column + 1]):
            if row[p] == wanted:
                result[k] = below[p]
                break
    return result


@kernel_with(nogil=True)
def _variances_of(
    start: IntArray,
    row: IntArray,
    value: FloatArray,
    pivot: FloatArray,
    wanted: IntArray,
    weight: FloatArray,
) -> FloatArray:
    """The sum of squares of what the factor makes of each right-hand side: it begins at the first
    of the unknowns wanted, and passes over those that nothing reaches."""
    n = len(pivot)
    x = np.zeros(n)
    result = np.zeros(len(wanted))
    for k in range(len(wanted)):
        first = n
        for c in range(wanted.shape[1]):
            if wanted[k, c] >= 0:
                x[wanted[k, c]] += weight[k, c]
                first = min(first, wanted[k, c])
        for j in range(first, n):
            own = x[j]
            if own != 0.0:
                for p in range(start[j], start[j + 1]):
                    x[row[p]] -= value[p] * own
                result[k] += own * own / pivot[j]
                x[j] = 0.0
    return result
