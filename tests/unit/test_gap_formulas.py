"""Formulas outside the library: what confirms them, and their instants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.layout import CH_NHC
from automap.gap import base_model
from automap.gap.columns import sensitivities
from automap.gap.dictionary import finer_texts, inertial_columns
from automap.gap.drive import open_drive
from automap.gap.evidence import Scores
from automap.gap.fit import Fit, fit_drive, motion_of
from automap.gap.formula import _conflict, refined, screen_formulas
from automap.gap.formula_trial import FORMULA_NATS, _different
from automap.gap.noise import fit_noise
from tests.unit.test_gap import simulated

STEP_AT_S = 47.0
SLIP_NATS = 400.0


@pytest.fixture(scope="module")
def stepped() -> Fit:
    """A drive whose lateral accelerometer jumps, with little drift allowed."""
    drive = simulated({})
    t = (drive.imu.t_ns - drive.imu.t_ns[0]) * 1e-9
    accel = drive.imu.accel.copy()
    accel[:, 1] += 0.1 * (t > STEP_AT_S)
    model = base_model()
    low = {**model.factors, "accel_bias_walk": 0.1, "gyro_bias_walk": 0.1}
    drive = replace(drive, imu=replace(drive.imu, accel=accel))
    return fit_drive(open_drive(drive, model.options), replace(model, factors=low))


def test_the_instant_of_a_step_is_found_between_those_of_the_dictionary(stepped: Fit) -> None:
    formulas = [
        f for f in screen_formulas([stepped], correct_overdispersion=False) if "step" in f.text
    ]
    best = formulas[0]
    assert best.channel == "accel_y"
    finer = refined([stepped], best, correct_overdispersion=False)
    assert finer.nats > best.nats
    told = float(finer.text.removeprefix("step(time - ").removesuffix(")"))
    assert told == pytest.approx(STEP_AT_S, abs=1.0)
    assert finer.coefficient == pytest.approx(0.1, abs=0.02)


def test_formulas_without_an_instant_stay_as_they_are(stepped: Fit) -> None:
    formula = next(f for f in screen_formulas([stepped]) if f.text == "speed^2")
    assert refined([stepped], formula) is formula
    assert finer_texts("tanh(rate_z / 0.01)", 100.0) == []


def test_one_of_each_shape_is_tried(stepped: Fit) -> None:
    chosen = _different(screen_formulas([stepped], correct_overdispersion=False))
    steps = [f for f in chosen if f.channel == "accel_y" and f.text.startswith("step")]
    assert len(chosen) == 4
    assert len(steps) == 1


def _one(score: float, info: float) -> Scores:
    none = np.zeros((0, 1))
    return Scores(np.array([score]), np.array([[info]]), none, none[:, :, None])


@pytest.mark.parametrize(
    ("constraint", "apart"), [(8.0, False), (0.0, False), (-300.0, True), (500.0, True)]
)
def test_the_vehicle_constraint_may_not_contradict_the_measurements(
    constraint: float, apart: bool
) -> None:
    # both with information 400: one sigma is 0.05, and measurements say 10 / 400
    measured = _one(10.0, 400.0)
    assert _conflict(measured + _one(constraint, 400.0), measured) is apart


def test_a_constraint_that_is_alone_contradicts_nobody() -> None:
    assert not _conflict(_one(500.0, 400.0), _one(0.0, 0.0))


def test_what_only_the_constraint_shows_is_no_sensor_formula(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the body slips to the outside of every bend by a little: no accelerometer does that
    model = base_model()
    fit = fit_drive(open_drive(simulated({}), model.options), model)
    factors = fit_noise([fit])
    fit = fit_drive(fit.opened, replace(model, factors=factors), linearised_at=fit)
    motion = motion_of(fit.last)
    column = inertial_columns(fit, motion, "accel_y", ["tanh(rate_z / 0.01)"])
    phi = sensitivities(fit, motion, column)[:, 0]
    store = fit.last.forward.store
    constraint = store.info[:, 1] == CH_NHC
    size = np.sqrt(2.0 * SLIP_NATS / float((phi[constraint] ** 2).sum()))
    nu = store.nu + np.where(constraint, size * phi * np.sqrt(store.var), 0.0)
    forward = replace(fit.last.forward, store=store._replace(nu=nu))
    slipping = replace(fit, last=replace(fit.last, forward=forward))

    def strongest() -> float:
        return max(f.nats for f in screen_formulas([slipping]) if f.channel == "accel_y")

    assert strongest() < FORMULA_NATS
    # the constraint alone would show one
    monkeypatch.setattr("automap.gap.formula.CONFLICT", np.inf)
    assert strongest() > FORMULA_NATS
