"""A formula against the name that it beats, each with what follows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from automap.effects.user import set_user_effects, user_effects
from automap.gap import base_model, branches
from automap.gap.drive import open_drive
from automap.gap.fit import fit_drive
from automap.gap.formula import screen_formulas
from automap.gap.screening import screen
from automap.gap.search import accept
from automap.gap.search_state import State, Trial
from automap.gap.trial import try_candidate, with_refitted_noise
from tests.unit.test_gap import simulated


@pytest.fixture(autouse=True)
def no_formula_left() -> Iterator[None]:
    yield
    set_user_effects([])


def nobody(said: str) -> None:
    pass


def decided(
    hidden: dict[str, Any],
    formula: tuple[str, str],
    name: str,
    monkeypatch: pytest.MonkeyPatch,
    exclude: frozenset[str] = frozenset(),
    follows: Callable[[State], Trial | None] = lambda state: None,
) -> State:
    """A drive on which a formula stands against a name, with what ``follows``."""
    model = base_model()
    opened = open_drive(simulated(hidden), model.options)
    fit = fit_drive(opened, model)
    state = State([opened], [], dict(model.factors), model, [fit])
    known = screen_formulas([fit], exclude, correct_overdispersion=False)
    screening = screen([fit], [name])
    candidate = screening.candidates[0]
    tried = try_candidate(state, candidate, model, screening, nobody)
    (state.runner_up,) = with_refitted_noise(state, [tried], nobody)
    state.unexplained = next(f for f in known if (f.channel, f.text) == formula)
    monkeypatch.setattr(branches, "forward_step", lambda state, *_: follows(state))
    branches.search(state, exclude, nobody)
    return state


def test_the_neighbour_of_a_name_is_no_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = {"speed_vibration": {"y": 1.5e-3}}
    state = decided(hidden, ("accel_y", "speed"), "speed_vibration", monkeypatch)
    assert state.unexplained is None
    assert list(state.accepted) == ["speed_vibration"]
    assert not user_effects()
    assert state.formulas


def test_what_no_name_explains_stays_a_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    asymmetry = "accel_scale_asymmetry"
    hidden = {asymmetry: {"x": 0.04}}
    formula = ("accel_x", "abs(force_x)")
    marginalised = frozenset({asymmetry})
    state = decided(hidden, formula, "speed_vibration", monkeypatch, marginalised)
    assert state.unexplained is not None
    assert (state.unexplained.channel, state.unexplained.text) == formula
    assert not state.accepted


def test_a_formula_that_its_own_end_does_without_leaves_no_trace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = "speed_vibration"

    def follows(state: State) -> Trial | None:
        with_formula = any(e.startswith("formula_") for e in state.accepted)
        if not with_formula or right in state.accepted:
            return None
        screening = screen(state.fits, [right])
        (candidate,) = screening.candidates
        trial = try_candidate(state, candidate, state.model, screening, nobody)
        return accept(state, trial, nobody)

    hidden = {right: {"y": 1.5e-3}}
    state = decided(hidden, ("accel_y", "speed"), "gnss_lever_arm", monkeypatch, follows=follows)
    assert state.unexplained is None
    assert list(state.accepted) == [right]
    assert not user_effects()
    assert all(set(values) <= {right} for _, values in state.stages)
