"""What is told of a search: names, what else they may be, and the sentence above it all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.candidates import candidates_of
from automap.gap.confirm import Confirmed
from automap.gap.doubt import doubts, strongest_refused, suspected
from automap.gap.evidence import shown_by
from automap.gap.fit import Values, base_model
from automap.gap.found import Found
from automap.gap.joint import Joint
from automap.gap.linear import Column, Given, conditional
from automap.gap.misfit import Misfit
from automap.gap.naming import chance, describe, verdict
from automap.gap.noise import Fitted
from automap.gap.result import (
    BODY,
    STRETCHED,
    Finding,
    KeptOut,
    NoiseClaim,
    Refused,
    Term,
    Unexplained,
)
from automap.gap.selection import Chosen, Selection
from automap.gap.stepwise import select
from automap.records import FloatArray
from tests.unit.gap_linear import STEP_S, columns_named, linear_of

NAMED = (
    "gyro_scale.x",
    "gyro_scale.y",
    "gyro_scale.z",
    "gnss_latency.s",
    "imu_time_offset.s",
    "accel_scale.x",
)
FORMULA = ("accel_x", "speed")
ROWS = 2000
STRETCH = round(limits.BLOCKS_S[0] / STEP_S)
VALUES = {"gyro_scale": {"z": 0.3}, "gnss_latency": {"s": 0.25}, "formula_accel_x": {"k": -0.2}}


class Told(Fitted):
    """A fitted set whose estimate is given."""

    def joint(self) -> Joint:
        names = (("formula_accel_x", "k"),)
        return Joint(names, np.array([-0.21]), np.array([[0.02**2]]), 0.0)


def found_with(
    sizes: Mapping[int, float],
    alike: tuple[int, int, float] | None = None,
    not_told_apart: Mapping[str, tuple[str, ...]] | None = None,
    varying: float = 0.0,
    step_s: float = STEP_S,
) -> Found:
    """Where a search on made-up rows ended, ``step_s`` apart, with columns of these sizes missing,
    which vary by so much from one stretch of ``STRETCH`` rows to another; the second of two that
    are ``alike`` is the first and so much of its own."""
    rng = np.random.default_rng(1)
    layout = [*columns_named(*NAMED), Column("accel_x += k * speed", "k", 0.5, term=FORMULA)]
    phi = rng.standard_normal((ROWS, len(layout)))
    if alike is not None:
        one, other, own = alike
        phi[:, other] = phi[:, one] + own * phi[:, other]
    w: FloatArray = rng.standard_normal(ROWS)
    for i, size in sizes.items():
        here = rng.normal(size, varying, ROWS // STRETCH + 1)
        w = w + np.repeat(here, STRETCH)[:ROWS] * phi[:, i]
    candidates = candidates_of(layout, [n.split(".")[0] for n in NAMED])
    selection = Selection(linear_of(phi, w, layout, step_s), {c.name: c for c in candidates})
    chosen = select(selection, Chosen(), limits.MAX_FINDINGS)
    names = (("gyro_scale", "x"), ("gyro_scale", "y"), ("gyro_scale", "z"), ("gnss_latency", "s"))
    full = Joint(names, np.array([0.0, 0.01, 0.3, 0.25]), np.diag([0.02**2] * 4), 0.0)
    fitted = Told(base_model(), {}, ())
    effects = {n: n for n in chosen.names} | {"accel_x += k * speed": "formula_accel_x"}
    alike_names = not_told_apart or {}
    stands = Confirmed(dict(VALUES), ())
    return Found(fitted, fitted, full, selection, chosen, effects, alike_names, stands, selection)


def told_of(found: Found, values: Values) -> list[Finding | Unexplained]:
    return describe(found, values, chance(found), {}, doubts(found, values, {}))


def test_findings_come_with_all_parameters_and_the_surest_first() -> None:
    told = told_of(found_with({2: 0.3, 3: 0.22, 6: -0.2}), VALUES)
    assert [t.effect for t in told] == ["gyro_scale", "gnss_latency", "formula_accel_x"]
    scale, latency, formula = told
    assert isinstance(scale, Finding)
    assert list(scale.parameters) == ["x", "y", "z"]
    z = scale.parameters["z"]
    assert z.value == pytest.approx(0.3)
    # what chance makes of the scatter of white rows
    assert 0.02 <= z.sd < 0.026
    assert scale.evidence_nats > latency.evidence_nats > 20.0
    assert scale.p_value < 1e-6
    assert scale.confusable_with == ()
    assert isinstance(latency, Finding)
    # stamps that are early do the same
    assert latency.confusable_with == ("imu_time_offset",)
    assert "tap the IMU" in latency.advice
    assert isinstance(formula, Unexplained)
    assert (formula.channel, formula.formula) == ("accel_x", "accel_x += k * speed")
    (term,) = formula.terms
    assert (term.channel, term.text) == FORMULA
    assert term.coefficient == pytest.approx(-0.21)
    assert 0.02 <= term.sd < 0.026
    assert formula.resembles is None


def test_what_varies_from_stretch_to_stretch_is_known_less_well() -> None:
    # 80 rows of a stretch tell a size to 0.11: the score scatters 14 times as much as it should,
    # give or take half of it in 25 stretches, and twelve that are as they should be take some off
    (told,) = told_of(found_with({2: 0.5}, varying=0.4), VALUES)
    assert isinstance(told, Finding)
    assert 0.02 * 4.0**0.5 < told.parameters["z"].sd < 0.02 * 14.0**0.5


@pytest.mark.parametrize("constant", [0.0, 0.4])
@pytest.mark.parametrize("rate", [0.0, 0.5])
def test_a_drift_and_the_constant_at_its_beginning_are_told_each_by_its_own_evidence(
    constant: float, rate: float
) -> None:
    rng = np.random.default_rng(4)
    acts, grown = rng.standard_normal(ROWS), np.linspace(0.0, 1.0, ROWS)
    layout = columns_named(
        *("imu_clock_skew.skew", "imu_clock_skew.origin", "imu_time_offset.s", "gyro_scale.x")
    )
    phi = np.column_stack([grown * acts, acts, acts, rng.standard_normal(ROWS)])
    w = (rate * grown + constant) * acts + rng.standard_normal(ROWS)
    candidates = candidates_of(layout, ["imu_clock_skew", "imu_time_offset", "gyro_scale"])
    selection = Selection(linear_of(phi, w, layout), {c.name: c for c in candidates})
    # what is weak beside the strongest waits for a round
    chosen = select(selection, select(selection, Chosen(), 3), 3)
    true = {"imu_clock_skew": {"skew": rate}, "imu_time_offset": {"s": constant}}
    there = {name: value for name, value in true.items() if any(value.values())}
    assert set(chosen.names) == set(there)
    names = (("imu_clock_skew", "skew"), ("imu_time_offset", "s"))
    full = Joint(names, np.array([rate, constant]), np.eye(2) * 0.08**2, 0.0)
    fitted, effects = Told(base_model(), {}, ()), {n: n for n in chosen.names}
    stands = Confirmed({}, ())
    found = Found(fitted, fitted, full, selection, chosen, effects, {}, stands, selection)
    told = told_of(found, there)
    for one in told:
        assert isinstance(one, Finding)
        assert one.confusable_with == ()
        # sigmas of a drift about a free constant, and of a constant about a free drift, of which
        # the one is a quarter of what either shows alone
        shows = 0.25 if len(told) == 2 or one.effect == "imu_clock_skew" else 1.0
        size = next(iter(there[one.effect].values())) ** 2 * ROWS * shows
        size *= np.mean(grown**2) if one.effect == "imu_clock_skew" else 1.0
        assert one.evidence_nats == pytest.approx(0.5 * size, abs=5.0 + 2.0 * size**0.5)


def test_what_held_out_data_refused_is_not_told() -> None:
    told = told_of(found_with({2: 0.3, 3: 0.22}), {"gnss_latency": {"s": 0.25}})
    assert [t.effect for t in told] == ["gnss_latency"]


def test_names_that_a_linear_model_cannot_tell_apart_are_told_with_each_other() -> None:
    (told,) = told_of(found_with({2: 0.3}, alike=(2, 5, 0.12)), VALUES)
    assert isinstance(told, Finding)
    assert told.effect == "gyro_scale"
    assert "accel_scale" in told.confusable_with


def test_names_that_the_filter_could_not_tell_apart_are_told_too() -> None:
    (told,) = told_of(found_with({2: 0.3}, not_told_apart={"gyro_scale": ("accel_scale",)}), VALUES)
    assert isinstance(told, Finding)
    assert told.confusable_with == ("accel_scale",)


def test_a_formula_says_which_name_it_resembles() -> None:
    (told,) = told_of(found_with({6: -0.3}, alike=(6, 5, 0.4)), VALUES)
    assert isinstance(told, Unexplained)
    assert told.resembles == "accel_scale"


def test_the_strongest_that_is_not_named_is_told_with_its_chance() -> None:
    known = found_with({2: 0.3})
    (one,) = strongest_refused(known)
    assert one.effect not in ("gyro_scale",)
    assert one.p_value > 0.01
    assert one.evidence_nats < limits.LEAST_ODDS


FINDING = Finding("gyro_scale", {}, 50.0, 1e-9, 1.0, 0.2)
SPEED = Unexplained("accel_x", "accel_x += k * speed", 0.2, 0.01, 40.0, 1e-8)
MISFIT = Misfit("velocity_n", "band", "periods of 20 to 40 s", 3.0, 1e-6)


def test_the_verdict_says_all_that_is_missing() -> None:
    quiet = verdict([], [], [], 0.1, 0.1)
    assert quiet.startswith("nothing is missing")
    text = verdict([FINDING], [SPEED], [], 1.0, 0.2)
    assert "missing from the model: gyro_scale" in text
    assert "accel_x += k * speed with k = 0.2 ± 0.01 (40 nats)" in text
    assert "falls from 1 to 0.2" in text
    assert "resembles" not in text
    named = Unexplained(*("accel_x", "f", 0.2, 0.01, 40.0, 1e-8), resembles="accel_scale")
    assert "which resembles accel_scale" in verdict([], [named], [], 1.0, 0.2)


def test_the_verdict_says_what_is_the_same_in_another_channel() -> None:
    long = Finding("gnss_velocity_scale", {}, 50.0, 1e-9, 1.0, 0.2)
    text = verdict([long, FINDING], [SPEED], [], 1.0, 0.2)
    assert f"gnss_velocity_scale (or {STRETCHED}), gyro_scale;" in text
    leans = (Term("imu_pitch", "speed^2", 1e-4, 1e-5),)
    lifts = Unexplained(*("imu_pitch", "f", 1e-4, 1e-5, 40.0, 1e-8), terms=leans)
    assert f"(40 nats), or {BODY}" in verdict([], [lifts], [], 1.0, 0.2)


def test_what_only_fitted_data_show_is_no_silence() -> None:
    text = verdict([], [], [], 0.1, 0.1, (KeptOut("gyro_dead_zone", False, 97.0),))
    assert text.startswith("nothing that held-out data bear out")
    assert "fitted data speak for it and the held-out data against: gyro_dead_zone" in text
    # a receiver's delay that each drive has its own of is told as such
    own = (KeptOut("gnss_latency", False, 9.0, each_drive=True),)
    assert verdict([], [], [], 0.1, 0.1, own) == verdict([], [], [], 0.1, 0.1)


def test_noise_that_is_not_as_stated_is_no_silence() -> None:
    claim = NoiseClaim("gyro", 5.4, 57.0, 1e-20)
    text = verdict([], [], [], 0.1, 0.1, claims=(claim,))
    assert "nothing is missing" not in text
    assert "gyro 5.4 times (57 nats)" in text
    # beside a finding the pages list it
    assert "5.4" not in verdict([FINDING], [], [], 1.0, 0.2, claims=(claim,))


def test_a_misfit_is_no_silence() -> None:
    alone = verdict([], [], [MISFIT], 0.1, 0.1)
    assert "nothing" not in alone
    assert "something is missing that no candidate explains" in alone
    assert "velocity n scatters 3 times as much as modelled at periods of 20 to 40 s" in alone
    more = verdict([FINDING], [], [MISFIT] * 3, 1.0, 0.2)
    assert "something is also missing" in more
    assert "and 2 more" in more


def test_coefficients_of_several_terms_have_their_names() -> None:
    terms = (Term("gyro_x", "rate_z", 0.01, 0.001), Term("gyro_y", "rate_z", -0.008, 0.001))
    two = Unexplained("gyro_x", "f", 0.01, 0.001, 40.0, 1e-8, terms=terms)
    assert two.numbers == "k = 0.01 ± 0.001, k2 = -0.008 ± 0.001"


def test_a_candidate_that_is_no_chance_and_yet_not_named_is_no_silence() -> None:
    weak = Refused("accel_x += k * speed", 6.0, 1e-5, CHANNELS.index("velocity_n"), 1.2)
    assert suspected([Refused("gyro_scale", 3.0, 0.2)]) == ()
    (one,) = suspected([weak])
    assert (one.channel, one.where, one.size, one.p_value) == (
        "velocity_n",
        "accel_x += k * speed",
        1.2,
        1e-5,
    )
    text = verdict([], [], [one], 0.1, 0.1)
    assert "nothing" not in text
    assert "velocity n follows what accel_x += k * speed would do" in text
    assert "scatters" not in text


def test_where_a_candidate_shows_is_told() -> None:
    rng = np.random.default_rng(1)
    phi, w = rng.standard_normal((4000, 4)), rng.standard_normal(4000)
    channel = np.arange(4000) % 2
    phi[:, 2] *= channel == 1
    linear = linear_of(phi, w + 0.3 * phi[:, 2], columns_named(*(f"e{i}.p" for i in range(4))))
    rows = (replace(linear.rows[0], channel=channel),)
    known = conditional(replace(linear, rows=rows), Given())
    shown, size = shown_by(known, (2,))
    assert shown == 1
    assert size == pytest.approx(1.0 + 3 * 0.09, rel=0.2)
