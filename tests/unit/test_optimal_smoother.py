"""The yardstick of the fusion: an optimal smoother is as good as it says, and needs its model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.fusion_monte_carlo import nees_bands
from tests.benchmarks.optimal_smoother import optimal_errors
from tests.slow_cases import others_slow
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import Motion, city_drive
from tests.unit.fusion_receiver import GPS0, WHITE, Receiver, receive, receiver_named

DRIVES, SECONDS = 6, 90.0
SENSOR = Sensor(vibration=0.08)


@pytest.fixture(scope="module")
def motions() -> list[Motion]:
    return [city_drive(SECONDS, seed, slip=True) for seed in range(DRIVES)]


def _prompt(name: str) -> Receiver:
    return replace(receiver_named(name), latency=0.0, vel_latency=0.0, course_latency=0.0)


def _smoothed(
    motions: list[Motion], receiver: Receiver, believed: Receiver
) -> tuple[np.ndarray, np.ndarray]:
    """Errors and sd [m, 9] on fixes of one receiver with the model of another."""
    outcomes = []
    for i, motion in enumerate(motions):
        imu, fixes = record(motion, SENSOR, i), receive(motion, receiver, i)
        outcomes.append(optimal_errors(motion, imu, fixes, SENSOR, believed))
    error, sd = zip(*outcomes, strict=True)
    return np.concatenate(error), np.concatenate(sd)


@pytest.mark.slow
@pytest.mark.parametrize("name", others_slow(["u-blox", WHITE, "phone"]))
def test_its_errors_are_as_large_as_their_sd(motions: list[Motion], name: str) -> None:
    receiver = _prompt(name)
    error, sd = _smoothed(motions, receiver, receiver)
    ratio = np.sqrt(np.mean((error / sd) ** 2, axis=0))
    # a position's mean error is one draw a drive and axis
    assert 0.6 < np.sqrt(np.mean(ratio[:3] ** 2)) < 1.4
    assert 0.8 < np.sqrt(np.mean(ratio[3:6] ** 2)) < 1.2
    assert 0.8 < np.sqrt(np.mean(ratio[6:] ** 2)) < 1.2


@pytest.mark.slow
def test_velocity_errors_that_last_want_their_own_states(motions: list[Motion]) -> None:
    """Who takes them for white is worse and believes to be far better."""
    receiver = _prompt("phone")
    size = float(np.hypot(receiver.velocity, receiver.lasting))
    error, _ = _smoothed(motions, receiver, receiver)
    worse, sd = _smoothed(motions, receiver, replace(receiver, velocity=size, lasting=0.0))
    level = slice(3, 5)
    assert np.mean(worse[:, level] ** 2) > 1.02 * np.mean(error[:, level] ** 2)
    assert np.sqrt(np.mean((worse[:, level] / sd[:, level]) ** 2)) > 1.3


@pytest.mark.slow
def test_a_named_receiver_errs_as_its_file_says() -> None:
    """Statistics of what the fusion's tests receive, built apart from the project's simulator."""
    motion = city_drive(40.0, 1)
    receiver = receiver_named("phone")
    assert not receiver.says_all
    prompt = _prompt("phone")
    # of the motion nothing is left: the errors alone, over many seeds
    errors, heights = [], []
    for seed in range(500):
        fixes = receive(motion, replace(prompt, says_all=True), seed)
        true = motion.at(fixes.gps_s - GPS0)
        errors.append(fixes.vel_ned - true.vel)
        heights.append(fixes.height_m - true.height)
    velocity = np.stack(errors)
    size = np.hypot(receiver.velocity, receiver.lasting)
    assert velocity.std() == pytest.approx(size, rel=0.05)
    later = np.mean(velocity[:, :-2] * velocity[:, 2:])
    expected = receiver.lasting**2 * np.exp(-2.0 / receiver.lasting_tau)
    assert later == pytest.approx(expected, rel=0.1)
    parts = (receiver.slow[2], receiver.wander[2], receiver.white[2], receiver.short)
    assert np.stack(heights).std() == pytest.approx(np.linalg.norm(parts), rel=0.15)
    assert np.isnan(receive(motion, receiver, 1).vel_ned[:, 2]).all()


def test_courses_are_older_than_speeds() -> None:
    motion = city_drive(120.0, 2)
    quiet = Receiver(1.0, (0.0,) * 3, 60.0, (0.0,) * 3, 0.0, vel_latency=0.3, course_latency=0.4)
    fixes = receive(motion, quiet, 1)
    t = fixes.gps_s[5:] - GPS0
    slow, turned = motion.at(t - 0.3).vel, motion.at(t - 0.7).vel
    moving = np.hypot(turned[:, 0], turned[:, 1]) > 1.0
    got = fixes.vel_ned[5:][moving]
    assert np.hypot(got[:, 0], got[:, 1]) == pytest.approx(np.hypot(*slow[moving, :2].T))
    cross = got[:, 0] * turned[moving, 1] - got[:, 1] * turned[moving, 0]
    assert np.abs(cross).max() < 1e-9


def test_what_a_slow_error_leaves_of_independent_draws() -> None:
    low, high = nees_bands(receiver_named(WHITE), 50, 600.0)[0]
    slow_low, slow_high = nees_bands(receiver_named("phone"), 50, 600.0)[0]
    assert slow_low < low < 1.0 < high < slow_high
