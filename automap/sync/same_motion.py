"""Whether readings and fixes are of one motion, by how much of the one the other explains.

In whatever axes and units the readings are: the files of two drives have neither turns nor changes
of speed in common.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.sync import limits
from automap.sync.axes_evidence import AxesEvidence, Followed


@dataclass(frozen=True)
class Likeness:
    """``log_odds`` that readings and fixes are of one motion; ``short`` whether they share less of
    the turns or the changes of speed than those of one motion do at least."""

    log_odds: float
    short: bool


def likeness(
    seen: AxesEvidence, worse: float = 1.0, beside: AxesEvidence | None = None
) -> Likeness:
    """How alike readings and fixes are, ``MISTAKE`` of all being of two motions; ``worse`` by how
    much more than a sound receiver's its velocities err, ``beside`` what they have in common in
    another part of the drive.

    By the turns, felt by that triad which follows them better, and by the changes of speed;
    ``MISTAKE`` of all triads feel nothing right. Of two motions the likelihood of a correlation r
    of n samples against none is (1 - r^2)^(-n / 2) times less; of one, Fisher's z (R. A. Fisher,
    Metron 1, 1921) is normal about that of the least share that one explains, and what is beyond it
    is not held against it; ``MISTAKE`` of receivers err by more than they show, so that any share
    may be explained. How much of one that errs so is explained here, that is elsewhere.
    """
    felt = 0.0 if seen.turn is None else seen.up @ seen.turn.xx @ seen.up / seen.turn.rows
    found = []
    best = _followed(seen)
    if best is not None:
        there = None if beside is None else _followed(beside)
        gain, short = _gain(best, worse * limits.TURN_UNEXPLAINED, there, float(felt))
        found.append((_unless_broken(gain, 2), short))
    if seen.surge is not None:
        there = None if beside is None else beside.surge
        gain, short = _gain(seen.surge, worse * limits.SURGE_UNEXPLAINED, there)
        found.append((_unless_broken(gain, 1), short))
    before = float(np.log((1.0 - limits.MISTAKE) / limits.MISTAKE))
    return Likeness(before + sum(gain for gain, _ in found), any(short for _, short in found))


def _followed(seen: AxesEvidence) -> Followed | None:
    """The turns by the triad that follows them better."""
    turns = [followed for followed in (seen.turn, seen.lateral) if followed is not None]
    return max(turns, key=lambda followed: followed.share, default=None)


def _unless_broken(gain: float, triads: int) -> float:
    """A log likelihood where so many ``triads`` may all be broken, and follow nothing."""
    return float(np.logaddexp(gain, triads * np.log(limits.MISTAKE)))


def _gain(
    seen: Followed, unexplained: float, there: Followed | None, felt: float = 0.0
) -> tuple[float, bool]:
    """Log likelihood of one motion over that of two, and whether the share is less than one's; of
    one the readings leave so much ``unexplained``, m/s one sigma, or what they leave ``there``, in
    another part of the drive, and they show a mean square ``felt`` themselves."""
    noise, size = unexplained**2 + seen.noise**2, seen.yy / seen.rows
    left = size - noise
    if seen.noise**2 > 0.5 * size:
        # what is mostly noise does not tell how large the rest is: the readings do
        left = min(left, float(np.trace(seen.xx)) / seen.rows)
        noise = max(noise, size - max(left, felt))
    signal = max(left, felt, 0.0)
    count = max(seen.count - 3.0, 0.0)
    share, below = _z(seen.share), max(_z(signal / (signal + noise)) - _z(seen.share), 0.0)
    # three factors of readings are fitted (G. Schwarz, Annals of Statistics 6, 1978)
    alike = count * np.log(np.cosh(share)) - 1.5 * np.log(max(count, 1.0))
    one = max(alike, 0.0) - 0.5 * count * below**2
    if there is None:
        # what is certainly no chance is of one motion, however little it is
        if alike > limits.CERTAIN_LEAD_NATS:
            one = np.logaddexp(one, np.log(limits.MISTAKE) + alike)
    elif there.count > 3.0:
        less = max(_z(there.share) - share, 0.0)
        of_both = count / (1.0 + count / (there.count - 3.0))
        one = max(one, max(alike, 0.0) - 0.5 * of_both * less**2)
    return float(one), bool(below > 0.0)


def _z(share: float) -> float:
    """Fisher's z of a correlation of which the square is ``share``."""
    return float(np.arctanh(np.sqrt(np.clip(share, 0.0, limits.MOST_CORRELATION**2))))
