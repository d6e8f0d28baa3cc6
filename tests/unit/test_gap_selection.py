"""Which sets of candidates are selected: linear models of which it is known what is missing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from automap.gap import limits
from automap.gap.candidates import Candidate, twins_of
from automap.gap.linear import Given, Linear
from automap.gap.reforming import log_prior
from automap.gap.selection import Chosen, Selection
from automap.gap.stepwise import close_rivals, rivals, select, told_apart
from automap.records import FloatArray
from tests.unit.gap_linear import columns_named, linear_of

ROWS, COLUMNS = 2500, 30


def noise(seed: int) -> tuple[FloatArray, FloatArray]:
    """Columns that have nothing to do with one another, and rows of nothing but noise."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((ROWS, COLUMNS)), rng.standard_normal(ROWS)


def linear_with(phi: FloatArray, w: FloatArray) -> Linear:
    return linear_of(phi, w, columns_named(*(f"e{i}.p{i}" for i in range(phi.shape[1]))))


def alone(linear: Linear) -> Selection:
    """Every column a candidate of its own."""
    count = len(linear.layout)
    each = [Candidate(f"e{i}", ((i,),), -math.log(count)) for i in range(count)]
    return Selection(linear, {c.name: c for c in each})


def of(selection: Selection, *names: str) -> Chosen:
    """A choice of the first part of each candidate."""
    return Chosen(tuple((n, selection.candidates[n].parts[0], 1.0) for n in names))


def selected(selection: Selection, *given: str, limit: int = limits.MAX_FINDINGS) -> set[str]:
    return set(select(selection, of(selection, *given), limit).names)


@pytest.mark.parametrize("seed", range(5))
def test_the_two_that_act_are_selected_and_no_third(seed: int) -> None:
    phi, w = noise(seed)
    # they overlap
    phi[:, 11] += 0.4 * phi[:, 4]
    linear = linear_with(phi, w + 0.25 * phi[:, 4] + 0.25 * phi[:, 11])
    selection = alone(linear)
    chosen = select(selection, Chosen(), limits.MAX_FINDINGS)
    assert set(chosen.names) == {"e4", "e11"}
    odds, (move,) = selection.odds_of(chosen, "e11")
    assert odds > 20.0
    assert move.evidence.estimate[0] == pytest.approx(0.25, abs=0.1)
    assert not any(selection.holds(third) for third in selection.best(chosen, least=-np.inf))


def test_noise_has_nothing_selected() -> None:
    for seed in range(12):
        phi, w = noise(seed)
        assert selected(alone(linear_with(phi, w))) == set()


def test_what_acts_on_a_sensor_is_asked_with_all_its_axes() -> None:
    phi, w = noise(1)
    linear = linear_with(phi, w)
    layout = tuple(
        replace(c, sensors=frozenset({0} if 4 <= i <= 6 else ()))
        for i, c in enumerate(linear.layout)
    )
    selection = alone(replace(linear, layout=layout))
    selection.candidates["warm"] = Candidate("warm", ((4,), (5,), (6,)), -4.0)
    selection.candidates["late"] = Candidate("late", ((7,), (8,)), -4.0)
    chosen = Chosen((("warm", (5,), 5.0), ("late", (7,), 1.0)))
    whole = selection.whole(chosen)
    assert whole.parts[:2] == chosen.parts
    assert whole.parts[2:] == (("warm", (4,), 5.0), ("warm", (6,), 5.0))
    assert selection.whole(whole) == whole


def test_what_is_not_needed_is_dropped() -> None:
    phi, w = noise(1)
    selection = alone(linear_with(phi, w + 0.2 * phi[:, 3]))
    assert selected(selection, "e3", "e8", "e9") == {"e3"}


def test_what_the_filter_needs_is_not_dropped() -> None:
    phi, w = noise(1)
    selection = alone(linear_with(phi, w + 0.2 * phi[:, 3]))
    selection.needed = frozenset({"e9"})
    assert selected(selection, "e3", "e8", "e9") == {"e3", "e9"}


def test_what_two_others_replace_is_dropped() -> None:
    phi, w = noise(4)
    # the sum of both is what stands out first
    phi[:, 0] += phi[:, 1] + phi[:, 2]
    selection = alone(linear_with(phi, w + 0.3 * phi[:, 1] + 0.3 * phi[:, 2]))
    assert selected(selection) == {"e0"}
    # once that is fitted it is seen to be two
    assert selected(selection, "e0") == {"e1", "e2"}
    assert selected(selection, "e0", "e1", "e2") == {"e1", "e2"}


def test_no_more_are_selected_than_asked_for() -> None:
    phi, w = noise(2)
    w = w + phi[:, :4] @ np.array([0.3, 0.28, 0.26, 0.24])
    selection = alone(linear_with(phi, w))
    assert selected(selection) == {"e0", "e1", "e2", "e3"}
    assert len(selected(selection, limit=2)) == 2


def test_nothing_is_added_where_no_more_are_asked_for() -> None:
    phi, w = noise(2)
    selection = alone(linear_with(phi, w + 0.3 * phi[:, 0] + 0.25 * phi[:, 1]))
    assert selected(selection, "e0", limit=1) == {"e0"}
    assert selected(selection, "e0") == {"e0", "e1"}


def test_what_is_weak_waits_until_the_strong_one_is_fitted() -> None:
    phi, w = noise(3)
    selection = alone(linear_with(phi, w + 0.6 * phi[:, 1] + 0.15 * phi[:, 2]))
    assert selected(selection) == {"e1"}
    assert selected(selection, "e1") == {"e1", "e2"}


@pytest.mark.parametrize(("sign", "names"), [(1.0, {"e5"}), (-1.0, set())])
def test_no_effect_acts_with_a_sign_that_nature_does_not_know(sign: float, names: set[str]) -> None:
    phi, w = noise(5)
    selection = alone(linear_with(phi, w + sign * 0.2 * phi[:, 5]))
    selection.candidates["e5"] = Candidate("e5", ((5,),), -math.log(COLUMNS), positive=True)
    assert selected(selection) == names


@pytest.mark.parametrize(("other", "named"), [(0.3, True), (0.22, True), (0.0, False)])
def test_what_is_alike_on_all_axes_does_not_act_on_one_alone(other: float, named: bool) -> None:
    phi, w = noise(3)
    linear = linear_with(phi, w + 0.3 * phi[:, 4] + other * phi[:, 5])
    selection = alone(linear)
    del selection.candidates["e5"]
    for isotropic in (True, False):
        selection.candidates["e4"] = Candidate(
            "e4", ((4,), (5,)), -math.log(30), isotropic=isotropic
        )
        chosen = select(selection, Chosen(), limits.MAX_FINDINGS)
        assert ("e4" in chosen.names) is (named or not isotropic)


@pytest.mark.parametrize(("own", "offered"), [(0.03, False), (0.3, True)])
def test_what_is_almost_in_the_model_is_not_offered(own: float, offered: bool) -> None:
    phi, w = noise(6)
    aside = phi[:, 7].copy()
    phi[:, 7] = phi[:, 6] + own * aside
    # as much as a linear model may have wrong of what is in it
    selection = alone(linear_with(phi, w + 0.3 * phi[:, 6] + 0.25 * aside))
    moves = {m.name for m in selection.best(of(selection, "e6"), least=-np.inf)}
    assert ("e7" in moves) is offered
    assert selected(selection, "e6") == ({"e6", "e7"} if offered else {"e6"})


def test_a_move_holds_from_a_thousand_to_one_on() -> None:
    phi, w = noise(16)
    selection = alone(linear_with(phi, w + 0.2 * phi[:, 3]))
    move = selection.best(Chosen())[0]
    assert not selection.holds(replace(move, odds=math.log(990.0)))
    assert selection.holds(replace(move, odds=math.log(1010.0)))


def test_what_was_refused_stays_out() -> None:
    phi, w = noise(7)
    selection = alone(linear_with(phi, w + 0.2 * phi[:, 3]))
    selection.refused = frozenset({("e3", ("p3",))})
    assert selected(selection) == set()


def test_what_only_one_stretch_shows_is_not_selected() -> None:
    phi, w = noise(8)
    shown = np.where(np.arange(ROWS) < 300, 1.5, 0.0) * phi[:, 3]
    selection = alone(linear_with(phi, w + shown))
    (move,) = (m for m in selection.best(Chosen()) if m.name == "e3")
    assert move.evidence.uncorrected > 20.0
    assert not selection.holds(replace(move, odds=100.0))
    assert selected(selection) == set()


def grouped(linear: Linear, *parts: tuple[int, ...]) -> Selection:
    """The first columns as parts of one candidate, all others alone."""
    taken = {i for part in parts for i in part}
    prior = -math.log(len(linear.layout))
    each = [Candidate(f"e{i}", ((i,),), prior) for i in range(COLUMNS) if i not in taken]
    wide = Candidate("wide", parts, prior, -math.log(len(parts)))
    return Selection(linear, {c.name: c for c in (wide, *each)})


def test_of_an_effect_the_parameters_act_that_show() -> None:
    phi, w = noise(9)
    nine = [(i,) for i in range(9)]
    selection = grouped(linear_with(phi, w + 0.2 * phi[:, 2] - 0.15 * phi[:, 7]), *nine)
    chosen = select(selection, Chosen(), limits.MAX_FINDINGS)
    assert {(n, part) for n, part, _ in chosen.parts} == {("wide", (2,)), ("wide", (7,))}
    # one that does not act is taken out, the effect stays
    more = chosen.joined("wide", (4,), 1.0)
    assert select(selection, more, limits.MAX_FINDINGS) == chosen


def test_terms_of_a_formula_act_together() -> None:
    phi, w = noise(10)
    selection = grouped(linear_with(phi, w + 0.2 * phi[:, 0] + 0.2 * phi[:, 1]), (0, 1))
    chosen = select(selection, Chosen(), limits.MAX_FINDINGS)
    assert [(n, part) for n, part, _ in chosen.parts] == [("wide", (0, 1))]


def test_rivals_come_with_how_far_they_are_ahead() -> None:
    phi, w = noise(11)
    phi[:, 1] = phi[:, 0] + 0.5 * phi[:, 1]
    selection = alone(linear_with(phi, w + 0.25 * phi[:, 0]))
    best, behind = (of(selection, name) for name in ("e0", "e1"))
    (rival, *_) = rivals(selection, best, "e0")
    assert (rival.name, rival.chosen.names) == ("e1", ("e1",))
    assert rival.ahead < -5.0
    (back, *_) = rivals(selection, behind, "e1")
    assert back.name == "e0"
    assert back.ahead == pytest.approx(-rival.ahead, abs=1e-6)


@pytest.mark.parametrize(("shaken", "apart"), [(1.0, True), (6.0, False)])
def test_rivals_are_told_apart_by_what_stretches_say_and_not_by_the_noise_as_modelled(
    shaken: float, apart: bool
) -> None:
    phi, w = noise(19)
    phi[:, 1] = phi[:, 0] + 0.5 * phi[:, 1]
    # some stretches of 8 s are noisier than the rest
    loud = (np.arange(ROWS) // 80) % 6 == 2
    selection = alone(linear_with(phi, np.where(loud, shaken, 1.0) * w + 0.25 * phi[:, 0]))
    chosen = of(selection, "e0")
    (rival,) = (r for r in rivals(selection, chosen, "e0", ["e1"]))
    assert rival.ahead < -limits.CLOSE_NATS
    assert told_apart(selection, rival, chosen, "e0") == apart


def test_another_may_stand_in_the_place_of_one_axis_alone() -> None:
    phi, w = noise(23)
    phi[:, 2] = phi[:, 1] + 0.1 * phi[:, 2]
    selection = alone(linear_with(phi, w + 0.3 * phi[:, 0] + 0.2 * phi[:, 1]))
    selection.candidates["both"] = Candidate("both", ((0,), (1,)), -math.log(COLUMNS))
    chosen = Chosen((("both", (0,), 1.0), ("both", (1,), 1.0)))

    def apart(part: tuple[int, ...] | None) -> bool:
        (rival,) = rivals(selection, chosen, "both", ["e2"], part=part)
        return told_apart(selection, rival, chosen, "both", part)

    # it does what the second axis does, and nothing of the first
    assert apart(None)
    assert not apart((1,))


def test_what_is_needed_beside_another_is_no_rival_of_it() -> None:
    phi, w = noise(20)
    # both act, and neither stands for the other
    selection = alone(linear_with(phi, w + 0.2 * phi[:, 0] + 0.2 * phi[:, 1]))
    chosen = of(selection, "e0")
    (rival,) = (r for r in rivals(selection, chosen, "e0", ["e1"]))
    assert told_apart(selection, rival, chosen, "e0")


def test_a_wrong_first_choice_is_swapped_once_what_it_stood_for_is_there() -> None:
    phi, w = noise(17)
    # nearly one that acts, and alone the strongest, for it has part of another that acts
    phi[:, 0] = phi[:, 2] + 0.5 * phi[:, 1] + 0.15 * phi[:, 0]
    selection = alone(linear_with(phi, w + 0.5 * phi[:, 1] + 0.5 * phi[:, 2]))
    assert selection.best(Chosen())[0].name == "e0"
    both = selection.best(of(selection, "e0", "e1"))
    assert not [m for m in both if selection.holds(m)]
    assert selected(selection, "e0") == {"e1", "e2"}
    # the filter, which has the last word, has found the other likelier
    selection.outdone = frozenset({("e0", "e2")})
    assert "e0" in selected(selection, "e0")


def with_formula(behind: Mapping[str, float]) -> Selection:
    """A formula that is there, and others that resemble it, by what of them is their own."""
    phi, w = noise(13)
    for name, own in behind.items():
        i = int(name.removeprefix("e"))
        phi[:, i] = phi[:, 0] + own * phi[:, i]
    selection = alone(linear_with(phi, w + 0.4 * phi[:, 0]))
    formula = Candidate("e0", ((0,),), -math.log(COLUMNS), terms=(("accel_x", "speed"),))
    selection.candidates["e0"] = formula
    return selection


def test_a_formula_is_held_against_names_however_far_behind() -> None:
    selection = with_formula({"e1": 0.1, "e2": 1.5})
    close = {r.name for r in close_rivals(selection, of(selection, "e0"), "e0")}
    assert close == {"e1", "e2"}
    # between names only what comes near counts
    selection.candidates["e0"] = Candidate("e0", ((0,),), -math.log(COLUMNS))
    close = {r.name for r in close_rivals(selection, of(selection, "e0"), "e0")}
    assert close == {"e1"}


def test_what_was_not_needed_beside_others_may_still_stand_in_a_place() -> None:
    phi, w = noise(21)
    phi[:, 1] = phi[:, 0] + 0.1 * phi[:, 1]
    selection = alone(linear_with(phi, w + 0.3 * phi[:, 0]))
    chosen = of(selection, "e0")
    # it was tried, say beside e0 itself
    selection.refused = frozenset({selection.key("e1", (1,))})
    assert not [r for r in rivals(selection, chosen, "e0") if r.name == "e1"]
    assert [r.name for r in close_rivals(selection, chosen, "e0")] == ["e1"]


def test_courses_of_time_that_show_much_the_same_are_barred_together() -> None:
    phi, w = noise(23)
    phi[:, 1], phi[:, 2] = phi[:, 0] + 0.3 * phi[:, 1], phi[:, 0] + 0.8 * phi[:, 2]
    selection = alone(linear_with(phi, w))
    for i in range(3):
        terms = (("accel_x", f"step(time - {i + 7})"),)
        selection.candidates[f"e{i}"] = Candidate(f"e{i}", ((i,),), -3.0, terms=terms)
    # four fifths of one are the other's, of the third three
    assert selection.alike(of(selection, "e0")) == {("e0", ("p0",)), ("e1", ("p1",))}
    # of what is no course of time the others stay open
    assert selection.alike(of(selection, "e5")) == {("e5", ("p5",))}


def test_of_two_that_do_the_same_the_one_with_fewer_parameters_is_likelier() -> None:
    phi, w = noise(22)
    selection = alone(linear_with(phi, w))
    for name, count in (("e0", 3), ("e1", 9)):
        known = selection.candidates[name]
        selection.candidates[name] = replace(known, log_choice=-math.log(count))
    priors = [log_prior(selection, of(selection, n)) for n in ("e0", "e1")]
    assert priors[0] - priors[1] == pytest.approx(math.log(3.0))


def test_what_acts_as_a_chosen_effect_does_is_no_candidate_beside_it() -> None:
    assert twins_of(("gnss_latency",)) == {"imu_time_offset"}
    assert twins_of(("gyro_scale",)) == frozenset()
    phi, w = noise(14)
    names = ("gnss_latency", "imu_time_offset")
    linear = linear_of(
        phi[:, :2], w + phi[:, :2] @ [0.3, 0.3], columns_named(*map("{}.s".format, names))
    )
    each = [Candidate(name, ((i,),), -1.0) for i, name in enumerate(names)]
    selection = Selection(linear, {c.name: c for c in each})
    assert len(selected(selection)) == 1


def test_a_choice_knows_its_names_parts_and_factors() -> None:
    phi, w = noise(15)
    selection = alone(linear_with(phi, w))
    chosen = of(selection, "e3", "e1").joined("e3", (9,), 5.0)
    assert chosen.names == ("e3", "e1")
    assert chosen.scale_of("e3") == 5.0
    assert chosen.without("e3").names == ("e1",)
    assert selection.keys(chosen) == {("e3", ("p3",)), ("e1", ("p1",)), ("e3", ("p9",))}
    given = chosen.given(selection.linear, Given())
    assert given.columns == (3, 1, 9)
    assert given.prior_sd == pytest.approx((0.5, 0.5, 2.5))


def test_of_an_earlier_model_keys_and_priors_are_kept_and_no_rows() -> None:
    selection = alone(linear_with(*noise(2)))
    chosen = of(selection, "e3", "e1")
    earlier = selection.without_rows()
    assert earlier.linear.rows == ()
    assert earlier.keys(chosen) == selection.keys(chosen)
    assert earlier.log_prior(chosen) == selection.log_prior(chosen)
    assert earlier.linear.layout == selection.linear.layout
