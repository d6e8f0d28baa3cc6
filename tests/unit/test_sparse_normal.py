"""Sparse normal equations against dense ones."""

from __future__ import annotations

import numpy as np
import pytest

from automap.records import FloatArray, IntArray
from automap.sparse_normal import factorise, least_fill


def chain_with_ties(n: int, ties: int, seed: int) -> FloatArray:
    """A positive definite matrix [n, n]: a chain, and a few unknowns tied across it."""
    rng = np.random.default_rng(seed)
    A = np.zeros((n - 1 + ties + n, n))
    at = np.arange(n - 1)
    A[at, at], A[at, at + 1] = rng.uniform(0.5, 2.0, n - 1), rng.uniform(-2.0, -0.5, n - 1)
    for k in range(ties):
        some = rng.choice(n, 3, replace=False)
        A[n - 1 + k, some] = rng.normal(0.0, 1.0, 3)
    A[n - 1 + ties + np.arange(n), np.arange(n)] = 0.1
    return A.T @ A


def entries(matrix: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    row, column = np.nonzero(matrix)
    return row, column, matrix[row, column]


@pytest.mark.parametrize(("n", "ties"), [(1, 0), (2, 0), (60, 0), (60, 25), (300, 40)])
def test_solution_and_variances_are_those_of_the_dense_matrix(n: int, ties: int) -> None:
    matrix = chain_with_ties(n, ties, n + ties)
    row, column, value = entries(matrix)
    factor = factorise(row, column, value, least_fill(row, column, n))
    right = np.random.default_rng(1).normal(size=n)
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(matrix, right), rtol=1e-9)
    told = np.append(row, np.arange(n)), np.append(column, np.arange(n))
    np.testing.assert_allclose(
        factor.inverse_at(*told), np.linalg.inv(matrix)[told], rtol=1e-9, atol=1e-12
    )


def test_entries_of_one_place_are_added_and_any_order_will_do() -> None:
    matrix = chain_with_ties(30, 5, 3)
    row, column, value = entries(matrix)
    twice = (np.tile(row, 2), np.tile(column, 2), np.concatenate([0.25 * value, 0.75 * value]))
    backward = factorise(*twice, np.arange(30)[::-1].copy())
    np.testing.assert_allclose(
        backward.inverse_at(row, column), np.linalg.inv(matrix)[row, column], rtol=1e-9, atol=1e-12
    )


def test_the_factor_of_a_chain_with_few_ties_grows_with_its_length_only() -> None:
    sizes = []
    for n in (400, 4000):
        row, column, value = entries_of_loops(n)
        sizes.append(len(factorise(row, column, value, least_fill(row, column, n)).row))
    assert sizes[1] < 12 * sizes[0]


def entries_of_loops(n: int) -> tuple[IntArray, IntArray, FloatArray]:
    """A chain each of whose unknowns is tied to the one five before."""
    at = np.arange(n)
    pairs = [(at, at, np.full(n, 10.0))]
    for step in (1, 5):
        one, other = at[step:], at[:-step]
        pairs += [(one, other, np.full(n - step, -1.0)), (other, one, np.full(n - step, -1.0))]
    row, column, value = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return row, column, value
