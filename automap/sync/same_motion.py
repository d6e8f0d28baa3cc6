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


def likeness(seen: AxesEvidence) -> Likeness:
    """How alike readings and fixes are, ``MISTAKE`` of all being of two motions.

    By the turns, felt by that triad which follows them better, for one may be broken, and by the
    changes of speed. Of two motions the likelihood of a correlation r of n samples against none is
    (1 - r^2)^(-n / 2) times less; of one, Fisher's z (R. A. Fisher, Metron 1, 1921) is normal about
    that of the least share that one explains, and what is beyond it is not held against it.
    """
    felt = 0.0 if seen.turn is None else seen.up @ seen.turn.xx @ seen.up / seen.turn.rows
    turns = [followed for followed in (seen.turn, seen.lateral) if followed is not None]
    found = []
    if turns:
        best = max(turns, key=lambda followed: followed.share)
        found.append(_gain(best, limits.TURN_UNEXPLAINED, float(felt)))
    if seen.surge is not None:
        found.append(_gain(seen.surge, limits.SURGE_UNEXPLAINED))
    before = float(np.log((1.0 - limits.MISTAKE) / limits.MISTAKE))
    return Likeness(before + sum(gain for gain, _ in found), any(short for _, short in found))


def _gain(seen: Followed, unexplained: float, felt: float = 0.0) -> tuple[float, bool]:
    """Log likelihood of one motion over that of two, and whether the share is less than one's; of
    one the readings leave so much ``unexplained``, m/s one sigma, and they show a mean square
    ``felt`` themselves."""
    noise = unexplained**2
    signal = max(seen.yy / seen.rows - noise, felt, 0.0)
    most = limits.MOST_CORRELATION**2
    share, least = (float(np.clip(s, 0.0, most)) for s in (seen.share, signal / (signal + noise)))
    below = max(np.arctanh(np.sqrt(least)) - np.arctanh(np.sqrt(share)), 0.0)
    gain = -0.5 * max(seen.count - 3.0, 0.0) * (np.log1p(-share) + below**2)
    return float(gain), below > 0.0
