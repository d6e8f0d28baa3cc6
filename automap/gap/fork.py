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
from automap.gap.scoring import robust_score, whitener_of
from automap.gap.search import MAX_FINDINGS, accept, eliminate, helps, step
from automap.gap.search_state import MIN_NATS, Say, Stage, State
from automap.gap.trial import few_gains


def search(state: State, exclude: Collection[str], say: Say) -> None:
    """Name one missing effect after another. Where a formula ends the search and a name was there
    too, the state becomes that of the names if these explain as much."""
    _name_all(state, exclude, say)
    if state.unexplained is None or state.contender is None:
        return
    formula, name = state.unexplained, state.contender
    if effect_of(formula) is None:
        return
    dismiss(formula)
    if not helps(state, name, say):
        return
    say(f"{name.effect} or {formula.told}: carrying on with the name")
    named = _branch(state)
    accept(named, name, say)
    _name_all(named, exclude, say)
    eliminate(named, say)
    told = _branch(state)
    told.unexplained = formula
    say(f"{name.effect} or {formula.told}: carrying on with the formula")
    adopt(told, say)
    _name_all(told, exclude, say)
    eliminate(told, say)
    ahead = _nats(told, named)
    needed = name_of(formula) in told.accepted
    more = MIN_NATS * (len(told.accepted) - len(named.accepted))
    say(
        f"{formula.told} explains {ahead:.1f} nats more than {', '.join(named.accepted)} where "
        f"{', '.join(told.accepted)} are named"
    )
    if needed and ahead - more >= OVER_NAMES_NATS:
        return
    best = named if needed or ahead <= more else _of_names(told, name_of(formula))
    dismiss(formula)
    for each in fields(State):
        setattr(state, each.name, getattr(best, each.name))
    state.formulas = True


def _of_names(told: State, effect: str) -> State:
    """A formula's end that does not need the formula any more, without a trace of its effect."""
    stages: list[Stage] = [
        (model, {e: v for e, v in values.items() if e != effect}) for model, values in told.stages
    ]
    return replace(told, unexplained=None, stages=stages)


def _name_all(state: State, exclude: Collection[str], say: Say) -> None:
    while len(state.accepted) < MAX_FINDINGS and step(state, exclude, say) is not None:
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
        rivals=dict(state.rivals),
        refused=dict(state.refused),
        warnings=list(state.warnings),
        unexplained=None,
        contender=None,
        resembles=None,
        formulas=False,
    )


def _nats(one: State, other: State) -> float:
    """Nats by which the fits of one state are likelier than those of another, by the mean of what
    the whiteners of both say."""
    total = few_gains(one, one.accepted) - few_gains(other, other.accepted)
    for a, b in zip(one.fits, other.fits, strict=True):
        for whitener in (whitener_of(a), whitener_of(b)):
            total += 0.5 * (robust_score(a, whitener) - robust_score(b, whitener))
    return total
