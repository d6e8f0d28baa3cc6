"""Screening: a fit made linear in all candidates, again and again with what was found.

What a search knows of its candidates is here: the library without what the model has, the
dictionary, courses of time that were refined, and which effect stands for which candidate.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from automap.gap.candidates import candidates_of, library, named_columns
from automap.gap.columns import Column, NodeMotion
from automap.gap.dictionary import equation, formula_columns, formula_texts, warm
from automap.gap.evidence import Given, conditional, plain_nats
from automap.gap.fit import Fit, fit_drive, motion_of
from automap.gap.fitted import Fitted, Log
from automap.gap.formulas import effect_for
from automap.gap.linear import linearised
from automap.gap.motion import Motion
from automap.gap.motion_signals import motion_signals
from automap.gap.selection import Chosen, Selection
from automap.gap.slow import box_columns, is_course, term_columns, variants, with_shapes

Terms = tuple[tuple[str, str], ...]
ON = {"on": 1.0}


class Screening:
    """Candidates of drives whose base model is fitted; ``exclude`` effects that the library does
    without. ``effects`` the name of the effect that stands for a candidate in the filter."""

    def __init__(self, base: Fitted, exclude: Collection[str], log: Log) -> None:
        self.base, self.exclude, self.log = base, frozenset(exclude), log
        self.effects: dict[str, str] = {}
        self.courses: dict[str, Terms] = {}
        self.names = self._library()
        self.options = base.model.options
        fit = base.fits[0]
        self.texts = formula_texts(motion_signals(fit, motion_of(fit.last)), warm(fit))

    def selection(self, here: Fitted, slow: bool) -> Selection:
        """The fit made linear, and its candidates; ``slow``: courses of time among them."""
        values = here.values()
        # what was held may act beside what is found
        options = self.options
        carried = replace(here.model, values={**here.model.values, **values}, options=options)
        fits = [fit_drive(f.opened, carried, linearised_at=f) for f in here.fits]
        by_effect = {effect: name for name, effect in self.effects.items()}
        # what has no parameters is there
        known = {by_effect.get(e, e): v or ON for e, v in values.items()}

        def columns(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
            boxes = box_columns(fit, motion) if slow else []
            return self._columns(fit, motion, at) + boxes

        linear = linearised(fits, columns, known)
        linear = with_shapes(linear) if slow else linear
        candidates = candidates_of(linear.layout, self.names)
        return Selection(linear, {c.name: c for c in candidates})

    def refined(self, here: Fitted, selection: Selection, chosen: Chosen) -> Chosen:
        """The choice with the periods, instants and time constants that fit best."""
        length = float(here.fits[0].last.problem.t[-1])
        for name in chosen.names:
            candidate = selection.candidates[name]
            finer = variants(candidate.terms, length) if is_course(candidate.terms) else []
            if not finer or name in self.courses:
                continue
            self.log(f"refining {name}")
            rest = [n for n in chosen.names if n != name]
            best = self._likeliest(here, rest, [candidate.terms, *finer])
            self.courses[equation(best)] = best
            selection.candidates[equation(best)] = replace(
                candidate, name=equation(best), terms=best
            )
            chosen = Chosen(
                tuple(
                    (equation(best) if n == name else n, part, scale)
                    for n, part, scale in chosen.parts
                )
            )
        return chosen

    def estimate(self, selection: Selection, chosen: Chosen) -> dict[str, float]:
        """What the filter is to estimate of a choice: effect -> factor on its prior sds."""
        out = {}
        for name in chosen.names:
            self.effects[name] = effect_for(selection.candidates[name], selection.linear)
            out[self.effects[name]] = chosen.scale_of(name)
        return out

    def _library(self) -> list[str]:
        included = set(self.base.model.included) | self.exclude
        drives = [fit.opened for fit in self.base.fits]
        for opened in drives:
            if opened.drive.mounting_sd.any():
                included |= {"imu_mounting"}
            if opened.drive.delay.sd > 0.02:
                # a free offset between the clocks is the same thing
                included |= {"gnss_latency"}
        has_wheels = any(d.session.odometer is not None for d in drives)
        return library(frozenset(included), has_wheels, self.base.model.options.earth_rotation)

    def _likeliest(self, here: Fitted, rest: Collection[str], tried: Sequence[Terms]) -> Terms:
        """The course of time that explains most beside the effects ``rest``."""

        def columns(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
            out = self._columns(fit, motion, at)
            kept = [c for c in out if c.effect in rest]
            return kept + [c for terms in tried for c in term_columns(fit, motion, terms)]

        linear = linearised(here.fits, columns, {})
        parts: dict[str, list[int]] = {}
        given = Given()
        for i, column in enumerate(linear.layout):
            if column.effect in rest:
                given = given.joined((i,), linear, 1.0)
            else:
                parts.setdefault(column.effect, []).append(i)
        known = conditional(linear, given)
        best = max(parts.values(), key=lambda part: plain_nats(known, tuple(part))[0])
        return tuple(linear.layout[i].term for i in best)

    def _columns(self, fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
        out = named_columns(self.names, fit, motion, at)
        out += formula_columns(fit, motion, at, self.texts, self.exclude)
        for terms in self.courses.values():
            out += term_columns(fit, motion, terms)
        return out


def in_layout(chosen: Chosen, old: Selection, new: Selection) -> Chosen:
    """A choice with the columns of another layout; what that does not have is left out."""
    place = {(c.effect, c.parameter): i for i, c in enumerate(new.linear.layout)}
    parts = []
    for name, part, scale in chosen.parts:
        candidate = new.candidates.get(name)
        if candidate is None:
            continue
        if candidate.terms:
            parts.append((name, candidate.parts[0], scale))
            continue
        columns = [old.linear.layout[i] for i in part]
        rows = tuple(
            place[(c.effect, c.parameter)] for c in columns if (c.effect, c.parameter) in place
        )
        if len(rows) == len(part):
            parts.append((name, rows, scale))
    return Chosen(tuple(parts))
