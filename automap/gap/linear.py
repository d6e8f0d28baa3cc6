"""A fitted model made linear: how every candidate would show in its innovations.

A candidate's columns say how it acts, on the readings of an axis or on measurements themselves;
the filter's own gains turn that into what its innovations would show of a unit of each. About a
fit the innovations w are linear in the parameters of all candidates: w = phi theta + noise.
Effects that the fit has already count from zero again: what their values explain is given back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from automap.effects.signals import Signals, signals_of
from automap.effects.user import INERTIAL, towards, turned
from automap.frames import quat_to_matrix
from automap.fusion.problem import LateChange
from automap.gap import limits
from automap.gap.fit import Fit, whitened_innovations
from automap.gap.kernels import propagate_columns
from automap.gap.mixing import Mixing
from automap.gap.motion import (
    LEANS,
    Motion,
    Then,
    at_times,
    late_change,
    leaning,
    motion_of,
    swings,
    then_of,
)
from automap.gap.stretches import Frame
from automap.gap.whitening import LOOSE, Rows, moments, times, whitened_rows
from automap.records import BoolArray, FloatArray, IntArray

BATCH = 96
"""Columns carried through the filter together: their rows stay in the processor's cache."""
Part = tuple[int, ...]
"""Columns that act together."""
Side = tuple[BoolArray, Frame]
"""Which rows [s], and their frame."""


@dataclass(frozen=True)
class Inertial:
    """Adds ``signal`` [n], ``times`` another where there is one, times the parameter to an axis of
    a sensor (0 gyro, 1 accelerometer)."""

    sensor: int
    axis: int
    signal: FloatArray | BoolArray
    times: FloatArray | None = None

    @classmethod
    def on(cls, channel: str, signal: FloatArray | BoolArray) -> Inertial:
        """On a channel by its name."""
        return cls(*divmod(INERTIAL.index(channel), 3), signal)


@dataclass(frozen=True)
class Direct:
    """Adds ``by_channel`` [k, 15] times the parameter to the nodes' measurements."""

    by_channel: FloatArray


@dataclass(frozen=True)
class Column:
    """One parameter of a candidate: how it acts, and its prior sd; channel and text of a formula's
    ``term``, out of how many ``choices`` it was the likeliest, whether it acts on the vehicle
    constraint itself, ``of_vehicle``, what its axis mostly measures, ``mean_input``, and on the
    readings of which ``sensors`` it acts."""

    effect: str
    parameter: str
    prior_sd: float
    inertial: tuple[Inertial, ...] = ()
    direct: Direct | None = None
    term: tuple[str, str] = ("", "")
    choices: float = 1.0
    of_vehicle: bool = False
    mean_input: float = 0.0
    sensors: frozenset[int] = frozenset()

    def in_layout(self) -> Column:
        """The same without how it acts, which is as long as the drive."""
        loose = self.direct is not None and bool(self.direct.by_channel[:, LOOSE].any())
        sensors = frozenset(acts.sensor for acts in self.inertial)
        return replace(self, inertial=(), direct=None, of_vehicle=loose, sensors=sensors)


@dataclass(frozen=True)
class NodeMotion:
    """The motion at the nodes of a ``fit``: velocity, acceleration NED, ``dcm`` body to NED, rate
    in body axes without the noise of single readings; ``signals`` the quantities of formulas there,
    ``along`` these, and ``motion``, at the epochs of the IMU; ``units`` of effects what a unit of
    each parameter adds to the channels [k, 15], and what effects of the library but some have
    ``said`` of readings, where that was asked before."""

    fit: Fit
    motion: Motion
    t: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray
    signals: Signals
    along: Signals
    units: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    said: dict[frozenset[str], dict[str, FloatArray]] = field(default_factory=dict)

    @cached_property
    def late(self) -> LateChange | None:
        """By how much late velocities change otherwise than those at their tag."""
        swing = swings(self.motion)
        return late_change(self.motion, self.motion.acc, self.fit.delays, swing)

    @cached_property
    def then(self) -> Then:
        """Which instants the velocities with a tag at each epoch are of."""
        return then_of(self.motion, self.fit.delays)

    @cached_property
    def late_readings(self) -> dict[str, FloatArray]:
        """What readings show more [n] for each second that their stamps are late, by the names of
        what they change by."""
        ones = np.ones(len(self.along.time))
        parts = [part.turned for part in towards("imu_time")]
        return {part: turned(ones, part, self.along) for part in parts}

    def there(self, values: FloatArray) -> FloatArray:
        """What is known along the drive [n] at the nodes [k], as the filter takes it: a formula may
        remember what was in between."""
        return np.interp(self.signals.time, self.along.time, values)


def node_motion(fit: Fit, motion: Motion) -> NodeMotion:
    """The smoothed motion at the nodes of a fit."""
    nominal = fit.last.smooth.nominal
    t = fit.last.nodes.t
    rate = at_times(motion, motion.calm, t)
    acc = at_times(motion, motion.acc, t)
    along = motion_signals(fit, motion)
    signals, dcm = along.at(t + fit.opened.drive.begin_s), quat_to_matrix(nominal[:, 6:10])
    return NodeMotion(fit, motion, t, nominal[:, 3:6].copy(), acc, dcm, rate, signals, along)


def motions_of(fits: Sequence[Fit]) -> list[NodeMotion]:
    """The smoothed motion of each fit."""
    return [node_motion(fit, motion_of(fit.last)) for fit in fits]


def motion_signals(fit: Fit, motion: Motion) -> Signals:
    """Quantities [n] at the epochs of the motion."""
    drive = fit.opened.drive
    heading = np.unwrap(np.arctan2(motion.dcm[:, 1, 0], motion.dcm[:, 0, 0]))
    along = np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc)
    time = motion.t + drive.begin_s
    temp = drive.imu.temp_c
    return signals_of(time, motion.vel, heading, along, motion.rate, motion.force, temp)


@dataclass(frozen=True)
class Linear:
    """All drives: ``layout`` [v] the candidates' columns, score [v], prior sds [v] and the values
    [v] that the fit has of them; ``info`` [c, c] the information of the ``rows``' columns, of which
    they are made by ``mixing``, the same where that is None."""

    layout: tuple[Column, ...]
    rows: tuple[Rows, ...]
    mixing: Mixing | None
    score: FloatArray
    info: FloatArray
    prior_sd: FloatArray
    values: FloatArray

    @cached_property
    def frame(self) -> Frame:
        """Of which instants the rows of all drives are, one after the other."""
        t, channel = (np.concatenate([getattr(r, k) for r in self.rows]) for k in ("t", "channel"))
        return Frame(
            t, np.repeat(np.arange(len(self.rows)), [len(r.w) for r in self.rows]), channel
        )

    @cached_property
    def sides(self) -> tuple[Side, Side]:
        """The rows of the vehicle constraint, and all others."""
        loose = np.isin(self.frame.channel, LOOSE)
        return (loose, self.frame.some(loose)), (~loose, self.frame.some(~loose))

    def of_vehicle(self, at: Sequence[int]) -> bool:
        """Whether candidates' columns act on the vehicle constraint itself."""
        return any(self.layout[i].of_vehicle for i in at)

    def columns(self, rows: Rows, at: Sequence[int]) -> FloatArray:
        """Rows [s, k] of the candidates' columns ``at`` along one drive."""
        if self.mixing is None:
            return rows.phi.T[list(at)].T.astype(np.float64)
        mixing = self.mixing.matrix(at, rows.phi.shape[1])
        used = np.flatnonzero(mixing.any(axis=1))
        return np.asarray(rows.phi.T[used].T.astype(np.float64) @ mixing[used], np.float64)

    @cached_property
    def _within(self) -> tuple[FloatArray, ...]:
        """Information [n, n] of each group of columns."""
        return () if self.mixing is None else self.mixing.within(self.info)

    @cached_property
    def sizes(self) -> FloatArray:
        """Information [v] of each column by itself."""
        if self.mixing is None:
            return np.diag(self.info).copy()
        out = np.zeros(self.mixing.count)
        for group, own in zip(self.mixing.groups, self._within, strict=True):
            out[group.columns] = np.diag(own)
        return out

    def cross(self, at: Sequence[int] | IntArray) -> FloatArray:
        """Information [k, v] between some columns and all."""
        half = self.of_rows(at)
        return half if self.mixing is None else self.mixing.of(half)

    def of_rows(self, at: Sequence[int] | IntArray) -> FloatArray:
        """Information [k, c] between some columns and the rows' own."""
        if self.mixing is None:
            return np.asarray(self.info[list(at)])
        return self.mixing.half(self.info, np.array(at, np.int64))

    def pairs(self, parts: IntArray) -> FloatArray:
        """Information [k, p, p] of parts [k, p]."""
        if self.mixing is None:
            return np.asarray(self.info[parts[:, :, None], parts[:, None, :]])
        return self.mixing.pairs(self.info, self._within, parts)


ColumnsOf = Callable[[NodeMotion], Sequence[Column]]


def linearised(
    along: Sequence[NodeMotion],
    columns_of: ColumnsOf,
    values: Mapping[str, Mapping[str, float]],
    may_act: bool = True,
) -> Linear:
    """Fits ``along`` whose motion to ask, with effects held at ``values``, made linear in all
    columns, of which more than those ``may_act``."""
    layout: list[Column] = []
    place: dict[tuple[str, str], int] = {}
    raw: list[Rows] = []
    used: list[list[int]] = []
    lasts = [at.fit.last for at in along]
    for at in along:
        rows_of_drive, columns = _raw(at, columns_of)
        raw.append(rows_of_drive)
        for column in columns:
            key = (column.effect, column.parameter)
            if key not in place:
                place[key] = len(layout)
                layout.append(column)
        used.append([place[(c.effect, c.parameter)] for c in columns])
    # a motion is as long as the drive
    del along, at
    known = np.array([values.get(c.effect, {}).get(c.parameter, 0.0) for c in layout])
    sds = np.array([c.prior_sd for c in layout])
    raw = [_laid_out(r, own, known) for r, own in zip(raw, used, strict=True)]
    rows = whitened_rows(raw, known, sds, may_act)
    del raw
    score, info = (sum(each) for each in zip(*map(moments, rows), strict=True))
    if LEANS in place:
        row = place[LEANS]
        for lean, var in map(leaning, lasts):
            score[row] += lean / var
            info[row, row] += 1.0 / var
    return Linear(tuple(layout), rows, None, score, info, sds, known)


def _raw(at: NodeMotion, columns_of: ColumnsOf) -> tuple[Rows, list[Column]]:
    """Innovations over their sds with their sensitivities to the columns of one drive, and these
    as a layout has them."""
    columns = columns_of(at)
    whitened, t, channel = whitened_innovations(at.fit)
    phi: FloatArray = np.zeros((len(whitened), len(columns)), np.float32, "F")
    for start in range(0, len(columns), BATCH):
        part = slice(start, start + BATCH)
        phi[:, part] = sensitivities(at.fit, at.motion, columns[part])
    return Rows(whitened, phi, t, channel), [c.in_layout() for c in columns]


def _laid_out(rows: Rows, at: Sequence[int], known: FloatArray) -> Rows:
    """Rows whose columns stand where a layout has them, ``at``, with all effects left out."""
    phi = rows.phi
    if list(at) != list(range(len(known))):
        phi = np.zeros((len(phi), len(known)), np.float32, "F")
        phi[:, at] = rows.phi
    return replace(rows, w=rows.w + times(phi, known), phi=phi)


def sensitivities(fit: Fit, motion: Motion, columns: Sequence[Column]) -> FloatArray:
    """Whitened sensitivity [s, c] of the fit's scalars to the columns' parameters."""
    inertial = [i for i, c in enumerate(columns) if c.direct is None]
    direct = [i for i, c in enumerate(columns) if c.direct is not None]
    order = inertial + direct
    signals: list[FloatArray | BoolArray] = []
    index: dict[int, int] = {}
    terms: list[tuple[int, int, int, int, int]] = []
    for place, i in enumerate(order):
        for part in columns[i].inertial:
            for signal in (part.signal, part.times):
                if signal is not None and id(signal) not in index:
                    index[id(signal)] = len(signals)
                    signals.append(signal)
            factor = -1 if part.times is None else index[id(part.times)]
            terms.append((place, part.sensor, part.axis, index[id(part.signal)], factor))
    last = fit.last
    store = last.forward.store
    total = len(store.nu)
    node, channel = store.info[:, 0], store.info[:, 1]
    acting = np.zeros((total, len(direct)))
    for place, i in enumerate(direct):
        acts = columns[i].direct
        assert acts is not None
        acting[:, place] = acts.by_channel[node, channel]
    n = len(motion.t)
    table: IntArray = np.array(terms, dtype=np.int64).reshape(-1, 5)
    out = np.zeros((total, len(order)))
    propagate_columns(
        motion.t,
        motion.force,
        np.ascontiguousarray(motion.dcm),
        np.ascontiguousarray(np.stack(signals, axis=1, dtype=np.float64))
        if signals
        else np.zeros((n, 1)),
        table,
        last.nodes.t,
        store.trans,
        last.problem.model.tau,
        last.nodes.wander_keep,
        last.problem.model.kept,
        store.scalars,
        store.h,
        store.gain,
        store.var,
        acting,
        out,
    )
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return np.asarray(out[:, back])


@dataclass(frozen=True)
class Given:
    """What is in the model beside a candidate: its columns and their prior sds."""

    columns: tuple[int, ...] = ()
    prior_sd: tuple[float, ...] = ()

    def joined(self, part: Part, linear: Linear, scale: float) -> Given:
        """The same with one more part."""
        sds = tuple(float(scale * linear.prior_sd[i]) for i in part)
        return Given((*self.columns, *part), (*self.prior_sd, *sds))


@dataclass(frozen=True)
class Conditional:
    """Scores [v] and information of all columns with those given marginalised; ``weights`` [q, v]
    of the given ones in each, ``cross`` [q, v] their information with each, ``value`` [q] their
    estimate; ``told`` what was asked of parts before."""

    given: Given
    score: FloatArray
    diagonal: FloatArray
    weights: FloatArray
    cross: FloatArray
    value: FloatArray
    linear: Linear
    told: dict[tuple[Part, float], Any] = field(default_factory=dict)

    @cached_property
    def shown(self) -> BoolArray:
        """Which columns [v] have something of their own beside what is given: what is left of
        nearly the same is what a linear model has wrong of either."""
        return np.asarray(self.diagonal > limits.LEAST_OWN * self.linear.sizes)

    @cached_property
    def left(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Of each drive the columns [s, q] of what is given, and its rows [s] less what these
        explain."""
        out = []
        for rows in self.linear.rows:
            others = self.linear.columns(rows, self.given.columns)
            out.append((others, rows.w - others @ self.value if self.given.columns else rows.w))
        return tuple(out)

    def shows(self, part: Part) -> bool:
        """Whether all columns of a part have something of their own."""
        return bool(self.shown[list(part)].all())

    def info(self, part: Part) -> FloatArray:
        """Information [p, p] of a part."""
        rows = list(part)
        full = self.linear.pairs(np.array([rows]))[0]
        return np.asarray(full - self.cross[:, rows].T @ self.weights[:, rows])

    def infos(self, parts: IntArray) -> FloatArray:
        """The same [k, p, p] of many parts [k, p]."""
        taken = np.einsum("qkp,qkr->kpr", self.cross[:, parts], self.weights[:, parts])
        return np.asarray(self.linear.pairs(parts) - taken)

    def shared(self, columns: IntArray) -> float:
        """Sum of the squared correlations between the scores of all pairs of columns [k]."""
        info, size = self.of_rows(), 1.0 / self.diagonal[columns]
        if self.linear.mixing is None:
            return float(size @ info[np.ix_(columns, columns)] ** 2 @ size)
        # of columns M of what the rows have, of information I: trace((I M D M')^2)
        mixed = info @ self.linear.mixing.outer(columns, size, len(info))
        return float(np.sum(mixed * mixed.T))

    def of_rows(self) -> FloatArray:
        """Information [c, c] of the rows' own columns with what is given marginalised."""
        info, given = self.linear.info, list(self.given.columns)
        if not given:
            return info
        taken = self.linear.of_rows(given)
        inner = self.cross[:, given] + np.diag(np.array(self.given.prior_sd) ** -2.0)
        return np.asarray(info - taken.T @ np.linalg.solve(inner, taken))


def conditional(linear: Linear, given: Given) -> Conditional:
    """Marginalise what is given."""
    at = list(given.columns)
    if not at:
        none = np.zeros((0, len(linear.score)))
        return Conditional(given, linear.score, linear.sizes, none, none, np.zeros(0), linear)
    cross = linear.cross(at)
    inner = cross[:, at] + np.diag(np.array(given.prior_sd) ** -2.0)
    weights = np.asarray(np.linalg.solve(inner, cross), np.float64)
    value = np.asarray(np.linalg.solve(inner, linear.score[at]), np.float64)
    score = linear.score - weights.T @ linear.score[at]
    diagonal = linear.sizes - np.einsum("qv,qv->v", cross, weights)
    return Conditional(given, score, np.maximum(diagonal, 0.0), weights, cross, value, linear)
