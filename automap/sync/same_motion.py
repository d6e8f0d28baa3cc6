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


def likeness(seen: AxesEvidence, worse: float = 1.0) -> Likeness:
    """How alike readings and fixes are, ``MISTAKE`` of all being of two motions; ``worse`` by how
    much more than a sound receiver's its velocities err.

    By the turns, felt by that triad which follows them better, and by the changes of speed;
    ``MISTAKE`` of all triads feel nothing right. Of two motions the likelihood of a correlation r
    of n samples against none is (1 - r^2)^(-n / 2) times less; of one, Fisher's z (R. A. Fisher,
    Metron 1, 1921) is normal about that of the least share that one explains, and what is beyond it
    is not held against it.
    """
    felt = 0.0 if seen.turn is None else seen.up @ seen.turn.xx @ seen.up / seen.turn.rows
    turns = [followed for followed in (seen.turn, seen.lateral) if followed is not None]
    found = []
    if turns:
        best = max(turns, key=lambda followed: followed.share)
        gain, short = _gain(best, worse * limits.TURN_UNEXPLAINED, float(felt))
        found.append((_unless_broken(gain, 2), short))
    if seen.surge is not None:
        gain, short = _gain(seen.surge, worse * limits.SURGE_UNEXPLAINED)
        found.append((_unless_broken(gain, 1), short))
    before = float(np.log((1.0 - limits.MISTAKE) / limits.MISTAKE))
    return Likeness(before + sum(gain for gain, _ in found), any(short for _, short in found))


def _unless_broken(gain: float, triads: int) -> float:
    """A log likelihood where so many ``triads`` may all be broken, and follow nothing."""
    return float(np.logaddexp(gain, triads * np.log(limits.MISTAKE)))


def _gain(seen: Followed, unexplained: float, felt: float = 0.0) -> tuple[float, bool]:
    """Log likelihood of one motion over that of two, and whether the share is less than one's; of
    one the readings leave so much ``unexplained``, m/s one sigma, and they show a mean square
    ``felt`` themselves."""
    noise, size = unexplained**2 + seen.noise**2, seen.yy / seen.rows
    left = size - noise
    if seen.noise**2 > 0.5 * size:
        # what is mostly noise does not tell how large the rest is: the readings do
        left = min(left, float(np.trace(seen.xx)) / seen.rows)
        noise = max(noise, size - max(left, felt))
    signal = max(left, felt, 0.0)
    most = limits.MOST_CORRELATION**2
    share, least = (float(np.clip(s, 0.0, most)) for s in (seen.share, signal / (signal + noise)))
    below = max(np.arctanh(np.sqrt(least)) - np.arctanh(np.sqrt(share)), 0.0)
    count = max(seen.count - 3.0, 0.0)
    # three factors of readings are fitted (G. Schwarz, Annals of Statistics 6, 1978)
    alike = max(-0.5 * count * np.log1p(-share) - 1.5 * np.log(max(count, 1.0)), 0.0)
    return float(alike - 0.5 * count * below**2), bool(below > 0.0)
