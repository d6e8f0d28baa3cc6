"""Velocities that are the way between two positions over the time between them.

Tables that were made without Doppler have such velocities, apps that take the way of the last
second or two, and carrier-phase receivers whose filters smooth over an epoch. They belong to an
interval and not to the instant of their row, and tell no more of it than the positions at its ends
do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from automap.gates import sd_by_median
from automap.records import BoolArray, FloatArray
from automap.sync import limits
from automap.sync.receiver_path import ComplexArray, ReceiverPath

BEFORE, AFTER, AROUND = "before", "after", "around"
"""The interval: to the row from one before, from it to one after, from one before to one as far
after."""


@dataclass(frozen=True)
class EpochMeans:
    """Velocities are the means over the ``interval`` of their rows, whose ends are ``rows`` from
    these and which is ``seconds`` long, to ``sd`` m/s, and by ``nats`` likelier than those of
    instants."""

    interval: str
    rows: int
    seconds: float
    sd: float
    nats: float

    @property
    def text(self) -> str:
        """What they are, in words."""
        n = self.rows
        told = {
            BEFORE: "from the row before to it" if n == 1 else f"from {n} rows before to it",
            AFTER: "from it to the next row" if n == 1 else f"from it to {n} rows after",
            AROUND: "from the row before to the next"
            if n == 1
            else f"from {n} rows before to {n} rows after",
        }[self.interval]
        return (
            f"the velocity of a row is the way between positions, {told}, over its "
            f"{self.seconds:.2g} s (to {self.sd:.2g} m/s), and tells nothing that the positions "
            "do not"
        )


def epoch_means(path: ReceiverPath, use: BoolArray) -> EpochMeans | None:
    """Whether the velocities of the rows ``use`` [n] of ``path`` are means between positions, a row
    to ``WINDOW_S`` apart; None where they are not, or where the drive moves too little to say.

    Two explanations are weighed: the way between two positions over the time is the velocity of one
    row, at an end or in the middle, or it is the mean of the velocities of all rows from one to the
    other, by the trapezoidal rule, as told or, where a row is long past the middle, as late as
    that. The positions' noise is in both. What is near enough to a mean to be one errs by no more
    than the best receiver's velocity: then the way itself tells as much, whatever the receiver did.
    """
    return max(_found(path, use), key=lambda means: means.nats, default=None)


def path_of_means(path: ReceiverPath, use: BoolArray, means: EpochMeans) -> ComplexArray:
    """The path [n] that the velocities of the rows ``use`` [n] add up to, from zero, each in the
    middle of the interval of which it is the mean. Over lost rows, of which none tells, it is that
    of the positions, but where these go further aside than chance lets them go over any."""
    late = {BEFORE: 0.5, AFTER: -0.5, AROUND: 0.0}[means.interval] * means.seconds
    known = use & np.isfinite(path.velocity)
    velocity = np.interp(path.t + late, path.t[known], path.velocity[known])
    ways = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(path.t)
    aside = np.diff(path.place) - ways
    lost = ~_whole(path, use)
    if np.count_nonzero(lost) >= limits.LEAST_WINDOWS:
        usual = sd_by_median(np.concatenate([aside[lost].real, aside[lost].imag]))
        lost &= np.abs(aside) < math.sqrt(2.0 * limits.CERTAIN_LEAD_NATS) * usual
        ways[lost] += aside[lost]
    return np.concatenate([[0.0], np.cumsum(ways)])


def _whole(path: ReceiverPath, use: BoolArray) -> BoolArray:
    """Which steps [n - 1] of a path are of the usual length between rows ``use`` [n]."""
    step = np.diff(path.t)
    usual = limits.LONG_WINDOW * float(np.median(step))
    return np.asarray(use[1:] & use[:-1] & (step < usual))


def _found(path: ReceiverPath, use: BoolArray) -> Iterator[EpochMeans]:
    if len(path) < limits.LEAST_INTERVALS:
        return
    step = np.diff(path.t)
    usual = float(np.median(step))
    broken = ~_whole(path, use)
    gaps = np.concatenate([[0], np.cumsum(broken)])
    told = np.where(broken, 0.0, 0.5 * (path.velocity[1:] + path.velocity[:-1])) * step
    ways = np.concatenate([[0.0], np.cumsum(told)])
    for count in range(1, max(round(limits.WINDOW_S / usual), 2) + 1):
        first = np.flatnonzero(gaps[count:] == gaps[:-count])
        first = first[:: max(len(first) // limits.MOST_INTERVALS, 1)]
        last = first + count
        span = path.t[last] - path.t[first]
        way = (path.place[last] - path.place[first]) / span
        ends = [(BEFORE, count, last, 0.5), (AFTER, count, first, -0.5)]
        if count % 2 == 0:
            ends.append((AROUND, count // 2, first + count // 2, 0.0))
        for interval, rows, of, late in ends:
            lates = (0.0, late) if count > 1 else (0.0,)
            at = [
                [np.interp(path.t[k] + x * span, path.t, ways) for k in (first, last)]
                for x in lates
            ]
            instants = [(b - a) / span - way for a, b in at]
            means = _weighed(interval, rows, span, way, path.velocity[of] - way, instants=instants)
            if means is not None:
                yield means


def _weighed(
    interval: str,
    rows: int,
    span: FloatArray,
    way: ComplexArray,
    mean: ComplexArray,
    instants: Sequence[ComplexArray],
) -> EpochMeans | None:
    """Means by the residuals [m] of ``mean`` and of ``instants`` where the vehicle moves."""
    speed = np.abs(way)
    fast = float(np.quantile(speed, limits.FAST_QUANTILE)) if len(speed) else 0.0
    moves = speed > limits.COURSE_SHARE * fast
    if np.count_nonzero(moves) < limits.LEAST_INTERVALS:
        return None
    sizes = [
        max(sd_by_median(np.concatenate([r[moves].real, r[moves].imag])), limits.LEAST_DIGIT)
        for r in (mean, *instants)
    ]
    if sizes[0] > limits.BEST_VELOCITY_SD:
        return None
    # what a residual has of the motion lasts as long as a change of speed, or as its interval
    each = span[moves] / (rows * (1 + (interval == AROUND)))
    apart = float(each.sum()) / max(limits.MOTION_LASTS_S, float(np.median(span)))
    nats = 2.0 * min(float(np.count_nonzero(moves)), apart) * math.log(min(sizes[1:]) / sizes[0])
    if nats <= limits.CERTAIN_LEAD_NATS:
        return None
    return EpochMeans(interval, rows, float(np.median(span)), sizes[0], nats)
