"""How well a fitted model predicts its measurements, robustly, in nats.

Models are compared scalar by scalar on the same measurements, whitened by the same spread and
autoregression, so that coloured noise and a few wild values decide nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.gap import limits
from automap.gap.fit import Fit, whitened_innovations
from automap.gap.whitening import HUBER, Whitener, filtered, fit_whitener
from automap.records import FloatArray


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


def whitener_of(fit: Fit) -> Whitener:
    """Spread and autoregression of a fit's own innovations."""
    whitened, _, channel = whitened_innovations(fit)
    return fit_whitener(whitened, channel)


def robust_score(fit: Fit, whitener: Whitener) -> float:
    """Log-likelihood of the measurements in nats, up to a constant of the whitener."""
    return float(_each_score(fit, whitener)[0].sum())


def _each_score(fit: Fit, whitener: Whitener) -> tuple[FloatArray, FloatArray]:
    """The same of every measurement [s], and their times [s] in s."""
    whitened, t, channel = whitened_innovations(fit)
    out = -0.5 * np.log(fit.last.forward.store.var)
    for c, spread in whitener.spread.items():
        at = channel == c
        out[at] -= _rho(filtered(whitened[at, None], whitener.ar[c])[:, 0] / spread)
    return out, t


def likelier(one: Sequence[Fit], other: Sequence[Fit]) -> tuple[float, float]:
    """Nats by which drives are likelier under fits than under others, by the mean of what the
    whiteners of both sides say, and the sigmas of that by its scatter from stretch to stretch
    (Vuong, Econometrica 57 (1989), 307-333)."""
    parts = []
    for a, b in zip(one, other, strict=True):
        number = max(int(a.last.nodes.t[-1] / limits.BLOCKS_S[0]), 1)
        edges = np.linspace(0.0, np.nextafter(a.last.nodes.t[-1], np.inf), number + 1)
        total = np.zeros(number)
        for own in (a, b):
            whitener = whitener_of(own)
            for sign, fit in ((0.5, a), (-0.5, b)):
                score, t = _each_score(fit, whitener)
                total += sign * np.histogram(t, edges, weights=score)[0]
        parts.append(total)
    each = np.concatenate(parts)
    total_nats = float(each.sum())
    spread = float(np.sqrt(len(each)) * np.std(each))
    return total_nats, total_nats / spread if spread > 0.0 else 0.0


def _rho(u: FloatArray) -> FloatArray:
    """Huber's loss."""
    size = np.abs(u)
    return np.asarray(np.where(size < HUBER, 0.5 * u**2, HUBER * size - 0.5 * HUBER**2))


def combine(fits: Sequence[Fit], gains: Sequence[float], prior_sd: FloatArray) -> Joint:
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
