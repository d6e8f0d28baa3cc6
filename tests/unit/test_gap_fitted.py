"""Sets of effects as states of the filter, with the noise that suits them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.effects.terms import TRAVEL
from automap.gap import GapDrive, base_model
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.joint import combine
from automap.gap.noise import Fitted, fitted_about, noise_score, open_fits, with_noise
from tests.unit.gap_values import estimates
from tests.unit.test_gap import simulated

WANDER, LASTS_S = 0.08, 2.5


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


def quietly(said: str) -> None:
    pass


def fitted(drive: GapDrive, effect: str) -> Fitted:
    """A drive with an effect as a state, beside noise that was fitted without it."""
    model = base_model()
    plain = open_fits([open_drive(drive, model.options)], model, quietly)
    return with_noise(fitted_about(plain.model, {effect: 3.0}, plain.fits), model.factors)


def lasting_m_s(fitted: Fitted) -> float:
    """Size of velocity errors that last."""
    return fitted.model.options.velocity_wander_sd * fitted.model.factors["velocity_wander"]


@pytest.mark.slow
def test_velocity_errors_that_last_are_not_the_sensors_noise() -> None:
    model = base_model()
    without = replace(model, options=replace(model.options, velocity_wander_sd=0.0))
    drive = wandering(simulated({}), np.random.default_rng(5))
    quiet, found, deaf = (
        open_fits([open_drive(d, m.options)], m, quietly)
        for d, m in ((simulated({}), model), (drive, model), (drive, without))
    )
    assert lasting_m_s(quiet) < 0.3 * WANDER
    assert lasting_m_s(found) == pytest.approx(WANDER, rel=0.35)
    assert found.model.factors["accel"] < 0.5 * deaf.model.factors["accel"]


@pytest.mark.slow
def test_velocity_errors_that_an_effect_makes_do_not_stay_noise() -> None:
    found = fitted(simulated({"gnss_velocity_lag": {"tau": 0.25}}), "gnss_velocity_lag")
    assert lasting_m_s(found) < 0.3 * WANDER
    assert found.values()["gnss_velocity_lag"]["tau"] == pytest.approx(0.25, abs=0.03)


@pytest.mark.slow
def test_noise_that_was_left_with_drift_is_found_anew() -> None:
    model = base_model()
    opened = open_drive(simulated({"gyro_scale": {"z": 0.01}}), model.options)
    estimate = {"gyro_scale": 1.0}
    right = with_noise(
        Fitted(model, estimate, (fit_drive(opened, model, estimate),)), model.factors
    )
    drifting = dict(right.model.factors)
    for walk in ("accel_bias_walk", "gyro_bias_walk"):
        drifting[walk] *= 50.0
    left = fitted_about(replace(model, factors=drifting), estimate, right.fits)
    again = with_noise(left, model.factors)
    scores = [noise_score(right.fits, f.model.factors) for f in (left, again, right)]
    assert scores[0] < scores[2] - 5.0
    assert scores[1] > scores[2] - 2.0
    assert again.estimate == estimate


def test_values_of_several_drives_are_their_joint_estimate() -> None:
    model = base_model()
    opened = [open_drive(simulated({"gyro_scale": {"z": 0.01}}, s), model.options) for s in (3, 8)]
    fits = tuple(fit_drive(o, model, {"gyro_scale": 2.0}) for o in opened)
    found = Fitted(model, {"gyro_scale": 2.0}, fits)
    joint = combine(fits, [0.0, 0.0], 2.0 * np.array([0.01, 0.01, 0.01]))
    value, sd = joint.of("gyro_scale")["z"]
    assert found.values()["gyro_scale"]["z"] == pytest.approx(value, rel=0.05)
    assert abs(value - 0.01) < 4.0 * sd
    assert sd < min(estimates(f, "gyro_scale")["z"][1] for f in fits)


def test_the_filter_is_kept_whole_however_long_a_drive() -> None:
    model = base_model()
    opened = open_drive(simulated({}), model.options)
    in_sections = replace(opened, session=replace(opened.session, section_nodes=50))
    fit = fit_drive(in_sections, model)
    store = fit.last.forward.store
    assert len(fit.last.nodes.t) > 2 * in_sections.session.section_nodes
    assert len(store.gain) == len(store.nu)
    assert len(store.cov) == 1


def test_models_of_a_drive_share_its_readings_and_know_the_direction_of_travel() -> None:
    model = base_model()
    opened = open_drive(simulated({}), model.options)
    plain, warm = (fit_drive(opened, model, e) for e in ({}, {"accel_warm_up": 1.0}))
    one, other = (f.last.problem for f in (plain, warm))
    assert one.samples.raw is other.samples.raw
    # alone, and beside a term that asks for the drive's other quantities too
    assert other.samples.extra.shape[1] > one.samples.extra.shape[1]
    for name in TRAVEL:
        np.testing.assert_array_equal(one.users[name], other.users[name])
    assert len(plain.last.forward.store.cov) == 1
