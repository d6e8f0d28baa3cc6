"""The new model as a file: which effects a run with it estimates."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from automap.effects import CATALOGUE
from automap.fusion.options import FusionOptions
from automap.gap import Finding, GapResult, ParameterValue, base_model
from automap.gap.fit import BASE_NUISANCES, GapModel, base_options
from automap.gap.receivers import values_for_runs
from pipeline.gap.command import as_json
from pipeline.gap.model import _nuisances, left_to_runs, model_toml
from pipeline.gap.words import in_words
from pipeline.settings.effects import EffectsSettings


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


def named(effect: str, *confusable: str) -> GapResult:
    """A search on a model in which nothing was stated that found one effect."""
    base = base_model(base_options(FusionOptions()))
    known = CATALOGUE[effect].parameters
    values = {p.name: ParameterValue(0.001, 1e-4, p.unit) for p in known}
    finding = Finding(effect, values, 20.0, 1e-6, 1.0, 0.5, confusable)
    model = replace(base, values={effect: {p.name: 0.001 for p in known}})
    return GapResult(1.0, 0.5, (), (finding,), {}, (), "one", model, base)


@pytest.mark.parametrize(
    ("effect", "confusable", "instead"),
    [
        ("gyro_g_sensitivity", ("accel_scale", "gyro_dead_zone"), ("accel_scale",)),
        ("gyro_g_sensitivity", ("gyro_dead_zone",), ()),
        ("gyro_g_sensitivity", (), ()),
        # what a run estimates is better known from here
        ("gyro_scale", ("accel_scale", "gyro_g_sensitivity"), ()),
        # two names of one thing
        ("gnss_velocity_lag", ("gnss_velocity_latency",), ()),
    ],
)
def test_what_may_be_another_that_every_run_estimates_is_told_and_not_written(
    effect: str, confusable: tuple[str, ...], instead: tuple[str, ...], tmp_path: Path
) -> None:
    result = named(effect, *confusable)
    assert left_to_runs(result) == ({effect: instead} if instead else {})
    text = model_toml(result, [], EffectsSettings(), tmp_path)
    assert (f"[fuse.fixed.{effect}]" in text) == (not instead)
    assert (f"# {effect} is left out" in text) == bool(instead)
    assert as_json(result)["left_to_runs"].get(effect, []) == list(instead)
    assert any("model.toml is without it" in words for _, words in in_words(result)) == bool(
        instead
    )


def test_a_run_that_estimates_less_is_no_reason_to_leave_something_out() -> None:
    result = named("gyro_g_sensitivity", "accel_scale")
    few = replace(result.model.options, effects=("accel_bias", "gyro_bias"))
    assert left_to_runs(replace(result, model=replace(result.model, options=few))) == {}


def test_a_distance_that_every_search_estimates_is_written_where_it_is_a_finding(
    tmp_path: Path,
) -> None:
    result = named("gnss_course_distance", "gnss_lever_arm")
    (finding,) = result.findings
    carried = replace(result.model, values=values_for_runs([finding]))
    text = model_toml(replace(result, model=carried), [], EffectsSettings(), tmp_path)
    assert "[fuse.fixed.gnss_course_distance]\nm = 0.001\n" in text
    # how speeds are cut off is a receiver's way, and no value for a run
    assert (
        values_for_runs([replace(finding, effect="gnss_speed_offset")]) == values_for_runs([]) == {}
    )
    fixed = replace(FusionOptions(), fixed=carried.values)
    assert base_model(base_options(fixed)).values == carried.values


def test_levels_of_noise_are_where_a_run_begins_to_look_for_its_own(tmp_path: Path) -> None:
    result = named("gyro_g_sensitivity")
    louder = replace(result.model, factors={**result.model.factors, "velocity_h": 2.5})
    text = model_toml(replace(result, model=louder), [], EffectsSettings(), tmp_path)
    fuse = tomllib.loads(text)["fuse"]
    assert fuse["factors"]["velocity_h"] == 2.5
    assert fuse.get("adapt", FusionOptions().adapt)
