"""A fitted model that is linear in the parameters of all candidates.

About a fit the innovations w are linear in them: w = phi theta + noise. So what is known of any is
a score and its information, with whatever else is in the model marginalised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from automap.effects.user import INERTIAL
from automap.gap import limits
from automap.gap.mixing import Mixing
from automap.gap.rows import Rows
from automap.gap.stretches import Frame
from automap.gap.whitening import LOOSE
from automap.records import BoolArray, FloatArray, IntArray

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
