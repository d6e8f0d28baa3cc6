"""The dynamic calibration's kernels against matrices, numeric derivatives and integration."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.calibration import dynamic, limits
from automap.calibration.dynamic_kernel import (
    BA,
    N_ERRORS,
    N_STATES,
    PHI,
    POS,
    VEL,
    _propagate,
    _propagate_covariance,
    _propagate_response,
    _store,
    _update,
    _update_response,
)
from automap.calibration.gravity_kernel import N_SIGNALS, carry_direction
from automap.frames import (
    matrix_to_quat,
    matrix_to_rotation_vector,
    quat_to_matrix,
    rotation_vector_to_matrix,
)
from automap.records import FloatArray

GRAVITY = 9.8
H = 1e-3


def step(
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """An attitude, two readings of the accelerometer and of the gyro, and a covariance."""
    C = rotation_vector_to_matrix(rng.normal(size=3))
    accel, gyro = rng.normal(0.0, 6.0, (2, 3)), rng.normal(0.0, 2.0, (2, 3))
    root = rng.normal(size=(N_STATES, N_STATES))
    return C, accel, gyro, root @ root.T


def transition(F: FloatArray, h: float) -> FloatArray:
    """Place by the velocity of the step's start, then the other states."""
    place, rest = np.eye(N_STATES), np.eye(N_STATES)
    place[POS:, VEL : VEL + 3] = h * np.eye(3)
    rest[:6] += F
    return rest @ place


def propagated(
    C: FloatArray, accel: FloatArray, gyro: FloatArray, P: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The covariance after a step and the step's derivatives [6, 21]."""
    F, FP, P = np.empty((6, N_STATES)), np.empty((6, N_STATES)), P.copy()
    _propagate_covariance(P, C, accel.mean(axis=0), accel, gyro, 1, H, F, FP)
    return P, F


def test_the_covariance_of_a_step_is_that_of_its_matrices() -> None:
    C, accel, gyro, P = step(np.random.default_rng(1))
    after, F = propagated(C, accel, gyro, P)
    M = transition(F, H)
    np.testing.assert_allclose(after, M @ P @ M.T, atol=1e-9)
    T = np.random.default_rng(2).normal(size=(N_STATES, N_STATES + 6))
    wanted = M @ T
    _propagate_response(T, F, H)
    np.testing.assert_allclose(T, wanted, atol=1e-12)


def test_the_derivatives_of_a_step_are_those_of_velocity_and_attitude() -> None:
    """Numeric, through the nonlinear step itself; turns of the attitude on the navigation side."""
    C, accel, gyro, P = step(np.random.default_rng(3))
    _, F = propagated(C, accel, gyro, P)

    def moved(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        v = x[VEL : VEL + 3].copy()
        quat = matrix_to_quat(rotation_vector_to_matrix(x[PHI : PHI + 3]) @ C)
        e = x[BA:POS]
        f = (1.0 + e[6:9]) * accel.mean(axis=0) + e[:3]
        w = (1.0 + e[9:]) * gyro.mean(axis=0) + e[3:6]
        c = quat_to_matrix(quat)
        _propagate(v, quat, c, f, w, H, GRAVITY)
        np.testing.assert_allclose(c, quat_to_matrix(quat), atol=1e-12)
        return v, c

    small = 1e-4
    for j in range(POS):
        e = np.zeros(N_STATES)
        e[j] = small
        (v1, c1), (v0, c0) = moved(e), moved(-e)
        turn = matrix_to_rotation_vector(c1 @ c0.T) / (2.0 * small)
        slope = np.concatenate([(v1 - v0) / (2.0 * small), turn])
        if j < 6:
            slope[j] -= 1.0
        # of the second order in the step is a part of 5e-3 of what is of the first
        np.testing.assert_allclose(slope, F[:, j], atol=0.01 * max(np.abs(F[:, j]).max(), H))


def test_a_step_is_what_many_short_ones_add_up_to() -> None:
    """Constant force and rate in body axes over 0.01 s, gravity down."""
    rng = np.random.default_rng(4)
    C, f, w = (
        rotation_vector_to_matrix(rng.normal(size=3)),
        rng.normal(0, 6, 3),
        rng.normal(0, 2, 3),
    )
    h, parts = 0.01, 200
    velocity, place, quat, c = np.array([0.3, -0.2, 0.1]), np.zeros(3), matrix_to_quat(C), C.copy()
    wanted = velocity.copy()
    for k in range(parts):
        now = C @ rotation_vector_to_matrix(w * (k + 0.5) * h / parts)
        wanted += (now @ f + [0.0, 0.0, GRAVITY]) * h / parts
    _propagate(velocity, quat, c, f, w, h, GRAVITY)
    assert place.tolist() == [0.0] * 3
    np.testing.assert_allclose(velocity, wanted, atol=3e-5)
    np.testing.assert_allclose(c, C @ rotation_vector_to_matrix(w * h), atol=1e-12)


@pytest.mark.parametrize("state", [0, 2, POS + 1])
def test_an_update_is_kalmans(state: int) -> None:
    rng = np.random.default_rng(5)
    C, _, _, P = step(rng)
    P *= 1e-4
    y, s = 0.3, float(P[state, state]) + 2e-3
    v, place, errors = rng.normal(size=3), rng.normal(size=3), rng.normal(size=N_ERRORS)
    quat, T = matrix_to_quat(C), rng.normal(size=(N_STATES, N_STATES + 6))
    before = v.copy(), place.copy(), errors.copy()
    row = np.zeros((1, N_STATES))
    row[0, state] = 1.0
    K = P @ row.T / s
    wanted_P = (np.eye(N_STATES) - K @ row) @ P
    wanted_T = T - K @ row @ T
    wanted_T[:, 23] += K[:, 0]
    _update_response(T, P, state, s, 23)
    np.testing.assert_allclose(T, wanted_T, atol=1e-12)
    _update(state, y, s, v, place, quat, errors, P)
    np.testing.assert_allclose(P, wanted_P, atol=1e-15)
    x = K[:, 0] * y
    np.testing.assert_allclose(v, before[0] + x[:3])
    np.testing.assert_allclose(place, before[1] + x[POS:])
    np.testing.assert_allclose(errors, before[2] + x[BA:POS])
    np.testing.assert_allclose(
        quat_to_matrix(quat), rotation_vector_to_matrix(x[PHI:BA]) @ C, atol=1e-12
    )
    assert np.linalg.norm(quat) == pytest.approx(1.0, abs=1e-14)


def test_what_is_stored_are_quaternion_errors_and_their_sigmas() -> None:
    rng = np.random.default_rng(6)
    P = np.diag(rng.uniform(0.1, 1.0, N_STATES))
    P[BA + 3, BA + 3] = -1e-20
    quat, errors, out = rng.normal(size=4), rng.normal(size=N_ERRORS), np.zeros((3, 28))
    _store(1, quat, errors, P, out)
    sd = np.sqrt(np.maximum(np.diag(P)[BA:POS], 0.0))
    np.testing.assert_allclose(out[1], np.concatenate([quat, errors, sd]))
    assert not out[[0, 2]].any()


@pytest.mark.parametrize("at_rest", [True, False])
def test_a_start_is_level_and_as_wrong_as_the_errors_that_it_was_levelled_with(
    at_rest: bool,
) -> None:
    """Against numeric derivatives of the levelling by the errors; the truth is level with them."""
    rng = np.random.default_rng(7)
    C = rotation_vector_to_matrix(np.array([0.3, -0.4, 0.0]))
    force = C.T @ np.array([0.0, 0.0, -GRAVITY])
    log: Any = SimpleNamespace(rate_hz=50.0)
    rows = round(limits.LEAST_REST_S * 50.0)
    accel = np.vstack([np.tile(force, (rows, 1)), np.full((10, 3), 99.0)])
    errors, prior = np.zeros(N_ERRORS), rng.uniform(0.01, 0.05, N_ERRORS)

    def at(x: FloatArray) -> FloatArray:
        quat, _ = dynamic._start(log, accel, x, at_rest, GRAVITY, prior)
        return quat_to_matrix(quat)

    quat, P = dynamic._start(log, accel, errors, at_rest, GRAVITY, prior)
    level = quat_to_matrix(quat)
    assert level @ force == pytest.approx([0.0, 0.0, -GRAVITY], abs=1e-9)
    # less heading, which is one of convention
    J = np.zeros((2, N_ERRORS))
    for j, e in enumerate(1e-5 * np.eye(N_ERRORS)):
        down = (at(e).T - at(-e).T)[:, 2] / 2e-5
        # down in body axes turns by C' (e_z x phi), of the attitude that is turned by phi
        J[:, j] = np.array([[0.0, 1.0], [-1.0, 0.0]]) @ (level @ down)[:2]
    np.testing.assert_allclose(P[PHI : PHI + 2, BA:POS], J * prior**2, atol=1e-8)
    np.testing.assert_allclose(P, P.T, atol=1e-15)
    sd = limits.LEVEL_SD_REST if at_rest else limits.LEVEL_SD_MOVING
    tilt = J @ np.diag(prior**2) @ J.T + sd**2 * np.eye(2)
    np.testing.assert_allclose(P[PHI : PHI + 2, PHI : PHI + 2], tilt, atol=1e-8)
    speed = limits.START_SPEED_REST if at_rest else limits.START_SPEED_MOVING
    np.testing.assert_allclose(np.diag(P)[:3], speed**2)
    np.testing.assert_allclose(np.diag(P)[POS:], limits.START_PLACE_M**2)
    np.testing.assert_allclose(P[BA:POS, BA:POS], np.diag(prior**2))
    assert not P[:3, 3:].any()
    assert not P[POS:, :POS].any()


def test_a_direction_is_carried_as_rotations_in_turn_carry_it() -> None:
    """A rate that is linear in time, in steps of any length, against very short ones."""
    rng = np.random.default_rng(8)
    p, q = rng.normal(0.0, 3.0, (2, 3))
    t = np.array([0.0, 0.01, 0.03, 0.04])
    rate = p + t[:, None] * (q - p) / 0.04
    start = np.array([0.6, 0.0, 0.8])
    parts = 400
    wanted = start
    for k in range(parts):
        w = p + (k + 0.5) / parts * (q - p)
        wanted = rotation_vector_to_matrix(w * 0.04 / parts).T @ wanted
    end, unused = np.empty(3), np.empty((3, 3, N_SIGNALS))
    carry_direction(rate, np.zeros((4, N_SIGNALS)), np.diff(t), start, end, unused)
    np.testing.assert_allclose(end, wanted, atol=5e-6)
    # no turn keeps it, and a half turn turns it round
    for angle in (0.0, np.pi):
        about = np.tile([0.0, angle, 0.0], (2, 1))
        carry_direction(about, np.zeros((2, N_SIGNALS)), np.ones(1), start, end, unused)
        sign = 1.0 if angle == 0.0 else -1.0
        np.testing.assert_allclose(end, sign * start, atol=1e-12)


def test_a_reading_units_value_is_the_ratio_of_spreads() -> None:
    rng = np.random.default_rng(9)
    raw = rng.normal(size=(200, 3)) * [1.0, 5.0, 0.0]
    assert dynamic._unit(0.02 * raw + 3.0, raw) == pytest.approx(0.02)
