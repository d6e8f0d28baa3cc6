"""Whether a named effect is constant, as it is told: does its value drift or step?

The columns of every parameter that acts are cut into blocks of time. What a block adds to a
constant is a candidate as any other, beside all that was found: a trend along the drive, what
settles, a step between two blocks, another value on a further drive. Fitted and held-out drives
have a say, for a value is told of both.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.effects import CATALOGUE
from automap.gap import limits
from automap.gap.beside import Beside
from automap.gap.evidence import Evidence, evidence
from automap.gap.fit import Fit
from automap.gap.linear import Column, Conditional, Direct, Linear, NodeMotion
from automap.gap.motion import Motion
from automap.gap.result import Drift
from automap.gates import exceeds
from automap.records import BoolArray, FloatArray

Key = tuple[str, str]
"""Effect and parameter."""
TREND, SETTLING, STEP, DRIVE = "trend", "settling", "step", "drive"
TESTED = 2
"""Changes that a constant is tested against, whatever the odds of all: a trend, and one between the
halves of the drive."""


def drifts(asked: Beside, fits: Sequence[Fit]) -> dict[str, Drift]:
    """The named effects of a choice that are likelier to change than not, and how the parameter
    changes that shows it most, by ``fits`` of all drives."""
    layout = asked.selection.linear.layout
    acting = [
        (layout[i].effect, layout[i].parameter)
        for name, part, _ in asked.chosen.parts
        if not asked.selection.candidates[name].terms
        for i in part
        # what is there or not, as the Earth's rotation is, has no value that changes
        if layout[i].parameter in _units(layout[i].effect)
    ]
    if not acting:
        return {}
    edges = _edges(fits)
    number = iter(range(len(fits)))

    def blocks(fit: Fit, motion: Motion, at: NodeMotion) -> list[Column]:
        drive = next(number)
        own = (c for c in asked.columns_of(fit, motion, at) if (c.effect, c.parameter) in acting)
        return [b for c in own for b in _blocks(c, fit, motion, at, edges, drive)]

    raw = asked.linear(fits, blocks, may_act=True)
    linear, shapes = _changes(raw, acting, edges, len(fits))
    known = asked.known(linear)
    found: dict[str, list[tuple[float, Drift]]] = {}
    half = float(edges[limits.DRIFT_BLOCKS // 2])
    unlikely: dict[str, list[tuple[float, Drift]]] = {}
    for i, ((effect, parameter), kind, at_s) in shapes.items():
        if not known.shows((i,)):
            continue
        told = evidence(known, (i,), asked.noise)
        # what one stretch alone says is no change that lasts
        nats = told.nats if told.predicted_without_best > 0.0 else min(told.nats, 0.0)
        change, sd = float(told.estimate[0]), float(told.sd[0])
        unit = _units(effect)[parameter]
        drift = Drift(parameter, kind, change, sd, unit, at_s, nats)
        found.setdefault(effect, []).append((nats, drift))
        if kind == TREND or (kind == STEP and at_s == half):
            chance = exceeds(_squared_sigmas(known, i, told), 1)
            unlikely.setdefault(effect, []).append((chance, drift))
    out = {}
    for effect, changes in found.items():
        # of all shapes together: nobody says beforehand which
        every = np.array([nats for nats, _ in changes])
        odds = float(np.logaddexp.reduce(every) - np.log(len(every)))
        odds += math.log(limits.OUTSIDE_LIBRARY)
        # a constant that the drive's halves contradict is none for being likely beforehand
        chance, drift = min(unlikely.get(effect, [(1.0, changes[0][1])]), key=lambda one: one[0])
        tests = TESTED * sum(key[0] == effect for key in acting)
        if odds > 0.0:
            drift = max(changes, key=lambda change: change[0])[1]
            out[effect] = replace(drift, sure=odds >= limits.LEAST_ODDS)
        elif tests * chance <= limits.SUSPECTED:
            out[effect] = drift
    return out


def _units(effect: str) -> dict[str, str]:
    return {p.name: p.unit for p in CATALOGUE[effect].parameters}


def _squared_sigmas(known: Conditional, i: int, told: Evidence) -> float:
    """Of what a column adds, by its own scatter from stretch to stretch."""
    return float(known.score[i] ** 2 / (known.diagonal[i] * told.overdispersion))


def _edges(fits: Sequence[Fit]) -> FloatArray:
    """Instants [b + 1] between blocks, s since the beginning of a drive."""
    begin = min(fit.opened.drive.begin_s for fit in fits)
    end = max(fit.opened.drive.begin_s + float(fit.last.nodes.t[-1]) for fit in fits)
    return np.linspace(begin, end, limits.DRIFT_BLOCKS + 1)


def _blocks(
    column: Column, fit: Fit, motion: Motion, at: NodeMotion, edges: FloatArray, drive: int
) -> Iterator[Column]:
    """A column in blocks of time of one drive, those that have anything of it."""
    begin = fit.opened.drive.begin_s
    place, nodes = (np.digitize(t + begin, edges[1:-1]) for t in (motion.t, at.t))
    for number in np.unique(place).tolist():
        yield _within(column, place == number, nodes == number, f"{drive} {number}")


def _within(column: Column, epochs: BoolArray, nodes: BoolArray, name: str) -> Column:
    inertial = tuple(replace(i, signal=i.signal * epochs) for i in column.inertial)
    direct = None
    if column.direct is not None:
        direct = Direct(column.direct.by_channel * nodes[:, None])
    parameter = f"{column.parameter} {name}"
    return replace(column, parameter=parameter, inertial=inertial, direct=direct)


def _changes(
    linear: Linear, acting: Sequence[Key], edges: FloatArray, drives: int
) -> tuple[Linear, dict[int, tuple[Key, str, float]]]:
    """The linear model with changes in place of blocks, and of each such column the effect and
    parameter, the kind of change, and the instant of a step, s."""
    raw = linear.layout
    plain = [i for i, c in enumerate(raw) if " " not in c.parameter]
    layout, mixing = [raw[i] for i in plain], [np.eye(len(raw))[i] for i in plain]
    shapes: dict[int, tuple[Key, str, float]] = {}
    middle = 0.5 * (edges[1:] + edges[:-1])
    along = (middle - edges[0]) / (edges[-1] - edges[0])
    # within a block's time, as what warms up or yields does: nothing quicker is seen
    settled = -np.expm1(-limits.DRIFT_BLOCKS * along)
    forms = [(TREND, along, 0.0), (SETTLING, settled, 0.0)]
    forms += [(STEP, (middle > e).astype(np.float64), float(e)) for e in edges[1:-1]]
    for effect, parameter in acting:
        mine = {
            tuple(map(int, c.parameter.split(" ")[1:])): i
            for i, c in enumerate(raw)
            if c.effect == effect and c.parameter.startswith(f"{parameter} ")
        }
        if not mine:
            continue
        of_drives = [(DRIVE, d) for d in range(1, drives)]
        every = [(k, {key: v[key[1]] for key in mine}, s) for k, v, s in forms]
        every += [(k, {key: float(key[0] == d) for key in mine}, float(d)) for k, d in of_drives]
        for kind, weights, at_s in every:
            mixed = np.zeros(len(raw))
            for key, weight in weights.items():
                mixed[mine[key]] = weight
            shapes[len(layout)] = ((effect, parameter), kind, at_s)
            one = raw[next(iter(mine.values()))]
            layout.append(replace(one, parameter=f"{parameter} {kind} {at_s:.1f}"))
            mixing.append(mixed)
    by = np.array(mixing).T
    score, info = by.T @ linear.score, by.T @ linear.info @ by
    values = np.concatenate([linear.values[plain], np.zeros(len(layout) - len(plain))])
    sds = np.array([c.prior_sd for c in layout])
    more = dict(layout=tuple(layout), mixing=by, score=score, info=info)
    return replace(linear, **more, prior_sd=sds, values=values), shapes
