"""Lever arms where the gyro is noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap import base_model
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.noise import fitted_about, with_noise
from automap.gap.selection import Chosen
from tests.unit.gap_linear import screened
from tests.unit.gap_values import estimates, value_of
from tests.unit.test_gap import ARM, simulated

NOISE = 0.015
"""rad/s of a single reading, as of the cheapest gyros."""


@pytest.mark.slow
def test_noise_of_the_gyro_draws_no_arm_towards_nothing() -> None:
    """The stated arm, 1 m up, is right: what is found besides is nothing."""
    pulls, sizes = [], []
    for seed in range(3, 7):
        drive = simulated({}, seed)
        noise = np.random.default_rng(seed).normal(0.0, NOISE, drive.imu.gyro.shape)
        drive = replace(drive, imu=replace(drive.imu, gyro=drive.imu.gyro + noise))
        model = base_model()
        began = fit_drive(open_drive(drive, model.options), model)
        estimate = {"gnss_lever_arm": 3.0}
        (fit,) = with_noise(fitted_about(model, estimate, [began]), model.factors).fits
        value, sd = estimates(fit, "gnss_lever_arm")["z"]
        pulls.append(value / sd)
        sizes.append(sd)
    assert max(sizes) < 0.5 * abs(ARM[2])
    assert abs(np.mean(pulls)) < 1.8


def test_an_arm_to_the_side_is_no_roll_of_the_mounting() -> None:
    """Both move the antenna alike, but a sensor that leaned so would feel it in its weight."""
    drive = replace(simulated({}), lever_arm=ARM + np.array([0.0, 0.6, 0.0]))
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    selection = screened(fit, ["gnss_lever_arm", "imu_mounting"])
    moves = selection.best(Chosen())
    assert {m.name for m in moves if selection.holds(m)} == {"gnss_lever_arm"}
    (leaning,) = fitted_about(model, {"imu_mounting": 5.0}, [fit]).fits
    assert abs(value_of(leaning, "imu_mounting")["roll"]) < 0.06


def test_a_sensor_that_leans_is_told_by_its_weight() -> None:
    """Also where no arm would show it."""
    drive = simulated({"imu_mounting": {"roll": 0.15}})
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    selection = screened(fit, ["imu_mounting"])
    (move, *_) = selection.best(Chosen())
    assert selection.holds(move)
    (leaning,) = fitted_about(model, {"imu_mounting": 5.0}, [fit]).fits
    value, sd = estimates(leaning, "imu_mounting")["roll"]
    assert abs(value - 0.15) < 2.0 * sd < 0.06
