"""Velocities that are the way between two positions over the time between them.

Tables that were made without Doppler have such velocities, and carrier-phase receivers whose
filters smooth over an epoch. They belong to an interval and not to the instant of their row, and
tell no more of it than the positions at its ends do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from automap.gates import sd_by_median
from automap.records import BoolArray
from automap.sync import limits
from automap.sync.receiver_path import ComplexArray, ReceiverPath

BEFORE, AFTER, AROUND = "before", "after", "around"
"""The interval: to the row from the one before, from it to the next, from the one before to the
next."""


@dataclass(frozen=True)
class EpochMeans:
    """Velocities are the means over the ``interval`` of their rows, which is ``seconds`` long, to
    ``sd`` m/s, and by ``nats`` likelier than those of instants."""

    interval: str
    seconds: float
    sd: float
    nats: float

    @property
    def text(self) -> str:
        """What they are, in words."""
        told = {
            BEFORE: "from the row before to it",
            AFTER: "from it to the next row",
            AROUND: "from the row before to the next",
        }[self.interval]
        return (
            f"the velocity of a row is the way between positions, {told}, over its "
            f"{self.seconds:.2g} s (to {self.sd:.2g} m/s), and tells nothing that the positions "
            "do not"
        )


def epoch_means(path: ReceiverPath, use: BoolArray) -> EpochMeans | None:
    """Whether the velocities of the rows ``use`` [n] of ``path`` are means between positions; None
    where they are not, or where the drive moves too little to say.

    Two explanations are weighed: the way between two positions over the time is the velocity of one
    row, or it is the mean of the velocities at both ends (or, around a row, Simpson's). The
    positions' noise is in both. What is near enough to a mean to be one errs by no more than the
    best receiver's velocity: then the way itself tells as much, whatever the receiver did.
    """
    weighed = (_between(path, use), _around(path, use))
    found = [means for few in weighed for means in few if means is not None]
    return max(found, key=lambda means: means.nats, default=None)


def _between(path: ReceiverPath, use: BoolArray) -> list[EpochMeans | None]:
    step = np.diff(path.t)
    near = use[1:] & use[:-1] & (step < limits.LONG_WINDOW * _usual(step))
    way = np.diff(path.place)[near] / step[near]
    first, last = path.velocity[:-1][near], path.velocity[1:][near]
    at_ends = 0.5 * (first + last) - way
    return [
        _weighed(interval, step[near], way, told - way, at_ends)
        for interval, told in ((BEFORE, last), (AFTER, first))
    ]


def _around(path: ReceiverPath, use: BoolArray) -> list[EpochMeans | None]:
    step = path.t[2:] - path.t[:-2]
    near = use[2:] & use[1:-1] & use[:-2] & (step < limits.LONG_WINDOW * _usual(step))
    way = (path.place[2:] - path.place[:-2])[near] / step[near]
    before, at, after = (path.velocity[part][near] for part in (np.s_[:-2], np.s_[1:-1], np.s_[2:]))
    return [_weighed(AROUND, step[near], way, at - way, (before + 4.0 * at + after) / 6.0 - way)]


def _usual(step: np.ndarray) -> float:
    return float(np.median(step)) if len(step) else 0.0


def _weighed(
    interval: str, step: np.ndarray, way: ComplexArray, mean: ComplexArray, instant: ComplexArray
) -> EpochMeans | None:
    """Means by the residuals [m] of both explanations where the vehicle moves."""
    speed = np.abs(way)
    fast = float(np.quantile(speed, limits.FAST_QUANTILE)) if len(speed) else 0.0
    moves = speed > limits.COURSE_SHARE * fast
    if np.count_nonzero(moves) < limits.LEAST_INTERVALS:
        return None
    sizes = [
        max(sd_by_median(np.concatenate([r[moves].real, r[moves].imag])), limits.LEAST_DIGIT)
        for r in (mean, instant)
    ]
    # what a residual has of the motion lasts as long as a change of speed
    apart = min(float(np.count_nonzero(moves)), float(step[moves].sum()) / limits.MOTION_LASTS_S)
    nats = 2.0 * apart * math.log(sizes[1] / sizes[0])
    if sizes[0] > limits.BEST_VELOCITY_SD or nats <= limits.CERTAIN_LEAD_NATS:
        return None
    return EpochMeans(interval, float(np.median(step)), sizes[0], nats)
