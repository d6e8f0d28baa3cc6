"""Screening: a fit made linear in all candidates, again and again with what was found.

What a search knows of its candidates is here: the library without what the model has, the
dictionary, courses of time that were refined, and which effect stands for which candidate.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from automap.effects import CATALOGUE
from automap.fusion.delay_states import LATENCY_STATE
from automap.fusion.options import FusionOptions
from automap.gap import limits
from automap.gap.candidates import candidates_of, library
from automap.gap.columns import named_columns, term_columns
from automap.gap.dictionary import formula_columns, formula_terms, warm
from automap.gap.fit import CONSTANTS, ORIGIN, SKEW, Fit, fit_drive
from automap.gap.forms import About, ranked
from automap.gap.formula_effects import effect_for, left_out_columns
from automap.gap.joint import Joint, estimate_nats
from automap.gap.linear import Column, Part
from automap.gap.motion import motion_of
from automap.gap.neighbours import Terms
from automap.gap.nodes import NodeMotion, motion_signals, motions_of, node_motion
from automap.gap.noise import Fitted, Log, fitted_about
from automap.gap.result import equation
from automap.gap.selection import Chosen, Key, Selection
from automap.gap.sensitivity import ColumnsOf, linearised
from automap.gap.slow import box_columns, lasts, variants, with_shapes
from automap.records import FloatArray

ON = {"on": 1.0}
HELD = 1e-6
"""Share of its prior sd that is left to a parameter that is not to act."""


class Screening:
    """Candidates of drives whose base model is fitted; ``exclude`` effects that the library does
    without. ``effects`` the name of the effect that stands for a candidate in the filter."""

    def __init__(self, base: Fitted, exclude: Collection[str], log: Log) -> None:
        self.base, self.exclude, self.log = base, frozenset(exclude), log
        self.effects: dict[str, str] = {}
        self.refinements: dict[str, tuple[Column, ...]] = {}
        self._seeds: dict[str, str] = {}
        self._held_at: tuple[Fitted, list[NodeMotion], dict[str, dict[str, float]]] | None = None
        self.names = self._library()
        self.options = base.model.options
        fit = base.fits[0]
        self.signals = motion_signals(fit, motion_of(fit.last))
        self.dictionary = formula_terms(self.signals, warm(fit))

    def selection(
        self, here: Fitted, slow: bool, may_act: bool = True, more: Sequence[str] = ()
    ) -> Selection:
        """The fit made linear, and its candidates, of which more than those fitted ``may_act``;
        ``slow``: courses of time among them, and ``more``: effects that every model has, but not
        this one."""
        self._held_at = None
        fits, known = self._held(here, more)

        def columns(at: NodeMotion) -> Iterator[Column]:
            yield from named_columns(more, at)
            yield from self.columns(at)
            if slow:
                yield from box_columns(at)

        linear = linearised(motions_of(fits), columns, known, may_act)
        linear = with_shapes(linear) if slow else linear
        candidates = candidates_of(linear.layout, [*self.names, *more])
        return Selection(linear, {c.name: c for c in candidates})

    def _held(
        self, here: Fitted, fewer: Collection[str] = ()
    ) -> tuple[list[Fit], dict[str, dict[str, float]]]:
        """The fits with what they estimate held at its values, and these by candidates' names;
        without the effects ``fewer`` that every model has."""
        values, options = self._with_constant(here, here.values())
        options = replace(options, effects=tuple(e for e in options.effects if e not in fewer))
        # what was held may act beside what is found
        carried = replace(here.model, values={**here.model.values, **values}, options=options)
        fits = [fit_drive(f.opened, carried, linearised_at=f) for f in here.fits]
        by_effect = {effect: name for name, effect in self.effects.items()}
        # what has no parameters is there
        return fits, {by_effect.get(e, e): v or ON for e, v in values.items()}

    def _with_constant(
        self, here: Fitted, values: dict[str, dict[str, float]]
    ) -> tuple[dict[str, dict[str, float]], FusionOptions]:
        """Values with what a clock that runs fast was off by when the drive began, and the options
        under which that is no longer free: it is a name's to say. Several drives have each their
        own, which stays free where no name is that of all."""
        named = any(name in values for name in CONSTANTS)
        alone = len(here.fits) == 1 and CONSTANTS[1] in self.names
        if SKEW not in values or not (named or alone):
            return values, self.options
        if not named:
            found = here.fits[0].last.totals()[LATENCY_STATE]
            values = {**values, CONSTANTS[1]: {"s": found}}
        held = {SKEW: {ORIGIN: HELD}}
        return values, replace(self.options, prior_sd=_joined(self.options.prior_sd, held))

    def refined(
        self, here: Fitted, selection: Selection, chosen: Chosen
    ) -> tuple[Chosen, list[Key]]:
        """The choice with the periods, instants and time constants that fit best, but for what is
        too brief then to be seen, and the keys of that."""
        length = float(here.fits[0].last.problem.t[-1])
        brief: list[Key] = []
        for name in chosen.names:
            candidate = selection.candidates[name]
            finer = variants(candidate.terms, length)
            if not finer or name in self.refinements:
                continue
            self.log(f"refining {name}")
            about = self.about(here, [n for n in chosen.names if n != name])
            best = ranked(about, [candidate.terms, *finer])[0]
            if lasts(best, length):
                chosen = self.in_form(here, selection, chosen, name, best, 1.0)
            else:
                brief += [selection.key(n, part) for n, part, _ in chosen.parts if n == name]
                chosen = chosen.without(name)
        return chosen, brief

    def seed(self, name: str) -> str:
        """The formula that a candidate is another form of, itself where it is none."""
        return self._seeds.get(name, name)

    def about(self, here: Fitted, rest: Collection[str]) -> About:
        """What formulas are asked about: a fit, and the effects ``rest`` beside them."""
        if self._held_at is None or self._held_at[0] is not here:
            fits, known = self._held(here)
            self._held_at = here, motions_of(fits), known
        _, along, known = self._held_at

        def of(tried: Sequence[Terms]) -> ColumnsOf:
            single = [terms[0] for terms in tried if len(terms) == 1]
            asked = {equation(terms) for terms in tried}

            def columns(at: NodeMotion) -> Iterator[Column]:
                yield from self.columns(at, {*rest, *known} - asked)
                yield from formula_columns(at, single, self.exclude)
                for terms in tried:
                    if len(terms) > 1:
                        yield from term_columns(at, terms)

            return columns

        return About(along, known, rest, of)

    def in_form(
        self,
        here: Fitted,
        selection: Selection,
        chosen: Chosen,
        name: str,
        terms: Terms,
        choices: float,
    ) -> Chosen:
        """The choice with a formula in another form, which is a candidate from then on."""
        finer = equation(terms)
        motion = motion_of(here.fits[0].last)
        at = node_motion(here.fits[0], motion)
        columns = tuple(c.in_layout() for c in term_columns(at, terms, choices))
        self.refinements[finer] = columns
        if finer != name:
            self._seeds[finer] = self.seed(name)
        its = selection.candidates[name]
        part = its.parts[0][: len(terms)]
        prior = its.log_prior + math.log(its.choices / choices)
        selection.candidates[finer] = replace(
            its, name=finer, parts=(part,), terms=terms, log_prior=prior, choices=choices
        )
        return Chosen(tuple((finer, part, p[2]) if p[0] == name else p for p in chosen.parts))

    def _prior_sds(self, selection: Selection, name: str, columns: Sequence[int]) -> FloatArray:
        """Prior sds [p] of the parameters of a candidate in these columns: those of a formula are
        of the form that it has got."""
        if name in self.refinements:
            return np.array([c.prior_sd for c in self.refinements[name]])
        return selection.linear.prior_sd[list(columns)]

    def estimate(self, selection: Selection, chosen: Chosen) -> dict[str, float]:
        """What the filter is to estimate of a choice: effect -> factor on its prior sds."""
        out = {}
        for name in chosen.names:
            candidate = selection.candidates[name]
            sds = self._prior_sds(selection, name, candidate.parts[0])
            self.effects[name] = effect_for(candidate, sds)
            out[self.effects[name]] = chosen.scale_of(name)
        return out

    def states(self, here: Fitted, selection: Selection, chosen: Chosen) -> Fitted:
        """The chosen set as states under the noise as it is, begun about the path as it is.
        Parameters of its effects that do not act are held at nothing."""
        estimate = self.estimate(selection, chosen)
        held: dict[str, dict[str, float]] = {}
        for name in chosen.names:
            effect = self.effects[name]
            acting = {
                selection.linear.layout[i].parameter
                for n, part, _ in chosen.parts
                for i in part
                if n == name
            }
            own = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
            if not selection.candidates[name].terms:
                held[effect] = {p: HELD * sd for p, sd in own.items() if p not in acting}
        options = self.options
        options = replace(options, prior_sd=_joined(options.prior_sd, held))
        model = replace(here.model, options=options)
        return fitted_about(model, estimate, here.fits)

    def not_borne_out(self, here: Fitted, selection: Selection, chosen: Chosen) -> list[str]:
        """Candidates whose values as the filter finds them are worth less than a name, or larger
        than any such effect is: the screening looks at what changes quickly too, and there the
        vehicle sways. The least first, and the others where that one is nothing: of two that do
        nearly the same neither is worth much beside the other."""
        joint, left = here.joint(), list(chosen.names)
        out: list[str] = []
        while True:
            worth = {n: self._worth(joint, selection, chosen, n) for n in left}
            weakest = min(left, key=lambda n: worth[n], default="")
            if not weakest or worth[weakest] >= limits.LEAST_ODDS:
                return out
            out.append(weakest)
            left.remove(weakest)
            joint = joint.without(self.effects[weakest])

    def _worth(self, joint: Joint, selection: Selection, chosen: Chosen, name: str) -> float:
        """Log odds of a candidate by its values in a joint estimate."""
        candidate = selection.candidates[name]
        rows, columns = self.rows(joint, selection, chosen, name)
        if not rows:
            return np.inf
        most = limits.ONE_IN_A_THOUSAND * max(limits.PRIOR_SCALES)
        usual = self._prior_sds(selection, name, columns)
        values = joint.values[rows]
        below = candidate.positive and candidate.unless not in chosen.names and values[0] <= 0.0
        if below or (not candidate.terms and (np.abs(values) > most * usual).any()):
            # a delay of ten seconds is none, nor a dead zone below nothing: it is something else
            return -np.inf
        acting = self.acting(joint, selection, chosen, name)
        idle = tuple(p for p in chosen.parts if p[0] == name and p not in acting.parts)
        act = self.nats(joint, selection, chosen, name)
        act -= self.nats(joint, selection, chosen, name, idle)
        its = sum(p[0] == name for p in acting.parts)
        return act + candidate.log_prior + its * candidate.log_choice

    def rows(
        self, joint: Joint, selection: Selection, chosen: Chosen, name: str
    ) -> tuple[list[int], list[int]]:
        """Rows in a joint estimate of the parameters of a candidate that act, and their columns."""
        columns = [i for n, part, _ in chosen.parts if n == name for i in part]
        acting = {selection.linear.layout[i].parameter: i for i in columns}
        own = self.effects[name]
        rows = [i for i, (e, p) in enumerate(joint.names) if e == own and p in acting]
        return rows, [acting[joint.names[i][1]] for i in rows]

    def acting(self, joint: Joint, selection: Selection, chosen: Chosen, name: str) -> Chosen:
        """A choice without those parts of a named effect that are nothing by its values in a joint
        estimate; the terms of a formula act together."""
        if selection.candidates[name].terms:
            return chosen
        least = -selection.candidates[name].log_choice
        act = [
            part[0] != name or self.nats(joint, selection, chosen, name, (part,)) >= least
            for part in chosen.parts
        ]
        return Chosen(tuple(part for part, acts in zip(chosen.parts, act, strict=True) if acts))

    def nats(
        self,
        joint: Joint,
        selection: Selection,
        chosen: Chosen,
        name: str,
        parts: Sequence[tuple[str, Part, float]] | None = None,
    ) -> float:
        """What a candidate's values as the filter finds them are worth against nothing, or those of
        some ``parts`` of it."""
        own = chosen if parts is None else Chosen(tuple(parts))
        rows, columns = self.rows(joint, selection, own, name)
        if not rows:
            return 0.0
        sds = chosen.scale_of(name) * self._prior_sds(selection, name, columns)
        return estimate_nats(joint.values[rows], joint.cov[np.ix_(rows, rows)], sds)

    def _library(self) -> list[str]:
        included = set(self.base.model.included) | self.exclude
        drives = [fit.opened for fit in self.base.fits]
        for opened in drives:
            if opened.drive.mounting_sd.any():
                included |= {"imu_mounting"}
            if opened.drive.delay.sd > limits.FREE_DELAY_S:
                # a free offset between the clocks is the same thing
                included |= {"gnss_latency"}
        has_wheels = any(d.session.odometer is not None for d in drives)
        return library(frozenset(included), has_wheels, self.base.model.options.earth_rotation)

    def columns(self, at: NodeMotion, wanted: Collection[str] | None = None) -> Iterator[Column]:
        """Columns of one drive, of all candidates or of those ``wanted``, one by one: how each acts
        is as long as the drive."""
        names, formulas = self.names, self.dictionary
        if wanted is not None:
            names = [name for name in names if name in wanted]
            formulas = [term for term in formulas if equation([term]) in wanted]
        refined = (
            term_columns(at, [c.term for c in known], known[0].choices)
            for known in self.refinements.values()
        )
        every = chain(
            named_columns(names, at),
            formula_columns(at, formulas, self.exclude),
            left_out_columns(at, self.exclude),
            chain.from_iterable(refined),
        )
        return (c for c in every if wanted is None or c.effect in wanted)


def _joined(
    known: Mapping[str, Mapping[str, float]], more: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    return {e: {**known.get(e, {}), **more.get(e, {})} for e in {**known, **more}}
