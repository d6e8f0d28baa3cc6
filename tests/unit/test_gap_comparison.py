"""Names and formulas are compared under noise that suits both."""

from __future__ import annotations

from dataclasses import replace

import pytest

from automap.gap import base_model
from automap.gap.comparison import take_formulas_noise
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.scoring import log_likelihood_ratio
from automap.gap.search_state import State, fit_all
from tests.unit.test_gap import simulated


def nobody(said: str) -> None:
    pass


@pytest.fixture(scope="module")
def named() -> State:
    """A name, and the noise that the drive has."""
    model = base_model()
    opened = open_drive(simulated({"gyro_scale": {"z": 0.01}}), model.options)
    accepted = {"gyro_scale": 1.0}
    fit = fit_drive(opened, model, accepted)
    return State([opened], [], dict(model.factors), model, [fit], accepted=accepted)


def with_drift(state: State, factor: float) -> State:
    walks = {w: factor * state.model.factors[w] for w in ("accel_bias_walk", "gyro_bias_walk")}
    model = replace(state.model, factors={**state.model.factors, **walks})
    return replace(state, model=model, fits=fit_all(state, model, state.accepted))


def test_names_that_were_left_with_drift_take_the_noise_that_suits(named: State) -> None:
    drifting = with_drift(named, 300.0)
    before = drifting.fits
    assert take_formulas_noise(drifting, named, nobody)
    assert drifting.model.factors == named.model.factors
    assert list(drifting.accepted) == ["gyro_scale"]
    assert log_likelihood_ratio(drifting.fits, before) > 0.0


def test_names_keep_the_noise_that_suits_them(named: State) -> None:
    own = replace(named)
    assert not take_formulas_noise(own, with_drift(named, 300.0), nobody)
    assert own.model.factors == named.model.factors
    assert own.fits is named.fits
