"""Formulas of several terms: which terms are chosen, how they are written and made effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.effects.user import add_user_effect
from automap.gap import base_model
from automap.gap.columns import Column, Inertial
from automap.gap.composite import (
    _backward,
    _forward,
    _joint,
    _sums,
    _Table,
    composite_for,
    slow_formulas,
)
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula import Formula
from automap.gap.formula_effect import coefficients, dismiss, effect_of, name_of
from automap.gap.whitening import WhiteRows
from automap.records import FloatArray
from tests.unit.test_gap import simulated

ROWS, NAMES = 4000, 40
SIZE = 0.008


def table_of(w: FloatArray, phi: FloatArray) -> _Table:
    """A drive of white rows with columns on one axis."""
    rows = WhiteRows(w, phi, np.linspace(0.0, 400.0, len(w)), np.zeros(len(w), np.int64))
    columns = tuple(
        Column("accel_x", f"q{i}", 1.0, (Inertial(1, 0, phi[:, i]),)) for i in range(phi.shape[1])
    )
    return _Table((rows,), (columns,), len(columns), np.ones(len(columns)))


def test_the_terms_that_act_are_chosen_and_no_others() -> None:
    rng = np.random.default_rng(2)
    phi = rng.standard_normal((ROWS, NAMES))
    w = 0.2 * phi[:, 7] - 0.15 * phi[:, 20] + 0.1 * phi[:, 31] + rng.standard_normal(ROWS)
    table = table_of(w, phi)
    sums = _sums(table)
    chosen = _backward(sums, table, _forward(sums, table))
    assert chosen == [7, 20, 31]
    assert _joint(sums, chosen, table).estimate == pytest.approx([0.2, -0.15, 0.1], abs=0.06)


def test_noise_has_no_terms() -> None:
    rng = np.random.default_rng(3)
    table = table_of(rng.standard_normal(ROWS), rng.standard_normal((ROWS, NAMES)))
    sums = _sums(table)
    assert _forward(sums, table) == []
    assert _backward(sums, table, []) == []


def test_a_term_that_two_others_replace_is_dropped() -> None:
    rng = np.random.default_rng(4)
    phi = rng.standard_normal((ROWS, NAMES))
    # the sum of both is what stands out first
    phi[:, 0] += phi[:, 1] + phi[:, 2]
    w = 0.2 * phi[:, 1] + 0.2 * phi[:, 2] + rng.standard_normal(ROWS)
    table = table_of(w, phi)
    sums = _sums(table)
    forward = _forward(sums, table)
    assert forward[0] == 0
    assert sorted(_backward(sums, table, forward)) == [1, 2]


@pytest.fixture(scope="module")
def crossed() -> Fit:
    """A drive whose gyros x and y feel the turn rate, with little drift allowed."""
    drive = simulated({})
    gyro = drive.imu.gyro.copy()
    gyro[:, 0] += SIZE * gyro[:, 2]
    gyro[:, 1] -= SIZE * gyro[:, 2]
    model = base_model()
    low = {**model.factors, "accel_bias_walk": 0.1, "gyro_bias_walk": 0.1}
    drive = replace(drive, imu=replace(drive.imu, gyro=gyro))
    return fit_drive(open_drive(drive, model.options), replace(model, factors=low))


@pytest.fixture(scope="module")
def formula(crossed: Fit) -> Formula:
    found = composite_for([crossed], ("gyro_misalignment",))
    assert found is not None
    return found


def test_an_effect_of_two_axes_is_a_formula_of_two_terms(formula: Formula) -> None:
    terms = {(t.channel, t.text): t.coefficient for t in formula.terms}
    assert terms[("gyro_x", "rate_z")] == pytest.approx(SIZE, rel=0.4)
    assert terms[("gyro_y", "rate_z")] == pytest.approx(-SIZE, rel=0.4)
    assert "gyro_x += k" in formula.equation
    assert "; " in formula.equation


def test_its_effect_has_a_parameter_a_term(formula: Formula) -> None:
    effect = effect_of(formula)
    assert effect is not None
    assert [p.name for p in effect.parameters] == list(formula.names)
    values = coefficients(formula)
    assert values["k"] == formula.coefficient
    assert list(values) == list(formula.names)


def test_terms_can_be_left_out(formula: Formula) -> None:
    second = formula.of_terms([1])
    assert second.equation == f"{formula.others[0].channel} += k * {formula.others[0].text}"
    assert second.coefficient == formula.others[0].coefficient
    assert second.spent == pytest.approx(formula.spent / len(formula.terms))


def test_a_dismissed_formula_is_no_effect_any_more(formula: Formula) -> None:
    effect = effect_of(formula)
    assert effect is not None
    add_user_effect(effect)
    assert name_of(formula) in CATALOGUE
    dismiss(formula)
    assert name_of(formula) not in CATALOGUE


def test_formulas_of_one_channel_keep_their_names_when_another_is_dismissed(
    formula: Formula,
) -> None:
    first, second = formula.of_terms([0]), replace(formula.of_terms([0]), text="speed")
    names = []
    for one in (first, second):
        effect = effect_of(one)
        assert effect is not None
        add_user_effect(effect)
        names.append(effect.name)
    assert len(set(names)) == 2
    dismiss(first)
    assert name_of(second) == names[1]
    dismiss(second)


def test_a_slow_quantity_on_all_axes_is_one_formula_and_paid_for_once() -> None:
    drive = simulated({})
    t = 1e-9 * (drive.imu.t_ns - drive.imu.t_ns[0])
    warming = np.exp(-t / (0.1 * t[-1]))[:, None] * [1e-3, -1.5e-3, 1e-3]
    drive = replace(drive, imu=replace(drive.imu, gyro=drive.imu.gyro + warming))
    model = base_model()
    low = {**model.factors, "accel_bias_walk": 0.1, "gyro_bias_walk": 0.1}
    fit = fit_drive(open_drive(drive, model.options), replace(model, factors=low))
    jumps, found = slow_formulas([fit], (), ["gyro"], [("gyro_z", "step(time - 31.25)")])["gyro"]
    assert [j.equation for j in jumps] == ["gyro_z += k * step(time - 31.25)"]
    texts = {term.text for formula in found for term in formula.terms}
    assert texts
    assert all("time" in text or "temperature" in text for text in texts)
    assert not any("step" in text or "speed" in text for text in texts)
    best = found[0]
    assert {term.channel for term in best.terms} <= {"gyro_x", "gyro_y", "gyro_z"}
    assert len({term.text for term in best.terms}) == 1
    assert "exp" in best.text
    assert best.nats > 20.0
    single = composite_for([fit], ())
    assert single is not None
    assert best.spent == pytest.approx(single.spent / len(single.terms), rel=0.01)
