"""Whether readings and fixes are of one motion, by how much of the one the other explains.

In whatever axes and units the readings are: the files of two drives have neither turns nor changes
of speed in common.
"""

from __future__ import annotations

import numpy as np

from automap.sync import limits
from automap.sync.axes_evidence import AxesEvidence, Followed


def log_odds(seen: AxesEvidence) -> float:
    """Log odds that readings and fixes are of one motion, ``MISTAKE`` of all being of two.

    By the turns, felt by that triad which follows them better, for one may be broken, and by the
    changes of speed. Of two motions the likelihood of a correlation r of n samples against none is
    (1 - r^2)^(-n / 2) times less; of one, Fisher's z (R. A. Fisher, Metron 1, 1921) is normal about
    that of the least share that one explains, and what is beyond it is not held against it.
    """
    felt = 0.0 if seen.turn is None else seen.up @ seen.turn.xx @ seen.up / seen.turn.rows
    turns = [followed for followed in (seen.turn, seen.lateral) if followed is not None]
    total = float(np.log((1.0 - limits.MISTAKE) / limits.MISTAKE))
    if turns:
        best = max(turns, key=lambda followed: followed.share)
        total += _gain(best, limits.TURN_UNEXPLAINED, float(felt))
    if seen.surge is not None:
        total += _gain(seen.surge, limits.SURGE_UNEXPLAINED)
    return total


def _gain(seen: Followed, unexplained: float, felt: float = 0.0) -> float:
    """Log likelihood of one motion over that of two; of one the readings leave so much
    ``unexplained``, m/s one sigma, and they show a mean square ``felt`` themselves."""
    noise = unexplained**2
    signal = max(seen.yy / seen.rows - noise, felt, 0.0)
    most = limits.MOST_CORRELATION**2
    share, least = (float(np.clip(s, 0.0, most)) for s in (seen.share, signal / (signal + noise)))
    short = max(np.arctanh(np.sqrt(least)) - np.arctanh(np.sqrt(share)), 0.0)
    return float(-0.5 * max(seen.count - 3.0, 0.0) * (np.log1p(-share) + short**2))
