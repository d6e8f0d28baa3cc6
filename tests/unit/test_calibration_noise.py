"""The noise of a log, whether it rests, moves all the time, or is correlated."""

from __future__ import annotations

import numpy as np
import pytest

from automap.calibration.limits import STILL_LIMIT
from automap.calibration.rest import movement, noise_density
from automap.records import FloatArray, RawImu

SD = np.array([0.02, 0.03, 0.04, 0.001, 0.002, 0.003])


def log_of(values: FloatArray, rate_hz: float) -> RawImu:
    """A log of readings [n, 6], accelerometer first."""
    stamps = np.rint(np.arange(len(values)) / rate_hz * 1e9).astype(np.int64)
    return RawImu(stamps, values[:, 3:], values[:, :3])


def noise(rng: np.random.Generator, n: int) -> FloatArray:
    return np.asarray(SD * rng.normal(size=(n, 6)))


@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_the_density_is_that_of_averages(rate_hz: float) -> None:
    """White noise of a standard deviation at a rate averages like its density says, at rest and on
    a log that never rests."""
    rng = np.random.default_rng(2)
    n = round(300 * rate_hz)
    t = np.arange(n) / rate_hz
    resting = log_of(noise(rng, n), rate_hz)
    expected = SD / np.sqrt(rate_hz)
    # one rest: ten batches tell an sd to a quarter
    np.testing.assert_allclose(noise_density(resting, STILL_LIMIT), expected, rtol=0.75)
    # slow sway of many times the noise, at no time still on all axes: no window of it is a rest
    axes = np.arange(6)
    sway = 100.0 * SD * np.sin(2.0 * np.pi * np.outer(t, 0.3 + 0.07 * axes) + axes)
    moving = log_of(noise(rng, n) + sway, rate_hz)
    assert movement(moving).min() > STILL_LIMIT
    np.testing.assert_allclose(noise_density(moving, STILL_LIMIT), expected, rtol=0.5)


def test_correlated_noise_averages_out_more_slowly() -> None:
    """Noise of which a = 0.9 outlasts a sample has (1 + a) / (1 - a) of the white's power."""
    rng = np.random.default_rng(3)
    rate_hz, keep, n = 100.0, 0.9, 60_000
    drive = noise(rng, n) * np.sqrt(1.0 - keep**2)
    values = np.empty_like(drive)
    values[0] = drive[0]
    for k in range(1, n):
        values[k] = keep * values[k - 1] + drive[k]
    # rests of eight seconds between short jerks, so that there are many
    for start in range(0, n, 1000):
        values[start : start + 200] += 100.0 * SD * rng.normal(size=(200, 6))
    found = noise_density(log_of(values, rate_hz), STILL_LIMIT)
    expected = SD / np.sqrt(rate_hz) * np.sqrt((1.0 + keep) / (1.0 - keep))
    np.testing.assert_allclose(found, expected, rtol=0.35)
