"""A made-up effect on a measurement is one line: simulator, run and gap finder take it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from automap.effects.user import set_user_effects
from automap.effects.user_tables import effects_of_formulas
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import DEFAULT_EFFECTS, FusionOptions
from automap.fusion.result import Prior
from automap.gap import base_model
from automap.gap.candidates import library
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.selection import Chosen
from tests.slow_cases import others_slow
from tests.unit.gap_linear import screened
from tests.unit.test_gap import simulated

MADE_UP = {
    # longer the faster: longer by one share is an effect of the catalogue
    "stretched": ({"on": "velocity_along", "formula": "speed^2 / 10", "prior_sd": 0.05}, 0.03),
    "side_wind": ({"on": "nhc_y", "formula": "speed * sin(heading)", "prior_sd": 0.02}, 0.015),
    "lifted": ({"on": "height", "formula": "speed^2 / 100", "prior_sd": 1.0}, 3.0),
}


@pytest.fixture(autouse=True)
def no_effects_stay() -> Iterator[None]:
    yield
    set_user_effects([])


@pytest.mark.slow
@pytest.mark.parametrize("name", others_slow(MADE_UP))
def test_a_made_up_effect_is_simulated_estimated_and_named(name: str) -> None:
    table, size = MADE_UP[name]
    set_user_effects(effects_of_formulas({name: {"k": table}}, "mine.toml"))
    drive = simulated({name: {"k": size}})
    options = FusionOptions(effects=(*DEFAULT_EFFECTS, name))
    run = fuse_imu_gnss(
        drive.imu, drive.fixes, drive.clock, options, Prior(0.0, 0.1), drive.lever_arm
    )
    column = run.parameters.names.index(f"{name}_k")
    value, sd = run.parameters.values[-1, column], run.parameters.sd[-1, column]
    assert abs(value - size) < 4.0 * sd
    assert sd < 0.3 * size
    model = base_model()
    plain = fit_drive(open_drive(drive, model.options), model)
    names = library(model.included, has_wheels=False, earth_on=True)
    first = screened(plain, names).best(Chosen())[0]
    assert first.name == name
    assert first.evidence.nats > 7.0
