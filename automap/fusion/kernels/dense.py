"""States at every sample by re-integration between nodes."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.arrays import ModelArrays, Samples
from automap.fusion.kernels.integrate import GAP_STEP_S
from automap.fusion.kernels.readings import correct, correction_of, raw_at, shift_of
from automap.fusion.kernels.state import subtract
from automap.fusion.mechanisation import (
    N_EARTH,
    earth_terms,
    quat_to_dcm,
    radii,
    rotate_left,
    strapdown_step,
)
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def _spread(
    samples: Samples,
    first: int,
    last: int,
    t0: float,
    t1: float,
    miss: FloatArray,
    rm: float,
    rn: float,
    out: FloatArray,
) -> None:
    """Spread the mismatch ``miss`` [9] at ``t1`` evenly over samples ``first`` to ``last``."""
    for j in range(first, last + 1):
        s = (samples.t[j] - t0) / (t1 - t0)
        out[j, 0] += s * miss[0] / (rm + out[j, 2])
        out[j, 1] += s * miss[1] / ((rn + out[j, 2]) * math.cos(out[j, 0]))
        out[j, 2] -= s * miss[2]
        for a in range(3):
            out[j, 3 + a] += s * miss[3 + a]
        rotate_left(out[j, 6:10], s * miss[6], s * miss[7], s * miss[8])


@kernel
def run_dense(
    samples: Samples,
    model: ModelArrays,
    node_t: FloatArray,
    nominal: FloatArray,
    params: FloatArray,
    blend: bool,
    out: FloatArray,
    rates: FloatArray,
) -> None:
    """States ``out`` [n, 10] and corrected readings ``rates`` [n, 6] (or empty) at
    every sample.

    ``nominal`` [k, 10], ``params`` [k, n - 9] the states at the nodes. With ``blend`` the
    mismatch at the next node (process noise that the smoother assigned) is spread over the
    interval, without it the integration simply runs on. Samples before the first or after the
    last node keep what was there.
    """
    n_imu = samples.t.shape[0]
    pos = np.zeros(3)
    vel = np.zeros(3)
    q = np.zeros(4)
    c = np.zeros((3, 3))
    dvn = np.zeros(3)
    raw = np.zeros(6)
    ra = np.zeros(6)
    rb = np.zeros(6)
    miss = np.zeros(9)
    matrix = np.zeros((6, 6))
    shift = np.zeros(6)
    place = np.zeros(N_EARTH)
    i = 0
    while i < n_imu - 2 and samples.t[i + 1] <= node_t[0]:
        i += 1
    if samples.t[i] == node_t[0]:
        out[i, :] = nominal[0]
        correction_of(model.terms, params[0], samples.extra[i], matrix, shift)
        if rates.shape[0] > 0:
            correct(samples.raw[i], matrix, shift, rates[i])
    for k in range(node_t.shape[0] - 1):
        t0, t1 = node_t[k], node_t[k + 1]
        if t1 <= t0:
            continue
        pos[:] = nominal[k, 0:3]
        vel[:] = nominal[k, 3:6]
        q[:] = nominal[k, 6:10]
        quat_to_dcm(q, c)
        earth_terms(pos, model.earth_on, place)
        correction_of(model.terms, params[k], samples.extra[i], matrix, shift)
        raw_at(samples, i, t0, raw)
        correct(raw, matrix, shift, ra)
        t = t0
        first = i + 1
        while t < t1:
            following = samples.t[i + 1]
            wide = following - samples.t[i] > model.longest_step
            nxt = following
            if nxt > t1 or i == n_imu - 2:
                nxt = min(t1, following)
            if wide and nxt - t > GAP_STEP_S:
                nxt = t + GAP_STEP_S
            if samples.extra.shape[1] > 0:
                shift_of(model.terms, params[k], samples.extra[i], matrix, shift)
            if nxt == following:
                correct(samples.raw[i + 1], matrix, shift, rb)
            else:
                raw_at(samples, i, nxt, raw)
                correct(raw, matrix, shift, rb)
            if nxt > t:
                strapdown_step(pos, vel, q, c, ra, rb, nxt - t, place, dvn)
            for a in range(6):
                ra[a] = rb[a]
            t = nxt
            if t >= following:
                out[i + 1, 0:3] = pos
                out[i + 1, 3:6] = vel
                out[i + 1, 6:10] = q
                if rates.shape[0] > 0:
                    rates[i + 1, :] = ra
                if i == n_imu - 2:
                    break
                i += 1
        if blend:
            subtract(pos, vel, q, nominal[k + 1], miss)
            for a in range(9):
                miss[a] = -miss[a]
            rm, rn = radii(pos[0])
            last = i + 1 if samples.t[i + 1] <= t1 else i
            _spread(samples, first, last, t0, t1, miss, rm, rn, out)
