"""Dynamic calibration: known errors come back, and the paper's own filter agrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_scene import (
    GRAVITY,
    Errors,
    Motion,
    random_errors,
    random_poses,
    recorded,
    turned_by_hand,
)
from paper_filter import PaperFilter

from automap.calibration.dynamic import ERROR_NAMES, calibrate_dynamic
from automap.calibration.dynamic_kernel import N_STATES, run_filter
from automap.calibration.limits import PRIOR_SD, TURN_ON_SD
from automap.calibration.rest_attitude import rest_attitude
from automap.errors import InputError
from automap.frames import matrix_to_quat, quat_to_matrix
from automap.records import FloatArray, RawImu


def hand_turned(seed: int, seconds: float = 120.0) -> tuple[RawImu, FloatArray, Motion]:
    """A log of two minutes in the hand and its errors [12]."""
    rng = np.random.default_rng(seed)
    errors = replace(random_errors(rng), misalignment=np.zeros(3), gyro_matrix=np.eye(3))
    poses = random_poses(rng, round(seconds / 1.5))
    motion = turned_by_hand(rng, poses, rest_s=0.0, turn_s=1.5, first_s=2.0)
    return recorded(rng, motion, errors), as_corrections(errors), motion


def as_corrections(errors: Errors) -> FloatArray:
    return np.concatenate(
        [errors.accel_bias, errors.gyro_bias, errors.accel_scale - 1, errors.gyro_scale - 1]
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_known_errors_come_back(seed: int) -> None:
    log, truth, _ = hand_turned(seed)
    result = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)
    error = result.final - truth
    assert np.all(np.abs(error[:3]) < 0.02)
    assert np.all(np.abs(np.degrees(error[3:6])) < 0.005)
    assert np.all(np.abs(error) < 3.0 * result.sd[-1])
    assert result.warnings == ()
    assert result.errors.shape == (len(log), len(ERROR_NAMES))


def test_the_calibration_of_another_sensor_is_told() -> None:
    """Its errors are some ten times what changes from one turn-on to the next."""
    log, truth, _ = hand_turned(424207)
    other = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY, TURN_ON_SD)
    assert any("is the static calibration that of this sensor" in text for text in other.warnings)
    gyro, accel = (1.0 + truth[9:]) * log.gyro, (1.0 + truth[6:9]) * log.accel
    turn_on = TURN_ON_SD * np.random.default_rng(1).normal(size=12)
    own = calibrate_dynamic(
        log, gyro + truth[3:6] + turn_on[3:6], accel + truth[:3] + turn_on[:3], GRAVITY, TURN_ON_SD
    )
    assert own.warnings == ()


def test_too_little_turned_about_an_axis_is_said() -> None:
    rng = np.random.default_rng(0)
    angles = np.tile([0.0, 90.0, 180.0, 90.0], 10)
    from automap.frames import rpy_to_matrix

    poses = np.array([rpy_to_matrix(np.radians([a, 0.0, 0.0])) for a in angles])
    log = recorded(rng, turned_by_hand(rng, poses, 0.0, 2.0, 2.0), random_errors(rng, 0.1))
    text = " ".join(calibrate_dynamic(log, log.gyro, log.accel, GRAVITY).warnings)
    assert "about y" in text
    assert "about z" in text
    assert "about x" not in text


def test_a_carried_sensor_is_recognised() -> None:
    rng = np.random.default_rng(0)
    motion = turned_by_hand(rng, random_poses(rng, 40), 0.0, 2.0, 2.0, 0.4, 0.4)
    log = recorded(rng, motion, random_errors(rng, 0.1))
    result = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)
    assert any("carried" in text for text in result.warnings)


def test_the_log_of_a_drive_makes_no_calibration() -> None:
    """Hardly turned and pushed about for a minute: scales far from any sensor's would fit."""
    t = np.arange(0.0, 60.0, 0.02)
    gyro, accel = np.zeros((len(t), 3)), np.full((len(t), 3), [0.0, 0.0, -GRAVITY])
    gyro[:, 2] = 0.4 * np.sin(0.3 * t)
    accel[:, 0] = 2.0 * np.sin(0.2 * t)
    accel[:, 1] = 12.0 * gyro[:, 2]
    noise = np.random.default_rng(3).normal(0.0, 0.01, (2, len(t), 3))
    log = replace(
        hand_turned(0, 30.0)[0],
        t_ns=np.rint(t * 1e9).astype(np.int64),
        gyro=gyro + 0.1 * noise[0],
        accel=accel + noise[1],
    )
    with pytest.raises(InputError, match="as no sensor's is; turn it by hand and in place"):
        calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)


def test_a_log_in_another_unit_is_refused() -> None:
    log, _, _ = hand_turned(0, 30.0)
    with pytest.raises(InputError, match="accel-unit"):
        calibrate_dynamic(log, log.gyro, log.accel / 9.8, GRAVITY)
    short = replace(log, t_ns=log.t_ns[:500], gyro=log.gyro[:500], accel=log.accel[:500])
    with pytest.raises(InputError, match="lasts"):
        calibrate_dynamic(short, short.gyro, short.accel, GRAVITY)


def test_the_papers_filter_agrees() -> None:
    """The literal 19 states of (12) to (28) against the product's error states."""
    coarse, truth, motion = hand_turned(4, 12.0)
    # Euler's steps need short ones: the same signal at four times the rate
    t_s = np.arange(4 * len(coarse) - 3) / 400.0
    gyro, accel = (
        np.column_stack([np.interp(t_s, coarse.t_s, values[:, i]) for i in range(3)])
        for values in (coarse.gyro, coarse.accel)
    )
    log = replace(coarse, t_ns=np.rint(t_s * 1e9).astype(np.int64), gyro=gyro, accel=accel)
    quat = matrix_to_quat(motion.C[0])
    sd = np.concatenate([np.full(3, 0.1), np.full(3, 0.02), PRIOR_SD])
    q = np.array([1e-5, 4e-8])
    walk = np.zeros(12)
    every, variance = 40, 0.1
    paper = PaperFilter(quat, sd, q, GRAVITY)
    dt = np.diff(log.t_s)
    P = np.zeros((N_STATES, N_STATES))
    P[np.arange(18), np.arange(18)] = sd**2
    errors = np.zeros(12)
    out, innovations = np.empty((len(log), 28)), np.empty((len(log), 10))
    # no pseudo-position: the paper has none
    noise = np.column_stack([np.full(len(log), variance), np.full(len(log), 1e12)])
    run_filter(
        dt, log.gyro, log.accel, GRAVITY, quat.copy(), errors, P, q, every, noise, walk, out,
        innovations, np.empty((0, N_STATES, N_STATES + 6)),
    )  # fmt: skip
    for k in range(1, len(log)):
        paper.predict(log.gyro[k - 1], log.accel[k - 1], dt[k - 1])
        if k % every == 0:
            paper.update(variance)
    sigma = out[-1, 16:]
    # Euler's error, a small part of the uncertainty; it falls with the step as it should
    assert np.all(np.abs(paper.errors - errors) < 0.25 * sigma)
    np.testing.assert_allclose(paper.error_sd, sigma, rtol=0.03)
    C = quat_to_matrix(paper.x[3:7]) @ quat_to_matrix(out[-1, :4]).T
    assert np.degrees(np.arccos(np.clip((np.trace(C) - 1) / 2, -1, 1))) < 0.5
    assert np.all(np.abs(errors - truth) < 4.0 * sigma)
    assert np.all(sigma[:3] < 0.5 * PRIOR_SD[:3])


@pytest.mark.slow
def test_figure_2_on_simulated_turn_ons() -> None:
    """Ten sequences at rest, each with its own turn-on bias: without dynamic calibration roll
    and pitch run away, each differently; with it they stay put."""
    without, with_it = [], []
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        errors = random_errors(rng, 0.0)
        errors = replace(errors, gyro_bias=rng.normal(0, np.radians(0.15), 3))
        poses = random_poses(rng, 12)
        log = recorded(rng, turned_by_hand(rng, poses, 3.0, 2.0, 30.0), errors, 5e-5)
        rest = slice(0, 3000)
        result = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY, TURN_ON_SD)
        e = result.final
        gyro = (1.0 + e[9:]) * log.gyro + e[3:6]
        for found, rates in ((without, log.gyro), (with_it, gyro)):
            attitude = rest_attitude(log.t_s[rest], rates[rest], log.accel[rest])
            found.append(np.degrees(attitude.drift))
    assert np.median(without) > 3.0
    assert np.ptp(without) > 2.0
    assert max(with_it) < 0.3
