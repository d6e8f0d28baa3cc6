"""Static calibration: known errors come back, bad logs are refused with advice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration_scene import (
    GRAVITY,
    Errors,
    random_errors,
    random_poses,
    recorded,
    turned_by_hand,
)

from automap.calibration import limits
from automap.calibration.accelerometer import fit_accelerometer, leave_one_out
from automap.calibration.gravity_kernel import N_SIGNALS, carry_direction
from automap.calibration.plausible import refuse_swapped
from automap.calibration.poses import determination, helpful_poses
from automap.calibration.rest import movement, rests_below
from automap.calibration.static import calibrate_static
from automap.errors import InputError
from automap.frames import rotation_vector_to_matrix, rpy_to_matrix
from automap.records import FloatArray, RawImu

FACES = np.vstack([np.eye(3), -np.eye(3)])


@pytest.fixture(scope="module")
def scene() -> tuple[RawImu, Errors]:
    rng = np.random.default_rng(3)
    errors = random_errors(rng)
    return recorded(rng, turned_by_hand(rng, random_poses(rng, 16)), errors), errors


def within(found: FloatArray, truth: FloatArray, half_width: FloatArray) -> bool:
    # twice the 95 % interval: a test of one draw must not fail by chance
    return bool(np.all(np.abs(found - truth) < 2.0 * half_width))


def test_known_errors_come_back(scene: tuple[RawImu, Errors]) -> None:
    log, truth = scene
    result = calibrate_static([log], GRAVITY)
    a, g = result.accel, result.gyro
    assert g is not None
    assert a.n_parameters == 9
    assert len(result.search.rests) == 16
    assert within(a.scale, truth.accel_scale, a.half_width[:3])
    assert within(a.bias, truth.accel_bias, a.half_width[3:6])
    assert within(a.misalignment, truth.misalignment, a.half_width[6:])
    off = ~np.eye(3, dtype=bool)
    assert within(g.scale, truth.gyro_scale, g.half_width[:3])
    assert within(g.bias, truth.gyro_bias, g.half_width[3:6])
    assert within(g.matrix[off], truth.gyro_matrix[off], g.half_width[6:12])
    # the intervals are of use: a tenth of the errors' own size
    assert np.all(g.half_width[:3] < 1e-3)
    assert np.all(a.half_width[:3] < 1e-3)


def test_counts_need_no_data_sheet(scene: tuple[RawImu, Errors]) -> None:
    log, truth = scene
    counts = replace(
        log,
        gyro=np.rint(log.gyro * 5000.0 + 32768.0),
        accel=np.rint(log.accel * 400.0 + 32000.0),
        gyro_unit="counts",
        accel_unit="counts",
        gyro_scale=None,
        accel_scale=None,
    )
    result = calibrate_static([counts], GRAVITY)
    assert result.gyro is not None
    np.testing.assert_allclose(result.accel.scale, truth.accel_scale / 400.0, rtol=3e-4)
    np.testing.assert_allclose(result.gyro.scale, truth.gyro_scale / 5000.0, rtol=3e-4)


def test_g_sensitivity_comes_back() -> None:
    rng = np.random.default_rng(5)
    truth = replace(random_errors(rng), g_sensitivity=rng.normal(0, 2e-4, (3, 3)))
    log = recorded(rng, turned_by_hand(rng, random_poses(rng, 16)), truth)
    result = calibrate_static([log], GRAVITY)
    assert result.gyro is not None
    assert result.gyro_with_g is not None
    found = result.gyro_with_g.g_sensitivity
    width = result.gyro_with_g.half_width[12:].reshape(3, 3)
    # the simulated sensitivity acts before the gyro's matrix is undone: the same to 1 %
    assert np.all(np.abs(found + truth.g_sensitivity) > 0.5 * np.abs(found))
    assert within(found, truth.g_sensitivity, width + 0.02 * np.abs(found))
    assert result.gyro_with_g.turn_rms < result.gyro.turn_rms


def test_several_logs_count_as_one(scene: tuple[RawImu, Errors]) -> None:
    log, _ = scene
    half = len(log) // 2
    parts = [
        replace(log, t_ns=log.t_ns[k], gyro=log.gyro[k], accel=log.accel[k])
        for k in (slice(0, half), slice(half, None))
    ]
    whole, split = calibrate_static([log], GRAVITY), calibrate_static(parts, GRAVITY)
    np.testing.assert_allclose(split.accel.scale, whole.accel.scale, rtol=2e-4)
    assert split.turns in (whole.turns - 1, whole.turns)


@pytest.mark.slow
def test_a_turn_that_few_turns_leave_to_a_guess_is_no_other_axis() -> None:
    """Seven poses with a hand's sway: a first guess takes z for another axis, the fit does not."""
    rng = np.random.default_rng(424612)
    truth = random_errors(rng)
    poses = random_poses(rng, 6)[[0, 1, 2, 3, 4, 5, 0]]
    askew = np.radians(2.0) * rng.normal(size=(7, 3))
    poses = poses @ rotation_vector_to_matrix(askew)
    log = recorded(rng, turned_by_hand(rng, poses), truth)
    result = calibrate_static([log], GRAVITY)
    assert result.gyro is not None
    assert within(result.gyro.scale, truth.gyro_scale, 2.0 * result.gyro.half_width[:3])
    for order, sign in (([1, 0, 2], 1.0), ([0, 1, 2], np.array([1.0, 1.0, -1.0]))):
        assert "right-handed" in refused(replace(log, gyro=sign * log.gyro[:, order]))


def test_six_poses_give_six_parameters() -> None:
    rng = np.random.default_rng(1)
    truth = replace(random_errors(rng), misalignment=np.zeros(3), gyro_matrix=np.eye(3))
    log = recorded(rng, turned_by_hand(rng, random_poses(rng, 6)), truth)
    result = calibrate_static([log], GRAVITY)
    assert result.accel.n_parameters == 6
    assert any("six parameters" in text for text in result.warnings)
    np.testing.assert_allclose(result.accel.scale, truth.accel_scale, rtol=1e-3)
    np.testing.assert_allclose(np.diag(result.accel.covariance)[6:], limits.ANGLE_SD**2, rtol=0.01)


@pytest.mark.slow
def test_rests_in_a_hand_are_told_to_be_put_down(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(424901)
    motion = turned_by_hand(rng, random_poses(rng, 12))
    tremor = np.zeros_like(motion.force)
    for hz in (0.7, 1.3, 2.9):
        tremor += 0.2 * np.sin(2.0 * np.pi * (hz * motion.t_s[:, None] + rng.uniform(size=3)))
    log = recorded(rng, replace(motion, force=motion.force + tremor), random_errors(rng))
    assert "put it down for each rest" in calibrate_static([log], GRAVITY).warnings[0]
    # nor is it said to turn it more where the rests leave the gyro open
    monkeypatch.setattr(limits, "LOOSE_SCALE", 1e-5)
    result = calibrate_static([log], GRAVITY)
    assert result.gyro is None
    assert len(result.warnings) == 2
    assert all("put it down for each rest" in text for text in result.warnings)
    assert "turn the sensor" not in " ".join(result.warnings)
    still = calibrate_static([recorded(rng, motion, random_errors(rng))], GRAVITY)
    assert not any("put it down" in text for text in still.warnings)
    assert "turn the sensor" in still.warnings[-1]


def refused(log: RawImu) -> str:
    with pytest.raises(InputError) as error:
        calibrate_static([log], GRAVITY)
    return str(error.value)


def test_too_few_poses(scene: tuple[RawImu, Errors]) -> None:
    rng = np.random.default_rng(2)
    log = recorded(rng, turned_by_hand(rng, random_poses(rng, 4)), scene[1])
    text = refused(log)
    assert "too few" in text
    # the faces that the four poses lack
    assert "x up" in text


def test_poses_in_one_plane(scene: tuple[RawImu, Errors]) -> None:
    rng = np.random.default_rng(2)
    poses = np.array([rpy_to_matrix(np.radians([a, 0.0, 0.0])) for a in range(0, 360, 30)])
    text = refused(recorded(rng, turned_by_hand(rng, poses), scene[1]))
    assert "plane" in text
    assert "+x up; -x up" in text


def test_no_rest(scene: tuple[RawImu, Errors]) -> None:
    rng = np.random.default_rng(2)
    motion = turned_by_hand(rng, random_poses(rng, 40), rest_s=0.0, turn_s=1.5, first_s=0.0)
    assert "no rest" in refused(recorded(rng, motion, scene[1]))


def test_saturated_axis(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    assert "gyro's x axis is saturated" in refused(replace(log, gyro=np.clip(log.gyro, -1, 1)))
    accel = log.accel.copy()
    accel[:, 2] = np.minimum(accel[:, 2], 8.0)
    assert "accelerometer's z axis is saturated" in refused(replace(log, accel=accel))


def test_coarse_resolution_is_no_saturation(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    coarse = replace(log, accel=np.round(log.accel / 0.01) * 0.01)
    assert len(calibrate_static([coarse], GRAVITY).search.rests) == 16


@pytest.mark.slow
def test_a_zero_that_drifts_is_told(scene: tuple[RawImu, Errors]) -> None:
    log, _ = scene
    drift = np.linspace(0.0, 1.0, len(log.accel))[:, None]
    span = np.ptp(log.accel, axis=0)
    moved = replace(log, accel=log.accel + 0.01 * drift * span * [0, 1, 0])
    told = calibrate_static([moved], GRAVITY).warnings
    assert any("accelerometer's zero moves by 0." in text and "about y" in text for text in told)
    assert not any("zero moves" in text for text in calibrate_static([log], GRAVITY).warnings)
    turned = replace(log, gyro=log.gyro + 0.02 * drift * np.ptp(log.gyro, axis=0) * [1, 0, 0])
    told = calibrate_static([turned], GRAVITY).warnings
    assert any("its rate at rest is up to" in text for text in told)


def test_an_axis_that_reads_one_value_is_refused(scene: tuple[RawImu, Errors]) -> None:
    log, _ = scene
    with pytest.raises(InputError, match="the gyro's y axis reads 0 from the first sample"):
        calibrate_static([replace(log, gyro=log.gyro * [1, 0, 0])], GRAVITY)


def test_milli_g_is_told_in_units_that_can_be_said(scene: tuple[RawImu, Errors]) -> None:
    log, truth = scene
    stated = replace(
        log, accel=log.accel * truth.accel_scale / 9.80665e-3, accel_unit="m/s^2",
        accel_scale=np.ones(3),
    )  # fmt: skip
    with pytest.raises(InputError, match="divide by 1000 and say --accel-unit g"):
        calibrate_static([stated], GRAVITY)


def test_wrong_units(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    assert "--accel-unit g" in refused(replace(log, accel=log.accel / 9.80665))
    assert "--gyro-unit deg/s" in refused(replace(log, gyro=np.degrees(log.gyro)))


def test_swapped_axes(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    assert "right-handed" in refused(replace(log, gyro=log.gyro[:, [1, 0, 2]]))


def test_swapped_sensors(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    assert "gyro and accelerometer are swapped" in refused(
        replace(log, gyro=log.accel, accel=log.gyro)
    )


def test_counts_as_large_as_gravity_are_no_swap(scene: tuple[RawImu, Errors]) -> None:
    """Whatever the numbers: an accelerometer that feels gravity by its scale is one."""
    log = scene[0]
    gain = GRAVITY / float(np.median(np.linalg.norm(log.gyro, axis=1)))
    counted = replace(log, gyro=log.gyro * gain, gyro_scale=np.full(3, 1.0 / gain))
    counted = replace(counted, accel=log.accel * 200.0, accel_scale=np.full(3, 1.0 / 200.0))
    refuse_swapped(counted)


def test_rests_lie_where_the_sensor_rested(scene: tuple[RawImu, Errors]) -> None:
    log = scene[0]
    rests = rests_below([log], [movement(log)], 12.0)
    assert len(rests) == 16
    assert rests[0].start == 0
    for i, rest in enumerate(rests[1:]):
        assert rest.start >= round((10.0 + 2.0 + 6.0 * i) * 100) - 60
        assert rest.length_s > 3.0


def test_determination_of_the_faces() -> None:
    assert determination(FACES, 6) == pytest.approx(np.sqrt(2.0 / 6.0))
    assert determination(FACES, 9) == 0.0
    circle = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0, 6, 20)])
    assert determination(circle, 6) < 1e-9


def test_a_missing_face_is_named_first() -> None:
    assert helpful_poses(FACES[[0, 1, 2, 3, 4]], 6)[0] == "-z up"
    edges = np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1], [1, -1, 0], [1, 0, -1], [0, 1, -1]])
    full = np.vstack([FACES, edges / np.sqrt(2.0), -edges / np.sqrt(2.0)])
    assert helpful_poses(full, 9) == []


def test_leaving_out_needs_poses_to_spare() -> None:
    means, variances = GRAVITY * FACES, np.full((6, 3), 1e-8)
    fit = fit_accelerometer(means, variances, GRAVITY, 6)
    assert leave_one_out(means, variances, GRAVITY, fit) is None


def test_the_kernel_against_its_own_differences() -> None:
    rng = np.random.default_rng(0)
    signals = np.column_stack([np.ones(50), rng.normal(0, 1, (50, 3)), rng.normal(0, 1, (50, 3))])
    dt = np.full(49, 0.01)
    K = rng.normal(0, 1, (3, N_SIGNALS))
    start = np.array([0.6, 0.0, 0.8])
    end, slope = np.empty(3), np.empty((3, 3, N_SIGNALS))
    carry_direction(signals @ K.T, signals, dt, start, end, slope)
    assert np.linalg.norm(end) == pytest.approx(1.0)
    up, down, unused = np.empty(3), np.empty(3), np.empty((3, 3, N_SIGNALS))
    for a in range(3):
        for j in range(N_SIGNALS):
            step = np.zeros_like(K)
            step[a, j] = 1e-5
            carry_direction(signals @ (K + step).T, signals, dt, start, up, unused)
            carry_direction(signals @ (K - step).T, signals, dt, start, down, unused)
            # the kernel leaves out second-order terms of a step
            np.testing.assert_allclose(slope[:, a, j], (up - down) / 2e-5, atol=2e-3)
