"""The gap that is left: against the divergence of processes whose colour and size are known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from automap.fusion.layout import CH_NHC, CH_POS
from automap.gap.joint import combine
from automap.gap.limits import HUBER, REST_S
from automap.gap.rest import squared_steps
from automap.gap.scoring import _distance, _lag1, _rho


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


def test_a_wild_value_costs_no_more_than_its_slope_at_the_limit() -> None:
    """Huber's loss is the integral of a slope that stays at the limit."""
    u = np.linspace(-12.0, 12.0, 2401)
    slope = np.clip(u, -HUBER, HUBER)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(u))])
    np.testing.assert_allclose(_rho(u), integral - integral[1200], atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_estimates_of_drives_are_joined_as_one_least_squares_would(scale: float) -> None:
    """Three drives that measure two parameters with one prior: each posterior, and the evidence of
    all with the prior once, from the dense normal of all measurements."""
    rng = np.random.default_rng(5)
    prior = np.array([0.5, 2.0]) * scale
    fits: list[Any] = []
    gains, rows, seen, noise = [], [], [], []
    for k in range(3):
        A = rng.normal(size=(3 + k, 2)) / prior
        R = np.diag(rng.uniform(0.5, 2.0, 3 + k))
        z = A @ (prior * rng.standard_normal(2)) + np.sqrt(np.diag(R)) * rng.standard_normal(3 + k)
        cov = np.linalg.inv(A.T @ np.linalg.solve(R, A) + np.diag(prior**-2))
        fits.append(
            SimpleNamespace(names=("a.x", "a.y"), cov=cov, values=cov @ A.T @ np.linalg.solve(R, z))
        )
        whole = multivariate_normal(np.zeros(3 + k), A @ np.diag(prior**2) @ A.T + R)
        gains.append(whole.logpdf(z) - multivariate_normal(np.zeros(3 + k), R).logpdf(z))
        rows.append(A)
        seen.append(z)
        noise.append(np.diag(R))
    A, z, R = np.vstack(rows), np.concatenate(seen), np.diag(np.concatenate(noise))
    joint = combine(fits, gains, prior)
    cov = np.linalg.inv(A.T @ np.linalg.solve(R, A) + np.diag(prior**-2))
    np.testing.assert_allclose(joint.cov, cov, rtol=1e-6)
    assert joint.values == pytest.approx(cov @ A.T @ np.linalg.solve(R, z), rel=1e-6)
    n = len(z)
    alone = multivariate_normal(np.zeros(n), R).logpdf(z)
    whole = multivariate_normal(np.zeros(n), A @ np.diag(prior**2) @ A.T + R).logpdf(z)
    assert joint.nats == pytest.approx(whole - alone, rel=1e-6, abs=1e-6)
    nothing: Any = SimpleNamespace(names=())
    assert combine([nothing] * 2, [1.0, 2.5], np.zeros(0)).nats == 3.5


def test_neighbouring_means_of_a_halt_step_by_their_noise() -> None:
    t = np.arange(0.0, 30.0, 0.01) + 100.0
    readings = np.random.default_rng(6).normal(size=(3000, 3))
    found = squared_steps(t, readings, (102.995, 124.9))
    rows = np.flatnonzero((t >= 102.995) & (t < 124.9))
    size = round(REST_S / 0.01)
    whole = len(rows) // size
    means = [readings[rows[k * size : (k + 1) * size]].mean(axis=0) for k in range(whole)]
    # the last, whole or cut short, is not used
    means = means if len(rows) % size else means[:-1]
    np.testing.assert_allclose(found, np.diff(means, axis=0) ** 2, rtol=1e-9)
    assert squared_steps(t, readings, (0.0, 50.0)).shape == (0, 3)
