"""The camera: pixels to directions and back, and what its errors do to them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from geolocation_scene import camera
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.effects import CATALOGUE
from automap.effects.camera import (
    direction_by_point,
    error_columns,
    exposed,
    in_camera,
    row_share,
    true_camera,
)
from automap.effects.lens import normalise, project, touches_edge
from automap.frames import matrix_to_rotation_vector, rotation_vector_to_matrix, rpy_to_matrix
from automap.records import Camera, FloatArray
from automap.simulation.boxes import face_box

STATED = camera(
    distortion=np.array([-0.25, 0.08, 0.001, -0.002, 0.01]),
    mount_rpy=np.array([0.02, -0.05, 0.04]),
    lever_arm_m=np.array([1.4, 0.3, -0.9]),
    matrix=np.array([[1000.0, 0.0, 640.0], [0.0, 980.0, 360.0], [0.0, 0.0, 1.0]]),
)
KNOWN = {
    "camera_boresight": {"roll": 0.03, "pitch": -0.02, "yaw": 0.05},
    "camera_time_offset": {"s": 0.04},
    "camera_focal": {"relative": 0.02},
    "camera_distortion": {"k1": 0.05, "k2": -0.02},
    "camera_lever_arm": {"x": 0.3, "y": -0.2, "z": 0.1},
}
"""Errors that the camera is known to have, about which it is differentiated."""
KEYS = [(e.name, p.name) for e in CATALOGUE.values() if e.family == "camera" for p in e.parameters]
SIGNS = np.array([[24.0, 5.0, -2.5], [30.0, -6.0, 1.0], [26.0, 1.0, -4.5], [28.0, -9.0, -3.0]])
SIZE_M = 0.3
PLATE = 0.5 * np.array([[[0.0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]])
"""Middles of the edges of a plate that faces the camera, in its axes."""
STAMPS = np.array([0.0, 0.3, 0.5, 0.1])


def pose_at(seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A car that turns, climbs and sways."""
    t = np.asarray(seconds)
    position = np.column_stack([14.0 * t, 2.0 * t + 1.5 * t**2, -0.4 * t])
    rpy = np.column_stack([0.05 * t, 0.02 - 0.1 * t, 0.1 + 0.3 * t])
    return position, rpy_to_matrix(rpy)


def boxes(values: dict[str, dict[str, float]]) -> FloatArray:
    """Boxes [n, 4] of the signs as the simulator's camera takes them."""
    true = true_camera(STATED, values)
    out = []
    for sign, stamp in zip(SIGNS, STAMPS, strict=True):
        at = np.array([stamp + true.time_offset_s])
        out.append(face_box(true, exposed(true, values, pose_at, at, sign)[0], PLATE * SIZE_M)[0])
    return np.array(out)


def measured(box: FloatArray, known: Camera) -> FloatArray:
    """Direction and log height [n, 3] as the estimators take them from boxes."""
    x, y = 0.5 * (box[:, 0] + box[:, 2]), 0.5 * (box[:, 1] + box[:, 3])
    top, bottom = (normalise(known, np.column_stack([x, box[:, k]]))[:, 1] for k in (1, 3))
    return np.column_stack([normalise(known, np.column_stack([x, y])), np.log(bottom - top)])


def columns() -> FloatArray:
    """Analytic columns [n, 3, 11] about the known errors."""
    known = true_camera(STATED, KNOWN)
    at = STAMPS + known.time_offset_s
    step = 1e-5
    before, after = pose_at(at - step), pose_at(at + step)
    position, C = pose_at(at)
    C_cam_body = rpy_to_matrix(known.mount_rpy).T
    centre = [p + c @ known.lever_arm_m for p, c in (before, after)]
    speed = np.einsum("nji,nj->ni", C, (centre[1] - centre[0]) / (2.0 * step)) @ C_cam_body.T
    turned = matrix_to_rotation_vector(np.swapaxes(before[1], 1, 2) @ after[1]) / (2.0 * step)
    box = boxes(KNOWN)
    share = row_share(0.5 * (box[:, 1] + box[:, 3]), known.height)
    q = in_camera(known, position, C, SIGNS)
    height = np.exp(measured(box, known)[:, 2])
    return error_columns(known, KNOWN, q, height, share, turned @ C_cam_body.T, speed)


@pytest.mark.parametrize("key", KEYS, ids=".".join)
def test_columns_are_the_derivatives_of_what_the_simulator_films(key: tuple[str, str]) -> None:
    effect, parameter = key
    step = 1e-4
    known = true_camera(STATED, KNOWN)
    seen = []
    for move in (step, -step):
        values = {e: dict(v) for e, v in KNOWN.items()}
        at = values.setdefault(effect, {})
        at[parameter] = at.get(parameter, 0.0) + move
        seen.append(measured(boxes(values), known))
    numeric = (seen[0] - seen[1]) / (2.0 * step)
    column = columns()[:, :, KEYS.index(key)]
    scale = np.abs(numeric).max()
    assert scale > 0.0
    np.testing.assert_allclose(column[:, :2], numeric[:, :2], atol=2e-3 * scale)
    # a box about a bent plate is a little taller than the plate's middle line
    np.testing.assert_allclose(column[:, 2], numeric[:, 2], atol=0.05 * scale)


def test_direction_by_point_and_pose() -> None:
    known = true_camera(STATED, KNOWN)
    position, C = pose_at(STAMPS)

    def direction(move: FloatArray, turn: FloatArray) -> FloatArray:
        q = in_camera(known, position + move, C @ rotation_vector_to_matrix(turn), SIGNS)
        return np.column_stack([q[:, 1] / q[:, 0], q[:, 2] / q[:, 0], -np.log(q[:, 0])])

    q = in_camera(known, position, C, SIGNS)
    C_cam_body = rpy_to_matrix(known.mount_rpy).T
    slope = direction_by_point(q)
    by_place = -slope @ (C_cam_body @ np.swapaxes(C, 1, 2))
    # the vehicle turns about its own origin, the camera's arm with it
    arm = q @ C_cam_body + known.lever_arm_m
    step = 1e-6
    for axis in range(3):
        e = np.eye(3)[axis] * step
        numeric = (direction(e, 0.0 * e) - direction(-e, 0.0 * e)) / (2.0 * step)
        np.testing.assert_allclose(by_place[:, :, axis], numeric, atol=1e-7)
        numeric = (direction(0.0 * e, e) - direction(0.0 * e, -e)) / (2.0 * step)
        turned = np.cross(arm, np.eye(3)[axis]) @ C_cam_body.T
        np.testing.assert_allclose(np.einsum("nij,nj->ni", slope, turned), numeric, atol=1e-7)


@pytest.mark.parametrize(
    "distortion",
    [
        [-0.3, 0.1, 0.001, -0.002],
        [-0.3, 0.1, 0.001, -0.002, 0.05],
        [0.2, -0.4, 0.001, 0.002, 0.1, 0.25, -0.35, 0.08],
        [0.2, -0.4, 0.001, 0.002, 0.1, 0.25, -0.35, 0.08, 0.003, -0.001, 0.002, 0.004],
        [-0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.003, 0.0, 0.002, 0.0, 0.03, -0.05],
    ],
)
def test_the_simulator_sees_what_opencv_sees(distortion: list[float]) -> None:
    view = true_camera(camera(distortion=np.array(distortion)), KNOWN)
    place, C = pose_at(STAMPS[1:2])
    pixels = project(view, in_camera(view, place, C, SIGNS))
    # OpenCV: x right, y down, z forward
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    R = axes @ (C[0] @ rpy_to_matrix(view.mount_rpy)).T
    t = -R @ (place[0] + C[0] @ view.lever_arm_m)
    expected, _ = cv2.projectPoints(SIGNS, cv2.Rodrigues(R)[0], t, view.matrix, view.distortion)
    np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-8)


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


@settings(max_examples=50)
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
