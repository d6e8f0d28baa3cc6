"""Noise that is larger under a condition is told with it, and noise that is not is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap import base_model
from automap.gap.drive import GapDrive, open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.noise import fit_noise
from automap.gap.noise_conditions import Condition, conditional_noise
from automap.gap.noise_levels import Levels
from automap.gap.stochastic import noise_claims
from tests.unit.test_gap import simulated

ABOVE = 9.0


def shaken(seed: int, above: float) -> GapDrive:
    """A drive whose gyro is a hundred times noisier above a speed, m/s, by the fixes' speeds."""
    drive = simulated({}, seed=seed)
    fixes, imu = drive.fixes, drive.imu
    speed = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1])
    since = (imu.t_ns - imu.t_ns[0]) * 1e-9
    fast = np.interp(since, fixes.gps_s - fixes.gps_s[0], speed) > above
    noise = 0.04 * np.random.default_rng(seed).standard_normal(imu.gyro.shape)
    return replace(drive, imu=replace(imu, gyro=imu.gyro + noise * fast[:, None]))


def fitted(
    drive: GapDrive, factors: dict[str, float] | None = None
) -> tuple[Fit, dict[str, float]]:
    """The base model under the noise that suits a drive, or under that of another."""
    model = base_model()
    fit = fit_drive(open_drive(drive, model.options), model)
    factors = factors or fit_noise([fit])
    return fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit), factors


@pytest.mark.parametrize("above", [ABOVE, pytest.param(-1.0, marks=pytest.mark.slow)])
@pytest.mark.slow
def test_noise_above_a_speed_is_told_so(above: float) -> None:
    fit, factors = fitted(shaken(1, above))
    other, _ = fitted(shaken(8, above), factors)
    found = conditional_noise(Levels([fit]), [other])
    if above < 0.0:
        # it is as large everywhere
        assert found is None
        return
    assert found is not None
    assert (found.level, found.condition.quantity) == ("gyro", "speed")
    assert abs(found.condition.low - ABOVE) < 2.0
    assert found.inside > 4.0 * found.outside
    (claim,) = noise_claims(Levels([fit]), base_model().factors, [other])
    assert claim.level == "gyro"
    assert "at a speed above" in str(claim)


@pytest.mark.slow
def test_noise_that_a_held_out_drive_does_not_have_is_told_under_no_condition() -> None:
    fit, factors = fitted(shaken(1, ABOVE))
    quiet, _ = fitted(simulated({}, seed=8), factors)
    assert conditional_noise(Levels([fit]), [quiet]) is None


def test_conditions_are_told_in_words() -> None:
    inf = np.inf
    assert str(Condition("speed", 8.0, inf)) == "at a speed above 8 m/s"
    assert str(Condition("temperature", -inf, 30.0)) == "at a temperature below 30 deg C"
    assert str(Condition("turn", 0.1, 0.2)) == "at a turn rate of 0.1 to 0.2 rad/s"
