"""Noise told as a finding: only what no other noise says as well, and no floor of the model."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.gap import GapDrive, base_model, noise, stochastic
from automap.gap.drive import count_outliers, open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.found import Found
from automap.gap.limits import ANISOTROPY, LEVEL_RANGE, OCCAM_NATS
from automap.gap.noise import Fitted, fit_noise, with_noise
from automap.gap.noise_levels import Levels
from automap.gap.receivers import usual_finding
from automap.gap.stochastic import _floored, noise_claims, stochastic_findings
from tests.slow_cases import others_slow
from tests.unit.test_gap import simulated


def _noise_fitted(told: float) -> tuple[Fit, dict[str, float]]:
    """A drive whose receiver claims ``told`` times its velocity error."""
    drive = simulated({}, noise=0.2)
    fixes = replace(drive.fixes, sd_vel_ned=drive.fixes.sd_vel_ned * told)
    model = base_model()
    fit = fit_drive(open_drive(replace(drive, fixes=fixes), model.options), model)
    factors = fit_noise([fit])
    return fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit), dict(
        model.factors
    )


def test_a_receiver_better_than_the_models_floor_is_no_finding() -> None:
    # 1 cm/s, as it says itself; the model believes nobody below 3 cm/s
    fit, stated_factors = _noise_fitted(1.0)
    assert fit.model.factors["velocity_h"] < 0.6
    ratio = _floored([fit])
    assert ratio[2] == pytest.approx(3.0, rel=0.1)
    named = [f.effect for f in stochastic_findings(Levels([fit]), stated_factors, 0.0, ())]
    assert "gnss_noise_scale" not in named


def test_figures_above_the_floors_are_taken_as_they_are() -> None:
    fit, _ = _noise_fitted(20.0)
    np.testing.assert_allclose(_floored([fit]), 1.0, rtol=0.05)


@pytest.mark.parametrize(("claims", "wild"), [(1.0, True), (0.2, False)])
def test_fixes_are_wild_by_what_their_noise_turned_out_to_be(claims: float, wild: bool) -> None:
    drive = simulated({})
    lat, sd = drive.fixes.lat_rad.copy(), drive.fixes.sd_pos_ned * claims
    if wild:
        lat[50:60] += 60.0 / 6.37e6
    else:
        # noise all along, five times what is claimed
        rng = np.random.default_rng(2)
        lat += rng.standard_normal(len(lat)) * 5.0 * sd[:, 0] / 6.37e6
    drive = replace(drive, fixes=replace(drive.fixes, lat_rad=lat, sd_pos_ned=sd))
    model = base_model()
    before = open_drive(drive, model.options).n_outliers
    factors = dict(model.factors) | {"position_h": 20.0, "wander": 1.0}
    after = count_outliers(drive, model.options, factors)
    assert before > 0
    assert (after > 0) is wild


@pytest.mark.slow
@pytest.mark.parametrize(
    ("claims", "larger"), others_slow([(0.4, ("position_h", "position_v")), (1.0, ())])
)
def test_a_receivers_figure_is_of_its_whole_error(claims: float, larger: tuple[str, ...]) -> None:
    """How much of an error lasts is the model's guess: white levels of 1.2 and 3.0 times it are no
    fault of the figure, and its being too small is."""
    drive = simulated({})
    fixes = replace(drive.fixes, sd_pos_ned=drive.fixes.sd_pos_ned * claims)
    model = base_model()
    fit = fit_drive(open_drive(replace(drive, fixes=fixes), model.options), model)
    factors = fit_noise([fit])
    fit = fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit)
    told = {c.level: c.factor for c in noise_claims(Levels([fit]), model.factors)}
    assert {level for level in told if level.startswith("position")} == set(larger)
    for level in larger:
        # an error of minutes, which is most of it, has one value or two in a drive of two minutes
        assert 0.5 / claims < told[level] < 2.0 / claims


def _swaying(drive: GapDrive, sd: float, tau_s: float) -> GapDrive:
    """The body, and the sensors in it, turned about down by an angle that wanders, rad."""
    imu = drive.imu
    t = (imu.t_ns - imu.t_ns[0]) * 1e-9
    keep = np.exp(-np.median(np.diff(t)) / tau_s)
    drawn = np.random.default_rng(1).standard_normal(len(t)) * sd * np.sqrt(1.0 - keep**2)
    # no body jerks
    bell = np.hanning(30) / np.hanning(30).sum()
    angle = np.convolve(lfilter([1.0], [1.0, -keep], drawn), bell, "same")
    c, s = np.cos(angle), np.sin(angle)
    gyro, accel = (
        np.column_stack([c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0], v[:, 2]])
        for v in (imu.gyro, imu.accel)
    )
    gyro[:, 2] += np.gradient(angle, t)
    return replace(drive, imu=replace(imu, gyro=gyro, accel=accel))


@pytest.mark.slow
@pytest.mark.parametrize("noisy", others_slow([False, True]))
def test_a_body_that_sways_is_no_noise_of_the_sensors_in_it(noisy: bool) -> None:
    drive = simulated({})
    if noisy:
        noise = 0.04 * np.random.default_rng(2).standard_normal(drive.imu.gyro.shape)
        gyro = drive.imu.gyro + noise
        drive = replace(drive, imu=replace(drive.imu, gyro=gyro))
    else:
        drive = _swaying(drive, 0.02, 4.0)
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    factors = fit_noise([fit])
    # the level rises with either
    assert factors["gyro"] > 5.0
    fit = fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit)
    assert [c.level for c in noise_claims(Levels([fit]), model.factors)] == (
        ["gyro"] if noisy else []
    )


@pytest.mark.parametrize(
    ("offset", "told"), [(0.0, False), pytest.param(-0.06, True, marks=pytest.mark.slow)]
)
def test_speeds_that_are_all_too_low_are_no_silence(offset: float, told: bool) -> None:
    drive = simulated({})
    vel = drive.fixes.vel_ned.copy()
    speed = np.linalg.norm(vel[:, :2], axis=1)
    vel[:, :2] *= 1.0 + np.where(speed > 1.0, offset / np.maximum(speed, 1.0), 0.0)[:, None]
    drive = replace(drive, fixes=replace(drive.fixes, vel_ned=vel))
    model = base_model()
    fitted = Fitted(model, {}, (fit_drive(open_drive(drive, model.options), model),))
    fitted = with_noise(fitted, model.factors) if told else fitted
    (fit,) = fitted.fits
    candidates = dict.fromkeys(map(str, range(100)))
    found = SimpleNamespace(fitted=fitted, selection=SimpleNamespace(candidates=candidates))
    told_of = usual_finding(
        *("gnss_speed_offset", cast(Found, found), {}, (fit.opened,), (fit,), model.factors, 0.0)
    )
    assert (told_of is not None) is told
    if told_of is not None:
        finding, _ = told_of
        value = finding.parameters["along"]
        assert value.value == pytest.approx(offset, abs=3.0 * value.sd)
        assert ("cut off" in finding.resembles) is (offset < 0.0)


@pytest.mark.slow
def test_a_level_at_the_end_of_what_is_sought_has_no_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    true = 1.5e-3
    drive, model = simulated({}), base_model()
    imu = drive.imu
    steps = np.random.default_rng(3).standard_normal(imu.gyro.shape)
    steps *= true * np.sqrt(np.median(np.diff(imu.t_ns)) * 1e-9)
    drifting = replace(drive, imu=replace(imu, gyro=imu.gyro + np.cumsum(steps, axis=0)))
    fit = fit_drive(open_drive(drifting, model.options), model)
    factors = fit_noise([fit])
    fit = fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit)
    told = []
    for most in (LEVEL_RANGE, factors["gyro_bias_walk"]):
        monkeypatch.setitem(noise._LIMITS, "gyro_bias_walk", (1.0 / most, most))
        found = stochastic_findings(Levels([fit]), model.factors, 0.0, ())
        told.append({f.effect: f.parameters for f in found}["gyro_bias_walk"]["z"])
    free, held = told
    assert abs(free.value - true) < 2.0 * free.sd < true
    # each axis may have another than what all have together
    assert free.sd > ANISOTROPY * free.value
    assert str(held) == f"at least {free.value:.3g} rad/s/sqrt(s)"


@pytest.mark.parametrize(("nats", "climbs"), [(12.0, 0), (40.0, 1)])
def test_other_levels_are_moved_only_where_one_matters_as_they_are(
    nats: float, climbs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved: list[dict[str, float]] = []

    def loss(as_stated: dict[str, float]) -> float:
        moved.append(as_stated)
        return nats - 5.0

    levels: Any = SimpleNamespace(
        factors={"accel": 2.0}, score=lambda f: nats * (f["accel"] - 2.0), loss=loss
    )
    told = stochastic._worth(levels, {"accel": 1.0})
    assert len(moved) == climbs
    assert told == nats - 5.0 * climbs - OCCAM_NATS
