"""What a round of the search fits, and what it does not fit a second time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from automap.fusion.level_climb import Maximum
from automap.gap import base_fit, base_model, noise, search
from automap.gap import judge as judging
from automap.gap.candidates import Candidate
from automap.gap.joint import Joint
from automap.gap.judge import Judge
from automap.gap.linear import Column
from automap.gap.noise import Fitted
from automap.gap.screening import Screening
from automap.gap.search import Search
from automap.gap.selection import Chosen
from tests.unit.gap_asked import HERE, LATE, LOW_PASSED, SELECTION, Asked, fit_of, only


def says(monkeypatch: pytest.MonkeyPatch, all_sigmas: float, received: float = 0.0) -> None:
    """Let all channels, and the receiver's alone, be for the first of two sets by so many
    sigmas."""

    told, its = ((20.0 * sigmas, sigmas) for sigmas in (all_sigmas, received))
    monkeypatch.setattr(search, "likelier", lambda one, other: told)
    monkeypatch.setattr(judging, "likelier_by_side", lambda one, other: (told, its))


@pytest.mark.parametrize(
    ("name", "sigmas", "times"),
    [(LATE, -5.0, 1), (LOW_PASSED, -5.0, 1), (LATE, -1.0, 2)],
)
def test_a_twin_is_fitted_once_more_unless_it_was_clearly_outdone(
    monkeypatch: pytest.MonkeyPatch, name: str, sigmas: float, times: int
) -> None:
    says(monkeypatch, sigmas)
    asked = Asked()
    for _ in range(3):
        _, stays = asked._better_twins(HERE, HERE, SELECTION, only(name))
        assert stays.names == (name,)
    assert len(asked.sets) == times


def test_a_name_that_took_its_twins_place_clearly_is_not_asked_about_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    says(monkeypatch, 5.0)
    asked = Asked()
    _, instead = asked._better_twins(HERE, HERE, SELECTION, only(LOW_PASSED))
    assert instead.names == (LATE,)
    assert asked._better_twins(HERE, HERE, SELECTION, instead)[1] == instead
    assert asked.sets == [(LATE,)]


@pytest.mark.parametrize(
    ("every", "received", "stays"),
    [(5.0, 4.0, True), (5.0, -3.0, False), (5.0, 0.4, False), (-2.0, -1.0, False)],
)
def test_what_only_the_vehicle_constraint_bears_out_is_not_kept(
    monkeypatch: pytest.MonkeyPatch, every: float, received: float, stays: bool
) -> None:
    says(monkeypatch, every, received)
    asked = Asked()
    both = Chosen((*only(LATE).parts, ("accel_y += k * tanh(rate_z / 0.01)", (1,), 1.0)))
    kept, fitted = asked._kept(HERE, SELECTION, both, only(LATE))
    assert kept == (both if stays else only(LATE))
    # a set that was fitted to tell whether it is enough comes with its fit
    assert (fitted is None) == stays
    assert asked.sets == [(LATE,)]
    assert asked._kept(HERE, SELECTION, only(LATE), both) == (both, None)


@pytest.mark.parametrize("of_vehicle", [False, True])
def test_where_constraint_and_receiver_differ_no_sensor_is_told_apart(
    monkeypatch: pytest.MonkeyPatch, of_vehicle: bool
) -> None:
    says(monkeypatch, 4.0, -2.0)
    assert Asked().judge.ahead(HERE, HERE, of_vehicle)[1] == (4.0 if of_vehicle else 0.0)
    # nor more surely than the receiver says
    says(monkeypatch, 4.0, 0.5)
    assert Asked().judge.ahead(HERE, HERE, of_vehicle)[1] == 4.0
    told = Asked().judge.ahead(HERE, HERE, of_vehicle, strictly=True)
    assert told[1] == (4.0 if of_vehicle else 0.5)


@pytest.mark.parametrize("strength", [8.0, 1.0])
def test_of_two_that_do_the_same_one_is_borne_out_where_either_would_do(strength: float) -> None:
    names = (("accel_misalignment", "zx"), ("formula_accel_z", "k"))
    phi = np.array([[1.0, 0.99], [0.99, 1.0]])
    info, sds = 100.0 * phi, np.ones(2)
    cov = np.asarray(np.linalg.inv(info + np.eye(2)))
    values = np.asarray(cov @ info @ np.array([0.1 * strength, 0.0]))
    here = SimpleNamespace(joint=lambda: Joint(names, values, cov, 0.0))
    columns = [Column(effect, parameter, 1.0) for effect, parameter in names]
    candidates = {e: Candidate(e, ((i,),), math.log(0.05)) for i, (e, _) in enumerate(names)}
    linear = SimpleNamespace(layout=columns, prior_sd=sds)
    selection: Any = SimpleNamespace(linear=linear, candidates=candidates)
    chosen = Chosen(tuple((e, (i,), 1.0) for i, (e, _) in enumerate(names)))
    asked = object.__new__(Screening)
    asked.effects = {e: e for e, _ in names}
    asked.refinements = {}
    out = asked.not_borne_out(cast("Fitted", here), selection, chosen)
    assert len(out) == (1 if strength > 4.0 else 2)
    assert "formula_accel_z" in out


@pytest.mark.parametrize(("sigmas", "stays"), [(6.0, True), (3.0, False)])
def test_axes_that_are_nothing_cost_those_that_act_nothing(sigmas: float, stays: bool) -> None:
    warm = "gyro_temperature"
    names = tuple((warm, axis) for axis in "xyz")
    # in units of the priors, known to a twentieth
    values, cov = 0.05 * np.array([0.3, sigmas, 0.2]), 0.05**2 * np.eye(3)
    here = SimpleNamespace(joint=lambda: Joint(names, values, cov, 0.0))
    columns = [Column(effect, parameter, 1.0) for effect, parameter in names]
    candidate = Candidate(warm, ((0,), (1,), (2,)), math.log(0.05), -math.log(3.0))
    linear = SimpleNamespace(layout=columns, prior_sd=np.ones(3))
    selection: Any = SimpleNamespace(linear=linear, candidates={warm: candidate})
    chosen = Chosen(tuple((warm, (i,), 1.0) for i in range(3)))
    asked = object.__new__(Screening)
    asked.effects, asked.refinements = {warm: warm}, {}
    assert asked.not_borne_out(cast("Fitted", here), selection, chosen) == ([] if stays else [warm])
    # as well as alone: 18 nats, less ln 20 of the prior's width, of the name and one axis
    worth = asked._worth(here.joint(), selection, chosen, warm)
    alone = asked._worth(here.joint(), selection, Chosen(((warm, (1,), 1.0),)), warm)
    assert worth == pytest.approx(alone)
    acting = asked.acting(here.joint(), selection, chosen, warm)
    assert acting.parts == ((warm, (1,), 1.0),)


def test_the_noise_of_a_set_that_was_fitted_before_is_not_sought_from_everywhere_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[str, float]] = []

    def sought(fitted: Any, *stated: Any) -> Any:
        asked.append(("anew" if stated else "on", fitted.model.factors["accel"]))
        return replace(fitted, model=replace(fitted.model, factors={"accel": 2.0 + len(asked)}))

    monkeypatch.setattr(search, "with_noise", sought)
    monkeypatch.setattr(search, "with_levels", sought)
    here = Fitted(replace(base_model(), factors={"accel": 1.0}), {}, ())
    one = object.__new__(Search)
    one.log, one.stated, one.each_drive, one.levels = print, {}, [], {}
    one.screening = cast(
        "Screening",
        SimpleNamespace(seed=lambda name: name, states=lambda here, selection, chosen: here),
    )
    for name in (LATE, LOW_PASSED, LATE):
        one._fit(here, SELECTION, only(name))
    assert asked == [("anew", 1.0), ("anew", 1.0), ("on", 3.0)]


@pytest.mark.parametrize("valley", [False, True])
def test_noise_is_sought_from_a_second_side_where_a_valley_lies_between(
    monkeypatch: pytest.MonkeyPatch, valley: bool
) -> None:
    def score(fits: Any, factors: Mapping[str, float], rooms: Any = ()) -> float:
        x = math.log(factors["accel"])
        other = 60.0 * math.exp(-((x - 3.0) ** 2)) if valley else 0.0
        return other - 10.0 * x**2 * math.exp(-0.3 * abs(x))

    def top(fits: Any, levels: Any, start: Mapping[str, float], *inverse: Any) -> Maximum:
        asked.append(start["accel"])
        return Maximum(score(fits, start), {"accel": start["accel"]}, np.eye(1))

    asked: list[float] = []
    monkeypatch.setattr(noise, "noise_score", score)
    monkeypatch.setattr(noise, "rooms_of", lambda fits: ())
    monkeypatch.setattr(noise, "_likeliest", top)
    monkeypatch.setattr(noise, "fitted_about", lambda model, *about: Fitted(model, {}, ()))
    here = Fitted(replace(base_model(), factors={"accel": 1.0}), {LATE: 1.0}, ())
    found = noise.with_noise(here, {"accel": math.exp(3.0)})
    assert len(asked) == 1 + valley
    assert found.model.factors["accel"] == pytest.approx(math.exp(3.0) if valley else 1.0)


@pytest.mark.parametrize(("size", "borne_out"), [(0.8, True), (-0.8, False)])
def test_what_nature_knows_of_one_sign_is_not_borne_out_by_the_other(
    size: float, borne_out: bool
) -> None:
    zone = "gyro_dead_zone"
    asked = object.__new__(Screening)
    asked.effects, asked.refinements = {zone: zone}, {}
    joint = Joint(((zone, "z"),), np.array([size]), np.array([[0.01]]), 0.0)
    linear = SimpleNamespace(layout=[Column(zone, "z", 1.0)], prior_sd=np.ones(1))
    candidate = Candidate(zone, ((0,),), 0.0, positive=True)
    selection: Any = SimpleNamespace(linear=linear, candidates={zone: candidate})
    here = cast("Fitted", SimpleNamespace(joint=lambda: joint))
    assert asked.not_borne_out(here, selection, only(zone)) == ([] if borne_out else [zone])


def test_a_fit_that_others_are_compared_with_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def held_out(opened: Any, model: str, values: Any, about: Any) -> list[Any]:
        made.append(model)
        return []

    monkeypatch.setattr(judging, "fit_held_out", held_out)
    monkeypatch.setattr(judging, "likelier_by_side", lambda one, other: ((0.0, 0.0), (0.0, 0.0)))
    judge = Judge(cast("Any", ["a drive"]))
    here, *others = (
        cast("Any", SimpleNamespace(fits=(), model=name, values=dict)) for name in "habcd"
    )
    for other in others:
        judge.ahead(other, here, of_vehicle=True)
    assert sorted(made) == ["a", "b", "c", "d", "h"]


@pytest.mark.parametrize(("metres", "stays"), [(1.3, True), (-0.1, False), (4.4, False)])
def test_courses_from_further_behind_than_with_any_receiver_are_no_part_of_every_model(
    monkeypatch: pytest.MonkeyPatch, metres: float, stays: bool
) -> None:
    asked: list[tuple[str, ...]] = []

    def fits(opened: Any, model: Any, log: Any) -> Any:
        asked.append(model.options.effects)
        last = SimpleNamespace(totals=lambda: {"gnss_course_distance_m": metres})
        louder = replace(model, factors=dict.fromkeys(model.factors, 2.0))
        return SimpleNamespace(fits=(SimpleNamespace(last=last),), model=louder)

    def with_levels(fitted: Fitted) -> Fitted:
        # from the noise that suits the drives with it
        assert set(fitted.model.factors.values()) == {2.0}
        asked.append(fitted.model.options.effects)
        return fitted

    monkeypatch.setattr(base_fit, "open_fits", fits)
    monkeypatch.setattr(base_fit, "with_levels", with_levels)
    model = base_model()
    # of shocks nothing is asked
    model = replace(model, options=replace(model.options, shocks=True))
    base_fit.first_fit((), model, print)
    assert ("gnss_course_distance" in asked[-1]) == stays


@pytest.mark.parametrize(
    ("estimate", "names", "free"),
    [
        ((LATE,), ("gnss_latency",), True),
        ((LOW_PASSED,), ("gnss_latency",), True),
        ((LATE, "imu_time_offset"), ("gnss_latency",), False),
        # the delay between clocks is free in this model
        ((LATE,), (), False),
        (("gyro_scale",), ("gnss_latency",), False),
    ],
)
def test_velocities_are_as_much_older_than_positions_as_the_age_of_these_lets_be_known(
    estimate: tuple[str, ...], names: tuple[str, ...], free: bool
) -> None:
    asked = Asked()
    asked.screening = cast("Screening", SimpleNamespace(names=list(names)))
    told = asked._with_age(dict.fromkeys(estimate, 1.0))
    assert set(told) == {*estimate, *(["gnss_latency"] if free else [])}


def deciding(chosen: str, ahead: dict[str, tuple[float, float]]) -> tuple[Asked, Any, list[str]]:
    """A search that decides between what is chosen and others, by how far each is ahead, nats and
    sigmas; its selection, and which sets it fits."""
    asked, sets = Asked(), list[str]()

    def states(here: Any, selection: Any, chosen: Chosen) -> Any:
        sets.append(chosen.names[0])
        return fit_of(chosen.names[0])

    asked.spoken_against, asked.close = [], {}
    told: dict[str, Any] = dict(
        effects={},
        nats=lambda joint, selection, chosen, name: 1000.0,
        refined=lambda here, selection, chosen: (chosen, []),
        seed=lambda name: name,
        states=states,
        not_borne_out=lambda fitted, selection, chosen: [],
    )
    asked.screening = cast("Screening", SimpleNamespace(**told))
    asked.judge = cast("Judge", SimpleNamespace(ahead=lambda one, *about: ahead[one.name]))
    selection: Any = SimpleNamespace(
        candidates={
            n: SimpleNamespace(terms=(("gyro_y", n),) if "+=" in n else ())
            for n in (chosen, *ahead)
        },
        of_vehicle=lambda chosen, names: False,
        log_prior=lambda chosen: 0.0,
    )
    return asked, selection, sets


FORMULA = "gyro_y += k * force_x * speed"


@pytest.mark.parametrize(
    ("sigmas", "instead"), [(2.0, "gyro_g_sensitivity"), (4.0, None)], ids=["close", "clear"]
)
def test_a_search_that_ends_still_asks_its_formulas_whether_they_are_a_name(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, instead: str | None
) -> None:
    name, other = "gyro_g_sensitivity", "gyro_y += k * x"
    # by less than a tenth, so that it must be beyond all doubt
    asked, selection, sets = deciding(FORMULA, {name: (-50.0, -sigmas), other: (9.0, 4.0)})
    asked.close = {"imu_mounting": ("gnss_lever_arm",)}
    rivals = [SimpleNamespace(name=n, chosen=only(n)) for n in (other, name)]
    monkeypatch.setattr(search, "close_rivals", lambda selection, chosen, name: rivals)
    found = asked._decided(fit_of(FORMULA), selection, only(FORMULA), ending=True)
    assert (found and found.names[0]) == instead
    # no formula in its place, and what was found of names before is not forgotten
    assert sets == [name]
    assert asked.close["imu_mounting"] == ("gnss_lever_arm",)
    assert asked._decided(fit_of(name), selection, only(name), ending=True) is None
    assert sets == [name]


def test_of_names_that_a_formula_is_not_told_apart_from_the_likeliest_takes_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ahead = {"gnss_lever_arm": (-90.0, -1.5), "gyro_scale": (-50.0, -1.4)}
    asked, selection, _ = deciding(FORMULA, ahead)
    rivals = [SimpleNamespace(name=n, chosen=only(n)) for n in ahead]
    monkeypatch.setattr(search, "close_rivals", lambda selection, chosen, name: rivals)
    found = asked._decided(fit_of(FORMULA), selection, only(FORMULA))
    assert found is not None
    assert found.names == ("gyro_scale",)


@pytest.mark.parametrize(
    ("nats", "stays"), [((8.0, -2.0), (LATE,)), ((-3.0, -2.0), (LOW_PASSED,)), ((8.0, 0.0), None)]
)
def test_what_is_nothing_beside_what_came_with_it_goes_alone(
    nats: tuple[float, float], stays: tuple[str, ...] | None
) -> None:
    worth = dict(zip((LATE, LOW_PASSED), nats, strict=True))
    asked = Asked()
    asked.screening = cast("Any", SimpleNamespace(nats=lambda *about: worth[about[-1]]))
    both = Chosen((*only(LATE).parts, (LOW_PASSED, (1,), 1.0)))
    here: Any = SimpleNamespace(joint=lambda: None)
    assert asked._acting(here, SELECTION, both).names == (stays or both.names)
