"""What may be missing, and how likely each was before the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.effects.catalogue import alike_to_first_order
from automap.gap import limits
from automap.gap.candidates import Candidate, candidates_of, library
from automap.gap.linear import Column
from tests.unit.gap_linear import columns_named

NAMED = columns_named(
    "gyro_scale.x",
    "gyro_scale.y",
    "gyro_scale.z",
    "gnss_latency.s",
    "imu_clock_skew.skew",
    "imu_clock_skew.origin",
)
EFFECTS = ("gyro_scale", "gnss_latency", "imu_clock_skew")


def formula(number: int, choices: float = 1.0) -> Column:
    on, text = "accel_x", f"speed^{number}"
    return Column(f"{on} += k * {text}", "k", 0.1, term=(on, text), choices=choices)


def prior(candidate: Candidate) -> float:
    """Of a candidate by any one of its parts."""
    return float(np.exp(candidate.log_prior) * len(candidate.parts) * np.exp(candidate.log_choice))


@pytest.mark.parametrize(
    "formulas",
    [
        [],
        [formula(i) for i in range(2, 40)],
        [formula(i, 400.0) for i in range(2, 5)],
        [formula(2), formula(3), formula(4, 400.0), formula(5, 7.0)],
    ],
)
def test_priors_of_all_candidates_are_one_at_most(formulas: list[Column]) -> None:
    found = candidates_of([*NAMED, *formulas], EFFECTS)
    names = [c for c in found if not c.terms]
    others = [c for c in found if c.terms]
    assert len(names) == len(EFFECTS)
    assert len(others) == len(formulas)
    assert sum(map(prior, names)) == pytest.approx(1.0 - limits.OUTSIDE_LIBRARY)
    assert sum(map(prior, others)) <= limits.OUTSIDE_LIBRARY + 1e-12
    if all(c.choices == 1.0 for c in formulas) and formulas:
        assert sum(map(prior, others)) == pytest.approx(limits.OUTSIDE_LIBRARY)


def test_the_likeliest_of_many_has_the_prior_of_one_of_them() -> None:
    one, another = candidates_of([formula(2, 400.0), formula(3)], ())
    assert np.exp(one.log_prior) == pytest.approx(0.5 * limits.OUTSIDE_LIBRARY / 400.0)
    assert np.exp(another.log_prior) == pytest.approx(0.5 * limits.OUTSIDE_LIBRARY)


def test_parameters_of_an_effect_act_alone_and_terms_of_a_formula_together() -> None:
    wave = [
        Column("wave", name, 0.1, term=("gyro_z", f"{f}(2 * pi * time / 50)"))
        for name, f in (("k", "sin"), ("k2", "cos"))
    ]
    found = {c.name: c for c in candidates_of([*NAMED, *wave], EFFECTS)}
    assert found["gyro_scale"].parts == ((0,), (1,), (2,))
    assert found["gyro_scale"].log_choice == pytest.approx(-np.log(3.0))
    # what a clock was off by to begin with says nothing of its rate
    assert found["imu_clock_skew"].parts == ((4,),)
    assert found["imu_clock_skew"].beside == (5,)
    assert found["wave"].parts == ((6, 7),)
    assert found["wave"].terms == tuple(c.term for c in wave)
    assert found["gyro_scale"].terms == ()


def test_columns_may_come_in_any_order() -> None:
    layout = [NAMED[0], formula(2), NAMED[3], NAMED[1]]
    found = {c.name: c for c in candidates_of(layout, EFFECTS)}
    assert found["gyro_scale"].parts == ((0,), (3,))
    assert found["gnss_latency"].parts == ((2,),)


def test_late_fixes_have_a_sign_where_early_stamps_are_tried_too() -> None:
    twin = replace(NAMED[3], effect="imu_time_offset")
    both = {c.name: c for c in candidates_of([*NAMED, twin], (*EFFECTS, "imu_time_offset"))}
    assert both["gnss_latency"].positive
    assert both["imu_time_offset"].positive
    alone = {c.name: c for c in candidates_of(NAMED, EFFECTS)}
    assert not alone["gnss_latency"].positive
    assert not alone["gyro_scale"].positive
    slip = candidates_of(columns_named("vehicle_sideslip.coefficient"), ("vehicle_sideslip",))
    # no tyre slips inwards
    assert slip[0].positive


def test_what_the_model_has_is_not_missing_nor_what_acts_as_it_does() -> None:
    for one, other in alike_to_first_order():
        left = library(frozenset({one}), True, True)
        assert not {one, other} & set(left)
    assert {"gnss_latency", "imu_time_offset"} <= set(library(frozenset(), True, True))
    assert "accel_bias" not in library(frozenset({"accel_bias"}), True, True)


def test_wheels_and_earth_are_candidates_where_they_can_be() -> None:
    wheels = {name for name, e in CATALOGUE.items() if e.needs_wheels}
    assert wheels
    assert wheels & set(library(frozenset(), True, True))
    assert not wheels & set(library(frozenset(), False, True))
    assert "earth_rotation" in library(frozenset(), False, False)
    assert "earth_rotation" not in library(frozenset(), False, True)
    assert not any(CATALOGUE[e].nuisance for e in library(frozenset(), True, False))
