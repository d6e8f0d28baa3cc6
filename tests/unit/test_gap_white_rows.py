"""Rows of a linear model: which of them count in full."""

from __future__ import annotations

import numpy as np
import pytest

from automap.gap.linear import Linear, Rows, _white
from automap.records import BoolArray, FloatArray
from tests.unit.gap_linear import columns_named

ROWS, EVERY = 4000, 40
SIZE = 10.0


def drive(seed: int = 1) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Noise, a column that acts in few rows, and these."""
    rng = np.random.default_rng(seed)
    few = np.arange(ROWS) % EVERY == 7
    # to either side, or the median of all would follow
    bends = np.where(few, rng.choice([-1.0, 1.0], ROWS), 0.0)
    return rng.standard_normal(ROWS), bends, few


def rows_of(w: FloatArray, phi: FloatArray) -> Rows:
    """Rows of one channel."""
    t = np.arange(len(w), dtype=np.float64) * 0.1
    return Rows(w, phi, t, np.zeros(len(w), np.int64))


def weights(w: FloatArray, columns: FloatArray) -> FloatArray:
    """By how much each row counts beside the usual one; the last column, of ones, tells."""
    phi = np.column_stack([columns, np.ones(len(w))])
    rows = rows_of(w, phi)
    sds = np.full(phi.shape[1], 50.0)
    (white,) = _white([rows], np.zeros(phi.shape[1]), sds)
    assert len(white.w) == len(w)
    factor = white.phi[:, -1] ** 2
    return np.asarray(factor / np.median(factor))


def test_large_innovations_that_a_missing_effect_explains_count_in_full() -> None:
    noise, bends, few = drive()
    w = noise + SIZE * bends
    assert weights(w, bends)[few].mean() > 0.85
    # what no candidate explains is wild
    assert weights(w, np.zeros(ROWS))[few].mean() < 0.3


def test_wild_values_count_little_where_an_effect_is_missing_too() -> None:
    noise, bends, few = drive()
    rng = np.random.default_rng(2)
    wild = np.arange(ROWS) % EVERY == 20
    w = noise + SIZE * bends + np.where(wild, SIZE * rng.choice([-1.0, 1.0], ROWS), 0.0)
    found = weights(w, bends)
    assert found[few].mean() > 0.85
    assert found[wild].mean() < 0.3
    assert found[~wild & ~few].mean() > 0.9


def test_wild_values_do_not_move_what_is_estimated() -> None:
    rng = np.random.default_rng(3)
    noise, _, _ = drive()
    column = rng.standard_normal(ROWS)
    w = noise + 0.3 * column
    w[::50] += 30.0 * np.sign(column[::50])
    phi = column[:, None]
    rows = rows_of(w, phi)
    (white,) = _white([rows], np.zeros(1), np.ones(1))
    estimate = float(white.phi[:, 0] @ white.w / (white.phi[:, 0] @ white.phi[:, 0]))
    plain = float(column @ w / (column @ column))
    assert plain > 0.7
    assert estimate == pytest.approx(0.3, abs=0.1)


def test_wild_rows_do_not_make_their_neighbours_look_wild() -> None:
    noise, bends, few = drive()
    # of the rows where a column acts a fifth are wild, all to one side of it
    wild = few & (np.cumsum(few) % 5 == 0)
    found = weights(noise + np.where(wild, 60.0 * bends, 0.0), bends)
    assert found[wild].mean() < 0.1
    assert found[few & ~wild].mean() > 0.85


def test_many_candidates_do_not_make_noise_look_small() -> None:
    rng = np.random.default_rng(4)
    count, n = 400, 2000
    rows = rows_of(rng.standard_normal(n), rng.standard_normal((n, count)))
    (white,) = _white([rows], np.zeros(count), np.full(count, 50.0))
    # a score's scatter is as its information says
    z = (white.phi.T @ white.w) / np.sqrt(np.sum(white.phi**2, axis=0))
    assert float(np.mean(z**2)) == pytest.approx(1.0, abs=0.25)
    assert float(np.mean(white.w**2)) == pytest.approx(1.0, abs=0.25)


def test_columns_of_mixtures_are_sums_of_rows() -> None:
    rng = np.random.default_rng(5)
    phi: FloatArray = rng.standard_normal((50, 4))
    rows = rows_of(rng.standard_normal(50), phi)
    mixing = np.array([[1.0, 0.0], [0.0, 2.0], [0.0, -1.0], [0.0, 0.0]])
    layout = tuple(columns_named("a.p", "b.p"))
    nothing = np.zeros(2)
    linear = Linear(layout, (rows,), mixing, nothing, np.eye(2), np.ones(2), nothing)
    expected = phi[:, 1] * 2.0 - phi[:, 2]
    np.testing.assert_allclose(linear.columns(rows, (1,))[:, 0], expected, rtol=1e-5)
    np.testing.assert_allclose(linear.columns(rows, (1, 0))[:, 1], phi[:, 0], rtol=1e-5)
