"""The drift of biases as a rival: what of a sensor's errors it says as well.

A random walk follows whatever is slow. So what acts on a sensor is worth what it says beyond the
same set without it, the drift fitted anew; and a drift that says as much as a name must be worth is
asked whether it is one: what follows temperature, time or speed has the same value on another day,
which a walk has not. That one of the two is there a thousand to one tells; which of them is told as
of any rivals, by twenty to one, priors included, and beyond their scatter. Of a hundred drives that
drift one is so told otherwise (Markov: what is like drift has a fifth of the prior probability).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.catalogue import bias_walks
from automap.effects.imu import imu_terms
from automap.effects.terms import SPEED_SQUARED, TEMPERATURE, WARM_UP
from automap.gap import limits
from automap.gap.joint import Joint
from automap.gap.judge import Judge
from automap.gap.noise import Fitted, Log, noise_score, with_levels
from automap.gap.scoring import likelier
from automap.gap.selection import Chosen, Selection

WALK_OF = {term.sensor: w for w, e in bias_walks().items() for term in imu_terms([e.name])}
"""The drift of each sensor's biases."""
SLOW = tuple(n for n, e in CATALOGUE.items() if e.follows(TEMPERATURE) or e.follows(WARM_UP))
"""What changes a bias so slowly that no body sways so."""
LIKE_DRIFT = (*SLOW, *(n for n, e in CATALOGUE.items() if e.follows(SPEED_SQUARED)))
"""What changes a bias in the course of a drive, as drift does."""


class Screened(Protocol):
    """What is asked of candidates: a choice as states of the filter, and the parts of one that
    act."""

    def states(self, here: Fitted, selection: Selection, chosen: Chosen) -> Fitted: ...

    def acting(self, joint: Joint, selection: Selection, chosen: Chosen, name: str) -> Chosen: ...


class BiasDrift:
    """Weighs candidates against drift, by a ``judge`` with drives that were fitted and held out.

    ``borne_out`` what the filter needs, with the log odds of each, which is added to; ``nats`` of
    the candidates of a set beyond drift, and ``nearly`` what each drift says nearly as well, beside
    which set, with its log odds.
    """

    def __init__(
        self, screening: Screened, judge: Judge, borne_out: dict[str, float], log: Log
    ) -> None:
        self.screening, self.judge, self.borne_out, self.log = screening, judge, borne_out, log
        self.nats: dict[str, float] = {}
        self.nearly: dict[str, tuple[frozenset[str], dict[str, float]]] = {}
        self.asked: set[frozenset[str]] = set()

    def without(self, here: Fitted, selection: Selection, chosen: Chosen, name: str) -> Fitted:
        """A set less one candidate, the drift of the sensors that it acts on as suits the drives
        without it."""
        self.log(f"checking how much of {name} drift says")
        walks = [WALK_OF[sensor] for sensor in sorted(selection.sensors(chosen, name))]
        return with_levels(self.screening.states(here, selection, chosen.without(name)), walks)

    def needed(self, here: Fitted, selection: Selection, found: Chosen) -> Chosen:
        """The set less what acts on a sensor and is worth less than a name beyond what drift says,
        or, where it changes a bias as drift does, is not told apart from that:
        beside biases that are steady because of it, it always seems needed. It must be worth that
        by all drives, and beyond their scatter from stretch to stretch: noise as modelled makes D
        nats scatter by sqrt(2 D), so that this asks no more of what is worth a name, but what one
        stretch alone says is a receiver's error there as well."""
        self.nats, worth = {}, dict[str, float]()
        for name in found.names:
            if not selection.sensors(found, name):
                continue
            other = self.without(here, selection, found, name)
            prior = selection.log_prior(found) - selection.log_prior(found.without(name))
            self.nats[name], _ = likelier(here.fits, other.fits)
            if name in self.borne_out:
                # by held-out drives, too
                self.nats[name] = max(self.nats[name], self.borne_out[name])
                continue
            _, moves = selection.odds_of(found, name)
            self.nats[name] = min(self.nats[name], sum(m.evidence.nats for m in moves))
            of_vehicle = loose(selection, found, {name})
            ahead, sigmas = self.judge.beyond_drift(here, other, of_vehicle)
            worth[name] = ahead + prior if sigmas > limits.APART else min(ahead + prior, 0.0)
            if name in SLOW:
                # a fitted drive alone is little surer of what is slow than drift is
                self.nats[name] = max(self.nats[name], ahead + prior)
            walks = [WALK_OF[sensor] for sensor in selection.sensors(found, name)]
            worth[name] -= _least(here, walks) if name in SLOW else limits.LEAST_ODDS
            if worth[name] < 0.0:
                self._note(selection, found, name, ahead + prior, sigmas)
        weakest = min(worth, key=lambda n: worth[n], default="")
        return found.without(weakest) if worth.get(weakest, np.inf) < 0.0 else found

    def behind(self, here: Fitted, selection: Selection, found: Chosen) -> Chosen | None:
        """The set with what is told apart from a drift in the place of that, of each set asked
        once; what a drift says nearly as well is noted."""
        best, instead = 0.0, None
        asked = frozenset(found.names)
        if asked in self.asked:
            return None
        self.asked.add(asked)
        for name, its, odds, sigmas, least in self._rivals(here, selection, found):
            self._note(selection, its, name, odds, sigmas)
            if odds >= max(best, least) and sigmas > limits.APART:
                best, instead = odds, its
        if instead is not None:
            # that is what it would be asked again, with noise that has grown in its place
            self.borne_out[instead.names[-1]] = best
        return instead

    def beside(self, selection: Selection, chosen: Chosen) -> dict[str, dict[str, float]]:
        """What each drift says nearly as well beside a choice, the likeliest first, with the log
        odds of each."""
        names, out = frozenset(chosen.names), dict[str, dict[str, float]]()
        for walk, (rest, its) in self.nearly.items():
            known = {n: its[n] for n in its if n in selection.candidates}
            if known and rest <= names and not its.keys() & names:
                out[walk] = {n: known[n] for n in sorted(known, key=lambda n: -known[n])}
        return out

    def _rivals(
        self, here: Fitted, selection: Selection, chosen: Chosen
    ) -> Iterator[tuple[str, Chosen, float, float, float]]:
        """The choice with what may be there in the place of a sensor's drift, by name, and by how
        much its log odds are ahead, with the sigmas of that, and how far they must be.

        Drift has taken none where the drives say less than a name must be worth for it, against
        biases that are steady. Its level is sought from there: the likelihood may have a top with
        it and one without.
        """
        factors = here.model.factors
        for sensor, walk in WALK_OF.items():
            less = steady(factors, [walk])
            worth = noise_score(here.fits, factors) - noise_score(here.fits, less)
            known = [name for name in LIKE_DRIFT if name in selection.candidates]
            for name in known if worth >= limits.LEAST_ODDS else ():
                parts = selection.candidates[name].parts
                more = Chosen(tuple((name, part, 1.0) for part in parts))
                if name in chosen.names or sensor not in selection.sensors(more, name):
                    continue
                self.log(f"checking how much of {walk} {name} says")
                begun = replace(here, model=replace(here.model, factors=less))
                every = Chosen((*chosen.parts, *more.parts))
                fitted = with_levels(self.screening.states(begun, selection, every), [walk])
                best = self._acting(begun, fitted, selection, every, name)
                if best is None:
                    continue
                its, fitted = best
                of_vehicle = loose(selection, its, {name})
                price = selection.log_prior(its) - selection.log_prior(chosen)
                # the other levels suit the drift: what this follows badly was taken for noise
                fitted = with_levels(replace(fitted, curvature=here.curvature))
                ahead, sigmas = self.judge.beyond_drift(fitted, here, of_vehicle)
                yield name, its, ahead + price, sigmas, _least(fitted, [walk])

    def _acting(
        self, about: Fitted, fitted: Fitted, selection: Selection, chosen: Chosen, name: str
    ) -> tuple[Chosen, Fitted] | None:
        """A choice as ``fitted`` with all parts of a candidate, or, ``about`` the same path, with
        those alone that act, which ever is likelier: drift is one level of all axes, and one that
        is left to it keeps it up. None where none acts."""
        acting = self.screening.acting(fitted.joint(), selection, chosen, name)
        if acting == chosen:
            return chosen, fitted
        if name not in acting.names:
            return None
        fewer = self.screening.states(replace(about, model=fitted.model), selection, acting)
        ahead = likelier(fewer.fits, fitted.fits)[0]
        ahead += selection.log_prior(acting) - selection.log_prior(chosen)
        return (acting, fewer) if ahead > 0.0 else (chosen, fitted)

    def _note(
        self, selection: Selection, chosen: Chosen, name: str, odds: float, sigmas: float
    ) -> None:
        """Note what drift says nearly as well, by log ``odds`` for the candidate of a choice and
        the ``sigmas`` of what the filter says."""
        if odds > -limits.CLOSE_NATS or abs(sigmas) < limits.APART:
            rest = frozenset(chosen.names) - {name}
            for walk in (WALK_OF[sensor] for sensor in selection.sensors(chosen, name)):
                beside, its = self.nearly.get(walk, (rest, {}))
                its = its if beside == rest else {}
                # it is asked with drift free, and from steady biases: whichever suits it better
                self.nearly[walk] = rest, its | {name: max(odds, its.get(name, odds))}


def _least(fitted: Fitted, walks: Collection[str]) -> float:
    """Log odds that must speak for what is slow and ``fitted``: those by which rivals are told
    apart, where it is there in the place of drift. Where biases drift beside it as well, that
    something slow is there does not speak for it: it is one claim more, as any name is."""
    factors = fitted.model.factors
    left = noise_score(fitted.fits, factors) - noise_score(fitted.fits, steady(factors, walks))
    return limits.CLOSE_NATS if left < limits.LEAST_ODDS else limits.LEAST_ODDS


def steady(
    factors: Mapping[str, float], walks: Collection[str] = tuple(WALK_OF.values())
) -> dict[str, float]:
    """Levels of noise with biases that hardly drift."""
    return {**factors, **{walk: limits.STEADY * factors[walk] for walk in walks}}


def loose(selection: Selection, chosen: Chosen, names: Collection[str]) -> bool:
    """Whether the vehicle constraint has its say about candidates ``names`` of a choice: they act
    on it, or are so slow that no body sways so."""
    return selection.of_vehicle(chosen, names) or all(name in SLOW for name in names)
