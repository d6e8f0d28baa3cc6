"""The new model as a file: which effects a run with it estimates."""

from __future__ import annotations

from dataclasses import replace

from automap.fusion.options import FusionOptions
from automap.gap import base_model
from automap.gap.model import base_options
from pipeline.gap.model import _nuisances


def test_a_run_with_the_base_model_estimates_what_every_run_does() -> None:
    model = base_model(base_options(FusionOptions()))
    assert _nuisances(model, model.options.effects) == []


def test_effects_that_somebody_stated_are_stated_again() -> None:
    stated = replace(FusionOptions(), effects=("accel_bias", "gyro_bias", "gyro_scale"))
    model = base_model(base_options(stated, ("effects",)))
    (line,) = _nuisances(model, ["accel_bias", "gyro_scale"])
    assert line == 'effects = ["accel_bias", "gyro_scale"]'
