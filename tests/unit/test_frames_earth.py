"""Attitude forms and the ellipsoid, against scipy, pymap3d and published values."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from automap import earth, frames

ANGLE = st.floats(-np.pi, np.pi)
PITCH = st.floats(-1.5, 1.5)
PLACES = [
    (0.0, 0.0, 0.0),
    (-35.28, 149.13, 580.0),
    (48.1, 11.6, 520.0),
    (80.0, 20.0, -5.0),
    (-16.5, 179.999, 10.0),
    (89.9999, -75.0, 100.0),
    (-89.9, 10.0, 2800.0),
]


@given(ANGLE, PITCH, ANGLE)
def test_euler_angles_are_scipys_zyx(roll: float, pitch: float, yaw: float) -> None:
    ours = frames.rpy_to_matrix([roll, pitch, yaw])
    theirs = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert ours == pytest.approx(theirs, abs=1e-14)
    back = frames.matrix_to_rpy(ours)
    assert frames.wrap_pi(back - [roll, pitch, yaw]) == pytest.approx(np.zeros(3), abs=1e-9)


@given(ANGLE, st.sampled_from([-np.pi / 2, np.pi / 2]), ANGLE)
def test_straight_up_and_down_give_the_same_matrix_back(
    roll: float, pitch: float, yaw: float
) -> None:
    c = frames.rpy_to_matrix([roll, pitch, yaw])
    angles = frames.matrix_to_rpy(c)
    assert np.isfinite(angles).all()
    assert angles[1] == pytest.approx(pitch, abs=1e-6)


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_quaternions_and_rotation_vectors_invert(vector: list[float]) -> None:
    v = np.array(vector)
    if np.linalg.norm(v) > 3.1:
        v *= 3.1 / np.linalg.norm(v)
    c = frames.rotation_vector_to_matrix(v)
    assert c @ c.T == pytest.approx(np.eye(3), abs=1e-12)
    assert frames.matrix_to_rotation_vector(c) == pytest.approx(v, abs=1e-9)
    q = frames.matrix_to_quat(c)
    assert q[0] >= 0.0
    assert frames.quat_to_matrix(q) == pytest.approx(c, abs=1e-12)


def test_a_stack_is_treated_like_its_members() -> None:
    rpy = np.random.default_rng(1).uniform(-1.4, 1.4, (2, 5, 3))
    stacked = frames.rpy_to_matrix(rpy)
    assert stacked.shape == (2, 5, 3, 3)
    for i in range(2):
        for j in range(5):
            assert stacked[i, j] == pytest.approx(frames.rpy_to_matrix(rpy[i, j]), abs=0)
    assert frames.quat_to_matrix(frames.matrix_to_quat(stacked)) == pytest.approx(stacked)
    vectors = frames.matrix_to_rotation_vector(stacked)
    assert frames.rotation_vector_to_matrix(vectors) == pytest.approx(stacked)


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_lie_in_one_turn(angle: float) -> None:
    wrapped = float(frames.wrap_pi(angle))
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


def test_sd_of_angles_is_the_spread_of_turned_attitudes() -> None:
    rng = np.random.default_rng(5)
    rpy = np.array([[0.1, -0.3, 2.0]])
    root = rng.standard_normal((3, 3)) * 1e-3
    turns = frames.rotation_vector_to_matrix(rng.standard_normal((200_000, 3)) @ root.T)
    angles = frames.matrix_to_rpy(turns @ frames.rpy_to_matrix(rpy))
    sd = frames.rpy_sd_from_tilt(rpy, (root @ root.T)[None])
    assert sd[0] == pytest.approx(angles.std(axis=0), rel=0.01)


def test_gravity_has_the_published_values() -> None:
    # NIMA TR8350.2, table 3.4: equator and poles
    assert earth.gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert earth.gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=2e-9)
    # free air: 3.086e-6 per metre at middle latitudes
    fall = earth.gravity(np.pi / 4, 0.0) - earth.gravity(np.pi / 4, 1000.0)
    assert fall == pytest.approx(3.086e-3, rel=2e-3)


@pytest.mark.parametrize("lat", [-89.0, -35.28, 0.0, 10.0, 48.0, 80.0])
def test_radii_are_pymap3ds(lat: float) -> None:
    meridian, transverse = earth.radii(np.radians(lat))
    assert meridian == pytest.approx(pymap3d.rcurve.meridian(lat), rel=1e-12)
    assert transverse == pytest.approx(pymap3d.rcurve.transverse(lat), rel=1e-12)


@pytest.mark.parametrize("place", PLACES)
def test_local_metres_go_there_and_back(place: tuple[float, float, float]) -> None:
    ref = (np.radians(place[0]), np.radians(place[1]), place[2])
    ned = np.random.default_rng(2).uniform(-3e3, 3e3, (50, 3))
    lat, lon, height = earth.from_local_ned(ned, ref)
    assert earth.local_ned(lat, lon, height, ref) == pytest.approx(ned, abs=1e-6)


@pytest.mark.parametrize("place", PLACES[:-2])
def test_metres_per_radian_are_short_distances(place: tuple[float, float, float]) -> None:
    lat, lon, height = np.radians(place[0]), np.radians(place[1]), place[2]
    north, east = earth.metres_per_radian(lat, height)
    moved = earth.local_ned([lat + 1e-7, lat], [lon, lon + 1e-7], height, (lat, lon, height))
    assert moved[0, 0] == pytest.approx(float(north) * 1e-7, rel=1e-5)
    assert moved[1, 1] == pytest.approx(float(east) * 1e-7, rel=1e-5)


def test_local_metres_cross_the_date_line() -> None:
    ref = (np.radians(-16.5), np.radians(179.9999), 0.0)
    ned = earth.local_ned([ref[0]], [np.radians(-179.9999)], [0.0], ref)
    assert ned[0, 1] == pytest.approx(2e-4 * np.pi / 180 * 6.1179e6, rel=1e-3)
