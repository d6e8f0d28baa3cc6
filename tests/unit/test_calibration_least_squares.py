"""Least squares with an unknown floor, against closed forms, SciPy and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import t as student

from automap.calibration.least_squares import fit_with_floor, gauss_newton
from automap.records import FloatArray

TRUE = np.array([2.0, -0.7, 0.3])


def curve(at: FloatArray, y: FloatArray):  # type: ignore[no-untyped-def]
    """Residuals and Jacobian of y = a exp(b t) + c, of which the second is far from the others."""

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        e = np.exp(x[1] * at)
        return x[0] * e + x[2] - y, np.column_stack([e, x[0] * at * e, np.ones(len(at))])

    return model


def line(at: FloatArray, y: FloatArray):  # type: ignore[no-untyped-def]
    design = np.column_stack([np.ones(len(at)), at])
    return lambda x: (design @ x - y, design)


def test_the_minimum_is_scipys() -> None:
    rng = np.random.default_rng(1)
    at = np.linspace(0.0, 5.0, 60)
    sd = rng.uniform(0.01, 0.3, len(at))
    y = TRUE[0] * np.exp(TRUE[1] * at) + TRUE[2] + sd * rng.normal(size=len(at))
    model = curve(at, y)
    found = gauss_newton(model, np.array([1.0, -0.1, 0.0]), sd)
    expected = least_squares(
        lambda x: model(x)[0] / sd, np.array([1.0, -0.1, 0.0]), xtol=1e-14, ftol=1e-14, gtol=1e-14
    ).x
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    # from far off too, where a whole step would overshoot
    far = gauss_newton(model, np.array([8.0, -4.0, 3.0]), sd)
    np.testing.assert_allclose(far, expected, rtol=1e-4)


def test_without_a_floor_covariance_and_residuals_are_the_closed_forms() -> None:
    """Where the variances explain all: weighted least squares of a line."""
    at = np.linspace(-1.0, 3.0, 50)
    variance = np.linspace(0.5, 2.0, 50) ** 2
    # residuals well below their variances
    y = 1.0 + 2.0 * at + 0.1 * np.sin(7.0 * at)
    none = np.zeros(50, np.int64)
    fit = fit_with_floor(line(at, y), np.zeros(2), variance, none, np.ones(50))
    design = np.column_stack([np.ones(50), at])
    normal = np.linalg.inv(design.T @ (design / variance[:, None]))
    np.testing.assert_allclose(fit.floor, 0.0, atol=1e-9)
    np.testing.assert_allclose(fit.covariance, normal, rtol=1e-6)
    np.testing.assert_allclose(fit.parameters, normal @ design.T @ (y / variance), rtol=1e-6)
    np.testing.assert_allclose(fit.sd, np.sqrt(variance), rtol=1e-9)
    np.testing.assert_allclose(fit.residuals, design @ fit.parameters - y)


def test_with_nothing_but_a_floor_it_is_ordinary_least_squares() -> None:
    """The floor is then the usual estimate with n - p degrees of freedom, and so the intervals."""
    rng = np.random.default_rng(2)
    at = np.linspace(-1.0, 3.0, 12)
    y = 1.0 + 2.0 * at + 0.3 * rng.normal(size=12)
    design = np.column_stack([np.ones(12), at])
    start, group = np.zeros(2), np.zeros(12, np.int64)
    fit = fit_with_floor(line(at, y), start, np.zeros(12), group, np.ones(12))
    best, rest, *_ = np.linalg.lstsq(design, y, rcond=None)
    np.testing.assert_allclose(fit.parameters, best, rtol=1e-6)
    s2 = float(rest[0]) / 10.0
    assert fit.floor[0] == pytest.approx(np.sqrt(s2), rel=2e-3)
    np.testing.assert_allclose(fit.covariance, s2 * np.linalg.inv(design.T @ design), rtol=5e-3)
    assert fit.dof == pytest.approx(10.0, rel=1e-6)
    width = student.ppf(0.975, 10.0) * np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose(fit.half_width(), width, rtol=1e-9)


@pytest.mark.slow
def test_each_group_has_its_own_floor_without_bias() -> None:
    """Rows of two kinds on one line, one with known noise besides: Monte Carlo."""
    rng = np.random.default_rng(3)
    at = np.linspace(-1.0, 3.0, 40)
    group = (np.arange(40) % 2).astype(np.int64)
    known, floor = np.array([0.0, 0.2]), np.array([0.1, 0.4])
    variance = known[group] ** 2
    sd = np.sqrt(variance + floor[group] ** 2)
    found, offs, inside = [], [], 0
    for _ in range(400):
        y = 1.0 + 2.0 * at + sd * rng.normal(size=40)
        fit = fit_with_floor(line(at, y), np.zeros(2), variance, group, np.ones(40))
        found.append(fit.floor**2)
        off = fit.parameters - [1.0, 2.0]
        offs.append(off)
        inside += int(np.all(np.abs(off[1]) < fit.half_width()[1]))
    np.testing.assert_allclose(np.mean(found, axis=0), floor**2, rtol=0.08)
    design = np.column_stack([np.ones(40), at])
    stated = np.linalg.inv(design.T @ (design / sd[:, None] ** 2))
    np.testing.assert_allclose(np.cov(np.array(offs).T), stated, rtol=0.35)
    # only the part of the variance that is floor was estimated (Satterthwaite)
    part = np.mean(fit.floor[group] ** 2 / (variance + fit.floor[group] ** 2))
    assert fit.dof == pytest.approx(38.0 / part**2, rel=1e-9)
    assert 0.92 < inside / 400 < 0.985


def test_rows_that_share_degrees_of_freedom_bring_only_their_part() -> None:
    """Residuals in threes that lie in a plane: a third of them is no freedom of its own."""
    rng = np.random.default_rng(4)
    floors = []
    for _ in range(200):
        n = 60
        normal = rng.normal(size=(n, 3))
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        noise = 0.2 * rng.normal(size=(n, 3))
        noise -= normal * np.sum(normal * noise, axis=1)[:, None]
        y = noise.ravel()
        design = np.tile(np.eye(3), (n, 1))
        group = np.zeros(3 * n, np.int64)
        share = np.full(3 * n, 2.0 / 3.0)
        fit = fit_with_floor(
            lambda x, y=y, design=design: (design @ x - y, design),
            np.zeros(3), np.zeros(3 * n), group, share,
        )  # fmt: skip
        floors.append(fit.floor[0] ** 2)
    assert np.mean(floors) == pytest.approx(0.04, rel=0.05)
