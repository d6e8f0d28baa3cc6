"""Effects of which few parameters act: one axis is bent, not all nine elements of a matrix.

An effect with all its parameters free pays for each of them, whether it is there or not. So the
evidence of an effect is the mean over which of its parameters act, each number of them as likely
as any other and each choice of that number too: a spike and slab prior (Mitchell and Beauchamp,
1988). With a normal estimate the Bayes factor of a choice against the full effect is the
density of the others at zero, estimate over prior (Savage and Dickey).
"""

from __future__ import annotations

from functools import cache
from itertools import combinations

import numpy as np

from automap.records import FloatArray, IntArray

ALL_OF = 4
"""Of effects with more parameters than this, choices of one, of two and of all count."""


@cache
def choices(p: int) -> tuple[tuple[IntArray, float], ...]:
    """Which of p parameters act, and the logarithm of each choice's prior probability."""
    sizes = range(1, p + 1) if p <= ALL_OF else (1, 2, p)
    out = []
    for size in sizes:
        every = list(combinations(range(p), size))
        weight = -float(np.log(len(sizes) * len(every)))
        out += [(np.array(each, np.int64), weight) for each in every]
    return tuple(out)


def estimate_nats(values: FloatArray, cov: FloatArray, prior_sd: FloatArray) -> float:
    """Nats that an estimate [p] of covariance [p, p] is worth against nothing: the density of the
    prior, of sds [p], at zero over that of the estimate (Savage and Dickey)."""
    z = values / prior_sd
    root = np.linalg.cholesky(cov / np.outer(prior_sd, prior_sd) + 1e-12 * np.eye(len(z)))
    y = np.linalg.solve(root, z)
    return 0.5 * float(y @ y) + float(np.log(np.diag(root)).sum())


def sparse_gain(values: FloatArray, cov: FloatArray, prior_sd: FloatArray) -> float:
    """Nats by which an effect of few parameters is likelier than one with all of them free: from
    the estimate [p] with all, its covariance [p, p] and the prior sds [p]."""
    p = len(values)
    # in sigmas of the prior, where its density at zero is one
    z = values / prior_sd
    c = cov / np.outer(prior_sd, prior_sd)
    each = []
    for acting, weight in choices(p):
        rest = np.setdiff1d(np.arange(p), acting)
        if len(rest) == 0:
            each.append(weight)
            continue
        root = np.linalg.cholesky(c[np.ix_(rest, rest)] + 1e-12 * np.eye(len(rest)))
        y = np.linalg.solve(root, z[rest])
        each.append(weight - 0.5 * float(y @ y) - float(np.log(np.diag(root)).sum()))
    return float(np.logaddexp.reduce(each))
