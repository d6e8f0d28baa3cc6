"""The offset of a drive from the map, which wanders slowly along it.

Per axis it is a Gauss-Markov process with the trajectory's own sd, so that in units of that
sd it has variance one and correlation exp(-dt / tau).
"""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.mapping import limits
from automap.mapping.candidates import V_EE, V_NN, V_U, agreement
from automap.records import FloatArray, IntArray


@kernel
def vote(
    time_s: FloatArray,
    shared_sd: FloatArray,
    index: IntArray,
    values: FloatArray,
    offset: FloatArray,
    offset_var: FloatArray,
) -> None:
    """First guess of the offset [n, 3] of a drive's sightings [n], stretch by stretch, and its
    variance [n, 3].

    Every candidate proposes its own difference of place as the offset of its stretch; the
    proposal that most of the others agree with wins. One sign alone cannot pull a drive onto the
    wrong map signs. Stretches begin at fixed times, so that they are the same whatever else of the
    drive is looked at.
    """
    n = len(time_s)
    start = 0
    while start < n:
        stop = start + 1
        while (
            stop < n
            and stop - start < limits.STRETCH_SIGHTINGS
            and time_s[stop] // limits.STRETCH_S == time_s[start] // limits.STRETCH_S
        ):
            stop += 1
        middle = 0.5 * (time_s[start] + time_s[stop - 1])
        # the map's own frame is some other drive's, as far off as this one
        prior = 2.0 * np.sum(shared_sd[start:stop] ** 2, axis=0) / (stop - start)
        prior += limits.LEAST_OFFSET_VARIANCE
        spread = 1.0 - np.exp(-np.abs(time_s[start:stop] - middle) / limits.PATH_CORRELATION_S) ** 2
        offset[start:stop] = _offset_of(index[start:stop], values[start:stop], spread, prior)
        for i in range(start, stop):
            offset_var[i] = spread[i - start] * prior
        start = stop


@kernel
def _offset_of(
    signs: IntArray, values: FloatArray, spread: FloatArray, prior: FloatArray
) -> FloatArray:
    """The offset [3] that most of a stretch's sightings agree with, of candidates ``signs`` [k,
    MOST] and ``values`` [k, MOST, PLACES]; ``prior`` [3] variance of the drive's offset, and the
    part ``spread`` [k] of it by which that at each may differ from the stretch's."""
    best = np.zeros(3)
    highest = _support(signs, values, spread, prior, best)
    for i in range(len(signs)):
        for c in range(limits.MOST):
            if signs[i, c] < 0:
                break
            guess = values[i, c, :3].copy()
            if values[i, c, V_U] != values[i, c, V_U]:
                guess[2] = 0.0
            score = _support(signs, values, spread, prior, guess)
            if score > highest:
                highest = score
                best = guess
    return best


@kernel
def _support(
    signs: IntArray, values: FloatArray, spread: FloatArray, prior: FloatArray, offset: FloatArray
) -> float:
    """Evidence in nats for an offset [3]: its prior's, and of each sighting the best candidate's,
    or none."""
    total = -0.5 * (offset**2 / prior).sum()
    for i in range(len(signs)):
        most = 0.0
        for c in range(limits.MOST):
            if signs[i, c] < 0:
                break
            most = max(most, agreement(values[i, c], offset, spread[i] * prior))
        total += most
    return float(total)


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
