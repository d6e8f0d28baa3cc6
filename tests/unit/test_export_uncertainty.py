"""95 % circles and ellipses of a horizontal covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from automap.export.uncertainty import ce95, ellipse_outlines, principal_axes


def one(value: float) -> np.ndarray:
    return np.array([value])


def test_circle_and_line_are_the_known_quantiles() -> None:
    circle = ce95(one(4.0), one(0.0), one(4.0))[0]
    line = ce95(one(9.0), one(0.0), one(0.0))[0]
    assert circle == pytest.approx(2.0 * np.sqrt(chi2.ppf(0.95, 2)), rel=1e-7)
    assert line == pytest.approx(3.0 * norm.ppf(0.975), rel=1e-7)


@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.3, 0.7, 0.95])
def test_radius_holds_95_percent(ratio: float) -> None:
    """Against the cumulative probability by Gauss-Legendre integration over x."""
    radius = ce95(one(1.0), one(0.0), one(ratio**2))[0]
    nodes, weights = np.polynomial.legendre.leggauss(400)
    # x = r sin(u) takes the square root's kink at the ends away
    angle = 0.5 * np.pi * nodes
    x = radius * np.sin(angle)
    inside = 2.0 * norm.cdf(radius * np.cos(angle) / ratio) - 1.0
    density = norm.pdf(x) * inside * radius * np.cos(angle) * 0.5 * np.pi
    assert float(weights @ density) == pytest.approx(0.95, abs=1e-6)


@given(st.floats(0.01, 100.0), st.floats(0.01, 1.0), st.floats(0.0, np.pi), st.floats(0.0, np.pi))
def test_radius_does_not_depend_on_direction(
    major: float, ratio: float, first: float, second: float
) -> None:
    radii = []
    for angle in (first, second):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        cov = turn @ np.diag([major**2, (ratio * major) ** 2]) @ turn.T
        radii.append(ce95(one(cov[0, 0]), one(cov[0, 1]), one(cov[1, 1]))[0])
    assert radii[0] == pytest.approx(radii[1], rel=1e-6)
    assert 1.959 * major < radii[0] < 2.448 * major


def test_ellipse_points_lie_on_the_95_percent_contour() -> None:
    cov = np.array([[2.0, 0.7], [0.7, 0.5]])
    outline = ellipse_outlines(one(2.0), one(0.7), one(0.5))[0]
    distance = np.einsum("ki,ij,kj->k", outline, np.linalg.inv(cov), outline)
    np.testing.assert_allclose(distance, chi2.ppf(0.95, 2), rtol=1e-9)
    np.testing.assert_array_equal(outline[0], outline[-1])
    x, y = outline.T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0, "outer rings turn counter-clockwise"


def test_azimuth_is_clockwise_from_north() -> None:
    # a long axis to the north-east
    _, _, azimuth = principal_axes(one(1.0), one(0.9), one(1.0))
    assert np.degrees(azimuth[0]) == pytest.approx(45.0)
    _, _, east = principal_axes(one(2.0), one(0.0), one(1.0))
    assert np.degrees(east[0]) == pytest.approx(90.0)


def test_unknown_and_slightly_negative_covariances() -> None:
    assert np.isnan(ce95(one(np.nan), one(0.0), one(1.0))[0])
    assert ce95(one(0.0), one(0.0), one(0.0))[0] == 0.0
    assert np.isfinite(ce95(one(1.0), one(1.0 + 1e-12), one(1.0))[0])
