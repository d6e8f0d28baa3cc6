"""Turn rates without the noise of single readings."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from automap.fusion.steady_readings import _spectrum, steady
from automap.records import FloatArray

NOISE = 0.015
"""rad/s of a single reading, as large as the swaying."""


def at_100_hz(n: int) -> FloatArray:
    return np.asarray(0.01 * np.arange(n), np.float64)


def swaying(t: FloatArray, seed: int = 1) -> FloatArray:
    """A body on its springs, which a road excites, in the bends of a town."""
    f = np.fft.rfftfreq(len(t), t[1] - t[0])
    rng = np.random.default_rng(seed)
    out = []
    for most, size in ((1.5, 0.02), (1.2, 0.015), (0.1, 0.2)):
        shape = np.exp(-(((f - most) / (0.25 * most)) ** 2))
        moved = np.fft.irfft(shape * rng.normal(size=len(f)) * np.exp(6.28j * rng.random(len(f))))
        out.append(size * moved / moved.std())
    return np.stack(out, axis=1)


def test_noise_goes_and_motion_stays() -> None:
    t = at_100_hz(24_000)
    true = swaying(t)
    noise = np.random.default_rng(1).normal(0.0, NOISE, true.shape)
    inner = slice(200, -200)
    found = steady(t, true + noise)[inner]
    assert np.all(np.std(found - true[inner], axis=0) < 0.25 * NOISE)
    assert np.all(np.std(steady(t, true)[inner] - true[inner], axis=0) < 2e-3)


def test_an_arm_by_such_a_rate_is_the_true_one() -> None:
    """What the rate misses is not correlated with it; what a single reading has too much is."""
    t = at_100_hz(24_000)
    inner = slice(200, -200)
    for seed in range(4):
        true = swaying(t, seed)[inner]
        readings = swaying(t, seed) + np.random.default_rng(seed).normal(0.0, NOISE, (len(t), 3))
        for axis in (0, 1):
            slopes = [
                float(rate[inner, axis] @ true[:, axis] / (rate[inner, axis] @ rate[inner, axis]))
                for rate in (readings, steady(t, readings))
            ]
            assert slopes[0] < 0.7
            assert slopes[1] == pytest.approx(1.0, abs=0.03)


def test_vibration_moves_no_antenna() -> None:
    t = at_100_hz(12_000)
    shaken = swaying(t) + 0.05 * np.sin(2 * np.pi * 25.0 * t)[:, None]
    inner = slice(200, -200)
    assert np.all(np.std(steady(t, shaken)[inner] - swaying(t)[inner], axis=0) < 2e-3)


def test_readings_beside_a_gap_and_at_the_ends_stay_as_they_are() -> None:
    t = np.concatenate([np.arange(0.0, 20.0, 0.01), np.arange(22.0, 40.0, 0.01)])
    rate = swaying(at_100_hz(len(t)))
    rate = rate + np.random.default_rng(2).normal(0.0, 0.01, rate.shape)
    out = steady(t, rate)
    edge = int(np.searchsorted(t, 21.0))
    for rows in (slice(0, 200), slice(edge - 200, edge + 200), slice(len(t) - 200, None)):
        assert np.array_equal(out[rows], rate[rows])
    assert not np.any(out[300:1500] == rate[300:1500])


@pytest.mark.parametrize("n", [0, 1, 2, 5, 30, 300])
def test_what_is_too_short_or_too_slow_stays_as_it_is(n: int) -> None:
    rate = np.random.default_rng(n).normal(0.0, 0.01, (n, 3))
    for step in (0.01, 0.2) if n < 300 else (0.2,):
        assert np.array_equal(steady(step / 0.01 * at_100_hz(n), rate), rate)


def test_stamps_that_stand_still_and_axes_without_a_reading_do_no_harm() -> None:
    rate = swaying(at_100_hz(500))
    assert np.array_equal(steady(np.zeros(500), rate), rate)
    t = at_100_hz(3000)
    assert np.array_equal(steady(t, np.zeros((3000, 3))), np.zeros((3000, 3)))


def test_the_spectrum_is_welchs() -> None:
    rng = np.random.default_rng(3)
    for n, half in ((9000, 8), (401, 100), (400, 100)):
        rate = 0.3 + rng.standard_normal(n).cumsum() * 0.01
        expected = welch(rate, 100.0, nperseg=2 * half)
        for found, told in zip(_spectrum(rate, 0.01, half), expected, strict=True):
            np.testing.assert_allclose(found, told, rtol=1e-9, atol=1e-12 * told.max())
