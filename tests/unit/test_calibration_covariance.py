"""Stated covariances of the static calibration against Monte Carlo, cross terms included."""

from __future__ import annotations

import numpy as np
import pytest

from automap.calibration.accelerometer import AccelFit, fit_accelerometer, misalignment_matrix
from automap.calibration.gyroscope import turns_between
from automap.calibration.limits import ANGLE_SD
from automap.calibration.rest import Rest
from automap.frames import rotation_vector_to_matrix
from automap.records import FloatArray, RawImu

GRAVITY = 9.8
SCALE = np.array([0.011, 0.0097, 0.0103])
ZERO = np.array([5120.0, -3000.0, 2500.0])
"""Readings at no force: what ties a bias to its scale."""
MISALIGNMENT = np.array([0.01, -0.02, 0.015])
NOISE = np.array([0.4, 0.9, 0.6])
TRIALS = 300


def readings(rng: np.random.Generator) -> FloatArray:
    """Readings [k, 3] without noise at poses all over the sphere."""
    m = MISALIGNMENT
    skew = np.array([[1.0, -m[0], m[1]], [0.0, 1.0, -m[2]], [0.0, 0.0, 1.0]])
    faces = np.vstack([np.eye(3), -np.eye(3)])
    more = rng.normal(size=(18, 3))
    directions = np.vstack([faces, more / np.linalg.norm(more, axis=1)[:, None]])
    inner = np.linalg.solve(skew, GRAVITY * directions.T).T
    return inner / SCALE + ZERO


@pytest.fixture(scope="module", params=[6, 9])
def draws(request: pytest.FixtureRequest) -> tuple[FloatArray, list[AccelFit]]:
    """Parameters [trials, 6 or 9] of fits to noisy poses, and the fits."""
    rng = np.random.default_rng(7)
    n = request.param
    exact = readings(rng)
    if n == 6:
        # a sensor without skew
        directions = (exact - ZERO) * SCALE
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        exact = GRAVITY * directions / SCALE + ZERO
    variance = np.tile(NOISE**2, (len(exact), 1))
    fits = [
        fit_accelerometer(exact + NOISE * rng.normal(size=exact.shape), variance, GRAVITY, n)
        for _ in range(TRIALS)
    ]
    found = [np.concatenate([f.scale, f.bias, f.misalignment])[:n] for f in fits]
    return np.array(found), fits


def test_the_accelerometers_covariance_is_what_fits_scatter(
    draws: tuple[FloatArray, list[AccelFit]],
) -> None:
    found, fits = draws
    n = found.shape[1]
    # what a fit adds for a floor that chance shows is no part of the noise: the median has none
    stated = np.median([f.covariance[:n, :n] for f in fits], axis=0)
    scatter = np.cov(found.T)
    sd = np.sqrt(np.diag(stated))
    # 300 trials: one sigma of an sd is 4 %, of a correlation at most 0.06
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)), sd, rtol=0.25)
    correlation = scatter / np.sqrt(np.outer(np.diag(scatter), np.diag(scatter)))
    np.testing.assert_allclose(stated / np.outer(sd, sd), correlation, atol=0.25)
    # and here no small one: a bias is minus its zero times its scale
    for axis in range(3):
        assert correlation[axis, 3 + axis] * -np.sign(ZERO[axis]) > 0.5


def test_the_zero_is_known_better_than_the_bias_alone(
    draws: tuple[FloatArray, list[AccelFit]],
) -> None:
    """The reading at no force, -bias / scale, by its own scatter and by both variances with what
    they share."""
    found, fits = draws
    zero = -found[:, 3:6] / found[:, :3]
    covariance = np.median([f.covariance[:6, :6] for f in fits], axis=0)
    for axis in range(3):
        row = np.zeros(6)
        row[axis], row[3 + axis] = -ZERO[axis] / SCALE[axis], -1.0 / SCALE[axis]
        stated = np.sqrt(row @ covariance @ row)
        assert np.std(zero[:, axis]) == pytest.approx(stated, rel=0.25)


def _rest(start: int, stop: int) -> Rest:
    zero = np.zeros(3)
    middle, length = 0.5 * (start + stop) / 100.0, (stop - start) / 100.0
    return Rest(0, start, stop, middle, length, *([zero] * 6))


def test_a_turn_ends_as_unsurely_as_its_two_rests_are() -> None:
    """The difference of two directions scatters by the variances of both."""
    rng = np.random.default_rng(1)
    n = 1000
    log = RawImu(np.arange(n) * 10_000_000, np.zeros((n, 3)), np.zeros((n, 3)))
    rests = [_rest(0, 100), _rest(400, 500), _rest(800, 900)]
    directions = np.array([rotation_vector_to_matrix(v)[2] for v in rng.normal(size=(3, 3))])
    sd = np.array([[1e-3, 2e-3, 3e-3], [5e-3, 1e-3, 8e-3], [2e-3, 9e-3, 1e-3]])
    turns = turns_between([log], [np.zeros((n, 3))], rests, directions, sd**2, GRAVITY)
    assert len(turns) == 2
    for k, turn in enumerate(turns):
        first = directions[k] + sd[k] * rng.normal(size=(20000, 3))
        second = directions[k + 1] + sd[k + 1] * rng.normal(size=(20000, 3))
        np.testing.assert_allclose(turn.variance, np.var(second - first, axis=0), rtol=0.05)
        np.testing.assert_array_equal(turn.start, directions[k])
        np.testing.assert_array_equal(turn.end, directions[k + 1])


@pytest.mark.slow
@pytest.mark.parametrize("tilt_deg", [0.0, 3.0])
def test_angles_that_six_poses_leave_open_are_in_the_covariance(tilt_deg: float) -> None:
    """Sensors with angles as usual ones have, on their faces exactly and put down askew."""
    rng = np.random.default_rng(12)
    faces = np.vstack([np.eye(3), -np.eye(3)])
    off = []
    for _ in range(50):
        angles = ANGLE_SD * rng.normal(size=3)
        u = np.array(
            [
                rotation_vector_to_matrix(np.radians(tilt_deg) * rng.normal(size=3)) @ face
                for face in faces
            ]
        )
        exact = np.linalg.solve(misalignment_matrix(angles), GRAVITY * u.T).T / SCALE + ZERO
        noise = 1e-3 * NOISE
        fit = fit_accelerometer(
            exact + noise * rng.normal(size=(6, 3)), np.tile(noise**2, (6, 1)), GRAVITY, 6, ANGLE_SD
        )
        found = np.concatenate([fit.scale, fit.bias, fit.misalignment])
        true = np.concatenate([SCALE, -ZERO * SCALE, angles])
        off.append((found - true) / np.sqrt(np.diag(fit.covariance)))
        np.testing.assert_allclose(
            fit.half_width, 1.96 * np.sqrt(np.diag(fit.covariance)), rtol=1e-3
        )
    z = np.array(off)
    # 50 draws tell a ratio to 10 %
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.35)
    assert np.mean(np.abs(z) < 1.96) > 0.92
    # and no angle changes the norm on the face of the first axis
    open_ones = z[:, [1, 2, 6, 7, 8]] if tilt_deg == 0.0 else z
    assert np.sqrt(np.mean(open_ones**2)) > 0.75
