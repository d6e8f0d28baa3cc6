"""Rows of a linear model: which of them count in full."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.layout import CH_NHC, CH_VEL
from automap.gap.linear import Linear
from automap.gap.mixing import Group, Mixing
from automap.gap.rows import Rows
from automap.gap.whitening import _factor, _ridge, _studentised, stretch_scatter, whitened_rows
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
    return Rows(w, np.array(phi, np.float32, order="F"), t, np.zeros(len(w), np.int64))


def weights(w: FloatArray, columns: FloatArray) -> FloatArray:
    """By how much each row counts beside the usual one; the last column, of ones, tells."""
    phi = np.column_stack([columns, np.ones(len(w))])
    rows = rows_of(w, phi)
    sds = np.full(phi.shape[1], 50.0)
    (white,) = whitened_rows([rows], np.zeros(phi.shape[1]), sds)
    assert len(white.w) == len(w)
    factor = white.phi[:, -1] ** 2
    return np.asarray(factor / np.median(factor))


def test_large_innovations_that_a_missing_effect_explains_count_in_full() -> None:
    noise, bends, few = drive()
    w = noise + SIZE * bends
    assert weights(w, bends)[few].mean() > 0.85
    # what no candidate explains is wild
    assert weights(w, np.zeros(ROWS))[few].mean() < 0.3


def test_where_nothing_more_acts_rows_count_alike_whatever_a_stretch_says() -> None:
    rng = np.random.default_rng(5)
    w, phi = rng.standard_t(3.0, ROWS), rng.standard_normal((ROWS, 300))
    turned = np.where(np.arange(ROWS) < ROWS // 2, 1.0, -1.0)
    sizes = {}
    for may_act in (True, False):
        counts = []
        for signs in (np.ones(ROWS), turned):
            rows = [rows_of(signs * w, phi)]
            (white,) = whitened_rows(rows, np.zeros(300), np.full(300, 5.0), may_act)
            counts.append(np.linalg.norm(white.phi, axis=1))
        sizes[may_act] = np.abs(np.log(counts[0] / counts[1]))
    # but for what noise remembers across the turn
    assert sizes[False].max() < 0.05
    # columns that may act follow what there is, and settle what counts by it
    assert sizes[True].max() > 0.2


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
    (white,) = whitened_rows([rows], np.zeros(1), np.ones(1))
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
    (white,) = whitened_rows([rows], np.zeros(count), np.full(count, 50.0))
    # a score's scatter is as its information says
    z = (white.phi.T @ white.w) / np.sqrt(np.sum(white.phi**2, axis=0))
    assert float(np.mean(z**2)) == pytest.approx(1.0, abs=0.25)
    assert float(np.mean(white.w**2)) == pytest.approx(1.0, abs=0.25)


def test_columns_of_mixtures_are_sums_of_rows() -> None:
    rng = np.random.default_rng(5)
    phi: FloatArray = rng.standard_normal((50, 4))
    rows = rows_of(rng.standard_normal(50), phi)
    one, other = np.array([[1.0]]), np.array([[2.0], [-1.0]])
    groups = Group(np.array([0]), np.array([0]), one), Group(np.arange(1, 3), np.array([1]), other)
    mixing = Mixing(groups, 2)
    layout = tuple(columns_named("a.p", "b.p"))
    nothing = np.zeros(2)
    linear = Linear(layout, (rows,), mixing, nothing, np.eye(4), np.ones(2), nothing)
    expected = phi[:, 1] * 2.0 - phi[:, 2]
    np.testing.assert_allclose(linear.columns(rows, (1,))[:, 0], expected, rtol=1e-5)
    np.testing.assert_allclose(linear.columns(rows, (1, 0))[:, 1], phi[:, 0], rtol=1e-5)


def test_a_stretch_that_scatters_more_counts_for_as_much_less() -> None:
    rng = np.random.default_rng(11)
    t = np.arange(0.0, 800.0, 0.5)
    u = rng.standard_normal(len(t))
    loud = (t >= 160.0) & (t < 240.0)
    u[loud] *= 5.0
    found = stretch_scatter(u, t)
    # twenty rows a stretch tell its size to a sixth, and the usual one draws it in
    assert found[loud] == pytest.approx(np.full(loud.sum(), 5.0), rel=0.5)
    assert np.median(found[loud]) == pytest.approx(4.5, abs=0.8)
    assert found[~loud].mean() < 1.1


def test_even_noise_and_single_wild_values_make_no_stretch_scatter() -> None:
    rng = np.random.default_rng(12)
    t = np.arange(0.0, 1600.0, 0.5)
    u = rng.standard_normal(len(t))
    assert stretch_scatter(u, t).max() < 1.1
    u[::97] *= 30.0
    assert np.median(stretch_scatter(u, t)) < 1.1
    assert stretch_scatter(np.zeros(0), np.zeros(0)).shape == (0,)


def test_receivers_rows_count_less_where_it_errs_more_and_the_vehicles_do_not() -> None:
    rng = np.random.default_rng(13)
    n = 1600
    t = np.repeat(np.arange(n // 2) * 0.5, 2)
    channel = np.tile([CH_VEL, CH_NHC], n // 2)
    loud = (t >= 100.0) & (t < 140.0)
    w = rng.standard_normal(n) * np.where(loud, 4.0, 1.0)
    (white,) = whitened_rows([Rows(w, np.ones((n, 1)), t, channel)], np.zeros(1), np.full(1, 1e-6))
    counts = white.phi[:, 0] ** 2
    for one, least, most in ((CH_VEL, 0.03, 0.12), (CH_NHC, 0.2, 1.0)):
        at = white.channel == one
        ratio = counts[at & loud].mean() / counts[at & ~loud].mean()
        assert least < ratio < most
    # what is left of the loud stretch is of size one again
    assert 0.8 < np.std(white.w[(white.channel == CH_VEL) & loud]) < 1.4


def test_a_fit_that_follows_a_few_rows_does_not_make_them_look_quiet() -> None:
    rng = np.random.default_rng(14)
    n, size = 1200, 5.0
    t = np.arange(n) * 0.5
    phi = np.zeros((n, 8))
    for i in range(8):
        # two rows of the loud stretch each
        phi[400 + 2 * i : 402 + 2 * i, i] = 1.0
    loud = (t >= 200.0) & (t < 208.0)
    noises, followed = [], []
    for _ in range(300):
        w = rng.standard_normal(n) * np.where(loud, size, 1.0)
        rows = Rows(w, phi, t, np.full(n, CH_VEL))
        left = w.copy()
        for i in range(8):
            left[400 + 2 * i : 402 + 2 * i] -= w[400 + 2 * i : 402 + 2 * i].mean()
        inverse = np.diag((phi**2).sum(axis=0) ** -0.5)
        noises.append(np.mean(_studentised(left, rows, np.ones(n), inverse)[loud] ** 2))
        followed.append(np.mean(left[loud] ** 2))
    assert np.mean(followed) < 0.6 * size**2
    assert np.mean(noises) == pytest.approx(size**2, rel=0.1)


def test_columns_that_only_their_priors_tell_apart() -> None:
    # as of a drive that stands: in single precision the information of such is not positive
    rng = np.random.default_rng(9933)
    n, c = 4000, 40
    shared = rng.normal(size=n)
    phi = np.outer(shared, 1e3 * np.ones(c)) + 1e-3 * rng.normal(size=(n, c))
    w = 1e3 * shared * 2e-3 + rng.normal(size=n)
    rows, sds = rows_of(w, phi), np.full(c, 1.0)
    white = whitened_rows([rows_of(w, phi)], np.zeros(c), sds)
    assert all(np.isfinite(each.w).all() and np.isfinite(each.phi).all() for each in white)
    unit = np.ones(n)
    with pytest.raises(np.linalg.LinAlgError):
        _factor([rows], [unit], sds, np.float32)
    _, values = _ridge([rows], [unit], sds)
    assert values.sum() == pytest.approx(2e-3, rel=0.2)
