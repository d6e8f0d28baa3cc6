"""How well a fitted model predicts measurements, in nats: those of its own drives and of others.

Models are compared scalar by scalar on the same measurements, whitened by the same spread and
autoregression, so that coloured noise and a few wild values decide nothing.

The gap is what a model does not predict of data that it was not fitted to, in nats an epoch of
fixes: how much likelier the held-out measurements would be under a model that leaves white
innovations of the stated size. Against the best model that was found this is a difference of
log-likelihoods; what that model itself still lacks is what a scale and an autoregression of its
own innovations could still gain (a Kullback-Leibler distance).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from automap.fusion.layout import CH_VEL, CHANNELS, HAS_POS_H, MAX_SCALARS
from automap.gap import limits
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, GapModel, fit_drive, whitened_innovations
from automap.gap.limits import AR_ORDER, CLIP, HUBER, MIN_ROWS
from automap.gap.result import ChannelGap
from automap.gap.whitening import LOOSE, Whitener, autoregression, filtered, fit_whitener
from automap.records import BoolArray, FloatArray

MEASURED = CH_VEL + 3
"""Channels of the receiver. The vehicle constraint is no measurement: what it says counts where
models are compared, but a vehicle that sways on its springs is no gap of the sensors."""
SHOWN = MEASURED + 2


def whitener_of(fit: Fit) -> Whitener:
    """Spread and autoregression of a fit's own innovations."""
    whitened, _, channel = whitened_innovations(fit)
    return fit_whitener(whitened, channel)


def _each_score(fit: Fit, whitener: Whitener) -> FloatArray:
    """Log-likelihood of every measurement [s] in nats, up to a constant of the whitener."""
    whitened, _, channel = whitened_innovations(fit)
    out = -0.5 * np.log(fit.last.forward.store.var)
    for c, spread in whitener.spread.items():
        at = channel == c
        out[at] -= _rho(filtered(whitened[at, None], whitener.ar[c])[:, 0] / spread)
    return np.asarray(out)


def _common(one: Fit, other: Fit) -> tuple[BoolArray, BoolArray]:
    """Which measurements [s] of each of two fits of a drive the other has, too. The vehicle
    constraint holds above a crawl alone, and where a car creeps one path may and the other may not:
    what only one is asked, whatever it says, tells nothing of the two.

    Nodes are told by their number: a delay that is free moves their times a little. Where one has a
    node more nobody says which, and all counts.
    """
    keys = []
    for fit in (one, other):
        _, t, channel = whitened_innovations(fit)
        keys.append(np.searchsorted(fit.last.nodes.t, t) * MAX_SCALARS + channel)
    if len(one.last.nodes.t) != len(other.last.nodes.t):
        return np.ones(len(keys[0]), bool), np.ones(len(keys[1]), bool)
    mine, its = keys
    return np.isin(mine, its), np.isin(its, mine)


def gain_over(one: Sequence[Fit], other: Sequence[Fit], whitener: Whitener) -> float:
    """Nats by which drives are likelier under fits than under others, in a whitener's terms."""
    total = 0.0
    for a, b in zip(one, other, strict=True):
        mine, its = _common(a, b)
        total += float(_each_score(a, whitener)[mine].sum() - _each_score(b, whitener)[its].sum())
    return total


Odds = tuple[float, float]
"""Nats by which drives are likelier under one model than under another, and the sigmas of that by
its scatter from stretch to stretch (Vuong, Econometrica 57 (1989), 307-333)."""


def likelier(one: Sequence[Fit], other: Sequence[Fit]) -> Odds:
    """By how much drives are likelier under fits than under others."""
    return likelier_by_side(one, other)[0]


def likelier_by_side(one: Sequence[Fit], other: Sequence[Fit]) -> tuple[Odds, Odds]:
    """The same, and what the receiver alone says of it, by the mean of what the whiteners of both
    sides say."""
    parts = []
    for a, b in zip(one, other, strict=True):
        number = max(int(a.last.nodes.t[-1] / limits.BLOCKS_S[0]), 1)
        edges = np.linspace(0.0, np.nextafter(a.last.nodes.t[-1], np.inf), number + 1)
        total = np.zeros((2, number))
        whiteners = [whitener_of(own) for own in (a, b)]
        for sign, fit, both in zip((0.5, -0.5), (a, b), _common(a, b), strict=True):
            score = np.sum([_each_score(fit, whitener) for whitener in whiteners], axis=0)
            _, t, channel = whitened_innovations(fit)
            loose = np.isin(channel, LOOSE)
            for side, mine in zip(total, (both & ~loose, both & loose), strict=True):
                side += sign * np.histogram(t[mine], edges, weights=score[mine])[0]
        parts.append(total)
    sides = np.concatenate(parts, axis=1)
    return _odds(sides.sum(axis=0)), _odds(sides[0])


def _odds(each: FloatArray) -> Odds:
    """Of what stretches say [b]."""
    total = float(each.sum())
    spread = float(np.sqrt(len(each)) * np.std(each))
    return total, total / spread if spread > 0.0 else 0.0


def _rho(u: FloatArray) -> FloatArray:
    """Huber's loss."""
    size = np.abs(u)
    return np.asarray(np.where(size < HUBER, 0.5 * u**2, HUBER * size - 0.5 * HUBER**2))


def epochs(fits: Sequence[Fit]) -> int:
    """Number of fixes."""
    return max(sum(int(((f.last.nodes.flags & HAS_POS_H) > 0).sum()) for f in fits), 1)


def fit_held_out(
    opened: Sequence[OpenDrive],
    model: GapModel,
    values: Mapping[str, Mapping[str, float]],
    linearised_at: Sequence[Fit] = (),
) -> list[Fit]:
    """The model on held-out drives, effects at the given values, nuisances found anew.

    ``linearised_at`` fits of the same drives under another model, where there are any.
    """
    carried = replace(model, values={**model.values, **values})
    points: Sequence[Fit | None] = linearised_at or [None] * len(opened)
    return [fit_drive(o, carried, linearised_at=p) for o, p in zip(opened, points, strict=True)]


def remaining_gap(fits: Sequence[Fit]) -> float:
    """What second-order statistics of the innovations could still gain, nats an epoch."""
    total = 0.0
    for fit in fits:
        whitened, _, channel = whitened_innovations(fit)
        for c in range(MEASURED):
            w = whitened[channel == c]
            total += len(w) * _distance(w, c)
    return total / epochs(fits)


def _distance(w: FloatArray, channel: int) -> float:
    """Nats a measurement between a channel's innovations and white noise of size one.

    The vehicle constraint is meant to be loose: small innovations are no gap there.
    """
    n = len(w)
    if n < MIN_ROWS:
        return 0.0
    w = np.clip(w, -CLIP, CLIP)
    variance = float(np.mean(w**2))
    size = 0.5 * (variance - 1.0 - np.log(max(variance, 1e-6)))
    if channel > CH_VEL + 2 and variance < 1.0:
        size = 0.0
    a = autoregression(w)
    rest = w.copy()
    for k, value in enumerate(a, start=1):
        rest[k:] -= value * w[:-k]
    share = float(np.mean(rest**2)) / max(variance, 1e-12)
    colour = -0.5 * np.log(min(share, 1.0))
    # what mere chance gives
    return float(max(size - 0.5 / n, 0.0) + max(colour - 0.5 * AR_ORDER / n, 0.0))


def channel_gaps(
    before: Sequence[Fit], after: Sequence[Fit], worst: Mapping[int, str]
) -> tuple[ChannelGap, ...]:
    """The channels one by one."""
    out = []
    for c in range(SHOWN):
        w0, w1 = _joined(before, c), _joined(after, c)
        if min(len(w0), len(w1)) < MIN_ROWS:
            continue
        out.append(
            ChannelGap(
                CHANNELS[c],
                _distance(w0, c),
                _distance(w1, c),
                float(np.sqrt(np.mean(w0**2))),
                float(np.sqrt(np.mean(w1**2))),
                _lag1(w0),
                _lag1(w1),
                worst.get(c, ""),
            )
        )
    return tuple(out)


def _joined(fits: Sequence[Fit], channel: int) -> FloatArray:
    parts = []
    for fit in fits:
        whitened, _, channels = whitened_innovations(fit)
        parts.append(whitened[channels == channel])
    return np.concatenate(parts) if parts else np.zeros(0)


def _lag1(w: FloatArray) -> float:
    return float(np.mean(w[1:] * w[:-1]) / max(float(np.mean(w**2)), 1e-12))
