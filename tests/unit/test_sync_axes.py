"""Which way the axes of an IMU are: found again on a simulated drive, and never doubted there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from automap.frames import rpy_to_matrix
from automap.records import Fixes, FloatArray, ImuData
from automap.sync.axes import (
    SIGNED_PERMUTATIONS,
    AxesJudgement,
    _beside_turns,
    judge_stated,
    judge_unknown,
    scores,
    slope,
)
from automap.sync.axes_evidence import AxesEvidence, Tilts, axes_evidence, effective_count
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

EYE = np.eye(3)
SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
NEXT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def _flip(letters: str) -> FloatArray:
    return np.diag([-1.0 if axis in letters else 1.0 for axis in "xyz"])


@cache
def _drive(rate: float = 5.0, imu_rate: float = 50.0) -> tuple[ImuData, Fixes]:
    motion = city_drive(240.0, seed=4)
    receiver = Receiver(rate=rate, vel_latency=0.2, course_latency=0.3)
    return record(motion, Sensor(), 1, rate=imu_rate), receive(motion, receiver, 2)


def _read(accel: FloatArray, gyro: FloatArray, rate: float = 5.0, imu_rate: float = 50.0):
    """Evidence of triads that become vehicle axes by ``accel`` and ``gyro``."""
    imu, fixes = _drive(rate, imu_rate)
    turned = replace(imu, accel=imu.accel @ accel, gyro=imu.gyro @ gyro)
    return axes_evidence(turned, fixes, CLOCK)


def _apart(one: FloatArray, two: FloatArray) -> float:
    """Angle in deg between two orthonormal matrices of the same handedness; else 180."""
    turn = one @ two.T
    if np.linalg.det(turn) < 0.0:
        return 180.0
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))))


def _is_best(judged: AxesJudgement, accel: FloatArray, gyro: FloatArray) -> None:
    np.testing.assert_array_equal(judged.best.accel, accel)
    np.testing.assert_array_equal(judged.best.gyro, gyro)


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("imu_rate", [10.0, 50.0])
def test_right_axes_are_not_doubted(rate: float, imu_rate: float) -> None:
    judged = judge_stated(_read(EYE, EYE, rate, imu_rate))
    assert judged.stated.probability > 0.999
    assert judged.best.rigid
    judged = judge_unknown(_read(EYE, EYE, rate, imu_rate))
    assert judged.stated.probability > 0.999


@pytest.mark.parametrize(
    ("accel", "gyro"),
    [
        (-EYE, EYE),
        (EYE, -EYE),
        (_flip("xy"), _flip("xy")),
        (SWAPPED, SWAPPED),
        (_flip("x") @ SWAPPED, _flip("x") @ SWAPPED),
        (_flip("x"), EYE),
        (_flip("y"), EYE),
        (_flip("z"), EYE),
        (EYE, _flip("x")),
        (EYE, _flip("y")),
        (EYE, _flip("z")),
        (_flip("y"), _flip("y")),
        (EYE, SWAPPED),
        (EYE, NEXT),
        (NEXT, EYE),
        (_flip("yz"), _flip("yz")),
        (-_flip("yz"), _flip("yz")),
    ],
)
def test_wrong_axes_are_found_and_named(accel: FloatArray, gyro: FloatArray) -> None:
    judged = judge_stated(_read(accel, gyro))
    # this road hardly rises, so that a turned pitch axis shows least
    assert judged.stated.probability < 1e-3
    _is_best(judged, accel, gyro)


@settings(max_examples=12)
@example(angles=(0.0, 3.0, -2.25), of_accel=9, of_gyro=33)
@given(
    st.tuples(*[st.floats(-np.pi, np.pi)] * 3),
    st.integers(0, len(SIGNED_PERMUTATIONS) - 1),
    st.integers(0, len(SIGNED_PERMUTATIONS) - 1),
)
def test_any_mounting_with_any_triads_is_found(
    angles: tuple[float, float, float], of_accel: int, of_gyro: int
) -> None:
    mounting = rpy_to_matrix(np.array(angles))
    accel = mounting @ SIGNED_PERMUTATIONS[of_accel]
    gyro = mounting @ SIGNED_PERMUTATIONS[of_gyro]
    judged = judge_unknown(_read(accel, gyro))
    assert judged.mounting is not None
    # where another order or sign of the axes leaves the turns nearly about the same axis, and this
    # road hardly tilts, little tells the two apart: the right one is likelier, but not sure
    vertical = gyro[2]
    alike = max(vertical @ way @ vertical for way in SIGNED_PERMUTATIONS[1:])
    assert judged.best.probability > (0.99 if alike < np.cos(np.radians(15.0)) else 0.5)
    assert np.linalg.det(judged.mounting) > 0.0
    assert _apart(judged.mounting @ judged.best.accel, accel) < 10.0
    assert _apart(judged.mounting @ judged.best.gyro, gyro) < 10.0


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.hypot(np.hypot(*v[:2]), v[2]) > 0.1)
)
@example((0.0, 0.0, 1.0))
@example((1.0, 1.0, 1.0))
def test_no_correlation_outweighs_gravity(down: tuple[float, float, float]) -> None:
    """A smooth robot's forces showed the roll along the axis of gravity ten times as surely."""
    up = -np.array(down) / np.linalg.norm(down)
    sure = np.full((3, 3), 1e6) + np.eye(3)
    seen = AxesEvidence(up, tilts=(Tilts(np.full(3, 1e4), sure, sure, sure),))
    found = scores(seen, SIGNED_PERMUTATIONS, SIGNED_PERMUTATIONS)
    likeliest = SIGNED_PERMUTATIONS[np.unravel_index(int(np.argmax(found)), found.shape)[0]]
    assert np.isfinite(found.max())
    assert (-likeliest @ up)[2] > 0.577
    # of 48 ways eight have a given direction down
    if max(np.abs(up)) > 0.999:
        assert np.count_nonzero(np.isfinite(found).any(axis=1)) == 8


def test_without_a_receiver_gravity_says_what_it_can() -> None:
    imu, _ = _drive()
    assert judge_stated(axes_evidence(imu, None, None)).stated.probability > 0.9
    turned = replace(imu, accel=imu.accel @ _flip("yz"), gyro=imu.gyro @ _flip("yz"))
    judged = judge_stated(axes_evidence(turned, None, None))
    assert judged.stated.probability < 1e-6
    assert judged.others


def test_what_a_gyro_of_one_axis_leaves_open_is_told_by_what_is_usual() -> None:
    imu, fixes = _drive()
    turned = replace(imu, gyro=imu.gyro @ np.diag([0.0, 0.0, -1.0]))
    judged = judge_stated(axes_evidence(turned, fixes, CLOCK))
    assert judged.stated.probability < 1e-6
    _is_best(judged, EYE, -EYE)


@pytest.mark.parametrize("factor", [1.0, 2.0, 57.3])
def test_the_turns_tell_the_scale_of_the_gyro(factor: float) -> None:
    imu, fixes = _drive()
    seen = axes_evidence(replace(imu, gyro=factor * imu.gyro), fixes, CLOCK)
    assert seen.turn is not None
    value, sd = slope(seen.turn, EYE[2])
    assert abs(factor * value - 1.0) < 0.1
    assert sd < 0.05 / factor


def test_a_recording_of_another_drive_says_nothing() -> None:
    imu, _ = _drive()
    fixes = receive(city_drive(240.0, seed=11), Receiver(), 2)
    judged = judge_stated(axes_evidence(imu, fixes, CLOCK))
    assert judged.stated.probability > 0.01


def test_correlated_and_heavy_tailed_series_count_for_less() -> None:
    rng = np.random.default_rng(3)
    white = rng.standard_normal(4000)
    assert 3000 < effective_count(white) <= 4000
    slow = np.convolve(white, np.ones(20), "same")
    assert 150 < effective_count(slow) < 500
    peak = np.where(np.arange(4000) == 2000, 1000.0, white)
    assert effective_count(peak) < 20
    assert effective_count(np.zeros(10)) == 0.0


def test_turns_about_the_vertical_tilt_no_case_that_leans() -> None:
    """Of a case that leans by 3 deg the roll axis feels more of the bends than of the rolling."""
    rng = np.random.default_rng(4)
    roll, yaw = 0.01 * rng.standard_normal(500), 0.2 * rng.standard_normal(500)
    force = -9.8 * roll + 0.1 * rng.standard_normal(500)
    lean = rpy_to_matrix(np.array([0.0, np.radians(3.0), 0.0]))
    for axes in (EYE, lean):
        w = np.column_stack([roll, 0.02 * rng.standard_normal(500), yaw]) @ axes
        a = np.column_stack([np.zeros(500), force, np.zeros(500)])
        tilts = Tilts(np.full(3, 500.0), a.T @ a, a.T @ w, w.T @ w)
        product, power = _beside_turns(tilts, EYE[1:2], -EYE[:1], EYE[2:])
        assert product[0, 0] / np.sqrt(power[0, 0]) == pytest.approx(0.7, abs=0.05)
