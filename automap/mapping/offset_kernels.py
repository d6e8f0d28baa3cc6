"""The offset of a drive from the map, which wanders slowly along it.

Per axis it is a Gauss-Markov process with the trajectory's own sd, so that in units of that
sd it has variance one and correlation exp(-dt / tau).
"""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.mapping.candidates import D_E, D_N, D_U, EVIDENCE, V_EE, V_EN, V_NN, V_U, match_gain
from automap.mapping.limits import (
    HYPOTHESES,
    LEAST_OFFSET_VARIANCE,
    MOST,
    STRAY_GATE,
    STRETCH_S,
    STRETCH_SIGHTINGS,
)
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
    tau_s: float,
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
            and stop - start < STRETCH_SIGHTINGS
            and time_s[stop] - time_s[start] < STRETCH_S
        ):
            stop += 1
        middle = 0.5 * (time_s[start] + time_s[stop - 1])
        prior = np.zeros(3)
        for axis in range(3):
            total = 0.0
            for i in range(start, stop):
                total += shared_sd[i, axis] ** 2
            # the map's own frame is some other drive's, as far off as this one
            prior[axis] = 2.0 * total / (stop - start) + LEAST_OFFSET_VARIANCE
            if variance[axis] < 0.0:
                variance[axis] = prior[axis]
            else:
                keep = np.exp(-(middle - last) / tau_s)
                mean[axis] *= keep
                variance[axis] = keep * keep * variance[axis] + (1.0 - keep * keep) * prior[axis]
        _best_of_stretch(start, stop, time_s, middle, prior, tau_s, index, values, mean, variance)
        for i in range(start, stop):
            for axis in range(3):
                offset[i, axis] = mean[axis]
        last = middle
        start = stop


@kernel
def _best_of_stretch(
    start: int,
    stop: int,
    time_s: FloatArray,
    middle: float,
    prior: FloatArray,
    tau_s: float,
    index: IntArray,
    values: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
) -> None:
    """Replace mean [3] and variance [3] by those after the stretch's sightings."""
    spread = np.zeros(stop - start)
    for i in range(start, stop):
        keep = np.exp(-abs(time_s[i] - middle) / tau_s)
        spread[i - start] = 1.0 - keep * keep
    best = np.array([mean[0], mean[1], mean[2]])
    highest = _support(start, stop, best, spread, prior, index, values, mean, variance)
    tried = 0
    for i in range(start, stop):
        for c in range(MOST):
            if index[i, c] < 0:
                break
            # after many proposals the nearest of each sighting has to do
            if tried >= HYPOTHESES and c > 0:
                break
            tried += 1
            guess = values[i, c, :3].copy()
            if values[i, c, V_U] != values[i, c, V_U]:
                guess[2] = mean[2]
            score = _support(start, stop, guess, spread, prior, index, values, mean, variance)
            if score > highest:
                highest = score
                best = guess
    for _ in range(_ROUNDS):
        best, after = _refine(start, stop, best, spread, prior, index, values, mean, variance)
    for axis in range(3):
        mean[axis], variance[axis] = best[axis], after[axis]


@kernel
def _support(
    start: int,
    stop: int,
    guess: FloatArray,
    spread: FloatArray,
    prior: FloatArray,
    index: IntArray,
    values: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
) -> float:
    total = 0.0
    for axis in range(3):
        total -= 0.5 * (guess[axis] - mean[axis]) ** 2 / variance[axis]
    for i in range(start, stop):
        wander = spread[i - start]
        most = 0.0
        for c in range(MOST):
            if index[i, c] < 0:
                break
            told = agreement(
                values[i, c], guess[0], guess[1], guess[2], wander * prior[0], wander * prior[1]
            )
            most = max(most, told)
        total += most
    return total


@kernel
def _refine(
    start: int,
    stop: int,
    guess: FloatArray,
    spread: FloatArray,
    prior: FloatArray,
    index: IntArray,
    values: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Weighted mean of the best candidates' differences and its variance, [3] each."""
    a_ee, a_en, a_nn = 1.0 / variance[0], 0.0, 1.0 / variance[1]
    b_e, b_n = mean[0] / variance[0], mean[1] / variance[1]
    a_u, b_u = 1.0 / variance[2], mean[2] / variance[2]
    for i in range(start, stop):
        wander = spread[i - start]
        most, chosen = 0.0, -1
        for c in range(MOST):
            if index[i, c] < 0:
                break
            told = agreement(
                values[i, c], guess[0], guess[1], guess[2], wander * prior[0], wander * prior[1]
            )
            if told > most:
                most, chosen = told, c
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
    tau_s: float,
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
            sd = np.sqrt(2.0 * shared_sd[i, axis] ** 2 + LEAST_OFFSET_VARIANCE)
            if i == 0:
                ahead[i], var_ahead[i] = 0.0, 1.0
            else:
                keep = np.exp(-max(time_s[i] - time_s[i - 1], 0.0) / tau_s)
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
            if square > STRAY_GATE:
                noise *= square / STRAY_GATE
            gain = var_ahead[i] / (var_ahead[i] + noise)
            filtered[i] += gain * miss
            var_filtered[i] *= 1.0 - gain
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                keep = np.exp(-max(time_s[i + 1] - time_s[i], 0.0) / tau_s)
                gain = var_filtered[i] * keep / var_ahead[i + 1]
                filtered[i] += gain * (filtered[i + 1] - ahead[i + 1])
                var_filtered[i] += gain * gain * (var_filtered[i + 1] - var_ahead[i + 1])
            sd = np.sqrt(2.0 * shared_sd[i, axis] ** 2 + LEAST_OFFSET_VARIANCE)
            offset[i, axis] = filtered[i] * sd
            offset_var[i, axis] = var_filtered[i] * sd * sd
