"""The new model as a file: which effects a run with it estimates."""

from __future__ import annotations

from dataclasses import replace

from automap.fusion.options import FusionOptions
from automap.gap import base_model
from automap.gap.fit import BASE_NUISANCES, GapModel, base_options
from pipeline.gap.model import _nuisances


def test_a_run_with_the_base_model_estimates_what_every_run_does() -> None:
    model = base_model(base_options(FusionOptions()))
    assert _nuisances(model, model.options.effects) == []


def test_effects_that_somebody_stated_are_stated_again() -> None:
    stated = replace(FusionOptions(), effects=("accel_bias", "gyro_bias", "gyro_scale"))
    model = base_model(base_options(stated, ("effects",)))
    (line,) = _nuisances(model, ["accel_bias", "gyro_scale"])
    assert line == 'effects = ["accel_bias", "gyro_scale"]'


def test_delays_that_an_ordinary_run_estimates_need_no_line() -> None:
    plain = replace(base_model().options, effects=BASE_NUISANCES)
    assert _nuisances(GapModel(plain), []) == []
    own = replace(plain, effects=(*BASE_NUISANCES, "gnss_course_latency"))
    assert _nuisances(GapModel(own), list(own.effects)) == []
    foreign = replace(plain, effects=(*BASE_NUISANCES, "accel_quadratic"))
    (line,) = _nuisances(GapModel(foreign), list(foreign.effects))
    assert "accel_quadratic" in line
