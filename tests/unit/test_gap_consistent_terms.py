"""Formulas that measurements bear out, and those that only the vehicle constraint shows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from automap.effects.user import set_user_effects
from automap.gap import base_model
from automap.gap.columns import node_motion
from automap.gap.dictionary import formula_columns, left_out_effect
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive, motion_of
from automap.gap.formula import screen_formulas
from automap.gap.formula_effect import consistent_terms, fit_as_effect
from automap.gap.search_state import State
from tests.unit.test_gap import simulated

ASYMMETRY = "accel_scale_asymmetry"


@pytest.fixture(autouse=True)
def no_formula_left() -> Iterator[None]:
    yield
    set_user_effects([])


def fitted(hidden: dict[str, Any], channel: str, text: str) -> State:
    """A drive with a formula as an effect."""
    model = base_model()
    opened = open_drive(simulated(hidden), model.options)
    fit = fit_drive(opened, model)
    found = screen_formulas([fit], {ASYMMETRY}, correct_overdispersion=False)
    formula = next(f for f in found if (f.channel, f.text) == (channel, text))
    state = State([opened], [], dict(model.factors), model, [fit], unexplained=formula)
    assert fit_as_effect(state)
    return state


def test_what_a_sensor_does_shows_without_the_constraint() -> None:
    state = fitted({ASYMMETRY: {"x": 0.03}}, "accel_x", "abs(force_x)")
    value = state.fits[0].value_of("formula_accel_x")["k"]
    assert value == pytest.approx(0.03, abs=0.01)
    assert consistent_terms(state) == [True]


def test_what_two_effects_make_up_is_no_formula() -> None:
    model = base_model()
    fit = fit_drive(open_drive(simulated({}), model.options), model)
    motion = motion_of(fit.last)
    at = node_motion(fit, motion)

    def one_sided(exclude: set[str]) -> bool:
        columns = formula_columns(fit, motion, at, exclude)
        return ("accel_x", "max(force_x, 0)") in {(c.effect, c.parameter) for c in columns}

    # a scale and its asymmetry
    assert not one_sided(set())
    assert one_sided({ASYMMETRY})
    # what no formula says is told as the effect that was left out
    told = {(c.effect, c.parameter) for c in formula_columns(fit, motion, at, {"imu_filter_delay"})}
    assert ("readings (imu_filter_delay)", "x") in told
    assert left_out_effect("readings (imu_filter_delay)") == "imu_filter_delay"
