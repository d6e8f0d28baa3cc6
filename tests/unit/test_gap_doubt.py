"""What speaks for something like a name, but not for it, and what stands in no name."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.gap import base_model, limits
from automap.gap.candidates import Candidate
from automap.gap.doubt import (
    doubt,
    formula_in_place,
    in_noise,
    strongest_beside,
    suspected,
)
from automap.gap.linear import Column
from automap.gap.noise import Fitted
from automap.gap.result import Refused
from automap.gap.screening import Screening
from automap.gap.selection import Chosen, Selection
from automap.records import FloatArray
from tests.unit.gap_linear import PRIOR_SD, linear_of
from tests.unit.test_gap_naming import found_with

ROWS = 2400
LONG_S = 0.3
"""Rows so far apart make ten minutes, of which chance can tell."""
FORMULA = "accel_x += k * force_x^3"


def selection_of(phi: FloatArray, w: FloatArray) -> Selection:
    """A name, then a formula."""
    layout = [
        Column("accel_scale", "x", PRIOR_SD),
        Column(FORMULA, "k", PRIOR_SD, term=("accel_x", "force_x^3")),
    ]
    candidates = [
        Candidate("accel_scale", ((0,),), math.log(0.02)),
        Candidate(FORMULA, ((1,),), math.log(4e-4), terms=(("accel_x", "force_x^3"),)),
    ]
    return Selection(linear_of(phi, w, layout), {c.name: c for c in candidates})


NAMED = Chosen((("accel_scale", (0,), 1.0),))


@pytest.mark.parametrize("true", [0, 1])
def test_a_formula_that_explains_more_casts_doubt_on_a_name(true: int) -> None:
    rng = np.random.default_rng(4)
    phi = rng.standard_normal((ROWS, 2))
    # they share nine tenths
    phi[:, 1] = 0.95 * phi[:, 0] + 0.3 * phi[:, 1]
    selection = selection_of(phi, 0.15 * phi[:, true] + rng.standard_normal(ROWS))
    assert formula_in_place(selection, NAMED, "accel_scale") == (FORMULA if true else "")


def test_held_out_data_that_are_no_likelier_with_a_name_cast_doubt_on_it() -> None:
    rng = np.random.default_rng(0)
    phi = rng.standard_normal((ROWS, 2))
    selection = selection_of(phi, 0.3 * phi[:, 0] + rng.standard_normal(ROWS))
    assert doubt(selection, NAMED, "accel_scale", 3.0) == ""
    assert "held-out" in doubt(selection, NAMED, "accel_scale", -0.1)


def test_what_is_missing_is_told_without_a_name() -> None:
    missing = found_with({0: 0.3}, step_s=LONG_S)
    (told,) = suspected(strongest_beside(missing.selection, Chosen()))
    assert (told.kind, told.where) == ("like", "gyro_scale")
    assert told.p_value < limits.SUSPECTED
    assert suspected(strongest_beside(missing.selection, missing.chosen)) == ()


def test_what_was_looked_for_under_several_noises_is_the_likelier_by_chance() -> None:
    one = Refused("gyro_scale", 9.0, 0.006)
    other = Refused("accel_scale", 1.0, 0.7)
    assert [m.p_value for m in suspected([one])] == [0.006]
    assert suspected([one, other]) == ()
    (told,) = suspected([replace(one, p_value=0.004), other])
    assert told.p_value == 0.008


@pytest.mark.parametrize(("size", "told"), [(0.135, True), (0.0, False)])
def test_forms_of_one_thing_share_what_speaks_for_it(size: float, told: bool) -> None:
    rng = np.random.default_rng(5)
    one, noise = rng.standard_normal((2, ROWS))
    phi = 0.98 * one[:, None] + 0.2 * rng.standard_normal((ROWS, 12))
    texts = [f"tanh(force_x / {i + 1}.0)" for i in range(12)]
    terms = [("accel_x", text) for text in texts]
    layout = [Column(t, "k", PRIOR_SD, term=at) for t, at in zip(texts, terms, strict=True)]
    candidates = {
        text: Candidate(text, ((i,),), math.log(4e-4), terms=(terms[i],))
        for i, text in enumerate(texts)
    }
    selection = Selection(linear_of(phi, size * one + noise, layout), candidates)
    assert bool(selection.suspected(Chosen())) == told
    # no form is so sure by itself, and what is missing makes all that resemble it say too much
    assert not [m for m in selection.best(Chosen()) if m.odds > -math.log(limits.SUSPECTED)]
    selection.inflate(Chosen())
    assert (selection.inflated[False] > 2.0) == told


@pytest.mark.parametrize(
    ("level", "raised", "worth", "told"),
    [
        ("gyro_bias_walk", 6.0, 5.0, True),
        # drift explains it better than any candidate
        ("gyro_bias_walk", 6.0, 500.0, False),
        ("gyro_bias_walk", 1.2, 5.0, False),
        # a receiver's lasting errors are judged by evidence alone
        ("wander", 3.0, 500.0, True),
        # what does not last swallows nothing
        ("position_h", 3.0, 5.0, False),
    ],
)
def test_what_raised_noise_took_is_told_under_the_noise_as_stated(
    level: str, raised: float, worth: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = base_model()
    stated = dict(model.factors)
    louder = replace(model, factors={**stated, level: raised})
    missing = found_with({0: 0.3}, step_s=LONG_S)
    here = Fitted(louder, {}, ())
    nothing = replace(missing, chosen=Chosen(), fitted=here)
    monkeypatch.setattr("automap.gap.doubt.noise_score", lambda fits, f: worth * (f[level] > 1.0))
    monkeypatch.setattr("automap.gap.doubt.fitted_about", lambda model, *about: model)
    screening = SimpleNamespace(selection=lambda here, slow, may_act: missing.selection)
    looked = in_noise(nothing, cast(Screening, screening), stated)
    assert [one.where for one in suspected(looked)] == ["gyro_scale"] * told
    # whatever is looked at counts, likelier than its noise or not
    lasts = level != "position_h"
    assert len(looked) == (lasts and raised > limits.SCALE_FACTOR)
