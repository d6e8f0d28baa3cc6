"""The search among forms: whether a formula, or a name, is one of the formulas near it.

A dictionary has one formula of each family, and a linear model says nearly the same of two that are
near: which of them a drive shows is told by the filter itself, on fitted and held-out drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import pairs_of_sign
from automap.gap import limits
from automap.gap.candidates import follows_time
from automap.gap.evidence import nats_of_parts
from automap.gap.joint import Joint
from automap.gap.judge import Judge
from automap.gap.linear import Column
from automap.gap.neighbours import Terms, complexity
from automap.gap.noise import Fitted, with_noise
from automap.gap.result import equation
from automap.gap.scoring import likelier
from automap.gap.selection import Chosen, Move, Selection

WHOLE_DELAYS = frozenset(pair for pairs in pairs_of_sign(-1.0) for pair in pairs)


class Screened(Protocol):
    """What is asked of candidates: the forms near a formula, a choice with one in its place, a
    choice as states of the filter, and what may be one thing with a formula. ``refinements`` the
    columns of formulas that are in no dictionary."""

    refinements: dict[str, tuple[Column, ...]]

    def forms(
        self, here: Fitted, selection: Selection, chosen: Chosen, name: str, gone: str = ""
    ) -> list[tuple[Terms, float]]: ...

    def in_form(
        self,
        here: Fitted,
        selection: Selection,
        chosen: Chosen,
        name: str,
        terms: Terms,
        choices: float,
    ) -> Chosen: ...

    def states(self, here: Fitted, selection: Selection, chosen: Chosen) -> Fitted: ...

    def entangled(
        self, joint: Joint, selection: Selection, chosen: Chosen, name: str
    ) -> list[str]: ...


class Forms:
    """Asks whether what was chosen is there in another form, of a ``judge`` with drives that were
    fitted and held out; ``as_drift`` fits a set less one candidate with the drift that suits it.
    ``alike`` the forms that are not told apart from one, and ``resembling`` the formula that a name
    may be beside others."""

    def __init__(
        self,
        screening: Screened,
        judge: Judge,
        as_drift: Callable[[Fitted, Selection, Chosen, str], Fitted],
        stated: Mapping[str, float],
    ) -> None:
        self.screening, self.judge, self.as_drift = screening, judge, as_drift
        self.stated = dict(stated)
        self.alike: dict[str, tuple[str, ...]] = {}
        self.resembling: dict[tuple[str, frozenset[str]], str] = {}

    def better(
        self, here: Fitted, selection: Selection, chosen: Chosen, ending: bool
    ) -> Chosen | None:
        """The choice with its formulas in other forms, for as long as one is better, or with what
        is suspected in one that is sure; None where none is."""
        instead = None
        room = len(chosen.names) < limits.MAX_FINDINGS and not ending
        moves = selection.suspected(chosen) if room else []
        formulas = [m for m in moves if selection.candidates[m.name].terms]
        unsure = [m for m in formulas if m.odds > formulas[0].odds - limits.CLOSE_NATS]
        while not ending and (found := self._better_form(here, selection, chosen, unsure)):
            (chosen, here), unsure = found, []
            instead = chosen
        return instead

    def _better_form(
        self, here: Fitted, selection: Selection, chosen: Chosen, suspects: Sequence[Move]
    ) -> tuple[Chosen, Fitted] | None:
        """The choice with a formula in the form near it with which all drives are likeliest by the
        filter itself: where a linear model says nearly the same of two, it is off by more. Where
        another of the choice and the formula may be one thing, also in the place of both. One of
        the ``suspects`` may be sure in another form, for which a thousand to one must speak. Of
        forms that are not told apart the simplest is taken, and the others are noted."""
        unsure, joint = {m.name: m for m in suspects}, here.joint()
        for name in (*chosen.names, *unsure):
            terms = selection.candidates[name].terms
            least, begun, entangled = 0.0, chosen, list[str]()
            if name in unsure:
                move = unsure[name]
                least = limits.LEAST_ODDS - limits.CLOSE_NATS
                begun = chosen.joined(name, move.part, move.evidence.scale)
            else:
                entangled = self.screening.entangled(joint, selection, chosen, name)
            near = [(least, chosen, (terms, 0.0), here)]
            for gone in ("", *entangled):
                of_vehicle = selection.of_vehicle(begun, {name, gone})
                for form, its, fitted in self._in_forms(here, selection, begun, name, gone):
                    ahead, sigmas = self.judge.ahead(fitted, here, of_vehicle)
                    ahead += selection.log_prior(its) - selection.log_prior(chosen)
                    # a few wild stretches are no reason to prefer either
                    ahead = ahead if sigmas > limits.APART else min(ahead, 0.0)
                    near.append((ahead, begun.without(gone), form, fitted))
                    least = max(one[0] for one in near) - limits.CLOSE_NATS
                    near = [one for one in near if one[0] > least]
            near.sort(key=lambda one: (len(one[1].parts), complexity(one[2][0])))
            _, fewer, best, its_fit = near[0]
            if len(near) > 1:
                self.alike[equation(best[0])] = tuple(equation(one[2][0]) for one in near[1:])
            if best[0] != terms:
                return self.screening.in_form(here, selection, fewer, name, *best), its_fit
        return None

    def _in_forms(
        self, here: Fitted, selection: Selection, chosen: Chosen, name: str, gone: str = ""
    ) -> Iterator[tuple[tuple[Terms, float], Chosen, Fitted]]:
        """The forms near a formula of a choice, out of how many each, the choice without what is
        ``gone`` with each in its place, a candidate for so long, and its fit."""
        known = self.screening.refinements, selection.candidates
        for form in self.screening.forms(here, selection, chosen, name, gone):
            self.screening.refinements, selection.candidates = dict(known[0]), dict(known[1])
            its = self.screening.in_form(here, selection, chosen.without(gone), name, *form)
            yield form, its, self.screening.states(here, selection, its)
            self.screening.refinements, selection.candidates = known

    def in_place(
        self, here: Fitted, selection: Selection, chosen: Chosen, name: str, nats: float
    ) -> tuple[float, Chosen] | None:
        """The choice with a formula in the place of a named effect of so many ``nats``, and by how
        much its log odds are ahead, where it is told apart from that; None where none is.

        The dictionary has one form of each family, and which of it a drive shows may explain twice
        as much: so it is sought from the formula that explains most in the effect's place, and the
        likeliest is asked with the noise that suits it. What is likelier than the effect, all forms
        that were tried paid for, but not told apart from it, or less likely beforehand by as much,
        is noted as what it may be.
        """
        if CATALOGUE[name].resembles == "a delay":
            # every receiver has some, and what is one instead has a name
            return None
        rest = chosen.without(name)
        formulas = [
            c
            for c in selection.candidates.values()
            if len(c.terms) == 1 and c.name not in chosen.names and not follows_time(c.terms)
        ]
        if not formulas:
            return None
        its_nats = nats_of_parts(selection.given(rest), [c.parts[0] for c in formulas])
        if its_nats.max() < limits.WEAK_SHARE * nats:
            return None
        first = formulas[int(np.argmax(its_nats))]
        begun = rest.joined(first.name, first.parts[0], 1.0)
        vehicle = selection.of_vehicle(chosen, {name}) | selection.of_vehicle(begun, {first.name})
        best: tuple[float, tuple[Terms, float], Fitted] | None = None
        for form, _, fitted in self._in_forms(here, selection, begun, first.name):
            ahead = self.judge.ahead(fitted, here, vehicle)[0] - math.log(form[1])
            if best is None or ahead > best[0]:
                best = ahead, form, fitted
        if best is None or best[0] < -limits.CLOSE_NATS:
            return None
        _, form, fitted = best
        fitted = with_noise(fitted, self.stated)
        ahead, sigmas = self.judge.ahead(fitted, here, vehicle, strictly=True)
        known = self.screening.refinements, selection.candidates
        self.screening.refinements, selection.candidates = dict(known[0]), dict(known[1])
        its = self.screening.in_form(here, selection, begun, first.name, *form)
        if ahead > math.log(form[1]):
            text = f"{equation(form[0])}, with which the drives are {ahead:.2g} nats likelier"
            self.resembling[name, frozenset(rest.names)] = text
        odds = ahead + log_prior(selection, its) - log_prior(selection, chosen)
        clear = sigmas > limits.APART and ahead > limits.CHALLENGE * nats
        if odds > 0.0 and (clear or sigmas > limits.ONE_IN_A_THOUSAND):
            if not selection.sensors(its, formula := its.names[-1]):
                return odds, its
            # what drift says as well would go, and the name with it
            drift = self.as_drift(fitted, selection, its, formula)
            worth = likelier(fitted.fits, drift.fits)[0] + selection.log_prior(its)
            if worth >= limits.LEAST_ODDS + selection.log_prior(rest):
                return odds, its
        self.screening.refinements, selection.candidates = known
        return None


def log_prior(selection: Selection, chosen: Chosen) -> float:
    """Log prior probability of a set; whole fixes are late more often than parts of them."""
    known = {n: CATALOGUE[n] for n in chosen.names if n in CATALOGUE and n not in WHOLE_DELAYS}
    parts = sum(effect.resembles == "a delay" for effect in known.values())
    return selection.log_prior(chosen) - limits.CLOSE_NATS * parts
