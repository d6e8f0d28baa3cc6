"""The offset of a drive from the map, which wanders slowly along it.

Per axis it is a Gauss-Markov process with the trajectory's own sd, so that in units of that
sd it has variance one and correlation exp(-dt / tau).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.candidates import D_E, D_N, D_U, EVIDENCE, V_EE, V_EN, V_NN, V_U, match_gain
from automap.records import FloatArray, IntArray

_ROUNDS = 3
"""Of the choice of candidates and their mean."""


@kernel
def agreement(values: FloatArray, e: float, n: float, u: float, p_e: float, p_n: float) -> float:
    """Evidence in nats for one candidate when the drive's offset is (e, n, u), variances p."""
    v_ee, v_en, v_nn = values[V_EE] + p_e, values[V_EN], values[V_NN] + p_n
    de, dn = values[D_E] - e, values[D_N] - n
    det = v_ee * v_nn - v_en * v_en
    square = (v_nn * de * de - 2.0 * v_en * de * dn + v_ee * dn * dn) / det
    if values[V_U] == values[V_U]:
        square += (values[D_U] - u) ** 2 / values[V_U]
    gain = match_gain(v_ee, v_en, v_nn, values[V_U])
    return float(values[EVIDENCE] + gain - 0.5 * square)


@kernel
def vote(
    time_s: FloatArray,
    shared_sd: FloatArray,
    index: IntArray,
    values: FloatArray,
    offset: FloatArray,
) -> None:
    """First guess of the offset [n, 3] of a drive's sightings [n], stretch by stretch.

    Every candidate proposes its own difference of place as the offset of its stretch; the
    proposal that most of the others agree with wins, weighed by what the stretch before it
    lets expect. One sign alone cannot pull a drive onto the wrong map signs.
    """
    n = len(time_s)
    mean, variance = np.zeros(3), np.full(3, -1.0)
    last = 0.0
    start = 0
    while start < n:
        stop = start + 1
        while (
            stop < n
            and stop - start < limits.STRETCH_SIGHTINGS
            and time_s[stop] - time_s[start] < limits.STRETCH_S
        ):
            stop += 1
        middle = 0.5 * (time_s[start] + time_s[stop - 1])
        prior = np.zeros(3)
        for axis in range(3):
            total = 0.0
            for i in range(start, stop):
                total += shared_sd[i, axis] ** 2
            # the map's own frame is some other drive's, as far off as this one
            prior[axis] = 2.0 * total / (stop - start) + limits.LEAST_OFFSET_VARIANCE
            if variance[axis] < 0.0:
                variance[axis] = prior[axis]
            else:
                keep = np.exp(-(middle - last) / limits.PATH_CORRELATION_S)
                mean[axis] *= keep
                variance[axis] = keep * keep * variance[axis] + (1.0 - keep * keep) * prior[axis]
        spread = 1.0 - np.exp(-np.abs(time_s[start:stop] - middle) / limits.PATH_CORRELATION_S) ** 2
        of = _Stretch(index[start:stop], values[start:stop], spread, prior, mean, variance)
        mean, variance = _offset_of(of)
        offset[start:stop] = mean
        last = middle
        start = stop


class _Stretch(NamedTuple):
    """Candidates ``signs`` [k, MOST] and ``values`` [k, MOST, PLACES] of sightings; ``prior`` [3]
    variance of the drive's offset, and the part ``spread`` [k] of it by which that at each may
    differ from the stretch's; ``mean`` and ``variance`` [3] of this by the stretches before."""

    signs: IntArray
    values: FloatArray
    spread: FloatArray
    prior: FloatArray
    mean: FloatArray
    variance: FloatArray


@kernel
def _offset_of(stretch: _Stretch) -> tuple[FloatArray, FloatArray]:
    """Mean [3] and variance [3] of the offset after the stretch's sightings."""
    signs, values = stretch.signs, stretch.values
    best = stretch.mean.copy()
    highest = _support(stretch, best)
    tried = 0
    for i in range(len(signs)):
        for c in range(limits.MOST):
            if signs[i, c] < 0:
                break
            # after many proposals the nearest of each sighting has to do
            if tried >= limits.HYPOTHESES and c > 0:
                break
            tried += 1
            guess = values[i, c, :3].copy()
            if values[i, c, V_U] != values[i, c, V_U]:
                guess[2] = stretch.mean[2]
            score = _support(stretch, guess)
            if score > highest:
                highest = score
                best = guess
    after = stretch.variance
    for _ in range(_ROUNDS):
        best, after = _refine(stretch, best)
    return best, after


@kernel
def _likeliest(stretch: _Stretch, i: int, offset: FloatArray) -> tuple[float, int]:
    """Evidence in nats for the best candidate of one sighting, and which it is: 0, -1 for none."""
    e, n, u = offset[0], offset[1], offset[2]
    p_e, p_n = stretch.spread[i] * stretch.prior[0], stretch.spread[i] * stretch.prior[1]
    most, chosen = 0.0, -1
    for c in range(limits.MOST):
        if stretch.signs[i, c] < 0:
            break
        told = agreement(stretch.values[i, c], e, n, u, p_e, p_n)
        if told > most:
            most, chosen = told, c
    return most, chosen


@kernel
def _support(stretch: _Stretch, offset: FloatArray) -> float:
    total = -0.5 * ((offset - stretch.mean) ** 2 / stretch.variance).sum()
    for i in range(len(stretch.signs)):
        total += _likeliest(stretch, i, offset)[0]
    return float(total)


@kernel
def _refine(stretch: _Stretch, offset: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted mean of the best candidates' differences and its variance, [3] each."""
    signs, values, spread, prior, mean, variance = stretch
    a_ee, a_en, a_nn = 1.0 / variance[0], 0.0, 1.0 / variance[1]
    b_e, b_n = mean[0] / variance[0], mean[1] / variance[1]
    a_u, b_u = 1.0 / variance[2], mean[2] / variance[2]
    for i in range(len(signs)):
        wander, chosen = spread[i], _likeliest(stretch, i, offset)[1]
        if chosen < 0:
            continue
        row = values[i, chosen]
        v_ee, v_nn = row[V_EE] + wander * prior[0], row[V_NN] + wander * prior[1]
        det = v_ee * v_nn - row[V_EN] ** 2
        w_ee, w_en, w_nn = v_nn / det, -row[V_EN] / det, v_ee / det
        a_ee, a_en, a_nn = a_ee + w_ee, a_en + w_en, a_nn + w_nn
        b_e += w_ee * row[D_E] + w_en * row[D_N]
        b_n += w_en * row[D_E] + w_nn * row[D_N]
        if row[V_U] == row[V_U]:
            w_u = 1.0 / (row[V_U] + wander * prior[2])
            a_u += w_u
            b_u += w_u * row[D_U]
    det = a_ee * a_nn - a_en * a_en
    best = np.array([(a_nn * b_e - a_en * b_n) / det, (a_ee * b_n - a_en * b_e) / det, b_u / a_u])
    return best, np.array([a_nn / det, a_ee / det, 1.0 / a_u])


@kernel
def smooth(
    time_s: FloatArray,
    shared_sd: FloatArray,
    chosen: IntArray,
    values: FloatArray,
    offset: FloatArray,
    offset_var: FloatArray,
) -> None:
    """Offset [n, 3] and its variance [n, 3] from the candidates ``chosen`` [n] (-1 none).

    Kalman filter and Rauch-Tung-Striebel smoother (AIAA Journal 3, 1965) per axis, each along its
    own variance (the ellipses' tilt matters little here). A difference of more than three
    sigmas counts less.
    """
    n = len(time_s)
    filtered, var_filtered = np.zeros(n), np.zeros(n)
    ahead, var_ahead = np.zeros(n), np.zeros(n)
    for axis in range(3):
        for i in range(n):
            sd = np.sqrt(2.0 * shared_sd[i, axis] ** 2 + limits.LEAST_OFFSET_VARIANCE)
            if i == 0:
                ahead[i], var_ahead[i] = 0.0, 1.0
            else:
                keep = np.exp(-max(time_s[i] - time_s[i - 1], 0.0) / limits.PATH_CORRELATION_S)
                ahead[i] = keep * filtered[i - 1]
                var_ahead[i] = keep * keep * var_filtered[i - 1] + 1.0 - keep * keep
            filtered[i], var_filtered[i] = ahead[i], var_ahead[i]
            c = chosen[i]
            if c < 0:
                continue
            noise = values[i, c, V_EE if axis == 0 else (V_NN if axis == 1 else V_U)]
            if noise != noise:
                continue
            noise /= sd * sd
            miss = values[i, c, axis] / sd - ahead[i]
            square = (values[i, c, axis] - offset[i, axis]) ** 2 / (noise * sd * sd)
            if square > limits.STRAY_GATE:
                noise *= square / limits.STRAY_GATE
            gain = var_ahead[i] / (var_ahead[i] + noise)
            filtered[i] += gain * miss
            var_filtered[i] *= 1.0 - gain
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                keep = np.exp(-max(time_s[i + 1] - time_s[i], 0.0) / limits.PATH_CORRELATION_S)
                gain = var_filtered[i] * keep / var_ahead[i + 1]
                filtered[i] += gain * (filtered[i + 1] - ahead[i + 1])
                var_filtered[i] += gain * gain * (var_filtered[i + 1] - var_ahead[i + 1])
            sd = np.sqrt(2.0 * shared_sd[i, axis] ** 2 + limits.LEAST_OFFSET_VARIANCE)
            offset[i, axis] = filtered[i] * sd
            offset_var[i, axis] = var_filtered[i] * sd * sd
