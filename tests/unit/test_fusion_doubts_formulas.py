"""Slopes and lags that doubts of a drive rest on, against motions of which they are known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.fusion.doubts import heights, limits
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.triads import _left, lateness
from automap.fusion.doubts.turns import _fit, slope_of
from automap.records import ImuData
from tests.unit.fusion_receiver import gauss_markov


def test_a_slope_scatters_by_its_sigma_whatever_bias_there_is() -> None:
    """Over 200 sets of changes that follow one another; strays of one in fifty move it little."""
    rng = np.random.default_rng(1)
    off, stated = [], []
    for _ in range(200):
        x, span = rng.normal(size=150), rng.uniform(1.9, 2.1, 150)
        y = 1.3 * x - 0.4 * span + 0.2 * rng.normal(size=150)
        y[::50] += 30.0
        found = _fit(x, y, span, 2.0, 0.3)
        assert found.lag_s == 0.3
        off.append(found.value - 1.3)
        stated.append(found.sd)
    assert np.mean(off) == pytest.approx(0.0, abs=0.005)
    # weights that settle say a little less or more than least squares would
    assert np.std(off) == pytest.approx(np.mean(stated), rel=0.35)
    # changes that begin four times as often as they last are a fourth of their number
    often = _fit(x, y, span, 0.5, 0.0)
    assert often.sd == pytest.approx(2.0 * found.sd, rel=0.05)
    exact = _fit(x, 0.7 * x + 0.1 * span, span, 2.0, 0.0)
    assert (exact.value, exact.correlation) == pytest.approx((0.7, 1.0), abs=1e-3)


@pytest.mark.parametrize("lag_s", [0.0, 0.4, -0.3])
@pytest.mark.parametrize("scale", [1.0, -0.8])
def test_the_slope_of_what_is_seen_on_what_is_felt_is_found_at_its_lag(
    lag_s: float, scale: float
) -> None:
    stamps = np.arange(0.0, 200.0, 0.02)
    t = np.arange(1.0, 199.0, 0.5)

    def course(t: Any) -> Any:
        return np.sin(0.35 * t) + 0.6 * np.sin(0.93 * t + 1.0)

    felt = 0.35 * np.cos(0.35 * stamps) + 0.6 * 0.93 * np.cos(0.93 * stamps + 1.0) + 0.01
    seen = scale * course(t - lag_s) + 2.0
    found = slope_of(stamps, felt, t, seen, np.ones(len(t), bool))
    assert found is not None
    assert found.lag_s == pytest.approx(lag_s, abs=1e-9)
    assert found.value == pytest.approx(scale, abs=0.02)
    noise = np.random.default_rng(2).normal(size=len(t))
    assert slope_of(stamps, felt, t, noise, np.ones(len(t), bool)) is None
    assert slope_of(stamps, felt, t, seen, np.zeros(len(t), bool)) is None


@pytest.mark.parametrize("factor", [1.0, 3.2808])
def test_heights_rise_by_a_units_factor_of_the_climb(factor: float) -> None:
    """Hills driven with a body that is pitched against the road all the way."""
    n = 12_000
    at = 0.1 * np.arange(n)
    speed = 15.0
    slope = 0.05 * np.sin(0.02 * at) + 0.03 * np.sin(0.007 * at)
    level = np.concatenate([[0.0], np.cumsum(speed * slope[1:] * 0.1)])
    velocity = np.column_stack([np.full(n, 0.6 * speed), np.full(n, 0.8 * speed), np.zeros(n)])
    rpy = np.column_stack([np.zeros(n), np.arctan(slope + 0.02), np.zeros(n)])
    path: Any = SimpleNamespace(gps_s=1e9 + at, vel_ned=velocity, rpy=rpy)
    t = np.arange(0.0, at[-1], 1.0)
    rng = np.random.default_rng(3)
    height = factor * np.interp(t, at, level) + 50.0 + 0.5 * rng.normal(size=len(t))
    changes = heights._changes(path, t, height)
    assert changes is not None
    found = heights._slope(changes)
    assert found is not None
    assert abs(found.value - factor) < 4.0 * found.sd
    assert found.sd < 0.03
    # as many windows as there is way, each with the noise of both its ends
    climbs = np.diff(np.interp(np.arange(0.0, at[-1], limits.CLIMB_WAY_M / speed), at, level))
    climbs -= climbs.mean()
    assert found.sd == pytest.approx(np.sqrt(2.0) * 0.5 / np.linalg.norm(climbs), rel=0.4)
    # on a road that never climbs, or climbs all the way alike, nothing is told
    for pitch in (0.0, 0.02):
        even = np.tile([0.0, pitch, 0.0], (n, 1))
        flat: Any = SimpleNamespace(gps_s=path.gps_s, vel_ned=velocity, rpy=even)
        changes = heights._changes(flat, t, rng.normal(size=len(t)))
        assert changes is not None
        assert heights._slope(changes) is None


def _low_hills(seed: int, unit: float, by_speed: float) -> list[Reason]:
    """Two kilometres with stops on low hills, heights off by some metres, in a ``unit`` per metre,
    and falling with the square of the speed."""
    at = 0.1 * np.arange(2_400)
    speed = 9.0 + 8.0 * np.sin(0.06 * at)
    pitch = 0.022 * np.sin(0.045 * at)
    velocity = np.column_stack([speed, np.zeros(len(at)), np.zeros(len(at))])
    rpy = np.column_stack([np.zeros(len(at)), np.arctan(pitch), np.zeros(len(at))])
    path: Any = SimpleNamespace(gps_s=1e9 + at, vel_ned=velocity, rpy=rpy)
    level = np.cumsum(speed * pitch * 0.1)[::10]
    rng = np.random.default_rng(seed)
    wander = gauss_markov(len(level), 1.0, 60.0, np.ones(3), rng)[:, 0]
    height = unit * (300.0 + level + wander - by_speed * speed[::10] ** 2)
    fixes: Any = SimpleNamespace(
        gps_s=path.gps_s[::10], lat_rad=np.zeros(len(level)), lon_rad=np.zeros(len(level)),
        height_m=height,
    )  # fmt: skip
    return list(heights.height_doubts(path, fixes))


@pytest.mark.parametrize("seed", range(4))
def test_feet_are_told_where_metres_are_far_less_likely(seed: int) -> None:
    (found,) = _low_hills(seed, 1.0 / 0.3048, 0.0)
    assert (found.code, found.state) == ("height_scale", "doubtful")
    assert "as feet where metres belong" in found.text


def test_heights_that_chance_may_make_fall_with_the_speed_are_as_unsure() -> None:
    """By pressure they are 4 m off at 17 m/s; by none they seldom seem to be."""
    by_pressure = [_low_hills(seed, 1.0, 0.015) for seed in range(12)]
    told = [reason for found in by_pressure for reason in found]
    assert len(told) >= 9
    assert {reason.code for reason in told} == {"height_by_pressure"}
    assert all(reason.height_m > 2.0 for reason in told)
    assert any(reason.state == "good" for reason in told)
    clean = [_low_hills(seed, 1.0, 0.0) for seed in range(40)]
    assert sum(map(len, clean)) <= 4


def test_what_bends_leave_of_a_force_is_that_of_a_line_and_a_delay_is_worth_what_is_new_of_it() -> (
    None
):
    rng = np.random.default_rng(4)
    n = 4000
    t = limits.BEND_STEP_S * np.arange(n)
    bend = 3.0 * np.sin(0.5 * t) + np.sin(1.3 * t)
    change, noise = rng.normal(size=n), 0.3 * rng.normal(size=n)
    rest, power = _left(0.2 + 1.1 * bend - 0.5 * change + noise, bend, change)
    assert rest == pytest.approx(noise, abs=0.05)
    slope = 1.5 * np.cos(0.5 * t) + 1.3 * np.cos(1.3 * t)
    design = np.column_stack([np.ones(n), bend, change])
    new = slope - design @ np.linalg.lstsq(design, slope, rcond=None)[0]
    # each square by the weight of its row, of Cauchy's at residuals of normal errors
    scale = 1.4826 * np.median(np.abs(noise))
    x = rng.normal(size=100_000) * 0.3 / scale
    from automap.robust import cauchy_weight

    assert power == pytest.approx(np.sum(new**2) * cauchy_weight(x**2).mean(), rel=0.03)


@pytest.mark.parametrize("late_s", [0.0, 0.25, -0.4])
def test_an_accelerometer_is_as_late_as_it_feels_bends(late_s: float) -> None:
    """A car ahead of whose axle the IMU is, turned in the vehicle."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 180.0, 0.01)

    def rate(t: Any) -> Any:
        return 0.2 * np.sin(0.45 * t) + 0.15 * np.sin(1.1 * t + 2.0)

    def change(t: Any) -> Any:
        return 0.09 * np.cos(0.45 * t) + 0.165 * np.cos(1.1 * t + 2.0)

    speed = np.full(len(t), 14.0)
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    force = np.zeros((len(t), 3))
    force[:, 1] = 14.0 * rate(t - late_s) + 1.2 * change(t - late_s) + 0.15
    force += 0.3 * rng.normal(size=force.shape)
    gyro = np.zeros((len(t), 3))
    gyro[:, 2] = rate(t) + 0.002 * rng.normal(size=len(t))
    imu = ImuData(t_ns=np.rint(t * 1e9).astype(np.int64), gyro=gyro @ turn, accel=force @ turn)
    found = lateness(imu, turn, speed)
    assert found is not None
    # an arm's part and a delay resemble each other, which the sigma holds
    assert abs(found[0] - late_s) < 3.0 * found[1]
    assert 0.01 < found[1] < 0.15
    assert lateness(imu, turn, 0.0 * speed) is None
