"""Scores of the camera's effects, with signs as blocks, and the evidence that is in them.

The log Bayes factor is that of ``evidence``; here the blocks are signs, and the unknowns of the
path and of each sign have been eliminated beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.gap.limits import PRIOR_SCALES, SHRINK_BLOCKS
from automap.records import FloatArray, IntArray

ROOM = 1.5
MAX_OVERDISPERSION = 4.0


@dataclass(frozen=True)
class Scores:
    """Score [c], information [c, c] of all columns; ``blocks`` [b, c] the scores of every sign,
    ``block_info`` [b, c, c] their information."""

    score: FloatArray
    info: FloatArray
    blocks: FloatArray
    block_info: FloatArray

    def __add__(self, other: Scores) -> Scores:
        return Scores(
            self.score + other.score,
            self.info + other.info,
            np.concatenate([self.blocks, other.blocks]),
            np.concatenate([self.block_info, other.block_info]),
        )


def marginalised(scores: Scores, nuisances: IntArray, prior_sd: FloatArray) -> Scores:
    """Scores with nuisance columns [q] of prior sds [q] marginalised (they stay, with nothing)."""
    if len(nuisances) == 0:
        return scores
    inner = scores.info[np.ix_(nuisances, nuisances)] + np.diag(prior_sd**-2.0)
    a = np.linalg.solve(inner, scores.info[nuisances]).T
    info = scores.info - a @ scores.info[nuisances]
    blocks = scores.blocks - scores.blocks[:, nuisances] @ a.T
    cross = np.einsum("ci,bij->bcj", a, scores.block_info[:, nuisances])
    inside = scores.block_info[:, nuisances][:, :, nuisances]
    block_info = scores.block_info - cross - np.swapaxes(cross, 1, 2)
    block_info = block_info + np.einsum("ci,bij,dj->bcd", a, inside, a)
    out = Scores(
        scores.score - a @ scores.score[nuisances], 0.5 * (info + info.T), blocks, block_info
    )
    for array in (out.score, out.info, out.info.T):
        array[nuisances] = 0.0
    return out


@dataclass(frozen=True)
class Evidence:
    """Of one candidate: log Bayes factor in nats, estimate [p] and sd [p], factor on the prior
    that leaves room for the estimate, factor by which the score scatters more than it should,
    and the nats before these were lowered for it."""

    nats: float
    estimate: FloatArray
    sd: FloatArray
    scale: float
    overdispersion: float
    uncorrected: float


def evidence(scores: Scores, columns: IntArray, prior_sd: FloatArray) -> Evidence:
    """Evidence of the candidate with these columns [p] and prior sds [p]."""
    g = scores.score[columns]
    info = scores.info[np.ix_(columns, columns)]
    best: Evidence | None = None
    for scale in PRIOR_SCALES:
        sd = scale * prior_sd
        h = sd * g
        b = info * np.outer(sd, sd)
        root = np.linalg.cholesky(b + np.eye(len(g)))
        y = np.linalg.solve(root, h)
        nats = 0.5 * float(y @ y) - float(np.log(np.diag(root)).sum())
        if scale > 1.0:
            nats -= np.log(2.0)
        if best is None or nats > best.nats + 1e-9:
            inverse = np.linalg.inv(root)
            cov = inverse.T @ inverse
            estimate = sd * (cov @ h)
            best = Evidence(nats, estimate, sd * np.sqrt(np.diag(cov)), scale, 1.0, nats)
    assert best is not None
    overdispersion = _overdispersion(scores, columns, best.estimate)
    room = ROOM * float(np.max(np.abs(best.estimate) / prior_sd))
    best = replace(best, scale=max(best.scale, room) if room > best.scale * ROOM else best.scale)
    if overdispersion > 1.0:
        fixed = 0.5 * float(best.estimate @ g)
        best = Evidence(
            best.nats - fixed * (1.0 - 1.0 / overdispersion),
            best.estimate,
            best.sd * np.sqrt(overdispersion),
            best.scale,
            overdispersion,
            best.uncorrected,
        )
    return best


def _overdispersion(scores: Scores, columns: IntArray, theta: FloatArray) -> float:
    """How much more the score along ``theta`` scatters from stretch to stretch than it should.

    The sandwich of White (1980) with stretches as clusters, shrunk towards one where there
    are few of them.
    """
    if not theta.any() or len(scores.blocks) < 4:
        return 1.0
    along = scores.blocks[:, columns] @ theta
    infos = scores.block_info[:, columns][:, :, columns]
    expected = np.einsum("bij,i,j->b", infos, theta, theta)
    total = float(expected.sum())
    if total <= 0.0:
        return 1.0
    # along = expected + noise of variance expected
    slope = float(along.sum()) / total
    ratio = float(np.sum((along - slope * expected) ** 2)) / total
    # in stretches that count
    count = total**2 / max(float(np.sum(expected**2)), 1e-300)
    return min(
        max(1.0, (count * ratio + SHRINK_BLOCKS) / (count + SHRINK_BLOCKS)), MAX_OVERDISPERSION
    )


def null_maxima(
    scores: Scores,
    groups: list[tuple[IntArray, FloatArray]],
    draws: int,
    seed: int = 1,
) -> FloatArray:
    """The largest evidence [draws] over all candidates where none acts, sorted.

    Scores are drawn from their own covariance, so the overlap of the candidates counts.
    """
    rng = np.random.default_rng(seed)
    unit = np.sqrt(np.maximum(np.diag(scores.info), 0.0))
    g = (rng.standard_normal((draws, len(unit))) @ _root(scores.info).T) * unit
    best = np.full(draws, -np.inf)
    alone = [(int(columns[0]), float(sd[0])) for columns, sd in groups if len(columns) == 1]
    if alone:
        at = np.array([column for column, _ in alone])
        best = _alone(g[:, at], np.diag(scores.info)[at], np.array([sd for _, sd in alone]))
    for columns, prior_sd in groups:
        if len(columns) == 1:
            continue
        info = scores.info[np.ix_(columns, columns)]
        for scale in PRIOR_SCALES:
            sd = scale * prior_sd
            h, b = (g[:, columns] * sd).T, info * np.outer(sd, sd)
            low = np.linalg.cholesky(b + np.eye(len(sd)))
            y = np.linalg.solve(low, h)
            nats = 0.5 * (y**2).sum(axis=0) - np.log(np.diag(low)).sum()
            best = np.maximum(best, nats - (np.log(2.0) if scale > 1.0 else 0.0))
    return np.sort(best)


def _alone(g: FloatArray, info: FloatArray, prior_sd: FloatArray) -> FloatArray:
    """The largest evidence [draws] of candidates of one column each, scores ``g`` [draws, c]."""
    best = np.full(len(g), -np.inf)
    for scale in PRIOR_SCALES:
        grown = (scale * prior_sd) ** 2
        room = 1.0 + info * grown
        cost = 0.5 * np.log(room) + (np.log(2.0) if scale > 1.0 else 0.0)
        best = np.maximum(best, (g**2 * (0.5 * grown / room) - cost).max(axis=1))
    return np.asarray(best, np.float64)


def _root(info: FloatArray) -> FloatArray:
    """A root [c, c] of the correlation matrix of an information matrix, singular or not."""
    correlation = info / _norm(info)
    try:
        return np.asarray(np.linalg.cholesky(correlation + 1e-9 * np.eye(len(info))), np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(correlation)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _norm(info: FloatArray) -> FloatArray:
    unit = np.sqrt(np.maximum(np.diag(info), 1e-300))
    return np.outer(unit, unit)
