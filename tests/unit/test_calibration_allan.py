"""Allan deviation against published values, and noise terms of simulated records."""

from __future__ import annotations

import numpy as np
import pytest

from automap.calibration.allan import allan_fit, averaging_factors, overlapping_deviation
from automap.calibration.allan_triads import resting_fits
from automap.errors import InputError
from automap.records import RawImu


def test_published_values() -> None:
    """NIST SP 1065, table 31: overlapping deviation of the 1000-point test series."""
    x = [1234567890]
    while len(x) < 1000:
        x.append(16807 * x[-1] % 2147483647)
    series = np.array(x) / 2147483647.0
    found = overlapping_deviation(series, 1.0, np.array([1, 10, 100]))
    np.testing.assert_allclose(found, [2.922319e-01, 9.159953e-02, 3.241343e-02], rtol=1e-6)


def test_allantools_agrees() -> None:
    """The field's own package, on white noise with a random walk."""
    allantools = pytest.importorskip("allantools")
    rng = np.random.default_rng(1)
    n, rate = 5000, 50.0
    series = rng.standard_normal(n) + 0.02 * np.cumsum(rng.standard_normal(n))
    factors = averaging_factors(n)
    taus, expected, _, _ = allantools.oadev(
        series, rate=rate, data_type="freq", taus=factors / rate
    )
    np.testing.assert_allclose(taus, factors / rate)
    np.testing.assert_allclose(overlapping_deviation(series, rate, factors), expected, rtol=1e-9)


def test_white_noise_and_walk_come_back() -> None:
    rng = np.random.default_rng(0)
    n, rate = 20_000, 50.0
    white, walk = 1e-3, 2e-4
    noise = white * np.sqrt(rate) * rng.standard_normal(n)
    noise += walk / np.sqrt(rate) * np.cumsum(rng.standard_normal(n))
    fit = allan_fit(noise, rate)
    assert fit.white.value == pytest.approx(white, rel=0.05)
    assert fit.white.low < white < fit.white.high
    assert fit.walk.value == pytest.approx(walk, rel=0.5)
    assert np.mean((fit.fitted > fit.low) & (fit.fitted < fit.high)) > 0.8


def test_factors_stay_within_a_fifth() -> None:
    factors = averaging_factors(1000)
    assert factors[0] == 1
    assert factors[-1] == 200
    assert np.all(np.diff(factors) > 0)


def test_short_or_dead_records_are_refused() -> None:
    with pytest.raises(InputError, match="too few"):
        allan_fit(np.random.default_rng(0).normal(size=100), 50.0)
    with pytest.raises(InputError, match="never changes"):
        allan_fit(np.zeros(1000), 50.0)


def test_only_the_longest_rest_is_used() -> None:
    rng = np.random.default_rng(0)
    n = 12_000
    gyro, accel = rng.normal(0, 0.01, (n, 3)), rng.normal(0, 0.02, (n, 3))
    gyro[2000:2500] += np.sin(np.arange(500) / 20.0)[:, None]
    # in counts, of another scale on each axis
    of_gyro, of_accel = np.array([0.5, 2.0, 4.0]), np.array([2.0, 1.0, 0.25])
    times = np.arange(n) * 10_000_000
    log = RawImu(times, gyro / of_gyro, accel / of_accel, gyro_scale=of_gyro, accel_scale=of_accel)
    result = resting_fits(log)
    assert result.start_s > 24.5
    assert result.seconds > 90.0
    assert "moved" in result.warnings[0]
    assert result.fits["gyro_x"].white.value == pytest.approx(0.001, rel=0.05)
    assert result.fits["accel_z"].white.value == pytest.approx(0.002, rel=0.05)
