"""Gates by a probability, against closed forms and drawn numbers."""

from __future__ import annotations

import numpy as np
import pytest

from automap.gates import (
    OUTSIDE_95,
    exceeds,
    gate,
    gate_in_plane,
    mean_square_limits,
    sd_by_median,
)


def test_a_gate_of_two_rows_is_the_tail_of_an_exponential() -> None:
    for probability in (0.05, 1e-3, 3e-4):
        assert gate(probability, 2) == pytest.approx(-2.0 * np.log(probability), rel=1e-12)
        assert gate_in_plane(probability) == pytest.approx(gate(probability, 2), rel=1e-12)


@pytest.mark.parametrize("dof", [1, 2, 3, 7])
def test_right_measurements_pass_a_gate_as_often_as_it_says(dof: int) -> None:
    square = (np.random.default_rng(dof).standard_normal((200_000, dof)) ** 2).sum(axis=1)
    assert np.mean(square > gate(0.01, dof)) == pytest.approx(0.01, abs=1e-3)
    assert exceeds(gate(0.01, dof), dof) == pytest.approx(0.01, rel=1e-9)


def test_mean_squares_keep_their_limits() -> None:
    mean = (np.random.default_rng(0).standard_normal((100_000, 12)) ** 2).mean(axis=1)
    low, high = mean_square_limits([12, 400])
    assert np.mean(mean < low[0]) == pytest.approx(0.5 * OUTSIDE_95, abs=3e-3)
    assert np.mean(mean > high[0]) == pytest.approx(0.5 * OUTSIDE_95, abs=3e-3)
    assert high[1] - low[1] < 0.3 * (high[0] - low[0])


def test_a_third_of_outliers_does_not_decide_a_sigma() -> None:
    residual = np.random.default_rng(1).normal(0.0, 0.2, 30_000)
    assert sd_by_median(residual) == pytest.approx(0.2, rel=0.02)
    residual[:6000] = 100.0
    assert sd_by_median(residual) < 0.3
