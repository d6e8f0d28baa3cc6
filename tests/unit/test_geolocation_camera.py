"""Pixels to directions and back."""

from __future__ import annotations

import numpy as np
import pytest
from geolocation_scene import camera
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.geolocation.camera_model import normalise, project, touches_edge


@pytest.mark.parametrize(
    "distortion",
    [
        np.zeros(5),
        np.array([-0.3, 0.1, 0.001, -0.002, 0.0]),
        np.array([0.2, -0.4, 0.0, 0.0, 0.1, 0.25, -0.35, 0.08]),
    ],
    ids=["none", "barrel", "rational"],
)
def test_projecting_undoes_normalising(distortion: np.ndarray) -> None:
    view = camera(distortion=distortion)
    x, y = np.meshgrid(np.linspace(40, 1240, 25), np.linspace(40, 680, 15))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    rays = normalise(view, pixels)
    assert np.isfinite(rays).all()
    again = project(view, np.column_stack([np.ones(len(rays)), rays]))
    np.testing.assert_allclose(again, pixels, atol=0.01)


def test_principal_point_looks_forward_and_right_is_right() -> None:
    view = camera()
    rays = normalise(view, np.array([[640.0, 360.0], [740.0, 360.0], [640.0, 460.0]]))
    np.testing.assert_allclose(rays, [[0, 0], [0.1, 0], [0, 0.1]], atol=1e-12)


def test_points_behind_the_camera_have_no_pixel() -> None:
    assert np.isnan(project(camera(), np.array([[-5.0, 0.0, 0.0]]))).all()


def test_pixels_outside_the_lens_model_have_no_direction() -> None:
    folding = camera(distortion=np.array([-0.6, 0.0, 0.0, 0.0, 0.0]))
    rays = normalise(folding, np.array([[640.0, 360.0], [1800.0, 1100.0]]))
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


@settings(max_examples=50, deadline=None)
@given(
    k1=st.floats(-0.25, 0.25),
    k2=st.floats(-0.05, 0.05),
    u=st.floats(300, 980),
    v=st.floats(150, 570),
)
def test_inverse_of_any_moderate_lens(k1: float, k2: float, u: float, v: float) -> None:
    view = camera(distortion=np.array([k1, k2, 0.0, 0.0, 0.0]))
    ray = normalise(view, np.array([[u, v]]))
    again = project(view, np.array([[1.0, *ray[0]]]))
    np.testing.assert_allclose(again, [[u, v]], atol=0.01)


def test_boxes_at_the_edge_are_recognised() -> None:
    box = np.array([[10.0, 10, 50, 50], [0, 10, 50, 50], [1240, 10, 1279, 50], [10, 680, 50, 719]])
    assert touches_edge(camera(), box).tolist() == [False, True, True, True]
