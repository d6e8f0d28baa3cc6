"""A fitted model made linear: how every candidate would show in its innovations.

A candidate's columns say how it acts, on the readings of an axis or on measurements themselves;
the filter's own gains turn that into what its innovations would show of a unit of each. About a
fit the innovations w are linear in the parameters of all candidates: w = phi theta + noise.
Effects that the fit has already count from zero again: what their values explain is given back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects.user import INERTIAL
from automap.frames import quat_to_matrix
from automap.fusion.steady_rate import steady_rate
from automap.gap.fit import Fit, whitened_innovations
from automap.gap.kernels import propagate_columns
from automap.gap.limits import HUBER, LEAST_OWN
from automap.gap.motion import Motion, at_times, motion_of
from automap.gap.whitening import LOOSE, MIN_SPREAD, fit_whitener, white_rows
from automap.gates import sd_by_median
from automap.records import FloatArray, IntArray

BATCH = 96
"""Columns carried through the filter together: their rows stay in the processor's cache."""
PASSES = 3
"""Of weights that the residuals decide: they have settled then."""
STRETCH = 2048
"""Rows that are multiplied together in double precision; bounds the memory."""


@dataclass(frozen=True)
class Inertial:
    """Adds ``signal`` [n] times the parameter to an axis of a sensor (0 gyro, 1 accelerometer)."""

    sensor: int
    axis: int
    signal: FloatArray

    @classmethod
    def on(cls, channel: str, signal: FloatArray) -> Inertial:
        """On a channel by its name."""
        return cls(*divmod(INERTIAL.index(channel), 3), signal)


@dataclass(frozen=True)
class Direct:
    """Adds ``by_channel`` [k, 15] times the parameter to the nodes' measurements."""

    by_channel: FloatArray


@dataclass(frozen=True)
class Column:
    """One parameter of a candidate: how it acts, and its prior sd; channel and text of a formula's
    ``term``, and out of how many ``choices`` it was the likeliest."""

    effect: str
    parameter: str
    prior_sd: float
    inertial: tuple[Inertial, ...] = ()
    direct: Direct | None = None
    term: tuple[str, str] = ("", "")
    choices: float = 1.0


@dataclass(frozen=True)
class NodeMotion:
    """The motion at the nodes: velocity, acceleration NED, ``dcm`` body to NED, rate in body axes
    without the noise of single readings."""

    t: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray


def node_motion(fit: Fit, motion: Motion) -> NodeMotion:
    """The smoothed motion at the nodes of a fit."""
    nominal = fit.last.smooth.nominal
    t = fit.last.nodes.t
    rate = at_times(motion, steady_rate(motion.t, motion.rate), t)
    acc = at_times(motion, motion.acc, t)
    return NodeMotion(t, nominal[:, 3:6].copy(), acc, quat_to_matrix(nominal[:, 6:10]), rate)


@dataclass(frozen=True)
class Rows:
    """Rows of one drive: ``w`` [s] with all effects left out, ``phi`` [s, c], times ``t``
    [s] in s, ``channel`` [s]."""

    w: FloatArray
    phi: FloatArray
    t: FloatArray
    channel: IntArray


@dataclass(frozen=True)
class Linear:
    """All drives: ``layout`` the columns, ``mixing`` [c, v] by which candidates' columns are made
    of them, None where each is one; score [v] and information [v, v] of these, prior sds [v], and
    the values [v] that the fit has of them."""

    layout: tuple[Column, ...]
    rows: tuple[Rows, ...]
    mixing: FloatArray | None
    score: FloatArray
    info: FloatArray
    prior_sd: FloatArray
    values: FloatArray

    def of_vehicle(self, at: Sequence[int]) -> bool:
        """Whether candidates' columns act on the vehicle constraint itself."""
        acts = (self.layout[i].direct for i in at)
        return any(d is not None and bool(d.by_channel[:, LOOSE].any()) for d in acts)

    def columns(self, rows: Rows, at: Sequence[int]) -> FloatArray:
        """Rows [s, k] of the candidates' columns ``at`` along one drive."""
        if self.mixing is None:
            return np.asarray(rows.phi[:, list(at)], np.float64)
        mixing = self.mixing[:, list(at)]
        used = np.flatnonzero(mixing.any(axis=1))
        return np.asarray(rows.phi[:, used].astype(np.float64) @ mixing[used], np.float64)


ColumnsOf = Callable[[Fit, Motion, NodeMotion], Sequence[Column]]


def linearised(
    fits: Sequence[Fit],
    columns_of: ColumnsOf,
    values: Mapping[str, Mapping[str, float]],
    may_act: bool = True,
) -> Linear:
    """The fits, with effects held at ``values``, made linear in all columns, of which more than
    those ``may_act``."""
    per_drive = []
    layout: list[Column] = []
    place: dict[tuple[str, str], int] = {}
    for fit in fits:
        motion = motion_of(fit.last)
        columns = list(columns_of(fit, motion, node_motion(fit, motion)))
        per_drive.append((fit, motion, columns))
        for column in columns:
            key = (column.effect, column.parameter)
            if key not in place:
                place[key] = len(layout)
                layout.append(column)
    known = np.array([values.get(c.effect, {}).get(c.parameter, 0.0) for c in layout])
    sds = np.array([c.prior_sd for c in layout])
    raw = []
    for fit, motion, columns in per_drive:
        at = [place[(c.effect, c.parameter)] for c in columns]
        raw.append(_raw(fit, motion, columns, at, known))
    rows = _white(raw, known, sds, may_act)
    score = sum((product(r.phi, r.w[:, None])[:, 0] for r in rows), np.zeros(len(layout)))
    info = sum((product(r.phi, r.phi) for r in rows), np.zeros((len(layout),) * 2))
    return Linear(tuple(layout), rows, None, score, info, sds, known)


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """a' b in double precision, a stretch at a time: the rows themselves are in single."""
    out: FloatArray = np.zeros((a.shape[1], b.shape[1]))
    for start in range(0, len(a), STRETCH):
        part = slice(start, start + STRETCH)
        out += a[part].astype(np.float64).T @ b[part].astype(np.float64)
    return out


def _raw(
    fit: Fit, motion: Motion, columns: Sequence[Column], at: Sequence[int], known: FloatArray
) -> Rows:
    """Innovations over their sds with all effects left out, and their sensitivities."""
    whitened, t, channel = whitened_innovations(fit)
    phi: FloatArray = np.zeros((len(whitened), len(known)), np.float32)
    for start in range(0, len(columns), BATCH):
        part = slice(start, start + BATCH)
        phi[:, at[part]] = sensitivities(fit, motion, columns[part])
    return Rows(whitened + _times(phi, known), phi, t, channel)


def sensitivities(fit: Fit, motion: Motion, columns: Sequence[Column]) -> FloatArray:
    """Whitened sensitivity [s, c] of the fit's scalars to the columns' parameters."""
    inertial = [i for i, c in enumerate(columns) if c.direct is None]
    direct = [i for i, c in enumerate(columns) if c.direct is not None]
    order = inertial + direct
    signals: list[FloatArray] = []
    index: dict[int, int] = {}
    terms: list[tuple[int, int, int, int]] = []
    for place, i in enumerate(order):
        for part in columns[i].inertial:
            key = id(part.signal)
            if key not in index:
                index[key] = len(signals)
                signals.append(part.signal)
            terms.append((place, part.sensor, part.axis, index[key]))
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
    table: IntArray = np.array(terms, dtype=np.int64).reshape(-1, 4)
    out = np.zeros((total, len(order)))
    propagate_columns(
        motion.t,
        motion.force,
        np.ascontiguousarray(motion.dcm),
        np.ascontiguousarray(np.stack(signals, axis=1)) if signals else np.zeros((n, 1)),
        table,
        np.ones(len(terms)),
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


def _times(phi: FloatArray, values: FloatArray) -> FloatArray:
    """phi times values [s] in double precision, of the columns that count."""
    used = np.flatnonzero(values)
    return np.asarray(phi[:, used].astype(np.float64) @ values[used], np.float64)


def _white(
    raw: Sequence[Rows], known: FloatArray, sds: FloatArray, may_act: bool = True
) -> tuple[Rows, ...]:
    """White rows, weighted by what is left of them once all candidates together have been fitted
    (ridge regression by their priors, iteratively reweighted: Huber, Robust Statistics, 1981).

    Innovations that only a missing effect makes large would else count for too little, and a
    formula that saturates as the weights do would explain them best. Where no more may act than
    what is ``known``, rows count by what that leaves: weights that so many candidates have settled
    favour what they say.
    """
    left = [r.w - _times(r.phi, known) for r in raw]
    for number in range(PASSES if may_act else 0):
        info: FloatArray = np.diag(sds**-2.0)
        score: FloatArray = np.zeros(len(sds))
        roots = [_root_weights(rest, r.channel) for r, rest in zip(raw, left, strict=True)]
        for r, root in zip(raw, roots, strict=True):
            for start in range(0, len(root), STRETCH):
                part = slice(start, start + STRETCH)
                f = r.phi[part] * root[part, None].astype(np.float32)
                info += f.T @ f
                score += f.T.astype(np.float64) @ (r.w[part] * root[part])
        values = np.asarray(np.linalg.solve(info, score))
        left = [r.w - _times(r.phi, values) for r in raw]
        if number == PASSES - 1:
            cov = np.asarray(np.linalg.inv(info), np.float64)
            left = [_studentised(*each, cov) for each in zip(left, raw, roots, strict=True)]
    out = []
    for r, rest in zip(raw, left, strict=True):
        whitener = fit_whitener(rest, r.channel)
        white = white_rows(whitener, r.w, r.phi, r.t, r.channel, rest)
        out.append(Rows(white.w, white.phi, white.t, white.channel))
    return tuple(out)


def _studentised(left: FloatArray, rows: Rows, root: FloatArray, cov: FloatArray) -> FloatArray:
    """What is left [s] of rows of weights ``root``^2 after a fit of covariance ``cov`` [c, c], as
    large as the noise in them is: a fit follows the rows that tell most, and leaves little of them
    (Cook and Weisberg, Residuals and Influence in Regression, 1982, section 2.2)."""
    out = np.empty_like(left)
    for start in range(0, len(left), STRETCH):
        part = slice(start, start + STRETCH)
        f = rows.phi[part] * root[part, None]
        leverage = np.einsum("sc,sc->s", f @ cov, f)
        out[part] = left[part] / np.sqrt(np.maximum(1.0 - leverage, LEAST_OWN))
    return out


def _root_weights(left: FloatArray, channel: IntArray) -> FloatArray:
    """Square roots [s] of the weights of rows by what is left of them."""
    out = np.zeros(len(left))
    for c in np.unique(channel):
        at = channel == c
        spread = max(sd_by_median(left[at]), MIN_SPREAD[c])
        out[at] = np.sqrt(HUBER / np.maximum(np.abs(left[at]) / spread, HUBER)) / spread
    return out
