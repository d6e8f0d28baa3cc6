"""Velocity errors that last, and shocks: found where a drive has them, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.shocks import shock_noise
from automap.gap import GapDrive, base_model
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.noise_kinds import NoiseFit, fit_with_noise, with_noise_kinds, without_wander
from automap.records import FloatArray
from tests.unit.test_gap import simulated

STEP_S = 0.01
WANDER, LASTS_S = 0.08, 2.5
SHOCK = 6.0


def wandering(drive: GapDrive, rng: np.random.Generator) -> GapDrive:
    """The drive with velocities whose errors last for seconds."""
    velocity = drive.fixes.vel_ned.copy()
    keep = np.exp(-np.diff(drive.fixes.gps_s) / LASTS_S)
    error = rng.normal(0.0, WANDER, 3)
    for i in range(len(velocity)):
        if i:
            error = keep[i - 1] * error
            error += rng.normal(0.0, WANDER * np.sqrt(1.0 - keep[i - 1] ** 2), 3)
        velocity[i] += error
    return replace(drive, fixes=replace(drive.fixes, vel_ned=velocity))


def shaken(drive: GapDrive, rng: np.random.Generator) -> GapDrive:
    """The drive with a pothole every eight seconds."""
    accel, gyro = drive.imu.accel.copy(), drive.imu.gyro.copy()
    for begin in range(800, len(accel) - 100, 800):
        accel[begin : begin + 25] += rng.normal(0.0, SHOCK, (25, 3))
        gyro[begin : begin + 25] += rng.normal(0.0, 0.02 * SHOCK, (25, 3))
    return replace(drive, imu=replace(drive.imu, accel=accel, gyro=gyro))


def found(drive: GapDrive) -> tuple[NoiseFit, NoiseFit]:
    """Noise fitted without and with the kinds that the drive shows."""
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    usual = fit_with_noise([fit], model)
    return usual, with_noise_kinds(usual.fits, usual.model, lambda said: None)


def test_a_drive_with_usual_noise_gets_no_other_kind() -> None:
    _, kinds = found(simulated({}))
    assert kinds.model.options.velocity_wander_sd == 0.0
    assert not kinds.model.options.shocks


def test_velocity_errors_that_last_are_not_the_sensors_noise() -> None:
    usual, kinds = found(wandering(simulated({}), np.random.default_rng(5)))
    options, factors = kinds.model.options, kinds.model.factors
    size = options.velocity_wander_sd * factors["velocity_wander"]
    assert size == pytest.approx(WANDER, rel=0.35)
    assert 0.6 <= options.velocity_wander_tau_s <= 6.0
    assert kinds.score > usual.score + 30.0
    assert factors["accel"] < usual.model.factors["accel"]


def believed_to_wander(drive: GapDrive, effect: str) -> NoiseFit | None:
    """What is left of lasting velocity errors once an effect is a state."""
    model = base_model()
    options = replace(model.options, velocity_wander_sd=0.05)
    model = replace(model, options=options)
    accepted = {effect: 3.0}
    began = fit_with_noise([fit_drive(open_drive(drive, options), model)], model, accepted)
    return without_wander(began.fits, began.model, accepted, lambda said: None)


def test_velocity_errors_that_an_effect_makes_do_not_stay_noise() -> None:
    lag = {"gnss_velocity_lag": {"tau": 0.25}}
    left = believed_to_wander(simulated(lag), "gnss_velocity_lag")
    assert left is not None
    assert left.model.options.velocity_wander_sd == 0.0
    assert left.fits[0].value_of("gnss_velocity_lag")["tau"] == pytest.approx(0.25, abs=0.03)
    wander = wandering(simulated({}), np.random.default_rng(5))
    assert believed_to_wander(wander, "gnss_velocity_lag") is None


def test_shocks_do_not_make_the_sensors_noisy_everywhere() -> None:
    plain, _ = found(simulated({}))
    usual, kinds = found(shaken(simulated({}), np.random.default_rng(6)))
    assert kinds.model.options.shocks
    assert usual.model.factors["accel"] > 1.5 * plain.model.factors["accel"]
    assert kinds.model.factors["accel"] < 0.7 * usual.model.factors["accel"]
    assert kinds.score > usual.score + 30.0


def readings(rng: np.random.Generator) -> FloatArray:
    """A minute of a smooth motion with white noise, [n, 6]."""
    t = STEP_S * np.arange(6000)
    smooth = np.stack([np.sin((0.3 + 0.2 * i) * t) for i in range(6)], axis=1)
    noise = rng.normal(0.0, 1.0, (len(t), 6)) * [*[1e-3] * 3, *[0.05] * 3]
    return np.asarray(smooth + noise)


def test_even_noise_has_no_shocks() -> None:
    assert not shock_noise(readings(np.random.default_rng(1)), STEP_S).any()


def test_a_shock_adds_the_noise_that_it_has() -> None:
    rng = np.random.default_rng(2)
    rows = readings(rng)
    rows[3000:3050, 3:] += rng.normal(0.0, 2.0, (50, 3))
    noise = shock_noise(rows, STEP_S)
    assert noise[3010:3040, 0].mean() == pytest.approx(2.0**2 * STEP_S, rel=0.3)
    assert not noise[:2980].any()
    assert not noise[:, 1].any()


def test_too_few_readings_have_no_shocks() -> None:
    assert not shock_noise(np.ones((2, 6)), STEP_S).any()
