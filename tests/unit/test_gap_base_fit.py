"""The base model of a search, and what of it the drives decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap import GapDrive, base_model
from automap.gap.base_fit import first_fit
from automap.gap.drive import open_drive
from automap.gap.noise_levels import Levels
from automap.gap.stochastic import noise_claims
from tests.unit.test_gap import simulated

SHOCK_M_S2, SHOCK_ROWS, SHOCKS = 4.0, 25, 20


def shaken(drive: GapDrive) -> GapDrive:
    """The drive over potholes: some quarters of a second in which forces scatter."""
    rng = np.random.default_rng(7)
    accel = drive.imu.accel.copy()
    for begin in rng.integers(0, len(accel) - SHOCK_ROWS, SHOCKS):
        accel[begin : begin + SHOCK_ROWS] += rng.normal(0.0, SHOCK_M_S2, (SHOCK_ROWS, 3))
    return replace(drive, imu=replace(drive.imu, accel=accel))


@pytest.mark.slow
@pytest.mark.parametrize("rough", [False, True])
def test_noise_of_shocks_is_not_that_of_the_whole_drive(rough: bool) -> None:
    drive, model = simulated({}), base_model()
    opened = open_drive(shaken(drive) if rough else drive, model.options)
    base = first_fit([opened], model, lambda said: None)
    assert base.model.options.shocks == rough
    # one level for all of the drive would be as large as the shocks are in the mean
    assert base.model.factors["accel"] < 2.0
    claims = noise_claims(Levels(base.fits, base.curvature), model.factors)
    assert [c.level for c in claims if c.condition] == (["accel"] if rough else [])
    if rough:
        (claim,) = claims
        step_s = float(np.median(np.diff(drive.imu.t_ns))) * 1e-9
        density = SHOCK_M_S2 * step_s**0.5
        assert claim.factor == pytest.approx(density / model.options.accel_noise, rel=0.4)
        assert claim.elsewhere == base.model.factors["accel"]
        # nothing is news that the model was given
        assert not noise_claims(Levels(base.fits), model.factors, stated_shocks=True)
