"""Formulas of the calibration against Monte Carlo, numeric derivatives and plain recursion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from automap.calibration.allan import (
    _basis,
    _simulated,
    averaging_factors,
    degrees_of_freedom,
    overlapping_deviation,
)
from automap.calibration.fold import angles, corrected, folded_covariance
from automap.calibration.hand_motion import (
    coloured_noise_covariance,
    coloured_noise_history,
    final_response,
    hand_motion,
)
from automap.calibration.limits import (
    LEAST_RUN,
    PEAK_PART,
    SAME_POSE,
    SATURATION_PROBABILITY,
    WINDOW_S,
)
from automap.calibration.plausible import _saturated, refuse_saturation
from automap.calibration.poses import pose_name
from automap.calibration.rest import _joined, _same_pose, _summary, quantisation_step
from automap.errors import InputError
from automap.records import FloatArray, ImuCalibration, RawImu, TriadCalibration


def test_degrees_of_freedom_are_those_of_repeated_records() -> None:
    """A mean of squares of f degrees of freedom scatters by its value times sqrt(2 / f)."""
    rng = np.random.default_rng(1)
    n, factors = 120, np.array([1, 3, 8])
    squares = np.array(
        [overlapping_deviation(rng.standard_normal(n), 1.0, factors) ** 2 for _ in range(1500)]
    )
    found = 2.0 * squares.mean(axis=0) ** 2 / squares.var(axis=0)
    # a variance of 1500 is known to 4 %, and the formula is itself good to some percent
    assert degrees_of_freedom(n, factors) == pytest.approx(found, rel=0.15)
    assert degrees_of_freedom(20, np.array([19])) == pytest.approx([1.0])


@pytest.mark.parametrize("terms", [(0.02, 0.0, 0.0), (0.0, 0.0, 0.003), (0.0, 0.01, 0.0)])
def test_simulated_noise_has_the_deviation_of_its_terms(terms: tuple[float, ...]) -> None:
    """White noise falls by the root of tau, a walk rises by it, flicker stays: each in its size."""
    rng = np.random.default_rng(2)
    rate_hz, factors = 4.0, np.array([4, 12, 40])
    found = np.mean(
        [
            overlapping_deviation(_simulated(rng, np.array(terms), 4000, rate_hz), rate_hz, factors)
            ** 2
            for _ in range(30)
        ],
        axis=0,
    )
    wanted = _basis(factors / rate_hz) @ np.square(terms)
    # flicker ends at the record's own length and at the rate; a walk's mean square moves by tau^2
    assert found == pytest.approx(wanted, rel=0.12)


@pytest.mark.parametrize("n", [3, 60, 1000, 54_321])
def test_averaging_times_rise_from_one_sample_to_a_fifth_of_the_record(n: int) -> None:
    factors = averaging_factors(n)
    assert factors[0] == 1
    assert factors[-1] == max(n // 5, 1)
    assert np.all(np.diff(factors) > 0)
    assert np.all(factors[1:] <= 1.5 * factors[:-1] + 1.0)


def test_what_each_measurement_moved_is_what_the_filter_moves_step_by_step() -> None:
    """The filter's own recursion, run with each measurement alone, from no errors at all."""
    rng = np.random.default_rng(3)
    m, states = 5, 21
    response = 0.5 * rng.normal(size=(m, states, states + 6))
    response[:, :, :states] += 0.6 * np.eye(states)
    measured = rng.normal(size=(m, 6))
    error = np.zeros(states)
    for k in range(m):
        error = response[k, :, :states] @ error + response[k, :, states:] @ measured[k]
    weights = final_response(response)
    assert weights.shape == (m, 12, 6)
    found = np.einsum("kij,kj->i", weights, measured)
    assert any(np.allclose(found, error[first : first + 12]) for first in range(10))
    # of the last measurement nothing is carried on
    alone = response[-1, :, states:]
    assert any(np.allclose(weights[-1], alone[first : first + 12]) for first in range(10))


def test_sigmas_over_time_end_at_the_last_and_gain_information_in_proportion() -> None:
    prior, final = np.array([2.0, 0.5]), np.array([0.4, 0.3])
    sd = np.array([[2.0, 0.5], [1.0, 0.4], [0.5, 0.2]])
    found = coloured_noise_history(sd, prior, final)
    assert found[0] == pytest.approx(prior)
    assert found[-1] == pytest.approx(final)

    def share(values: FloatArray) -> FloatArray:
        information = 1.0 / values**2 - 1.0 / prior**2
        return np.asarray(information[1] / information[-1])

    assert share(found) == pytest.approx(share(sd))


def test_the_covariance_that_is_folded_in_is_that_of_the_folding() -> None:
    """Against numeric derivatives of the folding by the dynamic errors."""
    rng = np.random.default_rng(4)
    matrix = np.eye(3)
    triads = [
        TriadCalibration(1.0 + 0.1 * rng.normal(size=3), rng.normal(size=3), matrix) for _ in "ag"
    ]
    before = ImuCalibration(triads[0], triads[1], g_sensitivity=0.01 * rng.normal(size=(3, 3)))
    root = rng.normal(size=(12, 12))
    errors = root @ root.T
    for name, at in (("accel", (0, 6)), ("gyro", (3, 9))):

        def folded(x: FloatArray, name: str = name) -> FloatArray:
            triad = getattr(corrected(before, x), name)
            return np.concatenate([triad.scale, triad.bias])

        h = 1e-6
        J = np.column_stack([(folded(h * e) - folded(-h * e)) / (2 * h) for e in np.eye(12)])
        found = folded_covariance(getattr(before, name), errors, at, 9)
        np.testing.assert_allclose(found[:6, :6], J @ errors @ J.T, rtol=1e-6, atol=1e-8)
        assert not found[6:].any()
        assert not found[:, 6:].any()


def test_a_folded_calibration_corrects_readings_as_both_in_turn() -> None:
    rng = np.random.default_rng(5)
    upper = np.eye(3) + np.triu(0.02 * rng.normal(size=(3, 3)), 1)
    triad = TriadCalibration(1.0 + 0.1 * rng.normal(size=3), rng.normal(size=3), upper)
    before = ImuCalibration(triad, triad, g_sensitivity=0.01 * rng.normal(size=(3, 3)))
    errors = 0.01 * rng.normal(size=12)
    after = corrected(before, errors)
    reading = rng.normal(size=3)
    for name, bias, scale in (
        ("accel", errors[:3], errors[6:9]),
        ("gyro", errors[3:6], errors[9:]),
    ):
        one, two = getattr(before, name), getattr(after, name)
        first = one.matrix @ (one.scale * reading + one.bias)
        second = two.matrix @ (two.scale * reading + two.bias)
        assert second == pytest.approx((1.0 + scale) * first + bias)
    assert after.g_sensitivity == pytest.approx((1.0 + errors[9:])[:, None] * before.g_sensitivity)


def test_the_step_of_readings_is_their_resolution() -> None:
    rng = np.random.default_rng(6)
    steps = np.array([0.5, 1e-3, 0.02])
    values = np.rint(rng.normal(0.0, 4.0, (400, 3))) * steps
    assert quantisation_step(values) == pytest.approx(steps)
    values[:, 1] = 7.0
    assert quantisation_step(values)[1] == 0.0


def log_of(gyro: FloatArray) -> RawImu:
    """A log of a gyro's x axis, the others noise."""
    n = len(gyro)
    noise = np.random.default_rng(7).normal(0.0, 1e-3, (n, 6))
    noise[:, 3] += gyro
    return RawImu(
        name="desk.csv", t_ns=np.arange(n) * 10_000_000, accel=noise[:, :3], gyro=noise[:, 3:],
        accel_unit="m/s^2", gyro_unit="rad/s", accel_scale=1.0, gyro_scale=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("samples", [LEAST_RUN - 1, LEAST_RUN, 40])
def test_an_axis_that_stays_at_its_extreme_in_the_midst_of_motion_is_saturated(
    sign: float, samples: int
) -> None:
    """A swing of the hand, at 2.5 s, whose top is cut off for some samples."""
    t = np.arange(4000) * 0.01
    log = log_of(sign * 2.4 * np.exp(-(((t - 2.5) / 0.4) ** 2)))
    first = 250 - samples // 2
    log.gyro[first : first + samples, 0] = sign * 2.5
    if samples < LEAST_RUN:
        refuse_saturation(log)
        return
    place = (
        rf"gyro's x axis .* from {first * 0.01:.2f} s on .* {2.5 * sign:g} for {samples} samples"
    )
    with pytest.raises(InputError, match=place):
        refuse_saturation(log)


def test_a_sensor_that_rests_at_its_extreme_is_not_saturated() -> None:
    """What goes to its extreme by little and stays there is held there, not cut off."""
    t = np.arange(4000) * 0.01
    x = np.where(t < 10.0, np.sin(t), 0.97)
    log = log_of(x)
    log.gyro[2000:2100, 0] = 1.03
    refuse_saturation(log)
    # the same run in the midst of the swing is
    log.gyro[300:400, 0] = 1.03
    with pytest.raises(InputError, match=r"from 3.00 s on"):
        refuse_saturation(log)


def test_poses_are_named_by_the_axes_that_point_up() -> None:
    assert pose_name(np.array([0.0, 0.0, -1.0])) == "-z up"
    assert pose_name(np.array([1.0, 0.0, 0.0])) == "+x up"
    assert pose_name(np.array([0.7, -0.7, 0.0])) == "half way between +x and -y up"


def test_angles_are_those_of_the_misalignment_matrix() -> None:
    T = np.array([[1.0, -0.01, 0.02], [0.0, 1.0, -0.03], [0.0, 0.0, 1.0]])
    assert angles(T).tolist() == [0.01, 0.02, 0.03]


@pytest.mark.parametrize("keep", [0.0, 0.9])
def test_errors_under_a_swaying_hand_have_the_covariance_of_its_sway(keep: float) -> None:
    """A hand whose sway is forgotten by ``keep`` from one measurement to the next: the weights'
    quadratic form in the sway's own covariance, where the spectrum is estimated from records."""
    rng = np.random.default_rng(4)
    m, step, white = 512, 0.05, np.array([0.4, 0.1])
    weights = np.zeros((m, 12, 6))
    bump = np.exp(-0.5 * ((np.arange(m) - 300.0) / 12.0) ** 2)
    weights[:, 0, 0], weights[:, 1, 1] = bump, 2.0 * bump
    weights[:, 0, 3], weights[:, 2, 4] = -bump, np.roll(bump, 6)
    base = 20.0 * np.eye(12)
    sd = np.array([0.5, 0.2])
    sway = toeplitz(keep ** np.arange(m)) if keep else np.eye(m)
    coloured, replaced = np.zeros((12, 12)), np.zeros((12, 12))
    for k in range(6):
        W = weights[:, :3, k]
        coloured[:3, :3] += sd[k % 2] ** 2 * W.T @ sway @ W
        replaced[:3, :3] += white[k % 2] * W.T @ W
    found = np.zeros((12, 12))
    records = 12
    for _ in range(records):
        # velocity and place of each axis by themselves
        x = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal((m + 100, 6)), 0)
        innovations = np.zeros((m, 10))
        innovations[:, [1, 7, 2, 8, 3, 9]] = np.tile(sd, 3) * x[100:]
        one = coloured_noise_covariance(
            base, weights, np.tile(white, (m, 1)), innovations, np.ones(m, bool), step
        )
        np.testing.assert_allclose(one, one.T, atol=1e-12)
        found += one / records
    size = np.sqrt(np.diag(coloured)[:3])
    off = (found - (base - replaced + coloured))[:3, :3] / np.outer(size, size)
    # bands of a spectrum, twelve times, are known to a sixth or so
    assert np.abs(off).max() < 0.25
    np.testing.assert_allclose(found[3:], base[3:], atol=1e-12)


def test_at_rest_the_velocity_stays_white() -> None:
    rng = np.random.default_rng(5)
    m = 600
    weights = rng.normal(size=(m, 12, 6))
    innovations = rng.normal(size=(m, 10))
    moving = np.arange(m) < 300
    white = np.full((m, 2), 0.5)
    base = np.eye(12)
    found = coloured_noise_covariance(base, weights, white, innovations, moving, 0.05)
    # weights of a velocity that rests are not looked at
    weights[300:, :, [0, 2, 4]] *= 7.0
    np.testing.assert_allclose(
        coloured_noise_covariance(base, weights, white, innovations, moving, 0.05), found
    )
    weights[:, :, 1] *= 2.0
    other = coloured_noise_covariance(base, weights, white, innovations, moving, 0.05)
    assert np.abs(other - found).max() > 1.0
    # too few measurements leave it
    none = coloured_noise_covariance(base, weights, white, innovations, moving & False, 0.05)
    assert none is base


def test_what_a_hand_does_is_seen_in_the_innovations_of_its_motion() -> None:
    rng = np.random.default_rng(6)
    m = 4096
    innovations = np.zeros((m, 10))
    innovations[:, 1:4], innovations[:, 7:10] = (
        0.3 * rng.standard_normal((2, m, 3)) * [[[1.0]], [[0.5]]]
    )
    moving = np.arange(m) % 4096 < 3000
    # what it has not learnt yet is not the hand's
    innovations[:400] *= 50.0
    hand = hand_motion(innovations, moving, 0.05)
    assert hand.velocity == pytest.approx(0.3, rel=0.05)
    assert hand.place == pytest.approx(0.15, rel=0.05)
    # white noise is its own spectrum, of which the velocity takes the peak
    assert 0.09 < hand.variance[0] < 0.09 * 2.0
    assert hand.variance[1] == pytest.approx(0.0225, rel=0.3)
    slow = innovations.copy()
    slow[:, 7:10] = np.cumsum(slow[:, 7:10], axis=0) * 0.02
    assert hand_motion(slow, moving, 0.05).variance[1] > 4.0 * np.mean(slow[410:, 7:10] ** 2)
    # a fast sway is not followed: its place has a part of the peak, which the velocity has whole
    fast = np.tile(np.sin(2.0 * np.pi * 4.0 * 0.05 * np.arange(m))[:, None], (1, 10))
    peak, part = hand_motion(fast, np.ones(m, bool), 0.05).variance
    assert part == pytest.approx(PEAK_PART * peak)
    few = hand_motion(innovations[:45], moving[:45], 0.05)
    rms = np.sqrt([np.mean(innovations[4:45, 1:4] ** 2), np.mean(innovations[4:45, 7:10] ** 2)])
    assert (few.velocity, few.place) == pytest.approx(tuple(rms))
    assert few.variance == pytest.approx(rms**2 * [5.0, 10.0])
    # of enough places and few velocities there is no spectrum either
    resting = hand_motion(innovations[400:600], np.arange(200) < 60, 0.05)
    rms = np.sqrt(
        [np.mean(innovations[420:460, 1:4] ** 2), np.mean(innovations[420:600, 7:10] ** 2)]
    )
    assert resting.variance == pytest.approx(rms**2 * [5.0, 10.0])
    still = hand_motion(np.zeros((10, 10)), np.zeros(10, bool), 0.05)
    assert still.variance == pytest.approx([5.0 * 0.05**2, 10.0 * 0.05**2])


def drawn_log(rng: np.random.Generator, n: int, rate_hz: float) -> RawImu:
    t_ns = np.int64(10**9) + np.rint(np.arange(n) / rate_hz * 1e9).astype(np.int64)
    return RawImu(t_ns, rng.normal(size=(n, 3)), rng.normal(5.0, 1.0, (n, 3)))


def test_two_rests_that_are_one_have_the_mean_of_both_and_its_variance() -> None:
    """Against the variance of a weighted mean of independent parts; lengths of one to three."""
    log = drawn_log(np.random.default_rng(7), 400, 100.0)
    first, second = _summary(log, 2, 0, 101), _summary(log, 2, 99, 400)
    assert (first.middle_s, second.length_s) == pytest.approx((0.5, 3.0))
    both = _joined(first, second)
    assert (both.log, both.start, both.stop) == (2, 0, 400)
    assert both.length_s == pytest.approx(4.0)
    assert both.middle_s == pytest.approx(0.25 * 0.5 + 0.75 * (0.99 + 1.5))
    for name in ("accel", "gyro"):
        values = getattr(log, name)
        mean = 0.25 * values[:101].mean(axis=0) + 0.75 * values[99:].mean(axis=0)
        assert getattr(both, name) == pytest.approx(mean)
        for kind in ("var", "batch_var"):
            a, b = (getattr(r, f"{name}_{kind}") for r in (first, second))
            assert getattr(both, f"{name}_{kind}") == pytest.approx(a / 16.0 + 9.0 * b / 16.0)
        # white noise of one: its mean's variance is one over the number
        assert getattr(first, f"{name}_var") == pytest.approx(np.full(3, 1.0 / 101.0), rel=0.4)
    batches = 301.0 * np.concatenate([second.accel_batch_var, second.gyro_batch_var])
    # six times nine degrees of freedom
    assert batches.mean() == pytest.approx(1.0, abs=0.5)


def test_rests_are_of_one_pose_where_they_are_near_in_time_and_alike() -> None:
    rng = np.random.default_rng(8)
    rate_hz = 50.0
    log = drawn_log(rng, 1000, rate_hz)
    first = _summary(log, 0, 100, 300)
    off = np.array([0.0, 0.03, 0.04])
    # from the last sample of one to the first of the other
    most = round(2.0 * WINDOW_S * rate_hz)
    for start, wanted in ((299 + most, True), (300 + most, False)):
        second = replace(_summary(log, 0, start, 600), accel=first.accel + off)
        assert _same_pose(log, first, second, 1.01 * 0.05 / SAME_POSE) is wanted
        assert not _same_pose(log, first, second, 0.99 * 0.05 / SAME_POSE)
        assert not _same_pose(log, first, replace(second, log=1), 9.0 / SAME_POSE)


@pytest.mark.parametrize(("n", "told"), [(30, False), (3000, True)])
def test_a_run_at_the_extreme_is_judged_by_the_rule_of_succession(n: int, told: bool) -> None:
    """Of n neighbours none was alike: the next is with a chance of 1 / (n + 2), and few readings
    say little."""
    ramp = np.linspace(0.0, 1.0, n)
    x = np.concatenate([ramp, np.full(LEAST_RUN, 1.5), ramp[::-1] + 1e-5])
    inner = 2 * n - 3
    chance = len(x) * (1.0 / (inner + 2.0)) ** (LEAST_RUN - 1)
    assert (chance < SATURATION_PROBABILITY) == told
    assert (_saturated(x) is not None) == told
