"""Exact slopes of the log-likelihood along the noise levels, all levels in one backward pass.

Koopman and Shephard (Exact score for time series models in state space form, Biometrika 79,
1992): with the smoother's adjoint r and its information N, the slope along a measurement's
variance R is 1/2 (u^2 - D), along the noise of an interval Q 1/2 tr((r r' - N) Q'), where u and
D are the smoothed measurement error over R and its variance. Along the share d of a correlated
state that outlasts an interval, with m and P of the filter before it, it is r m + ((r r' - N) F P)
at that state's place, and -2 d of that along its noise. So a dozen levels cost one run forward and
one back, not two runs each.

A block that surprised has its variance multiplied by f, just so that its NIS is at the gate; f
follows the levels. What that adds to their slopes is a multiplier on the block's NIS (Nocedal and
Wright, Numerical Optimization, 2006, section 12.1) with which the slope along f is none.
"""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import ForwardStore
from automap.fusion.kernels.smoother import undo_interval, undo_scalars
from automap.fusion.kernels.surprising_slopes import undo_surprising
from automap.fusion.kernels.transition import outlasting
from automap.fusion.layout import MAX_SCALARS, N_NAV
from automap.jit import kernel
from automap.records import FloatArray, IntArray

ACCEL, GYRO = 0, 1


@kernel
def level_slopes(
    node_t: FloatArray,
    var: FloatArray,
    keep: FloatArray,
    kept: IntArray,
    tau: FloatArray,
    walk: FloatArray,
    noise: FloatArray,
    level_of_channel: IntArray,
    level_of_state: IntArray,
    level_of_time: IntArray,
    store: ForwardStore,
    most_factor: float,
    left_out: FloatArray,
    slope: FloatArray,
    info: FloatArray,
    part: IntArray,
) -> None:
    """Add to ``slope`` [g, l] the slopes along the logarithms of factors on sds, to ``info``
    [g, l] the variance that each slope has where its level is right, those of the ``part`` [k] that
    each node, with the interval before it, is of.

    ``node_t`` [k] s, ``var`` [k, 15] by channel, ``keep`` [k, 6] and ``kept`` [n] as in the
    forward pass, ``tau``, ``walk`` [n], ``noise`` [2] PSD of force and rate. Levels of
    channels [15], of states [n] and of how long these last [n], -1 none; ``store`` of a forward
    run about given states.
    ``most_factor`` and ``left_out`` [2] as in ``undo_surprising``.
    """
    n_nodes, n = store.mean.shape
    lam = np.zeros(n)
    big = np.zeros((n, n))
    error, spread = np.zeros(MAX_SCALARS), np.zeros(MAX_SCALARS)
    decay = np.ones(n)
    for k in range(n_nodes - 1, -1, -1):
        a, b = store.scalars[k - 1] if k > 0 else 0, store.scalars[k]
        surprised = False
        for i in range(a, b):
            surprised = surprised or store.factor[i] > 1.0
        if surprised:
            undo_surprising(lam, big, var[k], store, a, b, most_factor, left_out, error, spread)
        else:
            undo_scalars(
                lam,
                big,
                store.h[a:b],
                store.gain[a:b],
                store.nu[a:b],
                store.var[a:b],
                error,
                spread,
            )
            for q in range(b - a):
                error[q] *= error[q]
        for q in range(b - a):
            channel = store.info[a + q, 1]
            level = level_of_channel[channel]
            if level >= 0:
                size = var[k, channel] * store.factor[a + q]
                slope[part[k], level] += size * (error[q] - spread[q])
                info[part[k], level] += 2.0 * (size * spread[q]) ** 2
        span = node_t[k] - node_t[k - 1] if k > 0 else 0.0
        outlasting(span, tau, kept, keep[k], decay)
        for j in range(N_NAV, n):
            level = level_of_state[j]
            if level < 0:
                continue
            q = walk[j] * span
            if tau[j] > 0.0:
                # at the start a correlated state has all of its variance
                q = (1.0 - decay[j] ** 2 if k > 0 else 1.0) * walk[j]
            slope[part[k], level] += q * (lam[j] ** 2 - big[j, j])
            info[part[k], level] += 2.0 * (q * big[j, j]) ** 2
        if k > 0 and span > 0.0:
            _lasting(
                *(lam, big, store, k, span, tau, walk, decay, level_of_time),
                *(slope[part[k]], info[part[k]]),
            )
            _inertial(lam, big, store.trans[k], noise, span, slope[part[k]], info[part[k]])
            undo_interval(lam, big, store.trans[k], decay)


@kernel
def _lasting(
    lam: FloatArray,
    big: FloatArray,
    store: ForwardStore,
    k: int,
    span: float,
    tau: FloatArray,
    walk: FloatArray,
    decay: FloatArray,
    level_of_time: IntArray,
    slope: FloatArray,
    info: FloatArray,
) -> None:
    """Slopes along the times that correlated states last, over the interval before node ``k``.

    Over a short one a longer time is less noise, to which half the variance of the slope along
    the size belongs.
    """
    n = lam.shape[0]
    before, moved = np.empty(n), np.empty(n)
    for j in range(N_NAV, n):
        level = level_of_time[j]
        if level < 0 or tau[j] <= 0.0:
            continue
        first = 0
        for i in range(n):
            if i < j:
                before[i] = store.cov[k - 1, first + j - i]
                first += n - i
            else:
                before[i] = store.cov[k - 1, first + i - j]
        for a in range(n):
            moved[a] = decay[a] * before[a]
        for a in range(N_NAV):
            moved[a] = 0.0
            for b in range(n):
                moved[a] += store.trans[k, a, b] * before[b]
        d, e = decay[j], lam[j] ** 2 - big[j, j]
        by_share = -lam[j] * (store.params[k - 1, j - N_NAV] + store.mean[k - 1, j])
        for a in range(n):
            by_share += (lam[j] * lam[a] - big[j, a]) * moved[a]
        slope[level] += span / tau[j] * d * (by_share - d * walk[j] * e)
        info[level] += 0.5 * ((1.0 - d * d) * walk[j] * big[j, j]) ** 2


@kernel
def _inertial(
    lam: FloatArray,
    big: FloatArray,
    trans: FloatArray,
    noise: FloatArray,
    span: float,
    slope: FloatArray,
    info: FloatArray,
) -> None:
    """Slopes along the noise of force and rate over one short interval.

    What noise adds to, it hands on evenly within the interval: position receives the velocity's
    noise through T = d position / d velocity, Q_pv = T/2, Q_pp = T T'/3 times the velocity's, and
    velocity the tilt's likewise. What tilts add to positions is left out.
    """
    _handed_on(lam, big, trans, 3, noise[0] * span, ACCEL, slope, info)
    _handed_on(lam, big, trans, 6, noise[1] * span, GYRO, slope, info)


@kernel
def _handed_on(
    lam: FloatArray,
    big: FloatArray,
    trans: FloatArray,
    first: int,
    q: float,
    level: int,
    slope: FloatArray,
    info: FloatArray,
) -> None:
    """Noise of variance ``q`` on the three states from ``first`` on and on the three before."""
    to = first - 3
    for i in range(first, first + 3):
        e = lam[i] ** 2 - big[i, i]
        m = big[i, i]
        for b in range(to, first):
            t = trans[b, i]
            e += t * (lam[b] * lam[i] - big[b, i])
            m += t * big[b, i]
            for c in range(to, first):
                w = t * trans[c, i] / 3.0
                e += w * (lam[b] * lam[c] - big[b, c])
                m += w * big[b, c]
        slope[level] += q * e
        info[level] += 2.0 * (q * m) ** 2
