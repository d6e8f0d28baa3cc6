"""What stands in no name, though the drives speak for it: candidates that were given up, and what
raised levels of noise have taken.

The filter or held-out data may refuse the likeliest candidate, for it need not be the truth; then
something is missing all the same. And noise that was fitted without an effect swallows it: so where
levels are higher than stated, candidates are judged under what was stated once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from automap.effects.catalogue import bias_walks
from automap.fusion.layout import CHANNELS
from automap.fusion.levels import RECEIVER_LEVELS
from automap.gap import limits
from automap.gap.candidates import is_course
from automap.gap.chance import p_value
from automap.gap.evidence import shown_by
from automap.gap.found import Found, in_layout
from automap.gap.misfit import LIKE, Misfit
from automap.gap.noise import INERTIAL_LEVELS, fitted_about, noise_score
from automap.gap.screening import Screening
from automap.gap.selection import Chosen, Selection
from automap.records import FloatArray

SWALLOW = ((tuple(bias_walks()), True), (INERTIAL_LEVELS, True), (RECEIVER_LEVELS, False))
"""Levels of noise that swallow effects, and whether they are sensors': drift, noise that adds up on
the way, errors that last."""


def given_up(found: Found, maxima: FloatArray) -> tuple[Misfit, ...]:
    """The likeliest candidate beside what was found that is as likely as a name and yet none."""
    return _likeliest(found.selection, found.chosen, maxima)


def in_noise(
    found: Found, screening: Screening, stated: Mapping[str, float], maxima: FloatArray
) -> tuple[Misfit, ...]:
    """The same under the noise as stated, kind by kind, where that was raised."""
    here = found.fitted
    fitted = here.model.factors
    for levels, of_sensors in SWALLOW:
        held = {k: stated[k] for k in levels if fitted[k] > limits.SCALE_FACTOR * stated[k]}
        if not held:
            continue
        factors = {**fitted, **held}
        # a path bends with its sensors' noise as with an effect: what explains less is no likelier
        least = noise_score(here.fits, fitted) - noise_score(here.fits, factors)
        least -= limits.OCCAM_NATS * len(held)
        model = replace(here.model, factors=factors)
        loud = screening.selection(fitted_about(model, here.estimate, here.fits), slow=False)
        chosen = in_layout(found.chosen, found.selection.linear.layout, loud)
        told = _likeliest(loud, chosen, maxima, least if of_sensors else 0.0)
        if told:
            return told
    return ()


def _likeliest(
    selection: Selection, chosen: Chosen, maxima: FloatArray, least: float = 0.0
) -> tuple[Misfit, ...]:
    # all evidence lowered by what candidates say too much together: noise that is not as modelled
    selection.inflate(chosen)
    for move in selection.best(chosen, refused=frozenset()):
        course = is_course(selection.candidates[move.name].terms)
        told = move.name in chosen.names or course or move.evidence.nats < least
        if told or not selection.holds(move):
            continue
        channel, size = shown_by(selection.given(chosen), move.part)
        p = p_value(move.evidence.nats, maxima)
        return (Misfit(CHANNELS[channel], LIKE, move.name, size, p),)
    return ()
