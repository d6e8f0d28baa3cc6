"""Noise levels by the exact slopes of the likelihood."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.level_climb import Maximum
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.limits import TIME_FACTORS
from automap.gap import base_model, noise
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.limits import LEAST_RESTS
from automap.gap.noise import Fitted, fit_noise, noise_score, noise_slopes, rest_factors
from automap.records import FloatArray
from tests.slow_cases import others_slow
from tests.unit.test_gap import simulated

STEP = 1e-3


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["white", "wandering"])
def ungated(request: pytest.FixtureRequest) -> Fit:
    """A drive whose every measurement counts in full: trust by surprise has no slope."""
    model = base_model()
    options = replace(model.options, gate_probability=1e-12, velocity_wander_sd=request.param)
    model = replace(model, options=options)
    return fit_drive(open_drive(simulated({}), model.options), model)


@pytest.mark.parametrize("off", others_slow([1.0, 1.7]))
def test_slopes_are_those_of_the_likelihood(ungated: Fit, off: float) -> None:
    factors = {k: v * off for k, v in ungated.model.factors.items()}
    here = noise_slopes([ungated], factors)
    score, slope, info = here.score, here.slope, here.info
    assert score == pytest.approx(noise_score([ungated], factors), rel=1e-9)
    assert (info >= 0.0).all()
    for i, level in enumerate(ALL_LEVELS):
        ends = [
            noise_score([ungated], factors | {level: factors[level] * float(np.exp(s * STEP))})
            for s in (1.0, -1.0)
        ]
        numeric = (ends[0] - ends[1]) / (2.0 * STEP)
        # forces within an interval are taken as constant
        assert slope[i] == pytest.approx(numeric, rel=0.03, abs=0.05), level


@pytest.mark.slow
def test_the_climb_ends_where_no_level_wants_to_move(ungated: Fit) -> None:
    start = dict(ungated.model.factors)
    found = fit_noise([ungated])
    assert noise_score([ungated], found) > noise_score([ungated], start)
    there = noise_slopes([ungated], found)
    slope, info = there.slope, there.info
    for i, level in enumerate(ALL_LEVELS):
        inside = 0.21 < found[level] < 60.0 and not (level == "nhc_z" and found[level] < 1.01)
        if inside and level not in TIME_FACTORS:
            # nats by a factor of e: what is left to gain is less than one
            assert abs(slope[i]) < 2.0 + np.sqrt(max(info[i], 0.0)), level


@pytest.mark.slow
@pytest.mark.parametrize("tau_s", [1.5, 24.0])
def test_how_long_velocities_err_is_the_drives_to_say(tau_s: float) -> None:
    drive = simulated({})
    tags = drive.fixes.gps_s
    keep = np.exp(-np.diff(tags) / tau_s)
    rng = np.random.default_rng(5)
    error = 0.2 * rng.standard_normal((len(tags), 3))
    for i, k in enumerate(keep):
        error[i + 1] = k * error[i] + np.sqrt(1.0 - k**2) * error[i + 1]
    fixes = replace(drive.fixes, vel_ned=drive.fixes.vel_ned + error)
    model = base_model()
    fit = fit_drive(open_drive(replace(drive, fixes=fixes), model.options), model)
    found = model.options.velocity_wander_tau_s * fit_noise([fit])["velocity_wander_tau"]
    # two minutes hold five of the longer ones
    assert tau_s / 4.0 < found < 4.0 * tau_s


def test_levels_that_may_not_move_stay(ungated: Fit) -> None:
    start = dict(ungated.model.factors)
    found = fit_noise([ungated], ("accel", "gyro"))
    assert {k: v for k, v in found.items() if k not in ("accel", "gyro")} == {
        k: v for k, v in start.items() if k not in ("accel", "gyro")
    }


RATE_HZ = 100.0


def at_rest(
    accel: float | FloatArray, gyro: float | FloatArray, spans: list[tuple[float, float]]
) -> Fit:
    """A drive of 100 s that stands in ``spans`` and is shaken elsewhere; noise of the sensors as
    factors on the stated densities."""
    rng = np.random.default_rng(7)
    n = round(100.0 * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    moving = np.ones(n, bool)
    for begin, end in spans:
        moving &= (t < begin) | (t >= end)
    options = SimpleNamespace(accel_noise=1e-3, gyro_noise=1e-4)
    sides = {}
    for name, factor, density in (("accel", accel, 1e-3), ("gyro", gyro, 1e-4)):
        white = rng.standard_normal((n, 3)) * factor * density * np.sqrt(RATE_HZ)
        # a bias and its drift
        slow = np.array([0.3, -9.8, 0.1]) + 1e-6 * t[:, None]
        sides[name] = white + slow + np.where(moving, np.sin(7.0 * t), 0.0)[:, None]
    imu = SimpleNamespace(t_ns=np.rint(1e9 * (t + 5.0)).astype(np.int64), **sides)
    opened = SimpleNamespace(
        drive=SimpleNamespace(imu=imu), session=SimpleNamespace(standstill=spans)
    )
    return cast("Fit", SimpleNamespace(opened=opened, model=SimpleNamespace(options=options)))


@pytest.mark.parametrize(("accel", "gyro"), [(1.0, 1.0), (4.0, 0.3)])
def test_noise_at_rest_is_that_of_the_sensors_and_surely_no_more(accel: float, gyro: float) -> None:
    found = rest_factors([at_rest(accel, gyro, [(5.0, 35.0), (60.0, 95.0)])])
    for level, true in (("accel", accel), ("gyro", gyro)):
        assert 0.6 * true < found[level] < true


def test_an_axis_that_is_shaken_does_not_count() -> None:
    axes = np.array([1.0, 5.0, 20.0])
    found = rest_factors([at_rest(axes, axes[::-1], [(5.0, 95.0)])])
    assert found["accel"] < 1.2
    assert found["gyro"] < 1.2


def test_the_quietest_drive_counts() -> None:
    drives = [at_rest(size, size, [(5.0, 95.0)]) for size in (3.0, 1.0)]
    assert rest_factors(drives) == rest_factors(drives[1:])


def test_drives_that_hardly_stand_say_nothing() -> None:
    # halts of one second have no two means
    short = [(10.0 * i, 10.0 * i + 1.0) for i in range(9)]
    assert rest_factors([at_rest(1.0, 1.0, short)]) == {}
    assert rest_factors([at_rest(1.0, 1.0, [(5.0, 5.0 + 0.5 * LEAST_RESTS)])]) == {}
    assert rest_factors([at_rest(1.0, 1.0, [])]) == {}


def test_no_sensor_is_taken_for_quieter_than_at_rest(
    ungated: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    quiet = fit_noise([ungated], ("accel", "gyro"))
    least = {"accel": 2.0 * quiet["accel"], "gyro": 0.5 * quiet["gyro"]}
    monkeypatch.setattr(noise, "rest_factors", lambda fits: least)
    found = fit_noise([ungated], ("accel", "gyro"))
    assert found["accel"] == pytest.approx(least["accel"])
    assert found["gyro"] > least["gyro"]


@pytest.mark.parametrize(
    ("moved", "climbs"), [((0.2,), 0), ((30.0, 0.5), 1), ((30.0, 9.0, 9.0), 2)]
)
def test_levels_are_climbed_about_their_own_path(
    monkeypatch: pytest.MonkeyPatch, moved: tuple[float, ...], climbs: int
) -> None:
    """Each fit about new levels moves the likelihood: until by less than a nat, or thrice."""
    model, asked = base_model(), list[float]()
    drops = iter(moved)
    monkeypatch.setattr(
        noise, "fitted_about", lambda model, estimate, fits: Fitted(model, {}, fits)
    )
    monkeypatch.setattr(noise, "noise_score", lambda fits, factors: 100.0 - next(drops))

    def likeliest(
        fits: object, levels: object, factors: dict[str, float], inverse: object
    ) -> Maximum:
        asked.append(factors["gyro"])
        return Maximum(100.0, factors | {"gyro": 2.0 * factors["gyro"]}, np.eye(1))

    monkeypatch.setattr(noise, "_likeliest", likeliest)
    top = Maximum(100.0, dict(model.factors), np.eye(1))
    found = noise._settled(Fitted(model, {}, ()), top)
    assert asked == [2.0**i for i in range(climbs)]
    assert found.model.factors["gyro"] == 2.0**climbs
