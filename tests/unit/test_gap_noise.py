"""Noise levels by the exact slopes of the likelihood."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.levels import ALL_LEVELS
from automap.gap import base_model
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.noise import fit_noise, noise_score, noise_slopes
from tests.unit.test_gap import simulated

STEP = 1e-3


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["white", "wandering"])
def ungated(request: pytest.FixtureRequest) -> Fit:
    """A drive whose every measurement counts in full: trust by surprise has no slope."""
    from dataclasses import replace

    model = base_model()
    options = replace(model.options, gate_probability=1e-12, velocity_wander_sd=request.param)
    model = replace(model, options=options)
    return fit_drive(open_drive(simulated({}), model.options), model)


@pytest.mark.parametrize("off", [1.0, 1.7])
def test_slopes_are_those_of_the_likelihood(ungated: Fit, off: float) -> None:
    factors = {k: v * off for k, v in ungated.model.factors.items()}
    here = noise_slopes([ungated], factors)
    score, slope, info = here.score, here.slope, here.info
    assert score == pytest.approx(noise_score([ungated], factors), rel=1e-9)
    assert (info >= 0.0).all()
    for i, level in enumerate(ALL_LEVELS):
        if level == "wander_tau":
            continue
        ends = [
            noise_score([ungated], factors | {level: factors[level] * float(np.exp(s * STEP))})
            for s in (1.0, -1.0)
        ]
        numeric = (ends[0] - ends[1]) / (2.0 * STEP)
        # forces within an interval are taken as constant
        assert slope[i] == pytest.approx(numeric, rel=0.03, abs=0.05), level


def test_the_climb_ends_where_no_level_wants_to_move(ungated: Fit) -> None:
    start = dict(ungated.model.factors)
    found = fit_noise([ungated])
    assert noise_score([ungated], found) > noise_score([ungated], start)
    there = noise_slopes([ungated], found)
    slope, info = there.slope, there.info
    for i, level in enumerate(ALL_LEVELS):
        inside = 0.21 < found[level] < 60.0 and not (level == "nhc_z" and found[level] < 1.01)
        if inside and level != "wander_tau":
            # nats by a factor of e: what is left to gain is less than one
            assert abs(slope[i]) < 2.0 + np.sqrt(max(info[i], 0.0)), level


def test_levels_that_may_not_move_stay(ungated: Fit) -> None:
    start = dict(ungated.model.factors)
    found = fit_noise([ungated], ("accel", "gyro"))
    assert {k: v for k, v in found.items() if k not in ("accel", "gyro")} == {
        k: v for k, v in start.items() if k not in ("accel", "gyro")
    }
