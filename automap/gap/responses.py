"""What a channel does after a manoeuvre, at once or later, whatever the form of that.

A formula says how something follows what the car does. What rings, hangs behind, warms at rest or
comes back slowly follows it too, by no formula that was thought of. So what each channel makes of
each manoeuvre is left free: a response in steps of time that grow (a finite impulse response), all
steps of one a candidate. Nothing is named by them; that something is missing, and where, is told.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.effects.user import INERTIAL, OF_FIXES
from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.chance import strongest_by_chance
from automap.gap.columns import signal_column
from automap.gap.dictionary import WARM_MOUNT
from automap.gap.evidence import evidence, shown_by
from automap.gap.fit import Fit
from automap.gap.found import Beside
from automap.gap.linear import Column, Conditional, Part
from automap.gap.misfit import AFTER, Misfit
from automap.gap.nodes import NodeMotion
from automap.records import FloatArray

MANOEUVRES = {
    "halts": "step(1 - speed)",
    "changes of speed": "speed",
    "pulling and braking": "acceleration",
    "bends": "lateral_acceleration",
    "turns to one side": "tanh(rate_z / 0.02)",
    # what is odd in a quantity says nothing of what is even in it
    "pulling or braking": "abs(acceleration)",
    "bends to either side": "abs(lateral_acceleration)",
}
"""What a car does, as formulas say it."""
RESPOND = (*INERTIAL, *WARM_MOUNT, *OF_FIXES)
"""What may follow it: of how the unit sits what the drive tells."""
STEPS_S = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Edges of the steps of a response: from a filter's to what warms, each step twice as long as all
before, so that none is longer than what it is behind."""


@dataclass(frozen=True)
class Response:
    """What a channel does after a manoeuvre, by ``name``: log ``odds`` for it, the chance that any
    is as strong where nothing is missing, the filter's channel in which it shows most, the
    variance there, times modelled, and its steps [p]."""

    name: str
    odds: float
    p_value: float
    channel: int
    size: float
    steps: FloatArray


def responses(asked: Beside, fits: Sequence[Fit], held_out: Sequence[Fit]) -> tuple[Misfit, ...]:
    """The likeliest response beside a choice where a thousand to one speaks for it on the drives
    that were fitted, as for any name, and twenty to one more, on these or on those held out, which
    may be short but must not speak against it; else the one that chance makes least often, where
    it hardly does."""
    likeliest, rarest = strongest_responses(asked, fits)
    if likeliest is not None and likeliest.odds >= limits.LEAST_ODDS:
        gain = gain_of(likeliest, asked, held_out)
        if gain > 0.0 and likeliest.odds + gain >= limits.LEAST_ODDS + limits.CLOSE_NATS:
            return (_told(likeliest),)
    if rarest is not None and rarest.p_value <= limits.SUSPECTED:
        return (_told(rarest),)
    return ()


def _told(found: Response) -> Misfit:
    return Misfit(CHANNELS[found.channel], AFTER, found.name, found.size, found.p_value)


def strongest_responses(
    asked: Beside, fits: Sequence[Fit]
) -> tuple[Response | None, Response | None]:
    """Of all channels' responses to all manoeuvres the likeliest whose parts predict one another,
    and the one that chance makes least often by the drives' own scatter, which many stretches
    must show."""
    known = _known(asked, fits)
    parts = _parts(known)
    prior = math.log(limits.OUTSIDE_LIBRARY) - math.log(max(len(parts), 1))
    found = {name: evidence(known, part, asked.noise) for name, part in parts.items()}

    def told(name: str, odds: float, p: float) -> Response:
        return Response(name, odds, p, *shown_by(known, parts[name]), found[name].estimate)

    odds = {n: e.nats + prior for n, e in found.items() if e.predicted_without_best > 0.0}
    likeliest = max(odds, key=lambda name: odds[name], default=None)
    best = strongest_by_chance(known, list(parts.values()), limits.NULL_DRAWS)
    # by its odds no chance is more than one
    least = {name: min(math.exp(-value), 1.0) for name, value in odds.items()}
    return (
        None if likeliest is None else told(likeliest, odds[likeliest], least[likeliest]),
        None if best is None else told(list(parts)[best.number], best.nats, best.p_value),
    )


def gain_of(found: Response, asked: Beside, fits: Sequence[Fit]) -> float:
    """Nats by which other drives are likelier with a response as it was found."""
    known = _known(asked, fits, [found.name])
    part = _parts(known).get(found.name, ())
    if len(part) != len(found.steps):
        return 0.0
    along = found.steps @ known.score[list(part)]
    return float(along - 0.5 * found.steps @ known.info(part) @ found.steps)


def _known(asked: Beside, fits: Sequence[Fit], names: Collection[str] = ()) -> Conditional:
    """Fits made linear in all responses, or in those by ``names``, beside a choice."""

    def more(at: NodeMotion) -> list[Column]:
        return [c for c in response_columns(at) if not names or c.effect in names]

    return asked.known(asked.linear(fits, more, may_act=False))


def _parts(known: Conditional) -> dict[str, Part]:
    """The columns of each response that shows."""
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(known.linear.layout):
        if f" {AFTER} " in column.effect:
            groups.setdefault(column.effect, []).append(i)
    return {name: tuple(part) for name, part in groups.items() if known.shows(tuple(part))}


def response_columns(at: NodeMotion) -> list[Column]:
    """The steps of all responses along one drive; a manoeuvre that it does not have has none."""
    out = []
    for manoeuvre, text in MANOEUVRES.items():
        signal = parse_formula(text)(at.along)
        if not np.ptp(signal) > 0.0:
            continue
        steps = _steps(at.along.time, signal)
        for channel in RESPOND:
            name = f"{channel} {AFTER} {manoeuvre}"
            out += [
                signal_column((channel, text), step, at, name, f"k{i}")
                for i, step in enumerate(steps)
            ]
    return out


def _steps(t: FloatArray, signal: FloatArray) -> list[FloatArray]:
    """Means [n] of a signal [n] over the times before that STEPS_S bound; before the beginning it
    was as then."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * (signal[1:] + signal[:-1]) * np.diff(t))])
    sums = [np.interp(t - s, t, total) + np.minimum(t - s - t[0], 0.0) * signal[0] for s in STEPS_S]
    return [
        (later - earlier) / (stop - start)
        for (later, earlier), (start, stop) in zip(pairwise(sums), pairwise(STEPS_S), strict=True)
    ]
