"""What gap.html says in words: each effect, how sure, what it costs, what is left."""

from __future__ import annotations

import math
from typing import Any

import pytest

from automap.effects import CATALOGUE
from automap.gap import Finding, GapResult, Unexplained, base_model
from automap.gap.misfit import Misfit
from automap.gap.result import (
    STRETCHED,
    Cost,
    Drift,
    Extent,
    HeldPositions,
    KeptOut,
    NoiseClaim,
    ParameterValue,
    Refused,
)
from automap.gap.stochastic import FIGURES, SENSOR_LEVELS
from pipeline.gap.command import as_json
from pipeline.gap.effect_sentences import SENTENCES
from pipeline.gap.effect_words import what_is_wrong
from pipeline.gap.remedies import TAKE_MODEL, remedy
from pipeline.gap.report import gap_report
from pipeline.gap.sizes import about, with_sd
from pipeline.gap.words import LEVELS, cost_words, finding_words, how_sure, in_words, position_words

COST = Cost(Extent(0.32, 0.61), Extent(0.0, 0.0004), Extent(2e-3, 4e-3), Extent(1e-3, 2e-3))


@pytest.mark.parametrize("sure", [True, False])
def test_a_value_that_changes_is_told_by_how_much(sure: bool) -> None:
    drift = Drift(*("yaw", "trend", -0.01, 0.001, "rad", "time", 0.0, "over the drive", 40.0, sure))
    parameters = {"yaw": ParameterValue(0.01, 0.001, "rad")}
    one = Finding("imu_mounting", parameters, 60.0, 1e-20, 1.0, 0.5, (), "", str(drift), drift)
    _, text = finding_words(one, None)
    assert ("It is not constant" in text) is sure
    assert "its yaw falls by 0.57° (give or take 0.06°) over the drive" in text


def finding(effect: str, sd_share: float = 0.1, **values: float) -> Finding:
    units = {p.name: p.unit for p in CATALOGUE[effect].parameters} if effect in CATALOGUE else {}
    parameters = {
        p: ParameterValue(v, sd_share * abs(v), units.get(p, "m/s^2")) for p, v in values.items()
    }
    return Finding(effect, parameters, 60.0, 1e-20, 1.0, 0.5)


def result(**given: Any) -> GapResult:
    model = base_model()
    return GapResult(
        **{
            **dict(gap_before=1.0, gap_after=0.5, channels=(), findings=(), noise={}, formulas=()),
            **dict(verdict="", model=model, base=model),
            **given,
        }
    )


def text_of(**given: Any) -> str:
    return " ".join(f"{lead} {text}" for lead, text in in_words(result(**given)))


def test_what_is_the_same_in_another_channel_is_told_with_what_is_sure() -> None:
    _, text = finding_words(finding("gnss_velocity_scale", relative=-0.02), None)
    assert f"To these data {STRETCHED} would be the same: that the two differ is what is" in text
    _, text = finding_words(finding("gyro_scale", z=0.02), None)
    assert "would be the same" not in text


def test_what_lies_beyond_what_was_sought_is_told_without_an_interval() -> None:
    text = what_is_wrong(finding("gnss_noise_scale", math.inf, factor=256.0))
    assert "at least 256" in text
    assert "give or take" not in text
    told = as_json(result(findings=(finding("gnss_noise_scale", math.inf, factor=256.0),)))
    assert told["findings"][0]["parameters"]["factor"] == {"value": 256.0, "sd": None, "unit": ""}


@pytest.mark.parametrize("name", sorted(SENTENCES))
def test_a_size_is_told_in_the_unit_it_has(name: str) -> None:
    units = {p.name: p.unit for p in CATALOGUE[name].parameters}
    for parameter, part in SENTENCES[name].parts.items():
        if part.factor == 1.0:
            assert units[parameter].replace("^2", "²").removesuffix("/image height") == part.unit


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_of_the_catalogue_has_a_sentence(name: str) -> None:
    effect = CATALOGUE[name]
    summary = what_is_wrong(Finding(name + " of a user", {}, 1.0, 1.0, 0.0, 0.0))
    assert name in SENTENCES
    told = {sign: [] for sign in (1.0, -1.0)}
    for p in effect.parameters:
        if p.name not in SENTENCES[name].parts:
            # all axes of a random walk are one
            assert effect.family == "noise"
            continue
        for sign, texts in told.items():
            texts.append(what_is_wrong(finding(name, **{p.name: sign * p.prior_sd})))
    texts = told[1.0] + told[-1.0] or [what_is_wrong(Finding(name, {}, 1.0, 1.0, 0.0, 0.0))]
    for text in texts:
        assert text[0].isupper()
        assert text.endswith(".")
        assert "{" not in text
        assert "[" not in text
        assert text != summary
        assert not effect.parameters or "give or take" in text
    assert len(set(told[1.0])) == len(told[1.0])
    if effect.terms and not effect.never_negative and effect.markov is None:
        assert not set(told[1.0]) & set(told[-1.0])


def test_an_arm_is_told_as_a_surveyor_would() -> None:
    one = finding("gnss_lever_arm", 0.04, x=0.5)
    assert what_is_wrong(one) == (
        "The antenna is 0.50 m further forward than the manifest says (give or take 0.02 m)."
    )
    back = finding("gnss_lever_arm", 0.04, x=-0.5, z=-1.0)
    assert "0.50 m further back" in what_is_wrong(back)
    assert "1.00 m higher" in what_is_wrong(back)


def test_parameters_that_do_not_show_are_not_told() -> None:
    parameters = {
        "x": ParameterValue(0.5, 0.02, "m"),
        "y": ParameterValue(0.04, 0.02, "m"),
    }
    text = what_is_wrong(Finding("gnss_lever_arm", parameters, 60.0, 0.0, 1.0, 0.5))
    assert "right" not in text
    weak = {"y": ParameterValue(-0.04, 0.02, "m")}
    text = what_is_wrong(Finding("gnss_lever_arm", weak, 60.0, 0.0, 1.0, 0.5))
    assert "to the left" in text


def test_of_many_parameters_the_surest_are_told() -> None:
    nine = {
        f"{a}{b}": ParameterValue(1e-4, 1e-5 * (1 + "xyz".index(b)), "")
        for a in "xyz"
        for b in "xyz"
    }
    text = what_is_wrong(Finding("gyro_g_sensitivity", nine, 60.0, 0.0, 1.0, 0.5))
    assert text.count("1 g along the forward axis") == 3
    assert "the right axis adds" not in text
    assert text.endswith("and 6 more.")


def test_sizes_are_in_units_that_one_measures() -> None:
    assert "0.57°" in what_is_wrong(finding("gyro_misalignment", xy=0.01))
    assert "1.00 %" in what_is_wrong(finding("gyro_scale", z=0.01))
    assert "0.36 s an hour" in what_is_wrong(finding("imu_clock_skew", 0.3, skew=1e-4))
    # 5e-4 (m/s^2)/(m/s)^2 at 20 m/s
    assert "0.20 m/s²" in what_is_wrong(finding("speed_vibration", x=5e-4))
    # 1e-3 1/(m/s^2) at 1 g
    assert "0.096 m/s²" in what_is_wrong(finding("accel_quadratic", x=1e-3))


def test_an_effect_of_the_users_is_told_by_name_and_numbers() -> None:
    text = what_is_wrong(finding("magnet_pull", k=-0.1))
    assert "agnet_pull" in text
    assert "-0.100 m/s^2 (give or take 0.010 m/s^2)" in text
    assert remedy("magnet_pull") == TAKE_MODEL


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_effect_has_something_to_do(name: str) -> None:
    text = remedy(name)
    assert text.endswith(".")
    if CATALOGUE[name].terms and not CATALOGUE[name].nuisance and name != "gnss_datum_shift":
        assert "model.toml" in text


@pytest.mark.parametrize(
    ("nats", "p", "words"),
    [
        (60.0, 1e-20, "practically certain"),
        (60.0, 1e-4, "very likely"),
        (12.0, 1e-20, "very likely"),
        (7.0, 1e-3, "likely"),
        (60.0, 0.3, "possible, but not sure"),
        (1.0, 1e-20, "possible, but not sure"),
    ],
)
def test_how_sure_goes_by_the_weaker_of_odds_and_p_value(nats: float, p: float, words: str) -> None:
    assert how_sure(nats, p).startswith(f"How sure: {words}.")


def test_odds_are_counted() -> None:
    assert "about 1 000 times" in how_sure(math.log(1100.0), 2e-4)
    assert "one search of 5 000" in how_sure(math.log(1100.0), 2e-4)
    assert "hardly" in how_sure(0.1, 0.4)
    assert "more than a million times" in how_sure(60.0, 0.4)


def test_what_it_may_be_instead_is_told_with_the_manoeuvre_that_tells() -> None:
    one = Finding(
        "gnss_velocity_latency",
        {"s": ParameterValue(0.34, 0.01, "s")},
        200.0,
        0.0,
        2.0,
        1.0,
        ("gnss_velocity_lag",),
        "brake hard to a halt",
    )
    _, text = finding_words(one, COST)
    assert "cannot tell it from gnss_velocity_lag (velocity passed" in text
    assert "To tell which it is: brake hard to a halt." in text
    assert "cannot tell" not in finding_words(finding("gyro_scale", z=0.01), COST)[1]


def test_costs_are_metres_and_degrees() -> None:
    text = cost_words(COST)
    assert "0.32 m level (at most 0.61 m)" in text
    assert "nothing in height" in text
    assert "0.11° in heading (at most 0.23°)" in text
    none = Extent(0.0, 0.0)
    assert "nothing here" in cost_words(Cost(none, none, none, none))


def test_a_camera_costs_no_path() -> None:
    assert "not the path" in finding_words(finding("camera_focal", relative=0.01), None)[1]
    text = finding_words(finding("gyro_scale", z=0.01), None, TAKE_MODEL)[1]
    assert "costs" not in text
    assert "What to do: take model.toml" in text
    assert "calibrate" not in text


def test_where_nothing_is_missing_it_says_so() -> None:
    text = text_of(refused=(Refused("gyro_scale", 3.0, 0.4),))
    assert text.startswith("Nothing is missing from the model")
    assert "gyro_scale (gyro scale error), which is too weak" in text
    assert "Something is left" not in text


def test_what_is_left_is_told_by_channel_time_and_size() -> None:
    left = (
        Misfit("velocity_n", "turn", "0.2 to 0.6 rad/s of turn", 4.0, 1e-9),
        Misfit("velocity_n", "time", "30 to 60 s after the start", 2.25, 1e-9),
        Misfit("position_d", "time", "1.5 to 20 s after the start", 2.0, 1e-9),
    )
    text = text_of(misfits=left)
    assert "Nothing is missing" not in text
    assert "Something is left that no candidate explains." in text
    # the root of a factor on the variance
    assert "The north velocity scatters 2.0 times as much" in text
    assert "from 30 to 60 s after the start (1.5 times)" in text
    assert "The down position scatters 1.4 times as much" in text
    assert "as random as it should be" not in text


def test_what_made_positions_worse_is_told() -> None:
    text = text_of(kept_out=(KeptOut("accel_scale", True),))
    assert "Not taken: accel_scale (accelerometer scale error)." in text
    assert "held-out positions are predicted worse" in text
    other = text_of(kept_out=(KeptOut("accel_scale", False, 9.0),))
    assert "predicted worse" not in other
    assert "less likely" in other


def test_a_delay_that_every_drive_has_its_own_of_is_told() -> None:
    own = text_of(kept_out=(KeptOut("gnss_course_latency", False, 9.0, each_drive=True),))
    assert "Not the same on every drive: gnss_course_latency" in own
    assert "every drive is fitted with its own" in own
    assert "Not taken" not in own


def test_how_well_positions_are_predicted_is_told_before_and_after() -> None:
    better = position_words(HeldPositions((1.0, 0.5), (2.0, 1.5)))
    assert "to 0.50 m level and 1.5 m in height (rms)" in better
    assert "to 1.0 m level and 2.0 m in height" in better
    assert "got worse" not in better
    assert "got worse" in position_words(HeldPositions((1.0, 1.2), (2.0, 1.5)))
    assert "without" not in position_words(HeldPositions((1.0, 0.5), (2.0, 1.5)), found=False)
    assert "as well without" in position_words(HeldPositions((1.0, 1.0001), (2.0, 2.0)))


@pytest.mark.parametrize("level", [*SENSOR_LEVELS, *FIGURES])
def test_every_noise_claim_has_a_paragraph(level: str) -> None:
    assert level in LEVELS
    text = text_of(noise_claims=(NoiseClaim(level, 2.5, 30.0, 1e-12),), costs={level: COST})
    assert f"{LEVELS[level]} is 2.5 times as large as stated." in text
    assert "with the noise as stated the held-out path is off by 0.32 m" in text


def test_a_formula_has_a_paragraph() -> None:
    one = Unexplained(
        "accel_x", "accel_x += k * sin(heading)", 0.1, 0.01, 90.0, 1e-30, "accel_scale", "found_1"
    )
    text = text_of(formulas=(one,), costs={"found_1": COST})
    assert text.startswith("One thing is missing")
    assert "acts on the accelerometer's forward axis that no known effect explains" in text
    assert "accel_x += k * sin(heading), with k = 0.1 ± 0.01" in text
    assert "accel_scale (accelerometer scale error) is most like it" in text
    assert "0.32 m level" in text


def test_the_page_begins_with_the_words() -> None:
    given = result(findings=(finding("gnss_lever_arm", 0.04, x=0.5),), warnings=("one <warning>",))
    page = gap_report(given, ["drive"])
    words = page.index("The antenna is 0.50 m further forward")
    assert words < page.index("one &lt;warning&gt;") < page.index("in numbers")
    assert "://" not in page


@pytest.mark.parametrize(
    ("value", "sd", "told"),
    [
        (0.5, 0.02, ("0.50 m", "0.02 m")),
        (0.5, 0.012, ("0.500 m", "0.012 m")),
        (-123.4, 30.0, ("123 m", "30 m")),
        (0.5, 0.0, ("0.5000 m", "0.0000 m")),
    ],
)
def test_digits_go_by_the_standard_deviation(
    value: float, sd: float, told: tuple[str, str]
) -> None:
    assert with_sd(value, sd, "m") == told


def test_what_is_too_small_to_matter_is_told_as_that() -> None:
    assert about(0.0004, "m", 0.001) == "less than 0.001 m"
    assert about(0.0234, "m", 0.001) == "0.023 m"
    assert about(-12.3, "°", 0.001) == "12°"


def test_what_is_suspected_is_told_in_words() -> None:
    left = (
        Misfit("velocity_n", "like", "gyro_warm_up", 1.2, 1e-6),
        Misfit("position_n", "after", "position_along after changes of speed", 1.2, 1e-6),
    )
    text = text_of(misfits=left)
    assert "The north velocity follows what gyro_warm_up (bias that dies away" in text
    assert "The north position shows that the position along the way is off after" in text
