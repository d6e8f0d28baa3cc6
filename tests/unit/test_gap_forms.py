"""Which form of a formula a search tells, and what it puts in the place of which."""

from __future__ import annotations

from collections.abc import Collection
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from automap.gap import base_model, confirm, limits, reforming, search
from automap.gap.candidates import Candidate
from automap.gap.joint import Joint
from automap.gap.judge import Judge
from automap.gap.linear import Column
from automap.gap.noise import Fitted
from automap.gap.reforming import Forms, Screened
from automap.gap.screening import Screening
from automap.gap.search import Search
from automap.gap.selection import Chosen, Move
from tests.unit.gap_asked import LATE, SELECTION, Asked, fit_of, only


@pytest.mark.parametrize(("shared", "one_thing"), [(-0.9, True), (0.6, False)])
def test_what_is_known_badly_beside_a_formula_may_be_one_thing_with_it(
    shared: float, one_thing: bool
) -> None:
    names = ("formula_velocity_along", "k"), ("gnss_velocity_scale", "relative"), (LATE, "s")
    cov = np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]) * np.array(
        [[1.0, shared, 0.1], [shared, 1.0, 0.0], [0.1, 0.0, 1.0]]
    )
    terms = {e: (("velocity_along", "tanh(speed / 5.0)"),) * (p == "k") for e, p in names}
    candidates = {e: Candidate(e, ((i,),), 0.0, terms=terms[e]) for i, (e, _) in enumerate(names)}
    layout = [Column(effect, parameter, 1.0) for effect, parameter in names]
    selection: Any = SimpleNamespace(linear=SimpleNamespace(layout=layout), candidates=candidates)
    chosen = Chosen(tuple((e, (i,), 1.0) for i, (e, _) in enumerate(names)))
    screening = object.__new__(Screening)
    screening.effects = {e: e for e, _ in names}
    asked = Forms(screening, cast("Judge", None), lambda *about: fit_of("drift"), {})
    joint = Joint(names, np.ones(3), cov, 0.0)
    told = asked.entangled(joint, selection, chosen, "formula_velocity_along")
    assert told == (["gnss_velocity_scale"] if one_thing else [])
    # what switches has many periods
    waves = {
        f"gyro_z += {p}": tuple(("gyro_z", f"{f}(2 * pi * time / {p})") for f in ("sin", "cos"))
        for p in ("82.0", "41.0")
    }
    both = {n: Candidate(n, ((0, 1),), 0.0, terms=its) for n, its in waves.items()}
    swings: Any = SimpleNamespace(linear=selection.linear, candidates={**candidates, **both})
    first, second = waves
    every = Chosen((*chosen.parts, *((n, (0, 1), 1.0) for n in waves)))
    assert asked.entangled(joint, swings, every, first) == [second]
    # a name has no other form
    assert asked.entangled(joint, selection, chosen, "gnss_velocity_scale") == []


CUBED, SQUARED, BENT = "rate_z^3", "rate_z^2", "max(rate_z^2 - 0.3, 0)"


@pytest.mark.parametrize(
    ("first", "worth", "sigmas", "told", "alike"),
    [
        ((CUBED, SQUARED), {CUBED: -18.0, SQUARED: 12.0, BENT: 20.0}, 3.0, BENT, ()),
        # of two that are not told apart the simpler, and the other beside it
        ((CUBED, SQUARED), {CUBED: -18.0, SQUARED: 12.0, BENT: 13.0}, 3.0, SQUARED, (BENT,)),
        ((CUBED, BENT), {CUBED: 12.0, SQUARED: 0.0, BENT: 14.0}, 3.0, CUBED, (BENT,)),
        ((CUBED, SQUARED), {CUBED: 2.0, SQUARED: 1.0, BENT: 20.0}, 3.0, None, (CUBED, SQUARED)),
        # a few wild stretches say nothing
        ((CUBED, SQUARED), {CUBED: 600.0, SQUARED: -18.0, BENT: 0.0}, 0.8, None, (CUBED,)),
    ],
)
def test_of_forms_that_say_much_the_same_the_filter_tells_one_step_by_step(
    monkeypatch: pytest.MonkeyPatch,
    first: tuple[str, ...],
    worth: dict[str, float],
    sigmas: float,
    told: str | None,
    alike: tuple[str, ...],
) -> None:
    asked = Forms(None, None, lambda *about: fit_of("drift"), {})  # type: ignore[arg-type]
    # the linear model has the first two the other way round
    near = {"rate_z": first, SQUARED: (BENT,)}
    monkeypatch.setattr(
        asked,
        "near",
        lambda here, selection, chosen, name, gone: [
            ((("gyro_z", f),), 1.0) for f in near.get(name, ())
        ],
    )
    monkeypatch.setattr(asked, "entangled", lambda joint, selection, chosen, name: [])
    asked.screening = cast(
        "Screened",
        SimpleNamespace(
            refinements={},
            in_form=lambda here, selection, chosen, name, terms, choices: only(terms[0][1]),
            states=lambda here, selection, chosen: fit_of(chosen.names[0]),
        ),
    )
    of = {**worth, "rate_z": 0.0}
    asked.judge = cast(
        "Judge",
        SimpleNamespace(
            ahead=lambda one, other, of_vehicle: (of[one.name] - of[other.name], sigmas)
        ),
    )
    formulas: Any = SimpleNamespace(
        candidates={f: SimpleNamespace(terms=(("gyro_z", f),)) for f in of},
        log_prior=lambda chosen: 0.0,
        of_vehicle=lambda chosen, names: False,
        suspected=lambda chosen: [],
    )
    formed = asked.better(fit_of("rate_z"), formulas, only("rate_z"), ending=False)
    assert (formed and formed.names[0]) == told
    assert asked.alike.get(f"gyro_z += k * {told or 'rate_z'}", ()) == tuple(
        f"gyro_z += k * {f}" for f in alike
    )


def move_of(name: str, odds: float) -> Move:
    """A part that may be added with such log odds."""
    return Move(name, (0,), cast("Any", SimpleNamespace(scale=1.0)), odds)


@pytest.mark.parametrize(
    ("worth", "suspects", "already", "ending", "told"),
    [
        ({SQUARED: 5.0, BENT: 15.0}, {"rate_z": 5.0}, (), False, BENT),
        # a name is sure or none, and what it is behind is looked at all the same
        ({SQUARED: 5.0, BENT: 15.0}, {"name": 6.0, "rate_z": 1.0}, (), False, BENT),
        # told apart from the likeliest formula
        ({SQUARED: 5.0, BENT: 15.0}, {"rate_x": 6.0, "rate_z": 1.0}, (), False, None),
        # a thousand to one must speak for it, as for any name
        ({SQUARED: 5.0, BENT: 6.0}, {"rate_z": 5.0}, (), False, None),
        # of two that are not told apart the simpler
        ({SQUARED: 6.0, BENT: 8.0}, {"rate_z": 5.0}, (), False, SQUARED),
        ({SQUARED: 5.0, BENT: 15.0}, {"rate_z": 5.0}, (), True, None),
        ({SQUARED: 5.0, BENT: 15.0}, {"rate_z": 5.0}, range(limits.MAX_FINDINGS), False, None),
        ({SQUARED: 5.0, BENT: 15.0}, {}, (), False, None),
    ],
)
def test_what_is_suspected_is_told_in_the_form_that_is_sure(
    monkeypatch: pytest.MonkeyPatch,
    worth: dict[str, float],
    suspects: dict[str, float],
    already: Collection[int],
    ending: bool,
    told: str | None,
) -> None:
    asked = Forms(None, None, lambda *about: fit_of("drift"), {})  # type: ignore[arg-type]
    monkeypatch.setattr(
        asked,
        "near",
        lambda here, selection, chosen, name, gone: [
            ((("gyro_z", f),), 1.0) for f in worth if name == "rate_z"
        ],
    )
    monkeypatch.setattr(asked, "entangled", lambda joint, selection, chosen, name: [])
    asked.screening = cast(
        "Screened",
        SimpleNamespace(
            refinements={},
            in_form=lambda here, selection, chosen, name, terms, choices: only(terms[0][1]),
            states=lambda here, selection, chosen: fit_of(chosen.names[0]),
        ),
    )
    of = {**worth, "nothing": 0.0}
    asked.judge = cast(
        "Judge",
        SimpleNamespace(ahead=lambda one, other, of_vehicle: (of[one.name] - of[other.name], 3.0)),
    )
    names = [f"rate_z + {i}" for i in already]
    formulas: Any = SimpleNamespace(
        candidates={
            f: SimpleNamespace(terms=(("gyro_z", f),) if f != "name" else ())
            for f in (*worth, "rate_z", "rate_x", "name", *names)
        },
        log_prior=lambda chosen: 0.0,
        of_vehicle=lambda chosen, names: False,
        suspected=lambda chosen: [move_of(n, odds) for n, odds in suspects.items()],
    )
    chosen = Chosen(tuple((name, (0,), 1.0) for name in names))
    formed = asked.better(fit_of("nothing"), formulas, chosen, ending)
    assert (formed and formed.names[0]) == told


@pytest.mark.parametrize("brief", [True, False])
def test_forms_come_before_courses_of_time_and_what_comes_to_nothing_costs_no_round(
    monkeypatch: pytest.MonkeyPatch, brief: bool
) -> None:
    done: list[str] = []

    class Rounds(Asked):
        def _kept(self, here: Any, selection: Any, chosen: Any, found: Chosen) -> Any:
            return found, None

        def _proposed(
            self, here: Any, selection: Any, found: Chosen, louder: Any, slow: Any
        ) -> Any:
            # what is there is fitted before more is sought beside it under other noise
            assert found.names == ("formula",)
            assert "fit" in done
            return found.joined("plateau", (1,), 1.0) if slow else found

        def _reconsidered(self, *about: Any) -> None:
            done.append("rivals")

        def _fit(self, here: Any, selection: Any, chosen: Chosen) -> Any:
            done.append("fit")
            return here

        def _better_twins(self, about: Any, here: Any, selection: Any, chosen: Chosen) -> Any:
            return here, chosen

    def selected(here: Any, slow: bool, may_act: bool = True) -> Any:
        done.append("courses of time" if slow else "linear")
        told = dict(keys=SELECTION.keys, without_rows=lambda: None, alike=lambda out: frozenset())
        return SimpleNamespace(linear=SimpleNamespace(layout=()), **told)

    def refined(here: Any, selection: Any, chosen: Chosen) -> Any:
        left = chosen.without("plateau") if brief else chosen
        return left, [("plateau", (1,))] if left != chosen else []

    def not_borne_out(here: Any, selection: Any, chosen: Chosen) -> list[str]:
        return [name for name in chosen.names if name == "plateau"]

    for name, instead in {
        "select": lambda selection, chosen, limit: only("formula"),
        "in_layout": lambda found, layout, selection: found,
        "fitted_about": lambda model, estimate, fits: SimpleNamespace(joint=lambda: None),
    }.items():
        monkeypatch.setattr(search, name, instead)
    asked, model = Rounds(), base_model()
    asked.stated, asked.close, asked.spoken_against, asked.nats = {}, {}, [], {}
    asked.stands = confirm.Confirmed({}, ())
    asked.base = cast("Fitted", SimpleNamespace(model=model, fits=(), estimate={}))
    told: dict[str, Any] = dict(names=(), effects={}, options=model.options)
    told |= dict(selection=selected, refined=refined, not_borne_out=not_borne_out)
    asked.screening = cast("Screening", SimpleNamespace(**told))
    monkeypatch.setattr(asked.forms, "better", lambda *about: done.append("forms"))
    asked.run()
    # what the filter does not bear out was fitted to tell, and nothing is made anew for it
    tried = [] if brief else ["fit"]
    rounds = ["linear", "fit", "linear", "forms", "courses of time", *tried, "rivals"]
    assert done == [*rounds, "linear"]


def test_another_form_of_a_formula_has_the_noise_of_the_one_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked, climbed = Asked(), list[str]()
    seeds = {"bent": "plain"}
    asked.screening = cast(
        "Screening",
        SimpleNamespace(
            seed=lambda name: seeds.get(name, name),
            states=lambda here, selection, chosen: Fitted(here.model, {}, ()),
        ),
    )
    asked.levels, asked.each_drive, asked.stated = {}, [], {}

    def climb(kind: str) -> Any:
        def fit(fitted: Fitted, *stated: Any) -> Fitted:
            climbed.append(kind)
            return fitted

        return fit

    monkeypatch.setattr(search, "with_noise", climb("from everywhere"))
    monkeypatch.setattr(search, "with_levels", climb("from there"))
    here = Fitted(base_model(), {}, ())
    for name in ("plain", "bent", "other"):
        Search._fit(asked, here, SELECTION, only(name))
    assert climbed == ["from everywhere", "from there", "from everywhere"]


WARM, SUN, SHADE = "accel_temperature", "lag(speed, 20.0)", "lag(speed, 52.0)"


@pytest.mark.parametrize(
    ("share", "nats", "sigmas", "beyond_drift", "instead", "noted"),
    [
        # hardly anything of what the name explains
        (0.1, 40.0, 5.0, 40.0, False, False),
        (0.6, 40.0, 5.0, 40.0, True, True),
        # drift says it as well: it would go, and the name with it
        (0.6, 40.0, 5.0, 4.0, False, True),
        # not told apart, but likelier than all that were tried make it by chance
        (0.6, 12.0, 1.0, 40.0, False, True),
        (0.6, 2.0, 1.0, 40.0, False, False),
        (0.6, -9.0, -1.0, 40.0, False, False),
    ],
)
def test_a_formula_in_its_own_form_stands_beside_the_name_that_it_resembles(
    monkeypatch: pytest.MonkeyPatch,
    share: float,
    nats: float,
    sigmas: float,
    beyond_drift: float,
    instead: bool,
    noted: bool,
) -> None:
    monkeypatch.setattr(reforming, "nats_of_parts", lambda known, parts: np.array([share * 100.0]))
    monkeypatch.setattr(reforming, "with_noise", lambda fitted, stated: fitted)
    asked = Forms(None, None, lambda *about: fit_of("drift"), {})  # type: ignore[arg-type]
    monkeypatch.setattr(reforming, "likelier", lambda one, other: (beyond_drift, 9.0))
    asked.judge = cast(
        "Judge",
        SimpleNamespace(
            ahead=lambda one, other, of_vehicle, strictly=False: (
                nats * (one.name == SHADE),
                sigmas,
            )
        ),
    )
    seed = f"accel_x += k * {SUN}"
    known = {seed: Candidate(seed, ((1,),), -9.0, terms=(("accel_x", SUN),))}
    selection: Any = SimpleNamespace(
        candidates={WARM: Candidate(WARM, ((0,),), -4.0), **known},
        given=lambda chosen: None,
        of_vehicle=lambda chosen, names: False,
        log_prior=lambda chosen: 0.0,
        sensors=lambda chosen, name: {1},
    )
    monkeypatch.setattr(
        asked,
        "near",
        lambda here, selection, chosen, name, gone: [
            ((("accel_x", form),), 8.0) for form in (SUN, SHADE)
        ],
    )
    asked.screening = cast(
        "Screened",
        SimpleNamespace(
            refinements={},
            in_form=lambda here, selection, chosen, name, terms, choices: only(terms[0][1]),
            states=lambda here, selection, chosen: fit_of(chosen.names[0]),
        ),
    )
    found = asked.in_place(fit_of(WARM), selection, only(WARM), WARM, 100.0)
    assert (found is not None) == instead
    assert found is None or found[1].names == (SHADE,)
    told = asked.resembling.get((WARM, frozenset()), "")
    assert (SHADE in told) == noted
