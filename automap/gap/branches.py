"""A formula or names: where a formula beats the best name, both searches are carried to their end.

With several effects missing a formula may look like what is left of them all, and beat each name
taken by itself: the neighbour of a name, and a part of the next. So the name is given its chance
with the names that follow it, and the formula with those that follow it; the two ends are compared,
each without what is not needed any more.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, replace

from automap.gap.formula_effect import adopt, dismiss, effect_of, name_of
from automap.gap.formula_trial import OVER_NAMES_NATS
from automap.gap.scoring import mean_ratio
from automap.gap.search import MAX_FINDINGS, accept, backward_elimination, forward_step, validated
from automap.gap.search_state import MIN_NATS, Log, Stage, State
from automap.gap.trial import sparsity_gains


def search(state: State, exclude: Collection[str], log: Log) -> None:
    """Name one missing effect after another. Where a formula ends the search and a name was there
    too, the state becomes that of the names if these explain as much."""
    _forward_selection(state, exclude, log)
    if state.unexplained is None or state.runner_up is None:
        return
    formula, name = state.unexplained, state.runner_up
    if effect_of(formula) is None:
        return
    dismiss(formula)
    if not validated(state, name, log):
        return
    log(f"{name.effect} or {formula.equation}: carrying on with the name")
    with_names = _branch(state)
    accept(with_names, name, log)
    _forward_selection(with_names, exclude, log)
    backward_elimination(with_names, log)
    with_formula = _branch(state)
    with_formula.unexplained = formula
    log(f"{name.effect} or {formula.equation}: carrying on with the formula")
    adopt(with_formula, log)
    _forward_selection(with_formula, exclude, log)
    backward_elimination(with_formula, log)
    ahead = _nats(with_formula, with_names)
    needed = name_of(formula) in with_formula.accepted
    more = MIN_NATS * (len(with_formula.accepted) - len(with_names.accepted))
    log(
        f"{formula.equation} explains {ahead:.1f} nats more than "
        f"{', '.join(with_names.accepted)} where {', '.join(with_formula.accepted)} are named"
    )
    if needed and ahead - more >= OVER_NAMES_NATS:
        return
    best = (
        with_names if needed or ahead <= more else _without_formula(with_formula, name_of(formula))
    )
    dismiss(formula)
    for each in fields(State):
        setattr(state, each.name, getattr(best, each.name))
    state.formulas = True


def _without_formula(with_formula: State, effect: str) -> State:
    """A formula's end that does not need the formula any more, without a trace of its effect."""
    stages: list[Stage] = [
        (model, {e: v for e, v in values.items() if e != effect})
        for model, values in with_formula.stages
    ]
    return replace(with_formula, unexplained=None, stages=stages)


def _forward_selection(state: State, exclude: Collection[str], log: Log) -> None:
    while len(state.accepted) < MAX_FINDINGS and forward_step(state, exclude, log) is not None:
        pass


def _branch(state: State) -> State:
    """A copy of the state that goes on by itself, without formulas."""
    return replace(
        state,
        fits=list(state.fits),
        held_fits=list(state.held_fits),
        accepted=dict(state.accepted),
        trials=list(state.trials),
        stages=list(state.stages),
        confusable=dict(state.confusable),
        refused=dict(state.refused),
        warnings=list(state.warnings),
        unexplained=None,
        runner_up=None,
        resembles=None,
        formulas=False,
    )


def _nats(one: State, other: State) -> float:
    """Nats by which the fits of one state are likelier than those of another, by the mean of what
    the whiteners of both say."""
    sparse = sparsity_gains(one, one.accepted) - sparsity_gains(other, other.accepted)
    return sparse + mean_ratio(one.fits, other.fits)
