"""Shocks: noise that readings show by their scatter from sample to sample."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.shocks import shock_noise
from automap.records import FloatArray

STEP_S = 0.01


def readings(rng: np.random.Generator) -> FloatArray:
    """A minute of a smooth motion with white noise, [n, 6]."""
    t = STEP_S * np.arange(6000)
    smooth = np.stack([np.sin((0.3 + 0.2 * i) * t) for i in range(6)], axis=1)
    noise = rng.normal(0.0, 1.0, (len(t), 6)) * [*[1e-3] * 3, *[0.05] * 3]
    return np.asarray(smooth + noise)


def split(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    return rows[:, :3], rows[:, 3:]


def test_even_noise_has_no_shocks() -> None:
    assert not shock_noise(*split(readings(np.random.default_rng(1))), STEP_S).any()


def test_a_shock_adds_the_noise_that_it_has() -> None:
    rng = np.random.default_rng(2)
    rows = readings(rng)
    rows[3000:3050, 3:] += rng.normal(0.0, 2.0, (50, 3))
    noise = shock_noise(*split(rows), STEP_S)
    assert noise[3010:3040, 0].mean() == pytest.approx(2.0**2 * STEP_S, rel=0.3)
    assert not noise[:2980].any()
    assert not noise[:, 1].any()


def test_too_few_readings_have_no_shocks() -> None:
    assert not shock_noise(np.ones((2, 3)), np.ones((2, 3)), STEP_S).any()
