"""The offset of a drive from the map, which wanders slowly along it.

Per axis it is a Gauss-Markov process with the trajectory's own sd: over a stretch of less than its
time constant it stays about the same.
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
    """Offset [n, 3] of a drive's sightings [n] and its variance [n, 3].

    Every candidate proposes its own difference of place as the offset of its stretch; the
    proposal that most of the others agree with wins. One sign alone cannot pull a drive onto the
    wrong map signs. The offset at a sighting is the mean of what agrees within a stretch's time of
    it, each by its own error and by what the offset wanders until there. Stretches begin at fixed
    times, so that they are the same whatever else of the drive is looked at.
    """
    n = len(time_s)
    chosen, prior = np.full(n, -1), np.empty((n, 3))
    start = 0
    while start < n:
        stop = start + 1
        while (
            stop < n
            and stop - start < limits.STRETCH_SIGHTINGS
            and time_s[stop] // limits.STRETCH_S == time_s[start] // limits.STRETCH_S
        ):
            stop += 1
        part = slice(start, stop)
        # the map's own frame is some other drive's, as far off as this one
        prior[part] = 2.0 * np.sum(shared_sd[part] ** 2, axis=0) / (stop - start)
        prior[part] += limits.LEAST_OFFSET_VARIANCE
        wander = _wander(time_s[part], 0.5 * (time_s[start] + time_s[stop - 1]))
        _agreeing(index[part], values[part], wander, prior[start], chosen[part])
        start = stop
    for i in range(n):
        first, last = max(i - limits.STRETCH_SIGHTINGS, 0), i + limits.STRETCH_SIGHTINGS + 1
        wander = _wander(time_s[first:last], time_s[i])
        weight, pull = 1.0 / prior[i], np.zeros(3)
        for k in range(first, first + len(wander)):
            if chosen[k] < 0 or abs(time_s[k] - time_s[i]) > limits.STRETCH_S:
                continue
            place = values[k, chosen[k]]
            for axis, column in enumerate((V_EE, V_NN, V_U)):
                if place[column] == place[column]:
                    told = 1.0 / (place[column] + wander[k - first] * prior[i, axis])
                    weight[axis] += told
                    pull[axis] += told * place[axis]
        offset[i], offset_var[i] = pull / weight, 1.0 / weight


@kernel
def _wander(time_s: FloatArray, at_s: float) -> FloatArray:
    """Of the variance of an offset, what that at the times [n] does not share with one other."""
    return 1.0 - np.exp(-2.0 * np.abs(time_s - at_s) / limits.PATH_CORRELATION_S)


@kernel
def _agreeing(
    signs: IntArray, values: FloatArray, wander: FloatArray, prior: FloatArray, chosen: IntArray
) -> None:
    """Fill in the candidates ``chosen`` [k] (-1 none) of the offset that most of a stretch's
    sightings agree with, of ``signs`` [k, MOST] and ``values`` [k, MOST, PLACES]; ``prior`` [3]
    variance of the drive's offset, and the part ``wander`` [k] of it by which that at each may
    differ from the stretch's."""
    trial = np.full(len(signs), -1)
    highest = _support(signs, values, wander, prior, np.zeros(3), chosen)
    for i in range(len(signs)):
        for c in range(limits.MOST):
            if signs[i, c] < 0:
                break
            guess = values[i, c, :3].copy()
            if values[i, c, V_U] != values[i, c, V_U]:
                guess[2] = 0.0
            score = _support(signs, values, wander, prior, guess, trial)
            if score > highest:
                highest, chosen[:] = score, trial


@kernel
def _support(
    signs: IntArray,
    values: FloatArray,
    wander: FloatArray,
    prior: FloatArray,
    offset: FloatArray,
    chosen: IntArray,
) -> float:
    """Evidence in nats for an offset [3]: its prior's, and of each sighting the best candidate's,
    ``chosen`` [k], or none (-1)."""
    total = -0.5 * (offset**2 / prior).sum()
    chosen[:] = -1
    for i in range(len(signs)):
        p_e, p_n = wander[i] * prior[0], wander[i] * prior[1]
        most = 0.0
        for c in range(limits.MOST):
            if signs[i, c] < 0:
                break
            told = agreement(values[i, c], offset[0], offset[1], offset[2], p_e, p_n)
            if told > most:
                most, chosen[i] = told, c
        total += most
    return float(total)
