"""Estimates of several drives as one, and what is left of one without some of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from automap.records import FloatArray


class Estimated(Protocol):
    """What is estimated of one drive: ``names`` of effects and parameters, ``values`` [p], ``cov``
    [p, p]."""

    @property
    def names(self) -> tuple[tuple[str, str], ...]: ...

    @property
    def values(self) -> FloatArray: ...

    @property
    def cov(self) -> FloatArray: ...


@dataclass(frozen=True)
class Joint:
    """Estimated parameters of all drives together: ``values`` [p], ``cov`` [p, p], the log Bayes
    factor in nats against the model without them."""

    names: tuple[tuple[str, str], ...]
    values: FloatArray
    cov: FloatArray
    nats: float

    def of(self, effect: str) -> dict[str, tuple[float, float]]:
        """Parameter -> value and sd of one effect."""
        sd = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
        rows = zip(self.names, self.values, sd, strict=True)
        return {p: (float(v), float(s)) for (e, p), v, s in rows if e == effect}

    def without(self, effect: str) -> Joint:
        """What is known of the others where one effect is nothing; the nats stay those of all."""
        gone = np.array([e == effect for e, _ in self.names], bool)
        gain = self.cov[np.ix_(~gone, gone)] @ np.linalg.inv(self.cov[np.ix_(gone, gone)])
        values = self.values[~gone] - gain @ self.values[gone]
        cov = self.cov[np.ix_(~gone, ~gone)] - gain @ self.cov[np.ix_(gone, ~gone)]
        names = tuple(name for name in self.names if name[0] != effect)
        return Joint(names, np.asarray(values), np.asarray(0.5 * (cov + cov.T)), self.nats)


def combine(fits: Sequence[Estimated], gains: Sequence[float], prior_sd: FloatArray) -> Joint:
    """Estimates of several drives as one, as if they had been filtered in a row.

    ``gains``: each drive's log Bayes factor under its own prior ``prior_sd`` [p].
    """
    names = fits[0].names
    p = len(names)
    if p == 0:
        return Joint((), np.zeros(0), np.zeros((0, 0)), float(sum(gains)))
    info: FloatArray = np.eye(p)
    eta: FloatArray = np.zeros(p)
    nats = 0.0
    for fit, gain in zip(fits, gains, strict=True):
        each = fit.cov / np.outer(prior_sd, prior_sd)
        own = np.linalg.inv(0.5 * (each + each.T) + 1e-12 * np.eye(p))
        value = fit.values / prior_sd
        info += own - np.eye(p)
        eta += own @ value
        nats += gain - 0.5 * float(value @ own @ value) + 0.5 * np.linalg.slogdet(own)[1]
    info = np.asarray(0.5 * (info + info.T))
    cov: FloatArray = np.asarray(np.linalg.inv(info), np.float64)
    value = cov @ eta
    nats += 0.5 * float(value @ eta) - 0.5 * np.linalg.slogdet(info)[1]
    scale = np.outer(prior_sd, prior_sd)
    return Joint(names, value * prior_sd, cov * scale, float(nats))


def estimate_nats(values: FloatArray, cov: FloatArray, prior_sd: FloatArray) -> float:
    """Nats that an estimate [p] of covariance [p, p] is worth against nothing: the density of the
    prior, of sds [p], at zero over that of the estimate (Savage and Dickey)."""
    z = values / prior_sd
    root = np.linalg.cholesky(cov / np.outer(prior_sd, prior_sd) + 1e-12 * np.eye(len(z)))
    y = np.linalg.solve(root, z)
    return 0.5 * float(y @ y) + float(np.log(np.diag(root)).sum())
