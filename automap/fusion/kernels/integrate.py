"""The nominal state from node to node, with transition rows and process noise."""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import ModelArrays, Samples
from automap.fusion.kernels.readings import correct, correction_of, raw_at, shift_of
from automap.fusion.kernels.transition import add_noise, add_transition
from automap.fusion.mechanisation import strapdown_step
from automap.jit import kernel
from automap.records import FloatArray

GAP_STEP_S = 0.02
"""Inside a gap of the samples the integration takes steps of this length."""


@kernel
def integrate(
    samples: Samples,
    model: ModelArrays,
    i: int,
    t: float,
    t_end: float,
    pos: FloatArray,
    vel: FloatArray,
    q: FloatArray,
    c: FloatArray,
    xi: FloatArray,
    place: FloatArray,
    phi: FloatArray,
    noise: FloatArray,
    rate: FloatArray,
    now: FloatArray,
    mid: FloatArray,
) -> int:
    """Carry the nominal state from ``t`` to ``t_end`` with transition rows and noise.

    ``i`` the sample at or before ``t``; returns the one at or before ``t_end``. ``rate`` [3]
    receives the mean corrected rate, ``now`` [6] the corrected reading at the end, ``mid`` [6 + e]
    the last corrected reading and extra signals.
    """
    # taken out of the tuples once: in the loop that would count references at every access
    times, readings, extra, shocks = samples.t, samples.raw, samples.extra, samples.shocks
    terms, gap = model.terms, model.gap
    qa0, qg0 = model.noise[0], model.noise[1]
    n_imu = times.shape[0]
    full = np.empty(6)
    matrix = np.empty((6, 6))
    shift = np.empty(6)
    raw = np.empty(6)
    ra = np.empty(6)
    rb = np.empty(6)
    dvn = np.empty(3)
    c_mid = np.empty((3, 3))
    n_extra = extra.shape[1]
    correction_of(model.terms, xi, samples.extra[i], matrix, shift)
    raw_at(samples, i, t, raw)
    correct(raw, matrix, shift, ra)
    start = t
    for a in range(3):
        rate[a] = 0.0
    while t < t_end:
        following = times[i + 1]
        width = following - times[i]
        wide = width > gap[0]
        nxt = following
        if nxt > t_end or i == n_imu - 2:
            nxt = t_end
        if wide and nxt - t > GAP_STEP_S:
            nxt = t + GAP_STEP_S
        if n_extra > 0:
            shift_of(terms, xi, extra[i], matrix, shift)
        if nxt == following:
            for a in range(6):
                full[a] = readings[i + 1, a]
            correct(full, matrix, shift, rb)
        else:
            raw_at(samples, i, nxt, raw)
            correct(raw, matrix, shift, rb)
        dt = nxt - t
        for a in range(6):
            mid[a] = 0.5 * (ra[a] + rb[a])
        for a in range(n_extra):
            mid[6 + a] = extra[i, a]
        if dt > 0.0:
            for a in range(3):
                for b in range(3):
                    c_mid[a, b] = 0.5 * c[a, b]
            strapdown_step(pos, vel, q, c, ra, rb, dt, place, dvn)
            for a in range(3):
                for b in range(3):
                    c_mid[a, b] += 0.5 * c[a, b]
            add_transition(phi, terms, c_mid, mid, dvn, dt)
            qa, qg = qa0 + shocks[i, 0], qg0 + shocks[i, 1]
            if wide:
                qa += gap[1] * gap[1] * width
                qg += gap[2] * gap[2] * width
            add_noise(noise, dvn, dt, qa, qg)
        for a in range(3):
            rate[a] += mid[a] * dt
        for a in range(6):
            ra[a] = rb[a]
        t = nxt
        if i < n_imu - 2 and t >= following:
            i += 1
    for a in range(3):
        rate[a] /= max(t_end - start, 1e-9)
    for a in range(6):
        now[a] = ra[a]
    return i


@kernel
def reading_at(
    samples: Samples,
    model: ModelArrays,
    i: int,
    t: float,
    xi: FloatArray,
    rate: FloatArray,
    mid: FloatArray,
) -> None:
    """Corrected rate [3] and reading with extra signals [6 + e] at one instant."""
    matrix = np.empty((6, 6))
    shift = np.empty(6)
    raw = np.empty(6)
    correction_of(model.terms, xi, samples.extra[i], matrix, shift)
    raw_at(samples, i, t, raw)
    correct(raw, matrix, shift, mid)
    for a in range(3):
        rate[a] = mid[a]
    for a in range(samples.extra.shape[1]):
        mid[6 + a] = samples.extra[i, a]
