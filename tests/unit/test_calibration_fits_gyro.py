"""The static calibration's fits of gyroscopes against other ways to the same figures."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm as normal
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
    _without_each_turn,
    other_axes,
)
from automap.calibration.least_squares import Fit
from automap.calibration.rest_attitude import largest_turn, rest_attitude, roll_pitch_since_start
from automap.frames import rotation_vector_to_matrix
from automap.records import RawImu

GRAVITY = 9.8


def test_leaving_a_turn_out_moves_a_linear_fit_by_what_the_fit_without_it_says() -> None:
    rng = np.random.default_rng(8)
    turns, p = 5, 4
    X, y, sd = rng.normal(size=(3 * turns + 6, p)), rng.normal(size=21), rng.uniform(0.5, 2.0, 21)
    A = X / sd[:, None]
    x = np.asarray(np.linalg.lstsq(A, y / sd, rcond=None)[0], np.float64)
    fit = Fit(
        x,
        np.asarray(np.linalg.inv(A.T @ A), np.float64),
        X @ x - y,
        sd,
        X,
        np.zeros(1),
        9.0,
        np.zeros(21, bool),
    )
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
    rows = 3 * 6 + 9
    jacobian = 1e4 * rng.normal(size=(rows, p))
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    fit = Fit(
        K[used], covariance, rng.normal(size=rows), np.ones(rows), jacobian, np.zeros(1), 9.0,
        np.zeros(rows, bool),
    )  # fmt: skip
    # as the 95 % of nine degrees of freedom say
    root = student.ppf(0.975, 9.0) / normal.ppf(0.975) * np.linalg.cholesky(covariance)
    errors, left = np.zeros(6), np.zeros((3, 3))
    found = gyroscope._to_readings(fit, used, offset, unit, GRAVITY, errors, left)
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
        found.half_width, normal.ppf(0.975) * np.sqrt(np.diag(found.covariance))
    )
    # the largest that leaving out a turn changes, through the same derivatives
    flat = _without_each_turn(fit, 6)
    own = np.zeros((6, 3, N_SIGNALS))
    own[:, used] = flat
    change = np.einsum("nii->ni", own[:, :, 1:4] / unit) / found.scale
    assert found.scale_change == pytest.approx(np.abs(change).max(), rel=1e-5)


@pytest.mark.slow
def test_an_accelerometers_errors_are_in_a_gyros_sigmas() -> None:
    """Turns between rests whose directions an accelerometer in error tells, a little off."""
    rng = np.random.default_rng(10)
    root = 5e-4 * rng.normal(size=(9, 9))
    true = AccelFit(
        1.0 + 0.1 * rng.normal(size=3), 0.2 * rng.normal(size=3), 0.02 * rng.normal(size=3),
        root @ root.T, np.zeros(9), np.zeros(3), np.ones(3), 0.0, 9, np.zeros((9, 9)),
    )  # fmt: skip
    used = np.zeros((3, N_SIGNALS), bool)
    used[:, :4] = True
    K = np.zeros((3, N_SIGNALS))
    K[:, 1:4] = np.eye(3) + 0.02 * rng.normal(size=(3, 3))
    dt, noise = np.full(60, 0.02), 3e-4
    up, signals = [np.array([0.0, 0.0, 1.0])], []
    for _ in range(6):
        turning = np.outer(np.sin(np.pi * np.arange(61) / 60.0), 2.0 * rng.normal(size=3))
        signals.append(np.column_stack([np.ones(61), turning, np.zeros((61, 3))]))
        end, unused = np.empty(3), np.empty((3, 3, N_SIGNALS))
        carry_direction(signals[-1] @ K.T, signals[-1], dt, up[-1], end, unused)
        up.append(end)
    inner = np.linalg.solve(true.matrix, GRAVITY * np.array(up).T).T
    still = np.full(3, 1e-14)
    rests: Any = [
        SimpleNamespace(accel=m, gyro_var=still, length_s=1.0)
        for m in (inner - true.bias) / true.scale
    ]
    at_rest = np.zeros((7, N_SIGNALS))
    at_rest[:, 0] = 1.0
    values = np.concatenate([true.scale, true.bias, true.misalignment])
    own = [1, 2, 3, 5, 6, 7, 9, 10, 11]
    squares, alone = [], []
    for _ in range(25):
        x = values + root @ rng.normal(size=9)
        accel = replace(true, scale=x[:3], bias=x[3:6], misalignment=x[6:])
        u = directions_of(accel, np.array([rest.accel for rest in rests]))
        ends = u[1:] + noise * rng.normal(size=(6, 3))
        ends /= np.linalg.norm(ends, axis=1)[:, None]
        turns = [Turn(s, dt, u[k], ends[k], np.full(3, noise**2), k) for k, s in enumerate(signals)]
        by = gyroscope.directions_by(accel, rests)
        fit = gyroscope._fit(turns, rests, at_rest, K, used, np.ones(3), by)
        off = (fit.parameters[:12] - K[used])[own]
        sd = np.sqrt(np.diag(fit.covariance))[own]
        squares.append((off / sd) ** 2)
        # one that leaves the accelerometer's errors out is far too sure
        A = fit.jacobian[:, :12] / fit.sd[:, None]
        alone.append((off / np.sqrt(np.diag(np.linalg.inv(A.T @ A)))[own]) ** 2)
    # a floor that chance shows makes sigmas larger, seldom smaller
    assert 0.4 < np.mean(squares) < 1.5
    assert np.mean(alone) > 3.0


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
    assert other_axes(right) == ""
    other = right.copy()
    other[2, 0] = -1.1 / limits.OWN_AXIS * 1.02
    just = right.copy()
    just[0, 1] = -2.1 / limits.OWN_AXIS * 0.99
    assert other_axes(just) == ""
    for matrix, words in (
        (right[[1, 0, 2]], "x axis as the gyro's y axis"),
         (other, "z axis as the gyro's -x axis"),
    ):  # fmt: skip
        assert words in other_axes(matrix)


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
