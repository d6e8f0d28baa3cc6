"""Steps of biases, by the drift that a fit has found."""

from __future__ import annotations

import numpy as np
import pytest

from automap.gap.jumps import clear_step

T = np.linspace(0.0, 300.0, 1501)


@pytest.mark.parametrize("instant", [20.0, 148.3, 270.0])
def test_a_step_under_noise_and_smoothing_is_placed(instant: float) -> None:
    rng = np.random.default_rng(3)
    values = -0.07 / (1.0 + np.exp(-(T - instant) / 1.0)) + 0.004 * rng.standard_normal(len(T))
    found = clear_step(T, values)
    assert found is not None
    assert found == pytest.approx(instant, abs=1.0)


def test_a_ramp_and_a_random_walk_that_returns_make_no_clear_step() -> None:
    assert clear_step(T, np.sin(2.0 * np.pi * T / 100.0)) is None
    assert clear_step(T, np.zeros(len(T))) is None


def test_what_settles_at_the_start_is_no_step() -> None:
    assert clear_step(T, np.exp(-T / 2.0)) is None
