"""Whether what is named is all that there is: what speaks for something like it, but not for it,
and what stands in no name though the drives speak for it.

The likeliest of the names that are known is told though none may be the truth. It is in doubt where
a formula that is not told apart from it explains more, where held-out data are no likelier with it,
where what it explains is of another size in some stretches than in others, or where its value
drifts or steps: one number is then not what the drive shows (``constancy``). The filter or held-out
data may refuse the likeliest candidate, and noise that was fitted without an effect swallows it: so
where levels are higher than stated, candidates are judged under what was stated once more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.effects.catalogue import bias_walks
from automap.effects.user import INSTALLED
from automap.fusion.layout import CHANNELS
from automap.fusion.levels import RECEIVER_LEVELS
from automap.gap import limits
from automap.gap.candidates import follows_time, is_course, twins_of
from automap.gap.chance import strongest_by_chance
from automap.gap.evidence import shown_by
from automap.gap.fit import Values
from automap.gap.found import Found, in_layout
from automap.gap.misfit import LIKE, Misfit
from automap.gap.neighbours import Terms
from automap.gap.noise import INERTIAL_LEVELS, Fitted, fitted_about, noise_score
from automap.gap.reading_steps import cut_off
from automap.gap.result import Drift, Refused
from automap.gap.screening import Screening
from automap.gap.selection import Chosen, Selection
from automap.gap.stepwise import rivals, told_apart

SWALLOW = ((tuple(bias_walks()), True), (INERTIAL_LEVELS, True), (RECEIVER_LEVELS, False))
"""Levels of noise that swallow effects, and whether they are sensors': drift, noise that adds up on
the way, errors that last."""


def doubts(found: Found, values: Values, drifting: Mapping[str, Drift]) -> dict[str, str]:
    """What the named effects of a search that stand with ``values`` may be instead, those about
    which there is doubt; ``drifting`` those that are not constant."""
    out = {}
    for name in found.chosen.names:
        if found.selection.candidates[name].terms or name not in values:
            continue
        # without held-out data these have said nothing
        gain = found.stands.gains.get(name, np.inf)
        told = str(drifting.get(name, "")) or cut_off(found.fitted.fits, name, found.full.of(name))
        told = told or found.resembling.get(name, "")
        out[name] = told or doubt(found.selection, found.chosen, name, gain)
    return out


def doubt(selection: Selection, chosen: Chosen, name: str, gain: float) -> str:
    """What speaks for something like a named effect, but not for it, in words; nothing mostly.
    ``gain`` nats by which held-out data are likelier with it."""
    if gain <= 0.0:
        return "something else, for held-out data are no likelier with it"
    return formula_in_place(selection, chosen, name)


def formula_in_place(selection: Selection, chosen: Chosen, name: str) -> str:
    """The formula that explains most in the place of a named effect, and more than that one does,
    where the two are not told apart; nothing where none does."""
    # a course of what the name says by a constant is nearly that; whether it is one is asked below
    formulas = [
        c.name
        for c in selection.candidates.values()
        if c.terms and not (follows_time(c.terms) and _of_a_constant(c.terms))
    ]
    best, instead = 0.0, ""
    for rival in rivals(selection, chosen, name, formulas, frozenset()):
        if rival.name in chosen.names:
            continue
        # evidence alone: that formulas are seldom the truth is what is asked here
        ahead = rival.ahead - selection.log_prior(rival.chosen) + selection.log_prior(chosen)
        if ahead > best and not told_apart(selection, rival, chosen, name):
            best, instead = ahead, rival.name
    return instead


def doubt_of_usual(found: Found, screening: Screening, bare: Fitted, effect: str) -> str:
    """The same of an effect that every model has, by a fit that is ``bare`` of it: what every model
    has swallows what goes with the speed nearly as that does."""
    selection = screening.selection(bare, slow=False, more=[effect])
    chosen = in_layout(found.chosen, found.selection.linear.layout, selection)
    (part,) = selection.candidates[effect].parts
    scale = selection.evidence(selection.given(chosen), effect, part).scale
    return formula_in_place(selection, chosen.joined(effect, part, scale), effect)


def _of_a_constant(terms: Terms) -> bool:
    """Whether a course of time is one of a gain, or of how unit and antenna sit."""
    return not is_course(terms) or terms[0][0] in INSTALLED


def strongest_refused(found: Found) -> tuple[Refused, ...]:
    """The strongest candidate that is not named, and how likely chance makes one as strong."""
    selection = found.nothing_else
    return strongest_beside(
        selection, in_layout(found.chosen, found.selection.linear.layout, selection)
    )


def strongest_beside(selection: Selection, chosen: Chosen) -> tuple[Refused, ...]:
    """The same of a selection in which nothing else acts than what is chosen."""
    known, has = selection.given(chosen), {part for _, part, _ in chosen.parts}
    barred = twins_of(chosen.names)
    # the likeliest of many is not drawn anew: its chance would be told too small
    left = [
        (c.name, part)
        for c in selection.candidates.values()
        if c.choices == 1.0 and c.name not in barred
        for part in c.parts
        if part not in has
    ]
    best = strongest_by_chance(known, [part for _, part in left], limits.NULL_DRAWS)
    if best is None:
        return ()
    name, part = left[best.number]
    channel, size = shown_by(best.known, part)
    return (Refused(name, best.nats, best.p_value, channel, size),)


def suspected(refused: Sequence[Refused]) -> tuple[Misfit, ...]:
    """Candidates that were not named and yet no chance, each of which was the strongest under a
    noise of its own (Bonferroni): something is missing, whatever it is."""
    chances = [min(1.0, len(refused) * one.p_value) for one in refused]
    return tuple(
        Misfit(CHANNELS[one.channel], LIKE, one.effect, one.size, p)
        for one, p in zip(refused, chances, strict=True)
        if p <= limits.SUSPECTED
    )


def in_noise(
    found: Found, screening: Screening, stated: Mapping[str, float]
) -> tuple[Refused, ...]:
    """The strongest candidate that is not named under the noise as stated, kind by kind, where that
    was raised; of sensors' noise no chance where the noise that was raised explains more."""
    here, out = found.fitted, list[Refused]()
    fitted = here.model.factors
    for levels, of_sensors in SWALLOW:
        held = {k: stated[k] for k in levels if fitted[k] > limits.SCALE_FACTOR * stated[k]}
        if not held:
            continue
        factors = {**fitted, **held}
        model = replace(here.model, factors=factors)
        louder = fitted_about(model, here.estimate, here.fits)
        loud = screening.selection(louder, slow=False, may_act=False)
        # a path bends with its sensors' noise as with an effect: what explains less is no likelier
        least = noise_score(here.fits, fitted) - noise_score(here.fits, factors)
        least -= limits.OCCAM_NATS * len(held)
        for one in strongest_beside(
            loud, in_layout(found.chosen, found.selection.linear.layout, loud)
        ):
            no_likelier = of_sensors and one.evidence_nats < least
            out.append(replace(one, p_value=1.0) if no_likelier else one)
    return tuple(out)
