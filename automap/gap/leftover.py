"""What stands in no name, though the drives speak for it: candidates that were given up, and what
raised levels of noise have taken.

The filter or held-out data may refuse the likeliest candidate, for it need not be the truth; then
something is missing all the same. And noise that was fitted without an effect swallows it: so where
a level is claimed to be higher than stated, candidates are judged under what was stated once more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from automap.fusion.layout import CHANNELS
from automap.gap.candidates import is_course
from automap.gap.chance import p_value
from automap.gap.evidence import shown_by
from automap.gap.misfit import LIKE, Misfit
from automap.gap.noise import fitted_about
from automap.gap.result import NoiseClaim
from automap.gap.screening import Found, Screening, in_layout
from automap.gap.selection import Chosen, Selection
from automap.records import FloatArray


def given_up(found: Found, maxima: FloatArray) -> tuple[Misfit, ...]:
    """The likeliest candidate beside what was found that is as likely as a name and yet none."""
    return _likeliest(found.selection, found.chosen, maxima)


def in_noise(
    found: Found,
    screening: Screening,
    claims: Sequence[NoiseClaim],
    stated: Mapping[str, float],
    maxima: FloatArray,
) -> tuple[Misfit, ...]:
    """The same under the noise as stated, where levels are claimed to be higher."""
    if not claims:
        return ()
    here = found.fitted
    model = replace(here.model, factors=dict(stated))
    loud = screening.selection(fitted_about(model, here.estimate, here.fits), slow=False)
    chosen = in_layout(found.chosen, found.selection.linear.layout, loud)
    return _likeliest(loud, chosen, maxima)


def _likeliest(selection: Selection, chosen: Chosen, maxima: FloatArray) -> tuple[Misfit, ...]:
    # all evidence lowered by what candidates say too much together: noise that is not as modelled
    selection.inflate(chosen)
    for move in selection.best(chosen, refused=frozenset()):
        course = is_course(selection.candidates[move.name].terms)
        if move.name in chosen.names or course or not selection.holds(move):
            continue
        channel, size = shown_by(selection.given(chosen), move.part)
        p = p_value(move.evidence.nats, maxima)
        return (Misfit(CHANNELS[channel], LIKE, move.name, size, p),)
    return ()
