"""What the simulator does to fixes and boxes against the statistics and motions it stands for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.effects.gnss import (
    frozen,
    gauss_markov,
    low_pass,
    markov_error,
    noise_factor,
    short_error,
    slow_error,
    steps,
    velocity_wander,
    wander,
)
from automap.effects.lens import box_variances, focal_length, normalise
from automap.effects.limits import BLEND_S, FORCE_S
from automap.effects.signals import signals_of_readings
from automap.effects.vehicle import lever_arm_motion, parameter, parameters
from automap.records import Camera


def test_a_wandering_error_has_its_sigma_and_forgets_with_its_time_constant() -> None:
    """40 000 short sequences: as large at every row, alike by exp(-t / tau), also at odd steps."""
    rng = np.random.default_rng(1)
    step = np.array([0.0, 0.5, 2.0, 0.1])
    k = 40_000
    x = gauss_markov(4, np.full(k, 3.0), step, rng)
    assert x.std(axis=1) == pytest.approx(np.full(4, 3.0), rel=0.02)
    gone = np.cumsum(step)
    for i in range(4):
        for j in range(i + 1, 4):
            alike = np.mean(x[i] * x[j]) / 9.0
            assert alike == pytest.approx(np.exp(-(gone[j] - gone[i])), abs=0.02)


def test_errors_of_the_receiver_have_the_sizes_that_are_given() -> None:
    rng = np.random.default_rng(2)
    one = markov_error(15_000, 1.0, {"sigma": 2.0, "tau": 5.0}, rng)
    assert one.std() == pytest.approx(2.0, rel=0.08)
    assert np.mean(one[5:] * one[:-5]) / 4.0 == pytest.approx(np.exp(-1.0), abs=0.08)
    assert not markov_error(5, 1.0, {"sigma": 0.0, "tau": 5.0}, rng).any()
    assert not markov_error(5, 1.0, {}, rng).any()
    # multipath forgets in ten seconds unless told otherwise
    for given, tau in (({}, 10.0), ({"tau": 3.0}, 3.0)):
        values = {"gnss_multipath": {"sigma": 1.5, **given}}
        short = short_error(12_000, 1.0, values, rng)
        assert short.std(axis=0) == pytest.approx([1.5] * 3, rel=0.15)
        alike = np.mean(short[2:] * short[:-2]) / 1.5**2
        assert alike == pytest.approx(np.exp(-2.0 / tau), abs=0.12)
    slow = slow_error(4000, 1.0, {"gnss_slow_wander": {"sigma": 2.0, "tau": 4.0}}, rng)
    assert slow[:, :2].std(axis=0) == pytest.approx([2.0, 2.0], rel=0.2)
    assert not slow[:, 2].any()
    up = slow_error(4000, 1.0, {"gnss_height_wander": {"sigma": 1.0, "tau": 4.0}}, rng)
    assert not up[:, :2].any()
    assert up[:, 2].std() == pytest.approx(1.0, rel=0.2)


def test_what_is_given_takes_the_place_of_the_receivers_own() -> None:
    own = np.array([1.0, 2.0, 3.0])
    assert wander(own, 9.0, {})[0].tolist() == own.tolist()
    assert wander(own, 9.0, {})[1] == 9.0
    sigma, tau = wander(own, 9.0, {"gnss_correlated_noise": {"sigma": 0.5, "tau": 4.0}})
    assert (sigma.tolist(), tau) == ([0.5] * 3, 4.0)
    assert velocity_wander({}) == (0.0, 2.0)
    assert velocity_wander({"gnss_velocity_wander": {"sigma": 0.3, "tau": 7.0}}) == (0.3, 7.0)
    assert noise_factor({}) == 1.0
    assert noise_factor({"gnss_noise_scale": {"factor": 1.7}}) == 1.7


def test_steps_hold_and_come_as_often_as_said() -> None:
    rng = np.random.default_rng(3)
    t = 50.0 + np.arange(20_000.0)
    found = steps(t, {"gnss_position_steps": {"size": 2.0, "interval": 40.0}}, rng)
    changes = np.flatnonzero(np.any(np.diff(found, axis=0) != 0.0, axis=1))
    # of 500 a Poisson number, less the few that fall into one second
    assert len(changes) == pytest.approx(500, abs=75)
    values = found[np.append(changes, len(t) - 1)]
    assert values.std(axis=0) == pytest.approx([2.0] * 3, rel=0.15)
    assert not steps(t, {}, rng).any()


def test_a_receiver_freezes_for_the_share_of_the_time_that_follows() -> None:
    """Beginnings at random, an interval apart in the mean, of exponential length: at an instant
    none holds with probability exp(-length / interval)."""
    rng = np.random.default_rng(4)
    t = np.arange(60_000.0)
    held = frozen(t, {"gnss_freeze": {"length": 8.0, "interval": 40.0}}, rng)
    assert held.mean() == pytest.approx(1.0 - np.exp(-0.2), rel=0.15)
    assert not frozen(t, {}, rng).any()


def test_a_lag_solves_its_equation() -> None:
    """tau y' = x - y for a signal of straight pieces: on one of slope s the output is behind by
    tau s in the end, and what is between dies away."""
    rng = np.random.default_rng(5)
    step_s, x = 0.2, rng.normal(size=(12, 2))
    for tau in (0.05, 0.7):
        y = x[0].copy()
        found = low_pass(x, step_s, tau)
        assert found[0] == pytest.approx(y)
        for k in range(11):
            slope = (x[k + 1] - x[k]) / step_s
            between = (y - x[k] + tau * slope) * np.exp(-step_s / tau)
            y = x[k + 1] - tau * slope + between
            assert found[k + 1] == pytest.approx(y)
    assert low_pass(x, step_s, 0.0).tolist() == x.tolist()


def test_the_motion_of_a_point_of_the_body_is_the_derivative_of_its_place() -> None:
    rng = np.random.default_rng(6)
    attitude = Rotation.random(4, random_state=rng)
    rate, arm, h = rng.normal(size=(4, 3)), rng.normal(size=3), 1e-6
    place, velocity = lever_arm_motion(attitude.as_matrix(), rate, arm)
    assert place == pytest.approx(attitude.apply(arm))
    later, before = (attitude * Rotation.from_rotvec(s * h * rate) for s in (1.0, -1.0))
    assert velocity == pytest.approx((later.apply(arm) - before.apply(arm)) / (2 * h), abs=1e-6)


def test_variances_of_boxes_are_those_of_edges_that_err() -> None:
    """Each edge errs by the pixels, the whole by a share of its height: what centre and logarithm
    of the height scatter by."""
    rng = np.random.default_rng(7)
    matrix = np.array([[900.0, 0.0, 640.0], [0.0, 1100.0, 360.0], [0.0, 0.0, 1.0]])
    camera = Camera(
        width=1280, height=720, matrix=matrix, distortion=np.zeros(5),
        lever_arm_m=np.zeros(3), mount_rpy=np.zeros(3), mount_sd=0.0, time_offset_s=0.0,
        time_offset_sd=0.0,
    )  # fmt: skip
    assert focal_length(camera) == 1000.0
    box = np.array([[600.0, 300.0, 640.0, 350.0], [0.5, 300.0, 40.0, 350.0]])
    height = np.full(2, 0.05)
    found = box_variances(camera, box, height, 0.6, 0.03, 0.001)
    n = 200_000
    edges = 0.6e-3 * rng.normal(size=(2, n))
    log_height = np.log(0.05 + edges[1] - edges[0]) + 0.03 * rng.normal(size=n)
    assert found[0, 2] == pytest.approx(log_height.var(), rel=0.02)
    pieces = (0.6e-3, 0.03 * 0.05, 0.001)
    centre = sum(size * rng.normal(size=n) for size in pieces)
    assert found[0, :2] == pytest.approx([np.var(centre)] * 2, rel=0.02)
    # the edge of the picture cuts the second
    assert found[1] == pytest.approx(36.0 * found[0])


def test_parameters_that_are_not_given_are_zero() -> None:
    values = {"gnss_lever_arm": {"y": 2.0}}
    assert parameters(values, "gnss_lever_arm").tolist() == [0.0, 2.0, 0.0]
    assert parameter({"gnss_outliers": {"fraction": 0.2}}, "gnss_outliers") == 0.2
    assert parameter({}, "gnss_outliers") == 0.0


def test_pixels_beyond_the_fold_of_a_lens_have_no_direction() -> None:
    """r + k r^3 is largest at r = 1 / sqrt(-3 k): no direction leads farther out."""
    k, f = -0.3, 900.0
    camera = Camera(
        2000, 2000, np.array([[f, 0.0, 1000.0], [0.0, f, 1000.0], [0.0, 0.0, 1.0]]), np.array([k]),
        np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0,
    )  # fmt: skip
    farthest = f * 2.0 / 3.0 / np.sqrt(-3.0 * k)
    off = np.array([-100.0, -2.0, 0.5, 3.0, 30.0])
    pixels = np.column_stack([1000.0 + farthest + off, np.full(5, 1000.0)])
    flat = normalise(camera, pixels)
    assert np.isfinite(flat).all(axis=1).tolist() == [True, True, False, False, False]
    r = flat[:2, 0]
    assert r + k * r**3 == pytest.approx((farthest + off[:2]) / f, abs=1e-5)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
@pytest.mark.parametrize("period_s", [1.0, 6.0, 40.0])
def test_the_acceleration_along_the_track_is_fast_from_the_force_and_slow_from_the_fixes(
    rate_hz: float, period_s: float
) -> None:
    """Waves of either alone: a Gaussian blur of sigma s leaves exp(-(2 pi s / T)^2 / 2) of one."""
    n = round(120.0 * rate_hz)
    time = np.arange(n) / rate_hz
    omega = 2.0 * np.pi / period_s
    left = np.exp(-0.5 * (omega * BLEND_S) ** 2)
    short = np.exp(-0.5 * (omega * FORCE_S) ** 2)
    wave, still = np.sin(omega * time), np.zeros((n, 3))
    accel = still.copy()
    accel[:, 0] = wave + 0.3
    steady = np.tile([9.0, 0.0, 0.0], (2, 1))
    middle = slice(n // 3, 2 * n // 3)
    found = signals_of_readings(time, still, accel, None, time[[0, -1]], steady).acceleration
    wanted = short * (1.0 - left) * wave
    assert found[middle] == pytest.approx(wanted[middle], abs=2e-3)
    velocity = np.column_stack([15.0 - np.cos(omega * time) / omega, still[:, :2]])
    found = signals_of_readings(time, still, still, None, time, velocity).acceleration
    assert found[middle] == pytest.approx((left * wave)[middle], abs=5e-3)
