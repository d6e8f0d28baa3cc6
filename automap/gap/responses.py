"""What a channel does after a manoeuvre, at once or later, whatever the form of that.

A formula says how something follows what the car does. What rings, hangs behind, warms at rest or
comes back slowly follows it too, by no formula that was thought of. So what each channel makes of
each manoeuvre is left free: a response in steps of time that grow (a finite impulse response), all
steps of one a candidate. Nothing is named by them; that something is missing, and where, is told.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.effects.user import INERTIAL, OF_FIXES
from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.candidates import signal_column
from automap.gap.chance import strongest_by_chance
from automap.gap.evidence import evidence, shown_by
from automap.gap.fit import Fit, Values
from automap.gap.linear import Column, NodeMotion, conditional, linearised
from automap.gap.misfit import AFTER, Misfit
from automap.gap.motion import Motion
from automap.gap.selection import Chosen, Selection
from automap.records import FloatArray

MANOEUVRES = {
    "halts": "step(1 - speed)",
    "changes of speed": "speed",
    "pulling and braking": "acceleration",
    "bends": "lateral_acceleration",
    "turns to one side": "tanh(rate_z / 0.02)",
}
"""What a car does, as formulas say it."""
STEPS_S = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Edges of the steps of a response: from a filter's to what warms, each step twice as long as all
before, so that none is longer than what it is behind."""
ColumnsOf = Callable[[Fit, Motion, NodeMotion], list[Column]]


@dataclass(frozen=True)
class Response:
    """What a channel does after a manoeuvre, by ``name``: log ``odds`` for it, the chance that any
    is as strong where nothing is missing, the filter's channel in which it shows most, and the
    variance there, times modelled."""

    name: str
    odds: float
    p_value: float
    channel: int
    size: float


def responses(
    selection: Selection, chosen: Chosen, columns_of: ColumnsOf, fits: Sequence[Fit], values: Values
) -> tuple[Misfit, ...]:
    """The strongest response beside a choice that a thousand to one speaks for, as for any name,
    else the strongest that chance hardly makes; ``columns_of``, ``fits``, ``values`` as of
    ``strongest_responses``."""
    likeliest, rarest = strongest_responses(selection, chosen, columns_of, fits, values)
    if likeliest is not None and likeliest.odds >= limits.LEAST_ODDS:
        found, p = likeliest, math.exp(-likeliest.odds)
    elif rarest is not None and rarest.p_value <= limits.SUSPECTED:
        found, p = rarest, rarest.p_value
    else:
        return ()
    return (Misfit(CHANNELS[found.channel], AFTER, found.name, found.size, p),)


def strongest_responses(
    selection: Selection, chosen: Chosen, columns_of: ColumnsOf, fits: Sequence[Fit], values: Values
) -> tuple[Response | None, Response | None]:
    """Of all channels' responses to all manoeuvres the likeliest whose parts predict one another,
    and the one that chance makes least often by the drives' own scatter, which many stretches
    must show.

    ``columns_of`` the columns of the choice along a drive, ``fits`` of the fitted drives with its
    effects held at ``values``.
    """

    def columns(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
        return columns_of(fit, motion, at) + response_columns(at)

    linear = linearised(fits, columns, values, may_act=False)
    groups: dict[str, list[int]] = {}
    for i, column in enumerate(linear.layout):
        if f" {AFTER} " in column.effect:
            groups.setdefault(column.effect, []).append(i)
    known = conditional(linear, selection.given_in(chosen, linear))
    parts = {name: tuple(part) for name, part in groups.items() if known.shows(tuple(part))}
    prior = math.log(limits.OUTSIDE_LIBRARY) - math.log(max(len(parts), 1))
    noise = selection.inflated.get(False, 1.0)

    def told(name: str, odds: float, p: float) -> Response:
        return Response(name, odds, p, *shown_by(known, parts[name]))

    odds = {}
    for name, part in parts.items():
        found = evidence(known, part, noise)
        if found.predicted_without_best > 0.0:
            odds[name] = found.nats + prior
    likeliest = max(odds, key=lambda name: odds[name], default=None)
    best = strongest_by_chance(known, list(parts.values()), limits.NULL_DRAWS)
    names = list(parts)
    return (
        None if likeliest is None else told(likeliest, odds[likeliest], math.exp(-odds[likeliest])),
        None if best is None else told(names[best.number], best.nats, best.p_value),
    )


def response_columns(at: NodeMotion) -> list[Column]:
    """The steps of all responses along one drive; a manoeuvre that it does not have has none."""
    out = []
    for manoeuvre, text in MANOEUVRES.items():
        signal = parse_formula(text)(at.along)
        if not np.ptp(signal) > 0.0:
            continue
        steps = _steps(at.along.time, signal)
        for channel in (*INERTIAL, *OF_FIXES):
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
