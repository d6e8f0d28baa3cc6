"""What of a sensor's errors the drift of its biases says as well."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from automap.fusion.levels import ALL_LEVELS
from automap.gap import base_model, bias_drift, limits
from automap.gap import judge as judging
from automap.gap.bias_drift import BiasDrift
from automap.gap.noise import Fitted
from automap.gap.selection import Chosen, Selection
from tests.unit.gap_asked import HERE, LATE, LOW_PASSED, Heard, fit_of, only

WARM, AGED = "gyro_temperature", "gyro_warm_up"
SHAKEN = "gyro_speed_vibration"


@pytest.fixture(autouse=True)
def left_to_drift(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """Nats that drives say for biases that drift as they are fitted, which may be changed."""
    said = {"nats": 0.0}

    def score(fits: Any, factors: Mapping[str, float]) -> float:
        return said["nats"] * (factors["gyro_bias_walk"] >= 1.0)

    monkeypatch.setattr(bias_drift, "noise_score", score)
    return said


class Drifting(BiasDrift):
    """A question of drift that notes which sets it is asked to fit."""

    def __init__(self) -> None:
        judge = Heard(cast("Any", ["a drive"]))
        super().__init__(cast("Any", None), judge, {}, print)
        self.sets: list[tuple[str, ...]] = []

    def without(self, here: Any, selection: Any, chosen: Chosen, name: str) -> Any:
        self.sets.append(chosen.without(name).names)
        return fit_of("drift")


def on_sensor(its: str = LOW_PASSED) -> Selection:
    """A selection of which one acts on a sensor, with 2000 nats."""
    move = SimpleNamespace(evidence=SimpleNamespace(nats=2000.0))
    told = dict(
        sensors=lambda chosen, name: {0} if name == its else set(),
        of_vehicle=lambda chosen, names: False,
        odds_of=lambda chosen, name: (1997.0, [move]),
        log_prior=lambda chosen: -3.0 * len(chosen.names),
    )
    return cast("Selection", SimpleNamespace(**told))


@pytest.mark.parametrize(("name", "of_vehicle"), [(WARM, True), (LOW_PASSED, False)])
def test_no_body_sways_as_slowly_as_a_sensor_warms(
    monkeypatch: pytest.MonkeyPatch, name: str, of_vehicle: bool
) -> None:
    heard: list[bool] = []

    def ahead(one: Any, other: Any, loose: bool) -> tuple[float, float]:
        heard.append(loose)
        return 20.0, 3.0

    asked = Drifting()
    monkeypatch.setattr(asked.judge, "beyond_drift", ahead)
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (40.0, 9.0))
    asked.needed(HERE, on_sensor(name), Chosen((*only(LATE).parts, (name, (1,), 1.0))))
    assert heard == [of_vehicle]


@pytest.mark.parametrize(
    ("name", "nats", "sigmas", "stays"),
    [
        (LOW_PASSED, 20.0, 2.0, True),
        # one stretch alone says all of it
        (LOW_PASSED, 20.0, 1.0, False),
        # the other drive says the opposite
        (LOW_PASSED, 5.0, 2.0, False),
        (LOW_PASSED, 7.0, 2.0, False),
        # what is slow and drift are rivals of which one is there
        (WARM, 7.0, 2.0, True),
        (WARM, 5.0, 2.0, False),
    ],
)
def test_what_acts_on_a_sensor_must_say_more_than_drift_on_all_drives(
    monkeypatch: pytest.MonkeyPatch, name: str, nats: float, sigmas: float, stays: bool
) -> None:
    asked, selection = Drifting(), on_sensor(name)
    monkeypatch.setattr(asked.judge, "beyond_drift", lambda *about: (nats, sigmas))
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (40.0, 9.0))
    both = Chosen((*only(LATE).parts, (name, (1,), 1.0)))
    assert asked.needed(HERE, selection, both) == (both if stays else only(LATE))
    # asked without it, and of the other, which acts on no sensor, nothing
    assert asked.sets == [(LATE,)]


def test_what_is_slow_is_worth_what_all_drives_say(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Drifting()
    monkeypatch.setattr(asked.judge, "beyond_drift", lambda *about: (12.0, 3.0))
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (4.0, 1.0))
    for name, nats in ((WARM, 9.0), (LOW_PASSED, 4.0)):
        asked.needed(HERE, on_sensor(name), Chosen(((name, (1,), 1.0),)))
        assert asked.nats == {name: nats}


@pytest.mark.parametrize(
    ("by_filter", "told"), [(90.0, 90.0), (5.0, None), (3000.0, 2000.0)], ids=str
)
def test_what_drift_would_say_is_no_evidence(
    monkeypatch: pytest.MonkeyPatch, by_filter: float, told: float | None
) -> None:
    asked = Drifting()
    monkeypatch.setattr(asked.judge, "beyond_drift", lambda *about: (by_filter, 9.0))
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (by_filter, 9.0))
    both = Chosen((*only(LATE).parts, (LOW_PASSED, (1,), 1.0)))
    kept = asked.needed(HERE, on_sensor(), both)
    assert asked.sets == [(LATE,)]
    assert kept == (only(LATE) if told is None else both)
    assert told is None or asked.nats == {LOW_PASSED: told}


@pytest.mark.parametrize(
    ("by_all", "sigmas", "may_be"), [(5.0, 2.0, True), (-5.0, -1.0, True), (-5.0, -2.0, False)]
)
def test_what_drift_says_nearly_as_well_is_told_beside_the_drift(
    monkeypatch: pytest.MonkeyPatch, by_all: float, sigmas: float, may_be: bool
) -> None:
    asked = Drifting()
    monkeypatch.setattr(asked.judge, "beyond_drift", lambda *about: (by_all, sigmas))
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (5.0, 1.0))
    both = Chosen((*only(LATE).parts, (LOW_PASSED, (1,), 1.0)))
    assert asked.needed(HERE, on_sensor(), both) == only(LATE)
    told = {"gyro_bias_walk": ({LATE}, {LOW_PASSED: by_all - 3.0})}
    assert asked.nearly == (told if may_be else {})


@pytest.mark.parametrize(
    ("odds", "sigmas", "taken", "told", "least"),
    [
        (12.0, 3.0, True, True, limits.CLOSE_NATS),
        (12.0, 1.0, False, True, limits.CLOSE_NATS),
        # a thousand to one says that something is there, twenty to one which of the two
        (3.5, 3.0, True, True, limits.CLOSE_NATS),
        (2.5, 3.0, False, True, limits.CLOSE_NATS),
        (-9.0, -3.0, False, False, limits.CLOSE_NATS),
        # beside biases that drift all the same it is one claim more
        (6.4, 3.0, False, True, limits.LEAST_ODDS),
    ],
)
def test_what_is_surely_behind_a_drift_takes_its_place_and_what_may_be_is_noted(
    monkeypatch: pytest.MonkeyPatch,
    odds: float,
    sigmas: float,
    taken: bool,
    told: bool,
    least: float,
) -> None:
    asked, here = Drifting(), only(LATE)
    with_one = {n: here.joined(n, (i,), 1.0) for i, n in enumerate((WARM, AGED))}
    rivals = [
        (WARM, with_one[WARM], odds, sigmas, least),
        (AGED, with_one[AGED], odds - 1.0, sigmas, least),
    ]
    monkeypatch.setattr(asked, "_rivals", lambda *about: iter(rivals))
    on_gyro: Any = SimpleNamespace(sensors=lambda chosen, name: {0})
    assert asked.behind(HERE, on_gyro, here) == (with_one[WARM] if taken else None)
    noted = {"gyro_bias_walk": ({LATE}, {WARM: odds, AGED: odds - 1.0})}
    assert asked.nearly == (noted if told else {})
    # what was decided is not asked about twice
    assert asked.borne_out == ({WARM: odds} if taken else {})
    assert asked.behind(HERE, on_gyro, here) is None


@pytest.mark.parametrize(("left", "kept"), [(6.0, True), (8.0, False)])
def test_what_is_slow_beside_a_drift_that_is_there_as_well_must_be_worth_a_name(
    monkeypatch: pytest.MonkeyPatch, left_to_drift: dict[str, float], left: float, kept: bool
) -> None:
    asked, found = Drifting(), only(WARM)
    left_to_drift["nats"] = left
    # less the three of its prior a hundred to one, three sigmas
    monkeypatch.setattr(asked.judge, "beyond_drift", lambda *about: (7.6, 3.0))
    monkeypatch.setattr(bias_drift, "likelier", lambda one, other: (7.6, 3.0))
    assert asked.needed(HERE, on_sensor(WARM), found) == (found if kept else Chosen())


@pytest.mark.parametrize(("taken", "asked_about"), [(9.0, [WARM, AGED, SHAKEN]), (5.0, [])])
def test_drift_is_asked_for_rivals_where_it_took_what_is_worth_a_name(
    monkeypatch: pytest.MonkeyPatch, taken: float, asked_about: list[str]
) -> None:
    def score(fits: Any, factors: Mapping[str, float]) -> float:
        return 100.0 - taken * (factors["gyro_bias_walk"] < 1.0)

    levels = {"gyro_bias_walk": 1.0, "accel_bias_walk": 1.0}
    here = Fitted(replace(base_model(), factors=levels), {}, ())
    begun: list[float] = []

    def states(about: Fitted, selection: Any, chosen: Chosen) -> Fitted:
        begun.append(about.model.factors["gyro_bias_walk"])
        return about

    screening: Any = SimpleNamespace(
        states=states, acting=lambda joint, selection, chosen, name: chosen
    )
    monkeypatch.setattr(Fitted, "joint", lambda fitted: None)
    monkeypatch.setattr(bias_drift, "noise_score", score)
    moved: list[Collection[str]] = []

    def with_levels(fitted: Fitted, levels: Collection[str] = ALL_LEVELS) -> Fitted:
        moved.append(levels)
        return fitted

    monkeypatch.setattr(bias_drift, "with_levels", with_levels)
    judge: Any = SimpleNamespace(beyond_drift=lambda *about: (20.0, 3.0))
    drift = BiasDrift(screening, judge, {}, print)
    names = (WARM, AGED, SHAKEN, "accel_warm_up", "gyro_scale")
    known = {n: SimpleNamespace(parts=((i,),)) for i, n in enumerate(names)}
    selection: Any = SimpleNamespace(
        candidates=known,
        sensors=lambda chosen, name: {int(name.startswith("accel"))},
        of_vehicle=lambda chosen, names: False,
        log_prior=lambda chosen: -3.0 * len(chosen.names),
    )
    told = list(drift._rivals(here, selection, only(LATE)))
    assert [name for name, *_ in told] == asked_about
    # drift is left nothing beside them
    assert all(one[2:] == (17.0, 3.0, limits.CLOSE_NATS) for one in told)
    # drift as it was fitted would leave nothing to them
    assert begun == [0.1] * len(asked_about)
    # the other levels are those that suited the drift
    assert moved == [["gyro_bias_walk"], ALL_LEVELS] * len(asked_about)


@pytest.mark.parametrize(
    ("fitted", "by_held_out"),
    [
        # a walk that is large where little changes loses there what it gains elsewhere
        ([30.0, -30.0, 30.0, -30.0], True),
        # drives that are surer together
        ([3.0, 2.0, 2.5, 2.0], False),
        # what is likelier without it is no surer for held-out drives
        ([-5.0, -9.0, -5.0, -9.0], False),
    ],
)
def test_held_out_drives_alone_may_tell_a_value_from_drift(
    monkeypatch: pytest.MonkeyPatch, fitted: list[float], by_held_out: bool
) -> None:
    held = [2.0, 3.5, 2.0, 3.5]

    class Stretches(Heard):
        def _held_out(self, one: Any) -> Any:
            return [held]

    def sides(one: list[list[float]], other: Any) -> Any:
        each = np.concatenate(one)
        told = float(each.sum()), float(each.sum() / (np.sqrt(len(each)) * np.std(each)))
        return told, told

    monkeypatch.setattr(judging, "likelier_by_side", sides)
    here: Any = SimpleNamespace(fits=[fitted])
    nats, sigmas = Stretches(cast("Any", ["a drive"])).beyond_drift(here, here, of_vehicle=True)
    assert nats == sum(fitted) + sum(held)
    assert sigmas == sides([held] if by_held_out else [fitted, held], None)[0][1]
