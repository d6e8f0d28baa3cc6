"""How likely the strongest of all candidates reaches so much where none acts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.gap import limits
from automap.gap.evidence import Conditional, Part
from automap.records import FloatArray

SINGULAR = 1e-6
"""Share of its variance by which a score is drawn too large, so that a matrix has a root."""


def null_maxima(known: Conditional, parts: Sequence[Part], draws: int, seed: int = 1) -> FloatArray:
    """The largest evidence [draws] over parts where none of them acts, sorted.

    Scores are drawn from their own covariance, so the overlap of the candidates counts.
    """
    rng = np.random.default_rng(seed)
    columns = np.array(sorted({i for part in parts for i in part}), np.int64)
    place = {int(c): i for i, c in enumerate(columns)}
    info = known.info(tuple(columns))
    unit = np.sqrt(np.maximum(np.diag(info), 1e-300))
    correlation = info / np.outer(unit, unit)
    # courses of time are made of fewer boxes than there are of them: their scores are singular
    root = np.linalg.cholesky(correlation + SINGULAR * np.eye(len(columns)))
    g = (rng.standard_normal((draws, len(columns))) @ root.T) * unit
    sds = known.linear.prior_sd[columns]
    best = np.full(draws, -np.inf)
    single = np.array([place[part[0]] for part in parts if len(part) == 1], np.int64)
    several = [np.array([place[i] for i in part]) for part in parts if len(part) > 1]
    for scale in limits.PRIOR_SCALES:
        if len(single):
            grown = (scale * sds[single]) ** 2
            room = 1.0 + np.diag(info)[single] * grown
            each = 0.5 * g[:, single] ** 2 * (grown / room) - 0.5 * np.log(room)
            best = np.maximum(best, each.max(axis=1))
        for at in several:
            sd = scale * sds[at]
            low = np.linalg.cholesky(info[np.ix_(at, at)] * np.outer(sd, sd) + np.eye(len(at)))
            y = np.linalg.solve(low, (g[:, at] * sd).T)
            best = np.maximum(best, 0.5 * (y**2).sum(axis=0) - np.log(np.diag(low)).sum())
    return np.sort(best - np.log(len(limits.PRIOR_SCALES)))


def p_value(nats: float, maxima: FloatArray) -> float:
    """Share of ``maxima`` [draws], sorted, that reach ``nats``; beyond them by their exponential
    tail (Pickands' theorem with shape zero)."""
    n = len(maxima)
    above = n - int(np.searchsorted(maxima, nats))
    top = max(n // 50, 10)
    if above >= top:
        return above / n
    threshold = float(maxima[n - top])
    mean_excess = max(float(np.mean(maxima[n - top :] - threshold)), 1e-3)
    return float(top / n * np.exp(-(nats - threshold) / mean_excess))
