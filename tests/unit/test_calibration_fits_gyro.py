"""The static calibration's fits of gyroscopes against other ways to the same figures."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from automap.calibration import gyroscope, limits
from automap.calibration.accelerometer import (
    AccelFit,
    directions_of,
)
from automap.calibration.gravity_kernel import N_SIGNALS, carry_direction
from automap.calibration.gyroscope import (
    Turn,
    _linear_start,
    _refuse_other_axes,
    _with_accel_uncertainty,
    _without_each_turn,
)
from automap.calibration.least_squares import Fit
from automap.calibration.rest_attitude import largest_turn, rest_attitude, roll_pitch_since_start
from automap.errors import InputError
from automap.frames import rotation_vector_to_matrix
from automap.records import FloatArray, RawImu

GRAVITY = 9.8


def test_leaving_a_turn_out_moves_a_linear_fit_by_what_the_fit_without_it_says() -> None:
    rng = np.random.default_rng(8)
    turns, p = 5, 4
    X, y, sd = rng.normal(size=(3 * turns + 6, p)), rng.normal(size=21), rng.uniform(0.5, 2.0, 21)
    A = X / sd[:, None]
    x = np.asarray(np.linalg.lstsq(A, y / sd, rcond=None)[0], np.float64)
    fit = Fit(x, np.asarray(np.linalg.inv(A.T @ A), np.float64), X @ x - y, sd, X, np.zeros(1), 9.0)
    moved = _without_each_turn(fit, turns)
    for k in range(turns):
        rows = np.delete(np.arange(21), np.arange(3 * k, 3 * k + 3))
        without = np.linalg.lstsq(A[rows], (y / sd)[rows], rcond=None)[0]
        assert moved[k] == pytest.approx(without - x, abs=1e-9)


@pytest.mark.parametrize("with_g", [False, True])
def test_a_gyros_parameters_give_the_rate_of_its_centred_signals(with_g: bool) -> None:
    rng = np.random.default_rng(9)
    K = np.zeros((3, N_SIGNALS))
    K[:, 0] = 0.01 * rng.normal(size=3)
    K[:, 1:4] = np.diag([0.5, 0.6, 0.7]) + 0.01 * rng.normal(size=(3, 3))
    K[:, 4:] = with_g * 0.01 * rng.normal(size=(3, 3))
    used = np.zeros((3, N_SIGNALS), bool)
    used[:, : N_SIGNALS if with_g else 4] = True
    p = int(used.sum())
    offset, unit = np.array([4.0, -3.0, 2.0]), np.array([30.0, 40.0, 50.0])
    root = 1e-4 * rng.normal(size=(p, p))
    rows = 3 * 6 + 9
    fit = Fit(
        K[used], root @ root.T, rng.normal(size=rows), np.ones(rows),
        rng.normal(size=(rows, p)), np.zeros(1), 9.0,
    )  # fmt: skip
    errors, left = np.zeros(6), np.zeros((3, 3))
    found = gyroscope._to_readings(fit, K, used, offset, unit, GRAVITY, errors, left)
    raw, force = offset + 40.0 * rng.normal(size=(5, 3)), GRAVITY * rng.normal(size=(5, 3))
    signals = np.column_stack([np.ones(5), (raw - offset) / unit, force / GRAVITY])
    np.testing.assert_allclose(found.apply(raw, force), signals @ K.T)
    assert np.diag(found.matrix) == pytest.approx(np.ones(3))
    # the covariance of what is drawn from the fit's own
    draws = K[used] + rng.normal(size=(4000, p)) @ root.T
    full = np.zeros((4000, 3, N_SIGNALS))
    full[:, used] = draws
    M = full[:, :, 1:4] / unit
    scale = np.einsum("nii->ni", M)
    matrix = M / scale[:, None, :]
    rate = full[:, :, 0] - M @ offset
    bias = np.linalg.solve(matrix, rate[:, :, None])[:, :, 0]
    off = matrix[:, ~np.eye(3, dtype=bool)]
    parts = [scale, bias, off] + ([(-full[:, :, 4:] / GRAVITY).reshape(4000, 9)] if with_g else [])
    drawn = np.concatenate(parts, axis=1)
    sd = drawn.std(axis=0)
    np.testing.assert_allclose(
        np.cov(drawn.T) / np.outer(sd, sd), found.covariance / np.outer(sd, sd), atol=0.12
    )
    np.testing.assert_allclose(
        found.half_width, student.ppf(0.975, 9.0) * np.sqrt(np.diag(found.covariance))
    )
    # the largest that leaving out a turn changes, through the same derivatives
    flat = _without_each_turn(fit, 6)
    own = np.zeros((6, 3, N_SIGNALS))
    own[:, used] = flat
    change = np.einsum("nii->ni", own[:, :, 1:4] / unit) / found.scale
    assert found.scale_change == pytest.approx(np.abs(change).max(), rel=1e-5)


def test_an_accelerometers_errors_go_into_the_gyros_as_the_fit_would_follow_them() -> None:
    """One Gauss-Newton step with residuals of the moved directions, each parameter by itself."""
    rng = np.random.default_rng(10)
    zeros = np.zeros((9, 9))
    root = 1e-3 * rng.normal(size=(9, 9))
    accel = AccelFit(
        1.0 + 0.1 * rng.normal(size=3), 0.2 * rng.normal(size=3), 0.02 * rng.normal(size=3),
        root @ root.T, np.zeros(9), np.zeros(3), np.ones(3), 0.0, 9, zeros,
    )  # fmt: skip
    up = rng.normal(size=(4, 3))
    means = GRAVITY * up / np.linalg.norm(up, axis=1)[:, None]
    rests: Any = [SimpleNamespace(accel=m) for m in means]
    used = np.zeros((3, N_SIGNALS), bool)
    used[:, :4] = True
    K = np.zeros((3, N_SIGNALS))
    K[:, :4] = rng.normal(size=(3, 4))
    dt, zero = np.full(7, 0.02), np.zeros(3)
    turns = [
        Turn(np.column_stack([np.ones(8), rng.normal(size=(8, 6))]), dt, zero, zero, zero, k)
        for k in range(3)
    ]
    rows = 9 + 12
    fit = Fit(
        K[used], np.eye(12), np.zeros(rows), rng.uniform(1.0, 2.0, rows),
        rng.normal(size=(rows, 12)), np.zeros(1), 9.0,
    )  # fmt: skip

    def residuals(x: FloatArray) -> FloatArray:
        moved = replace(accel, scale=x[:3], bias=x[3:6], misalignment=x[6:])
        u = directions_of(moved, means)
        r, end, unused = np.zeros(rows), np.empty(3), np.empty((3, 3, N_SIGNALS))
        for k, turn in enumerate(turns):
            carry_direction(turn.signals @ K.T, turn.signals, dt, u[k], end, unused)
            r[3 * k : 3 * k + 3] = end - u[k + 1]
        return r

    x = np.concatenate([accel.scale, accel.bias, accel.misalignment])
    h = 1e-5
    by = np.array([(residuals(x + e) - residuals(x - e)) / (2 * h) for e in h * np.eye(9)]).T
    effect = -fit.covariance @ fit.jacobian.T @ (by / fit.sd[:, None] ** 2)
    found = _with_accel_uncertainty(fit, turns, rests, accel, used).covariance
    wanted = effect @ accel.covariance @ effect.T
    size = np.sqrt(np.diag(wanted))
    off = (found - fit.covariance - wanted) / np.outer(size, size)
    assert np.abs(off).max() < 0.02


def test_the_first_value_of_a_gyros_axes_is_found_without_knowing_the_sensor() -> None:
    """A sensor that turns slowly in place, with scales, signs and axes of its own."""
    rng = np.random.default_rng(11)
    n, rate_hz = 3000, 50.0
    t = np.arange(n) / rate_hz
    phase = rng.uniform(0.0, 6.0, (2, 3))
    rate = 0.6 * np.sin(0.5 * t[:, None] + phase[0]) + 0.4 * np.sin(0.23 * t[:, None] + phase[1])
    C, u = np.eye(3), np.empty((n, 3))
    for k in range(n):
        u[k] = -C[2]
        C = C @ rotation_vector_to_matrix(rate[k] / rate_hz)
    truth = np.array([[0.02, 0.001, 0.0], [-0.001, 0.03, 0.002], [0.0, 0.001, 0.01]])
    offset, unit = np.array([50.0, -20.0, 10.0]), np.array([3.0, 4.0, 5.0])
    gyro = np.linalg.solve(truth, rate.T).T + offset
    log = RawImu(np.rint(t * 1e9).astype(np.int64), gyro, GRAVITY * u)
    found = _linear_start([log], [GRAVITY * u], offset, unit) / unit
    np.testing.assert_allclose(found, truth, atol=4e-4)


def test_gyro_axes_that_turn_gravity_as_others_do_are_refused() -> None:
    right = np.diag([2.0, 3.0, 1.0]) + 0.1
    _refuse_other_axes(right)
    other = right.copy()
    other[2, 0] = -1.1 / limits.OWN_AXIS * 1.02
    just = right.copy()
    just[0, 1] = -2.1 / limits.OWN_AXIS * 0.99
    _refuse_other_axes(just)
    for matrix, words in (
        (right[[1, 0, 2]], "x axis as the gyro's y axis"),
         (other, "z axis as the gyro's -x axis"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=words):
            _refuse_other_axes(matrix)


def test_a_resting_sensor_is_turned_by_its_gyro_in_body_axes() -> None:
    """A constant rate from any attitude: gravity goes round the axis of the rate."""
    rate, t = np.array([0.02, -0.01, 0.03]), 0.01 * np.arange(1001.0)
    down = np.array([0.48, -0.6, 0.64])
    accel = np.tile(-GRAVITY * down, (1001, 1))
    found = rest_attitude(t + 5.0, np.tile(rate, (1001, 1)), accel, 11)
    assert found.t_s == pytest.approx(np.linspace(0.0, 10.0, 11))
    wanted = [rotation_vector_to_matrix(rate * s).T @ down for s in found.t_s]
    np.testing.assert_allclose(found.down, wanted, atol=1e-9)
    angles = np.arccos(np.clip(np.array(wanted) @ down, -1.0, 1.0))
    assert found.drift == pytest.approx(angles.max(), abs=1e-7)
    assert largest_turn(np.array([down, -down])) == pytest.approx(np.pi)
    # roll and pitch together are that angle, whatever the attitude it began in
    roll, pitch = roll_pitch_since_start(found.down).T
    assert np.cos(roll) * np.cos(pitch) == pytest.approx(np.cos(angles), abs=1e-9)
