"""A camera's yaw against the direction of travel, where the trajectory's heading is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.effects.limits import NOSE_SLIP_DEG
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.geolocation.locate import locate_signs
from automap.geolocation.views import CameraCorrection, MeasurementNoise, build_views


@pytest.mark.slow
def test_a_heading_error_is_no_turn_of_the_camera() -> None:
    true = drive_path(120.0, turn_rate=0.01)
    view = camera(mount_rpy=np.zeros(3), mount_sd=np.radians(3.0))
    found, _ = boxes(true, roadside(true), view, np.random.default_rng(0), noise_px=0.5)
    off = float(np.radians(0.8))
    turned = true.rpy.copy()
    turned[:, 2] += off
    given = replace(true, rpy=turned, sd_rpy=np.full_like(turned, off))
    correction = locate_signs(given, [found], {"front": view}).corrections["front"]
    np.testing.assert_allclose(correction.turn[2], -off, atol=np.radians(0.15))
    assert correction.course_yaw is not None
    yaw, sd = correction.course_yaw
    assert abs(yaw) < np.radians(0.1)
    # two minutes tell no more than what the nose is off its course by for minutes
    assert sd == pytest.approx(np.radians(NOSE_SLIP_DEG), rel=0.05)


@pytest.mark.slow
def test_without_straight_roads_the_course_says_nothing() -> None:
    true = drive_path(40.0, turn_rate=0.2)
    view = camera(mount_rpy=np.zeros(3), mount_sd=np.radians(3.0))
    found, _ = boxes(true, roadside(true), view, np.random.default_rng(0))
    correction = locate_signs(true, [found], {"front": view}).corrections["front"]
    assert correction.course_yaw is not None
    np.testing.assert_allclose(correction.course_yaw, (0.0, np.radians(3.0)), atol=1e-6)


def test_a_turn_that_was_found_counts_as_if_the_manifest_had_it() -> None:
    path = drive_path(10.0)
    view = camera()
    found, _ = boxes(path, roadside(path, every_s=2.0), view, np.random.default_rng(0))
    turn = np.radians([1.0, -3.0, 5.0])
    mount = matrix_to_rpy(rpy_to_matrix(view.mount_rpy) @ rpy_to_matrix(turn))
    one, other = (
        build_views(path, [found], {"front": seen}, MeasurementNoise(), corrections)
        for seen, corrections in (
            (view, {"front": CameraCorrection(turn, 0.0, np.eye(9))}),
            (replace(view, mount_rpy=mount), None),
        )
    )
    for name in ("centre", "C_cam_ref", "C_cam_body", "velocity", "rate", "measured"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)
