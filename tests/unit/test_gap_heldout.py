"""The gap that is left: against the divergence of processes whose colour and size are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.fusion.layout import CH_NHC, CH_POS
from automap.gap.scoring import _distance, _lag1


def process(size: float, keep: float, n: int = 60_000) -> np.ndarray:
    """A Gauss-Markov process of a standard deviation, of which ``keep`` outlasts a step."""
    rng = np.random.default_rng(4)
    drive = rng.normal(size=n) * size * np.sqrt(1.0 - keep**2)
    drive[0] = rng.normal() * size
    return np.asarray(lfilter([1.0], [1.0, -keep], drive))


@pytest.mark.parametrize("size", [0.3, 0.5, 1.0, 1.2])
@pytest.mark.parametrize("keep", [0.0, 0.4, -0.6, 0.8])
def test_size_and_colour_are_what_a_right_model_would_gain(size: float, keep: float) -> None:
    """Kullback and Leibler's divergence from white noise of size one: of the size
    (s^2 - 1 - log s^2) / 2, of the colour -log(1 - a^2) / 2, whatever the size."""
    expected = 0.5 * (size**2 - 1.0 - np.log(size**2)) - 0.5 * np.log(1.0 - keep**2)
    # values beyond four sigmas of the stated size are clipped: here there are next to none
    assert _distance(process(size, keep), CH_POS) == pytest.approx(expected, abs=0.03)


def test_a_quiet_vehicle_constraint_is_no_gap_but_its_colour_is() -> None:
    assert _distance(process(0.3, 0.0), CH_NHC) < 0.01
    quiet = _distance(process(0.3, 0.8), CH_NHC)
    assert quiet == pytest.approx(-0.5 * np.log(1.0 - 0.64), abs=0.03)
    loud = _distance(process(1.2, 0.0), CH_NHC)
    assert loud == pytest.approx(0.5 * (0.44 - np.log(1.44)), abs=0.03)


def test_a_handful_of_values_tells_nothing() -> None:
    assert _distance(process(3.0, 0.8, 29), CH_POS) == 0.0
    assert _distance(process(3.0, 0.8, 300), CH_POS) > 0.0


def test_white_noise_of_the_stated_size_has_no_gap() -> None:
    rng = np.random.default_rng(5)
    gaps = [_distance(rng.normal(size=400), CH_POS) for _ in range(200)]
    # what chance gives is taken off: half of what is left would be below zero
    assert np.mean(gaps) < 0.004


@pytest.mark.parametrize("size", [0.2, 3.0])
def test_the_shown_correlation_is_that_of_neighbours(size: float) -> None:
    assert _lag1(process(size, 0.7)) == pytest.approx(0.7, abs=0.02)
