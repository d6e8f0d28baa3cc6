"""Whether what explains nothing on the whole does so under some condition.

A candidate of which a drive shows nothing may act all the same: with one sign here and with the
other there. So the score of every candidate's columns is cut where a condition changes: above some
speed, after some time, in a rhythm, by which way the car turned last. Where nothing is missing no
cut matters (fluctuations of scores as tests of parameter instability: Zeileis and Hornik,
Statistica Neerlandica 61 (2007), 488-508). Nothing is named by it; that something is missing, and
where, is told.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.fusion.layout import CHANNELS
from automap.gap import limits
from automap.gap.beside import Beside
from automap.gap.evidence import evidence, shown_by
from automap.gap.fit import Fit
from automap.gap.linear import (
    Column,
    Conditional,
    Given,
    Linear,
    NodeMotion,
    Part,
    conditional,
    node_motion,
)
from automap.gap.misfit import WHEN, Misfit
from automap.gap.motion import Motion, motion_of
from automap.gap.selection import Chosen, Selection
from automap.gap.slow import NUMBER, gain_shapes
from automap.gap.whitening import LOOSE, Rows, moments
from automap.records import FloatArray

ABOVE = {
    "above {:.3g} m/s": "speed",
    "above a pull of {:.2g} m/s^2": "acceleration",
    "above a turn rate of {:.2g} rad/s": "rate_z",
    "above {:.3g} deg C": "temperature",
}
"""What a car does and feels, with the words for more of it."""
LAST = {
    "by which way the car turned last": "play(heading, 0.1) - heading",
    "by whether it sped up or slowed down last": "play(speed, 1) - speed",
}
"""What has been, for all that hangs behind: turns by a tenth of a radian and changes of speed by
1 m/s are no sway of a body."""
PIECES = 8
"""Of a drive by each quantity, as many as a value is followed through in time."""
Columns = Callable[[Fit, Motion, NodeMotion, Collection[str]], list[Column]]
"""Columns of some candidates along a drive."""


@dataclass(frozen=True)
class Condition:
    """Something that may change what a candidate does: in words, and its courses as formulas."""

    words: str
    texts: tuple[str, ...]

    def along(self, at: NodeMotion, t: FloatArray) -> FloatArray:
        """Its courses at some instants [s, p] of a drive."""
        every = [at.there(parse_formula(text)(at.along)) for text in self.texts]
        return np.stack([np.interp(t, at.t, values) for values in every], axis=1)


def unstable(
    selection: Selection,
    chosen: Chosen,
    fits: Sequence[Fit],
    asked: Beside,
    columns: Columns,
    held_out: Sequence[Fit],
) -> tuple[Misfit, ...]:
    """The candidate of a ``selection`` that is likeliest to act under a condition beside what is
    ``chosen``, where a thousand to one speaks for it on the drives that were fitted, as for any
    name, and twenty to one on those held out, beside what is ``asked`` there."""
    known = selection.given(chosen)
    layout, given = known.linear.layout, known.given
    ats = [node_motion(fit, motion_of(fit.last)) for fit in fits]
    conditions = _conditions(ats)
    places = [i for i in range(len(layout)) if known.shows((i,)) and i not in given.columns]
    price = math.log(max(len(places) * len(conditions), 1)) - math.log(limits.OUTSIDE_LIBRARY)
    likely: list[tuple[float, Column, Condition, FloatArray, Misfit]] = []
    for number, i in _shortlist(known, places, ats, conditions):
        condition, column = conditions[number], layout[i]
        cut, part = _cut(known.linear, given, i, condition, ats)
        if not cut.shows(part):
            continue
        found = evidence(cut, part, asked.noise)
        odds = found.nats - price
        if odds < limits.LEAST_ODDS or found.predicted_without_best <= 0.0:
            continue
        what = column.effect if column.term[1] else f"{column.effect} {column.parameter}"
        channel, size = shown_by(cut, part)
        where = f"{what} {WHEN} {condition.words}"
        told = Misfit(CHANNELS[channel], WHEN, where, size, math.exp(-odds))
        likely.append((odds, column, condition, found.estimate, told))
    if not likely:
        return ()
    keys = {(column.effect, column.parameter) for _, column, _, _, _ in likely}

    def more(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
        every = columns(fit, motion, at, {effect for effect, _ in keys})
        return [c for c in every if (c.effect, c.parameter) in keys]

    other = asked.linear(held_out, more, may_act=False)
    place = {(c.effect, c.parameter): i for i, c in enumerate(other.layout)}
    beside = asked.selection.given_in(asked.chosen, other)
    others = [node_motion(fit, motion_of(fit.last)) for fit in held_out]
    borne_out: list[tuple[float, Misfit]] = []
    for odds, column, condition, estimate, told in likely:
        at = place.get((column.effect, column.parameter))
        if at is None or at in beside.columns:
            continue
        cut, part = _cut(other, beside, at, condition, others)
        gain = estimate @ cut.score[list(part)] - 0.5 * estimate @ cut.info(part) @ estimate
        if gain >= limits.CLOSE_NATS:
            borne_out.append((odds + float(gain), told))
    return tuple(told for _, told in sorted(borne_out, key=lambda one: -one[0])[:1])


def _conditions(ats: Sequence[NodeMotion]) -> list[Condition]:
    out = [Condition(words, (f"sign({text})",)) for words, text in LAST.items()]
    for words, text in ABOVE.items():
        every = np.concatenate([at.there(parse_formula(text)(at.along)) for at in ats])
        for edge in np.unique(np.quantile(every, np.arange(1, PIECES) / PIECES)):
            out.append(Condition(words.format(edge), (f"step({text} - ({edge:.6g}))",)))
    begin = min(float(at.along.time[0]) for at in ats)
    for shape in gain_shapes(begin, max(float(at.along.time[-1]) for at in ats)):
        last = NUMBER.findall(shape.texts[0])[-1]
        words = f"in periods of {last} s" if len(shape.texts) > 1 else f"about {last} s"
        out.append(Condition(words, shape.texts))
    return out


def _shortlist(
    known: Conditional,
    places: Sequence[int],
    ats: Sequence[NodeMotion],
    conditions: Sequence[Condition],
) -> list[tuple[int, int]]:
    """Numbers of conditions and columns whose scores a condition cuts most unevenly."""
    linear, given = known.linear, list(known.given.columns)
    counts = [len(c.texts) for c in conditions]
    first = np.cumsum([0, *counts[:-1]])
    sums = np.zeros((3, sum(counts), len(places)))
    whole = np.zeros((2, len(places)))
    for rows, at in zip(linear.rows, ats, strict=True):
        courses = np.concatenate([c.along(at, rows.t) for c in conditions], axis=1)
        own = rows.phi[:, places].astype(np.float64)
        w = rows.w
        if given:
            others = linear.columns(rows, given)
            own -= others @ known.weights[:, list(places)]
            w = w - others @ known.value
        heard = ~np.isin(rows.channel, LOOSE)
        for i, place in enumerate(places):
            if not linear.of_vehicle((place,)):
                own[:, i] *= heard
        score, info = own * w[:, None], own**2
        whole += score.sum(axis=0), info.sum(axis=0)
        sums += courses.T @ score, courses.T @ info, (courses**2).T @ info
    # what it does on the whole is no matter here
    mean = sums[1] / np.maximum(whole[1], 1e-300)
    score, info = sums[0] - mean * whole[0], sums[2] - mean * sums[1]
    shown = info > limits.LEAST_OWN * whole[1]
    each = np.where(shown, 0.5 * score**2 / np.maximum(info, 1e-300), 0.0)
    nats = np.add.reduceat(each, first, axis=0) - np.array(counts)[:, None]
    order = np.argsort(-nats, axis=None, kind="stable")[: limits.SHORTLIST]
    return [(int(n) // len(places), places[int(n) % len(places)]) for n in order]


def _cut(
    linear: Linear, given: Given, i: int, condition: Condition, ats: Sequence[NodeMotion]
) -> tuple[Conditional, Part]:
    """One column times the courses of a condition, beside what is given and itself.

    What the vehicle constraint says counts for what acts on the vehicle alone: a body sways against
    its path."""
    column, parts = linear.layout[i], []
    for rows, at in zip(linear.rows, ats, strict=True):
        own = linear.columns(rows, [i])
        phi = [linear.columns(rows, given.columns), own, own * condition.along(at, rows.t)]
        heard = linear.of_vehicle((i,)) | ~np.isin(rows.channel, LOOSE)
        every = np.concatenate(phi, axis=1) * heard[:, None]
        parts.append(Rows(rows.w * heard, every, rows.t, rows.channel))
    count, some = len(given.columns), len(condition.texts)
    layout = (*(linear.layout[k] for k in given.columns), *[column] * (1 + some))
    score, info = (sum(each) for each in zip(*map(moments, parts), strict=True))
    sds = np.array([*(linear.prior_sd[k] for k in given.columns), *[column.prior_sd] * (1 + some)])
    cut = Linear(layout, tuple(parts), None, score, info, sds, np.zeros(len(layout)))
    wide = max(limits.PRIOR_SCALES) * column.prior_sd
    before = Given((*range(count + 1),), (*given.prior_sd, wide))
    return conditional(cut, before), tuple(range(count + 1, count + 1 + some))
