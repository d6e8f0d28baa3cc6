"""Turn rates without the noise of single readings."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.steady_rate import steady_rate
from automap.records import FloatArray


def swaying(t: FloatArray) -> FloatArray:
    """A body on its springs in a bend."""
    return np.stack(
        [0.03 * np.sin(2 * np.pi * 1.5 * t), 0.02 * np.cos(2 * np.pi * 1.2 * t), 0.2 * np.sin(t)],
        axis=1,
    )


def test_noise_goes_and_motion_stays() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    true = swaying(t)
    noise = np.random.default_rng(1).normal(0.0, 0.01, true.shape)
    assert steady_rate(t, true) == pytest.approx(true, abs=5e-4)
    left = steady_rate(t, true + noise) - true
    assert np.sqrt(np.mean(left[20:-20] ** 2)) < 0.4 * 0.01


def test_readings_beside_a_gap_and_at_the_ends_stay_as_they_are() -> None:
    t = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(12.0, 20.0, 0.01)])
    rate = swaying(t) + np.random.default_rng(2).normal(0.0, 0.01, (len(t), 3))
    out = steady_rate(t, rate)
    edge = int(np.searchsorted(t, 11.0))
    for rows in (slice(0, 10), slice(edge - 10, edge + 10), slice(len(t) - 10, None)):
        assert np.array_equal(out[rows], rate[rows])
    assert not np.array_equal(out[200:300], rate[200:300])


@pytest.mark.parametrize("n", [0, 1, 2, 5, 30])
def test_what_is_too_short_or_too_slow_stays_as_it_is(n: int) -> None:
    t = 0.2 * np.arange(n)
    rate = swaying(t)
    assert np.array_equal(steady_rate(t, rate), rate)


def test_stamps_that_stand_still_do_no_harm() -> None:
    rate = swaying(np.arange(50.0))
    assert np.array_equal(steady_rate(np.zeros(50), rate), rate)
