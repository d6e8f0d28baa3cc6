"""What a linear model may be missing, and the posterior odds of any choice of it: the evidence of
each part given all others, and its prior probability; and what may stand in its place.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.gap import limits
from automap.gap.candidates import Candidate, follows_time, twins_of
from automap.gap.evidence import Evidence, evidence, inflation, nats_of_parts
from automap.gap.linear import Conditional, Given, Linear, Part, conditional
from automap.gates import exceeds

Key = tuple[str, tuple[str, ...]]
"""A part by name and parameters, which hold in any layout."""
KEPT = 6
"""So many choices are kept with what was told beside them: those that a rival is compared with are
asked for again and again. Bounds the memory."""


@dataclass(frozen=True)
class Chosen:
    """Parts of candidates with the factors on their priors; the order is that of choice."""

    parts: tuple[tuple[str, Part, float], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the candidates, each once."""
        return tuple(dict.fromkeys(name for name, _, _ in self.parts))

    def given(self, linear: Linear, always: Given) -> Given:
        """All parts as what is given, beside what always is."""
        for _, part, scale in self.parts:
            always = always.joined(part, linear, scale)
        return always

    def without(self, name: str, part: Part | None = None) -> Chosen:
        """The same less one candidate, or less a part of it."""
        return Chosen(
            tuple(p for p in self.parts if p[0] != name or (part is not None and p[1] != part))
        )

    def joined(self, name: str, part: Part, scale: float) -> Chosen:
        """The same with one more part."""
        return Chosen((*self.parts, (name, part, scale)))

    def scale_of(self, name: str) -> float:
        """The largest factor on a candidate's priors."""
        return max(scale for n, _, scale in self.parts if n == name)


@dataclass(frozen=True)
class Move:
    """One part that a candidate may add: its evidence and log posterior odds."""

    name: str
    part: Part
    evidence: Evidence
    odds: float


@dataclass
class Selection:
    """A linear model, what may be missing from it, parts that stay out (``refused``), names that
    stay in (``needed``), and which of two the filter has found likelier (``outdone``, that one and
    the other); ``always`` columns that every choice has beside it; ``inflated`` by how much scores
    are larger than noise makes them, of what follows time and of all else."""

    linear: Linear
    candidates: dict[str, Candidate]
    refused: frozenset[Key] = frozenset()
    needed: frozenset[str] = frozenset()
    outdone: frozenset[tuple[str, str]] = frozenset()
    inflated: Mapping[bool, float] = field(default_factory=dict)
    always: Given = field(default_factory=Given)
    _known: dict[Given, Conditional] = field(default_factory=dict)

    def given(self, chosen: Chosen) -> Conditional:
        """The model with what is chosen marginalised."""
        key = chosen.given(self.linear, self.always)
        known = self._known.pop(key, None) or conditional(self.linear, key)
        # the one that was asked for last stays longest
        self._known[key] = known
        if len(self._known) > KEPT:
            del self._known[next(iter(self._known))]
        return known

    def given_in(self, chosen: Chosen, linear: Linear) -> Given:
        """A choice, and what is free beside it, in another linear model that has its columns."""
        layout = self.linear.layout
        place = {(c.effect, c.parameter): i for i, c in enumerate(linear.layout)}
        given = Given()
        for name, part, scale in chosen.parts:
            for columns, its_scale in ((part, scale), (self.candidates[name].beside, 1.0)):
                keys = [(layout[i].effect, layout[i].parameter) for i in columns]
                new = tuple(place[k] for k in keys if place[k] not in given.columns)
                given = given.joined(new, linear, its_scale)
        return given

    def without_rows(self) -> Selection:
        """What is asked of an earlier model: its layout, keys and priors. Rows take most room."""
        return Selection(replace(self.linear, rows=()), self.candidates)

    def inflate(self, chosen: Chosen) -> None:
        """Lower all evidence by what the candidates beside a choice say more than they should."""
        known = self.given(chosen)
        single = [
            (follows_time(c.terms), part[0])
            for c in self.candidates.values()
            for part in c.parts
            if c.choices == 1.0 and c.name not in chosen.names and len(part) == 1
        ]
        self.inflated = {
            course: inflation(known, np.array([i for slow, i in single if slow == course], int))
            for course in (False, True)
        }

    def evidence(self, known: Conditional, name: str, part: Part) -> Evidence:
        """Evidence of a part of a candidate, given too what is free beside it."""
        known = self.with_free(known, name)
        ratio = self.inflated.get(follows_time(self.candidates[name].terms), 1.0)
        if (part, ratio) not in known.told:
            known.told[part, ratio] = evidence(known, part, ratio)
        told: Evidence = known.told[part, ratio]
        return told

    def with_free(self, known: Conditional, name: str) -> Conditional:
        """The same model with what is free beside a candidate marginalised too."""
        beside = self.candidates[name].beside
        if not beside or set(beside) <= set(known.given.columns):
            return known
        return conditional(self.linear, known.given.joined(beside, self.linear, 1.0))

    def of_vehicle(self, chosen: Chosen, names: Collection[str]) -> bool:
        """Whether any of the candidates ``names`` of a choice acts on the vehicle constraint."""
        return any(self.linear.of_vehicle(part) for n, part, _ in chosen.parts if n in names)

    def sensors(self, chosen: Chosen, name: str) -> frozenset[int]:
        """On the readings of which sensors a candidate of a choice acts."""
        layout = self.linear.layout
        return frozenset(
            sensor
            for n, part, _ in chosen.parts
            for i in part
            for sensor in (layout[i].sensors if n == name else ())
        )

    def whole(self, chosen: Chosen) -> Chosen:
        """A choice with all parts of what acts on sensors in it."""
        its = {n: self.candidates[n].parts for n in chosen.names if self.sensors(chosen, n)}
        more = [
            (name, part, chosen.scale_of(name))
            for name, parts in its.items()
            for part in parts
            if all(part != own for _, own, _ in chosen.parts)
        ]
        return Chosen((*chosen.parts, *more))

    def key(self, name: str, part: Part) -> Key:
        """A part of a candidate by its parameters' names, which hold in other layouts too."""
        return name, tuple(self.linear.layout[i].parameter for i in part)

    def keys(self, chosen: Chosen) -> frozenset[Key]:
        """All parts of a choice by their parameters' names."""
        return frozenset(self.key(name, part) for name, part, _ in chosen.parts)

    def alike(self, chosen: Chosen) -> frozenset[Key]:
        """The parts of a choice, and courses of time that show much the same as one of these."""
        size = np.maximum(self.linear.sizes, 1e-300)
        out = set(self.keys(chosen))
        for name, part, _ in chosen.parts:
            if len(part) > 1 or not follows_time(self.candidates[name].terms):
                continue
            (i,) = part
            shown = self.linear.cross((i,))[0] ** 2
            near = set(np.flatnonzero(shown > limits.ALIKE * size[i] * size).tolist())
            out |= {
                self.key(c.name, its)
                for c in self.candidates.values()
                for its in c.parts
                if its[0] in near and len(its) == 1 and follows_time(c.terms)
            }
        return frozenset(out)

    def best(
        self,
        chosen: Chosen,
        names: Sequence[str] | None = None,
        least: float = 0.0,
        refused: frozenset[Key] | None = None,
    ) -> list[Move]:
        """The strongest parts beside what is chosen, best first, of the candidates ``names``, whose
        odds before correction are above ``least``; ``refused`` in place of the selection's own."""
        refused = self.refused if refused is None else refused
        known = self.given(chosen)
        its_names = chosen.names
        barred = twins_of(its_names)
        has = {part for _, part, _ in chosen.parts}
        shown = known.shown.tolist()
        gone = {name for name, _ in refused}
        every = self.candidates.values()
        asked = every if names is None else [c for n in names if (c := self.candidates.get(n))]
        open_to = [
            (c, part)
            for c in asked
            if c.name not in barred
            for part in c.parts
            if all(shown[i] for i in part)
            and part not in has
            and not (c.name in gone and self.key(c.name, part) in refused)
        ]
        prior = np.array(
            [(c.log_prior if c.name not in its_names else 0.0) + c.log_choice for c, _ in open_to]
        )
        nats = nats_of_parts(known, [part for _, part in open_to])
        for i, (c, part) in enumerate(open_to):
            if c.beside:
                nats[i] = nats_of_parts(self.with_free(known, c.name), [part])[0]
        out = []
        for i in np.argsort(-(nats + prior), kind="stable")[: limits.SHORTLIST]:
            candidate, part = open_to[i]
            if nats[i] + prior[i] <= least:
                break
            found = self.evidence(known, candidate.name, part)
            free = candidate.unless in its_names
            if candidate.positive and not free and found.estimate[0] <= 0.0:
                continue
            if candidate.isotropic and self._axes_differ(known, candidate, found.overdispersion):
                continue
            out.append(Move(candidate.name, part, found, found.nats + float(prior[i])))
        return sorted(out, key=lambda m: -m.odds)

    def _axes_differ(self, known: Conditional, candidate: Candidate, ratio: float) -> bool:
        """Whether the axes of a candidate contradict one another: what is much the same on all of
        them is then not what they show."""
        every = [i for part in candidate.parts for i in part if known.shows((i,))]
        if len(every) < 2:
            return False
        cov = np.linalg.inv(known.info(tuple(every)))
        values = cov @ known.score[every]
        mean = float(np.linalg.solve(cov, values).sum() / np.linalg.inv(cov).sum())
        cov = ratio * cov + (limits.ANISOTROPY * mean) ** 2 * np.eye(len(every))
        weight = np.linalg.inv(cov)
        apart = values - float((weight @ values).sum() / weight.sum())
        return exceeds(float(apart @ weight @ apart), len(every) - 1) < math.exp(-limits.LEAST_ODDS)

    def holds(self, move: Move) -> bool:
        """Whether a move's odds are high, and other stretches predict what it explains."""
        return move.odds >= limits.LEAST_ODDS and move.evidence.predicted_without_best > 0.0

    def suspected(self, chosen: Chosen) -> list[Move]:
        """The strongest parts beside a choice, best first, where it is a hundred to one that any of
        them is there: forms of one thing share what speaks for it, and none alone need be sure.

        All is lowered by what candidates say too much together, for noise that is not as modelled,
        but beside the likeliest: what is missing makes all that resemble it say more.
        """
        asked, moves = replace(self, inflated={}), list[Move]()
        for _ in range(2):
            moves = [
                m
                for m in asked.best(chosen)
                if m.name not in chosen.names
                and m.evidence.nats >= 0.0
                and m.evidence.predicted_without_best > 0.0
            ]
            if not moves:
                return []
            asked.inflate(chosen.joined(moves[0].name, moves[0].part, moves[0].evidence.scale))
        surely = np.logaddexp.reduce([m.odds for m in moves]) >= -math.log(limits.SUSPECTED)
        return moves if surely else []

    def log_prior(self, chosen: Chosen) -> float:
        """Logarithm of a choice's prior probability."""
        names = sum(self.candidates[name].log_prior for name in chosen.names)
        return names + sum(self.candidates[name].log_choice for name, _, _ in chosen.parts)

    def odds_of(self, chosen: Chosen, name: str) -> tuple[float, list[Move]]:
        """Log posterior odds of all parts of one candidate given the others, and its parts."""
        rest = chosen.without(name)
        moves: list[Move] = []
        for _, part, _ in (p for p in chosen.parts if p[0] == name):
            found = self.evidence(self.given(rest), name, part)
            candidate = self.candidates[name]
            prior = candidate.log_choice + (0.0 if moves else candidate.log_prior)
            moves.append(Move(name, part, found, found.nats + prior))
            rest = rest.joined(name, part, found.scale)
        return sum(m.odds for m in moves), moves

    def alone(self, rest: Chosen, name: str, part: Part) -> Move:
        """One part of a candidate beside a choice that has others of it."""
        found = self.evidence(self.given(rest), name, part)
        return Move(name, part, found, found.nats + self.candidates[name].log_choice)
