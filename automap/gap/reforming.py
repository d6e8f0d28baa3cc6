"""The search among forms: whether a formula, or a name, is one of the formulas near it.

A dictionary has one formula of each family, and a linear model says nearly the same of two that are
near: which of them a drive shows is told by the filter itself, on fitted and held-out drives.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import pairs_of_sign
from automap.effects.signals import Signals
from automap.gap import limits
from automap.gap.candidates import Candidate, follows_time
from automap.gap.evidence import nats_of_parts
from automap.gap.forms import About, nearby, ranked
from automap.gap.formula_effects import left_out_effect
from automap.gap.joint import Joint
from automap.gap.judge import Judge
from automap.gap.linear import Column
from automap.gap.neighbours import Terms, complexity
from automap.gap.noise import Fitted, Log, with_noise
from automap.gap.result import equation
from automap.gap.scoring import likelier
from automap.gap.selection import Chosen, Move, Selection
from automap.gap.slow import switched

WHOLE_DELAYS = frozenset(pair for pairs in pairs_of_sign(-1.0) for pair in pairs)


class Screened(Protocol):
    """What is asked of candidates: the formula that each is another form of, fits to ask formulas
    about, a choice with another form in it, a choice as states of the filter, and which rows of an
    estimate a candidate has. ``refinements`` the columns of formulas that are in no ``dictionary``,
    ``signals`` what these are of."""

    refinements: dict[str, tuple[Column, ...]]
    dictionary: list[tuple[str, str]]
    signals: Signals
    log: Log

    def seed(self, name: str) -> str: ...

    def about(self, here: Fitted, rest: Collection[str]) -> About: ...

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

    def rows(
        self, joint: Joint, selection: Selection, chosen: Chosen, name: str
    ) -> tuple[list[int], list[int]]: ...


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
        self._asked: Counter[tuple[str, str]] = Counter()
        self._around: set[tuple[str, frozenset[str]]] = set()

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
                entangled = self.entangled(joint, selection, chosen, name)
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
        for form in self.near(here, selection, chosen, name, gone):
            self.screening.refinements, selection.candidates = dict(known[0]), dict(known[1])
            its = self.screening.in_form(here, selection, chosen.without(gone), name, *form)
            yield form, its, self.screening.states(here, selection, its)
            self.screening.refinements, selection.candidates = known

    def near(
        self, here: Fitted, selection: Selection, chosen: Chosen, name: str, gone: str = ""
    ) -> list[tuple[Terms, float]]:
        """The likeliest forms near a formula of the choice, and out of how many each, without what
        is ``gone`` from it. Asked where nothing can be added any more: before, it follows what else
        is missing."""
        candidate, asked = (
            selection.candidates[name],
            (self.screening.seed(name), self.screening.seed(gone)),
        )
        rest = frozenset(n for n in chosen.names if n not in (name, gone))
        known = (name, rest) in self._around or self._asked[asked] >= limits.TRIALS
        if known or not self._has_forms(candidate):
            return []
        self.screening.log(f"looking for the form of {name}{f' without {gone}' if gone else ''}")
        self._asked[asked] += 1
        about, around = self.screening.about(here, rest), [candidate.terms]
        if follows_time(candidate.terms):
            near = _switches(about, candidate.terms)
        else:
            ((channel, own),) = candidate.terms
            rivals = [
                text for on, text in self.screening.dictionary if on == channel and text != own
            ]
            near, around = nearby(about, self.screening.signals, candidate.terms, rivals)
        # what is near one of these was among what these are the likeliest of
        self._around |= {(equation(terms), rest) for terms in around}
        return [
            (terms, candidate.choices * tried)
            for terms, tried in near
            if equation(terms) not in chosen.names
        ]

    @staticmethod
    def _has_forms(candidate: Candidate) -> bool:
        """Whether other forms of a candidate are known: it is a formula of one term, and no course
        of time but one that swings."""
        terms = candidate.terms
        if not terms or left_out_effect(terms[0][0]):
            return False
        return len(terms) == 1 + follows_time(terms)

    def entangled(self, joint: Joint, selection: Selection, chosen: Chosen, name: str) -> list[str]:
        """What stands with a formula for one thing, maybe: of the choice that of which more than
        half of what is known hangs on how large the formula is, and the other way round. Two that
        each say a part of what neither is are known so badly beside one another. With what swings
        what else swings on its channel does."""
        terms = selection.candidates[name].terms
        if not self._has_forms(selection.candidates[name]):
            return []
        if follows_time(terms):
            alike = {n: selection.candidates[n].terms for n in chosen.names if n != name}
            return [n for n, its in alike.items() if len(its) == 2 and its[0][0] == terms[0][0]][:1]
        sd = np.sqrt(np.diag(joint.cov))
        shared = (joint.cov / np.outer(sd, sd)) ** 2
        own, _ = self.screening.rows(joint, selection, chosen, name)
        best, most = 0.5, list[str]()
        for other in (n for n in chosen.names if n != name):
            rows, _ = self.screening.rows(joint, selection, chosen, other)
            share = float(shared[np.ix_(own, rows)].max(initial=0.0))
            if share > best:
                best, most = share, [other]
        return most

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


def _switches(about: About, terms: Terms) -> list[tuple[Terms, int]]:
    """What is on for a part of each period, the likeliest in the place of what swings, and out of
    how many."""
    count = 1
    for _ in range(2):
        waves = switched(terms)
        terms = ranked(about, waves)[0]
        count *= len(waves)
    return [(terms, count)]


def log_prior(selection: Selection, chosen: Chosen) -> float:
    """Log prior probability of a set; whole fixes are late more often than parts of them."""
    known = {n: CATALOGUE[n] for n in chosen.names if n in CATALOGUE and n not in WHOLE_DELAYS}
    parts = sum(effect.resembles == "a delay" for effect in known.values())
    return selection.log_prior(chosen) - limits.CLOSE_NATS * parts
