"""What boxes say for an effect of the camera: priors, log Bayes factor, covariance."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from automap.effects import CATALOGUE
from automap.gap.camera_fit import CameraFit
from automap.gap.camera_scores import Scores, marginalised
from automap.gap.camera_views import Boxes, keys
from automap.gap.result import ParameterValue
from automap.records import FloatArray, IntArray

FREE_FACTOR = 5.0
"""Accepted effects may be so much larger than their usual size."""
SHRINK = 12.0
MAX_OVERDISPERSION = 9.0


def columns_of(effect: str) -> IntArray:
    """Rows of an effect's parameters among the shared ones."""
    return np.array([i for i, (e, _) in enumerate(keys()) if e == effect], np.int64)


def prior_sds(boxes: Boxes, effects: Collection[str], factor: float = 1.0) -> FloatArray:
    """Prior one sigma [g] of the shared parameters, zero of effects that are not ``effects``."""
    out = np.zeros(boxes.n_common)
    for effect in effects:
        out[columns_of(effect)] = [factor * p.prior_sd for p in CATALOGUE[effect].parameters]
    return out


def marginal(fit: CameraFit, accepted: Sequence[str]) -> Scores:
    """Scores of the effects, everything else marginalised."""
    prior = fit.boxes.prior_sd()
    nuisances = np.flatnonzero(np.isfinite(prior))
    sds = prior[nuisances]
    for effect in accepted:
        rows = columns_of(effect)
        nuisances = np.concatenate([nuisances, rows])
        sds = np.concatenate(
            [sds, [FREE_FACTOR * p.prior_sd for p in CATALOGUE[effect].parameters]]
        )
    kept = marginalised(fit.scores, nuisances, sds)
    k = len(keys())
    return Scores(kept.score[:k], kept.info[:k, :k], kept.blocks[:, :k], kept.block_info[:, :k, :k])


def gain(
    before: CameraFit, after: CameraFit, effect: str, accepted: Sequence[str], prior: FloatArray
) -> float:
    """Log Bayes factor of a fitted effect in nats, by Laplace's approximation; the scatter of
    the signs' scores at the top says how much less the boxes know than they claim."""
    scores = marginal(after, accepted)
    rows = columns_of(effect)
    info = scores.info[np.ix_(rows, rows)]
    own = prior[rows]
    occam = 0.5 * float(np.linalg.slogdet(np.eye(len(rows)) + info * np.outer(own, own))[1])
    gained = before.cost - after.cost
    return gained / overdispersion(scores, rows, after.common[rows]) - occam


def overdispersion(scores: Scores, rows: IntArray, theta: FloatArray) -> float:
    """How much more the score along ``theta`` scatters than its information says.

    The sandwich of White (1980) with the signs as clusters. What the information owes to the
    priors of the path's own errors does not scatter from sign to sign.
    """
    along = scores.blocks[:, rows] @ theta
    expected = np.einsum("bij,i,j->b", scores.block_info[:, rows][:, :, rows], theta, theta)
    total = float(theta @ scores.info[np.ix_(rows, rows)] @ theta)
    own = float(expected.sum())
    if total <= 0.0 or own <= 0.0:
        return 1.0
    along = along - along.mean()
    count = own**2 / max(float(np.sum(expected**2)), 1e-300)
    ratio = float(np.sum(along**2)) / own
    ratio = min(max(1.0, (count * ratio + SHRINK) / (count + SHRINK)), MAX_OVERDISPERSION)
    return 1.0 + (ratio - 1.0) * min(own / total, 1.0)


def covariance(fit: CameraFit, accepted: Sequence[str]) -> FloatArray:
    """Covariance [p, p] of the accepted effects' parameters, in their order."""
    scores = marginal(fit, ())
    rows = np.concatenate([columns_of(e) for e in accepted]) if accepted else np.zeros(0, np.int64)
    info = scores.info[np.ix_(rows, rows)]
    sds = np.array([FREE_FACTOR * p.prior_sd for e in accepted for p in CATALOGUE[e].parameters])
    cov = np.linalg.inv(info + np.diag(sds**-2.0)) if len(rows) else np.zeros((0, 0))
    scale = [overdispersion(scores, columns_of(e), fit.common[columns_of(e)]) for e in accepted]
    widths = np.array(
        [s for e, s in zip(accepted, scale, strict=True) for _ in CATALOGUE[e].parameters]
    )
    return np.asarray(cov * np.sqrt(np.outer(widths, widths)))


def parameters(
    fit: CameraFit, effect: str, accepted: Sequence[str], cov: FloatArray
) -> dict[str, ParameterValue]:
    order = [k for e in accepted for k in keys() if k[0] == e]
    sd = np.sqrt(np.diag(cov))
    return {
        p.name: ParameterValue(
            float(fit.common[keys().index((effect, p.name))]),
            float(sd[order.index((effect, p.name))]),
            p.unit,
        )
        for p in CATALOGUE[effect].parameters
    }
