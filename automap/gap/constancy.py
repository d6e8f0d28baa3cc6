"""Whether a value that is told as one number is one.

Every named effect is told as a constant. So the columns of every parameter that acts are cut into
blocks of time, and of what else it may go with: speed, turns, changes of speed, temperature. What a
block adds to a constant is a candidate as any other, beside all that was found: a trend, what
settles, a step between two blocks, another value on a further drive. Fitted and held-out drives
have a say, for a value is told of both.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from automap.effects import CATALOGUE
from automap.gap import limits
from automap.gap.columns import named_columns
from automap.gap.evidence import Evidence, evidence
from automap.gap.fit import ORIGIN, Fit
from automap.gap.found import Beside
from automap.gap.linear import Column, Conditional, Direct, Linear
from automap.gap.mixing import Group, Mixing
from automap.gap.nodes import NodeMotion
from automap.gap.noise_conditions import Condition, Course, courses_of
from automap.gap.result import Drift
from automap.gates import exceeds
from automap.records import BoolArray, FloatArray

TIME, TREND, SETTLING, STEP, DRIVE = "time", "trend", "settling", "step", "drive"
ALONG = {
    TIME: ("over the drive", "as it settles"),
    "speed": ("from rest to the highest speed", "as the car begins to roll"),
    "turn": ("from none to the quickest turns", "as turns begin"),
    "acceleration": ("from none to the hardest changes of speed", "as speeds begin to change"),
    "temperature": ("from cold to warm", "as it begins to warm"),
}
"""A trend and what settles along the quantities that a value may go with, in words."""


def drifts(asked: Beside, fits: Sequence[Fit], estimated: Collection[str] = ()) -> dict[str, Drift]:
    """The named effects of a choice that are likelier to change than not, and how the parameter
    changes that shows it most, by ``fits`` of all drives; of effects that these have ``estimated``
    on each drive anew too, which their filters keep as constant as it is."""
    layout = asked.selection.linear.layout
    acting = [
        (layout[i].effect, layout[i].parameter)
        for name, part, _ in asked.chosen.parts
        if not asked.selection.candidates[name].terms
        # with a clock's rate what it was off by, which may jump
        for i in (*part, *asked.selection.candidates[name].beside)
        # what is there or not, as the Earth's rotation is, has no value that changes
        if layout[i].parameter in _units(layout[i].effect)
    ]
    acting += [(effect, parameter) for effect in estimated for parameter in _units(effect)]
    if not acting:
        return {}
    courses = [courses_of(fit) for fit in fits]
    edges = _edges(courses)
    number = iter(range(len(fits)))

    def blocks(at: NodeMotion) -> list[Column]:
        drive = next(number)
        every = (*asked.columns_of(at), *named_columns(list(estimated), at))
        own = [c for c in every if (c.effect, c.parameter) in acting]
        return [b for c in own for b in _blocks(c, at, courses[drive], edges, drive)]

    raw = asked.linear(fits, blocks, may_act=True)
    linear, shapes = _changes(raw, acting, edges, len(fits))
    known = asked.known(linear)
    found: dict[str, list[Drift]] = {}
    unlikely: dict[str, list[tuple[float, Drift]]] = {}
    for i, (effect, drift) in shapes.items():
        if not known.shows((i,)):
            continue
        told = evidence(known, (i,), asked.noise)
        # what one stretch alone says is no change that lasts
        nats = told.nats if told.predicted_without_best > 0.0 else min(told.nats, 0.0)
        change, sd = float(told.estimate[0]), float(told.sd[0])
        drift = replace(drift, change=change, sd=sd, evidence_nats=nats)
        found.setdefault(effect, []).append(drift)
        half = edges[drift.quantity][limits.DRIFT_BLOCKS // 2]
        if drift.kind == TREND or (drift.kind == STEP and drift.at == half):
            chance = exceeds(_squared_sigmas(known, i, told), 1)
            unlikely.setdefault(effect, []).append((chance, drift))
    out = {}
    for effect, changes in found.items():
        # of all shapes together: nobody says beforehand which
        every = np.array([one.evidence_nats for one in changes])
        odds = float(np.logaddexp.reduce(every) - np.log(len(every)))
        odds += math.log(limits.OUTSIDE_LIBRARY)
        # a constant that halves of the drive contradict is none for being likely beforehand
        tests = unlikely.get(effect, [])
        chance, drift = min(tests, key=lambda one: one[0], default=(1.0, changes[0]))
        if odds > 0.0:
            drift = max(changes, key=lambda one: one.evidence_nats)
            out[effect] = replace(drift, sure=odds >= limits.LEAST_ODDS)
        elif len(tests) * chance <= limits.SUSPECTED:
            out[effect] = drift
    return out


def _units(effect: str) -> dict[str, str]:
    known = CATALOGUE[effect]
    units = {p.name: p.unit for p in known.parameters}
    if known.unknown_epoch:
        units[ORIGIN] = CATALOGUE[known.unknown_epoch].parameters[0].unit
    return units


def _squared_sigmas(known: Conditional, i: int, told: Evidence) -> float:
    """Of what a column adds, by its own scatter from stretch to stretch."""
    return float(known.score[i] ** 2 / (known.diagonal[i] * told.overdispersion))


def _edges(courses: Sequence[Course]) -> dict[str, FloatArray]:
    """Values [b + 1] between blocks of each quantity that has more than one, from its least to its
    largest."""
    out = {}
    for quantity in ALONG:
        every = np.concatenate([of[quantity] for _, of in courses])
        low, high = float(every.min()), float(every.max())
        if low < high:
            out[quantity] = np.linspace(low, high, limits.DRIFT_BLOCKS + 1)
    return out


def _blocks(
    column: Column, at: NodeMotion, course: Course, edges: Mapping[str, FloatArray], drive: int
) -> Iterator[Column]:
    """A column in blocks of each quantity along one drive, those that have anything of it."""
    t, values = course
    for quantity, ends in edges.items():
        along = values[quantity], np.interp(at.t, t, values[quantity])
        place, nodes = (np.digitize(v, ends[1:-1]) for v in along)
        for number in np.unique(place).tolist():
            name = f"{quantity} {drive} {number}"
            yield _within(column, place == number, nodes == number, name)


def _within(column: Column, epochs: BoolArray, nodes: BoolArray, name: str) -> Column:
    inertial = tuple(replace(i, signal=i.signal * epochs) for i in column.inertial)
    direct = None
    if column.direct is not None:
        direct = Direct(column.direct.by_channel * nodes[:, None])
    parameter = f"{column.parameter} {name}"
    return replace(column, parameter=parameter, inertial=inertial, direct=direct)


def _changes(
    linear: Linear, acting: Sequence[tuple[str, str]], edges: Mapping[str, FloatArray], drives: int
) -> tuple[Linear, dict[int, tuple[str, Drift]]]:
    """The linear model with changes in place of blocks, and of each such column the effect, and the
    change without its size."""
    raw = linear.layout
    plain = [i for i, c in enumerate(raw) if " " not in c.parameter]
    layout, mixing = [raw[i] for i in plain], [np.eye(len(raw))[i] for i in plain]
    shapes: dict[int, tuple[str, Drift]] = {}
    for (effect, parameter), (quantity, ends) in product(acting, edges.items()):
        start = f"{parameter} {quantity} "
        mine = {
            tuple(map(int, c.parameter.removeprefix(start).split())): i
            for i, c in enumerate(raw)
            if c.effect == effect and c.parameter.startswith(start)
        }
        if not mine:
            continue
        unit = _units(effect)[parameter]
        for kind, weights, value, when in _forms(quantity, ends, drives):
            if kind == DRIVE and parameter == ORIGIN:
                # of a clock every drive has its own offset
                continue
            mixed = np.zeros(len(raw))
            for (drive, block), i in mine.items():
                mixed[i] = weights[drive, block]
            drift = Drift(parameter, kind, 0.0, 0.0, unit, quantity, value, when, 0.0)
            shapes[len(layout)] = effect, drift
            name = f"{parameter} {kind} {quantity} {value:.4g}"
            layout.append(replace(raw[next(iter(mine.values()))], parameter=name))
            mixing.append(mixed)
    group = Group(np.arange(len(raw)), np.arange(len(layout)), np.array(mixing).T)
    made = Mixing((group,), len(layout))
    score = made.of(linear.score)
    values = np.concatenate([linear.values[plain], np.zeros(len(layout) - len(plain))])
    sds = np.array([c.prior_sd for c in layout])
    linear = replace(linear, layout=tuple(layout), mixing=made, score=score)
    return replace(linear, prior_sd=sds, values=values), shapes


def _forms(
    quantity: str, edges: FloatArray, drives: int
) -> Iterator[tuple[str, FloatArray, float, str]]:
    """Kinds of change along a quantity, what each adds in blocks [drives, b] between ``edges``, the
    value where a step is, and where it changes in words."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    along = (middle - edges[0]) / (edges[-1] - edges[0])
    everywhere = np.ones((drives, 1))
    trend, settling = ALONG[quantity]
    yield TREND, everywhere * along, 0.0, trend
    # within a block, as what warms up or yields does: nothing quicker is seen
    yield SETTLING, everywhere * -np.expm1(-limits.DRIFT_BLOCKS * along), 0.0, settling
    for edge in edges[1:-1].tolist():
        where = str(Condition(quantity, edge, math.inf))
        yield STEP, everywhere * (middle > edge), edge, where
    for drive in range(1, drives) if quantity == TIME else ():
        one = np.eye(drives)[drive][:, None] * np.ones(len(middle))
        yield DRIVE, one, float(drive), "from one drive to another"
