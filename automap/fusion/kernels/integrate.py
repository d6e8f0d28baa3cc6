"""The nominal state from node to node, with transition rows and process noise."""

from __future__ import annotations

import numpy as np

from automap.fusion.arrays import Legs, ModelArrays, Samples
from automap.fusion.kernels.readings import correct, correction_of, raw_at, shift_of, take_noise_out
from automap.fusion.kernels.state import load_state, subtract
from automap.fusion.kernels.transition import add_noise, add_transition, start_interval
from automap.fusion.mechanisation import earth_terms, strapdown_step
from automap.jit import kernel
from automap.records import FloatArray, IntArray

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
    rate: FloatArray,
    now: FloatArray,
    mid: FloatArray,
    done: int,
    dvns: FloatArray,
    dts: FloatArray,
    since: IntArray,
) -> tuple[int, int]:
    """Carry the nominal state from ``t`` to ``t_end`` with transition rows.

    ``i`` the sample at or before ``t``; returns the one at or before ``t_end``, and the number of
    steps that there are then: those from ``done`` on are noted (see ``Legs``). ``rate`` [3]
    receives the mean corrected rate, ``now`` [6] the corrected reading at the end, ``mid`` [6 + e]
    the last corrected reading, without its noise, and extra signals.
    """
    # taken out of the tuples once: in the loop that would count references at every access
    times, readings, extra, calm = samples.t, samples.raw, samples.extra, samples.calm
    terms, longest = model.terms, model.longest_step
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
        wide = width > longest
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
        for a in range(3):
            rate[a] += mid[a] * dt
        # a noisy reading would bend the size that its own error is found to have
        s = min(max((0.5 * (t + nxt) - times[i]) / width, 0.0), 1.0)
        for a in range(6):
            mid[a] += calm[i, a] + s * (calm[i + 1, a] - calm[i, a])
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
            for a in range(3):
                dvns[done, a] = dvn[a]
            dts[done], since[done] = dt, i
            done += 1
        for a in range(6):
            ra[a] = rb[a]
        t = nxt
        if i < n_imu - 2 and t >= following:
            i += 1
    for a in range(3):
        rate[a] /= max(t_end - start, 1e-9)
    for a in range(6):
        now[a] = ra[a]
    return i, done


@kernel
def sum_noise(
    samples: Samples,
    model: ModelArrays,
    dvns: FloatArray,
    dts: FloatArray,
    since: IntArray,
    noise: FloatArray,
) -> None:
    """Advance the process noise [29] over steps of integration [m] as ``Legs`` has them."""
    shocks = samples.shocks
    qa0, qg0 = model.noise[0], model.noise[1]
    # a row of its own: to take one out of all of them would count references at every step
    dvn = np.empty(3)
    for m in range(dts.shape[0]):
        i = since[m]
        for a in range(3):
            dvn[a] = dvns[m, a]
        qa, qg = qa0 + shocks[i, 0], qg0 + shocks[i, 1]
        add_noise(noise, dvn, dts[m], qa, qg)


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


@kernel
def go(
    samples: Samples,
    model: ModelArrays,
    legs: Legs,
    k: int,
    done: int,
    i: int,
    t: float,
    t_end: float,
    pos: FloatArray,
    vel: FloatArray,
    q: FloatArray,
    c: FloatArray,
    xi: FloatArray,
) -> None:
    """Carry the state from a node at ``t``, where the sample before is ``i``, to the next, and
    write row ``k`` of the legs, which has the readings of the node before where no time passes;
    ``done`` steps are noted already."""
    start_interval(legs.trans[k])
    earth_terms(pos, model.earth_on, legs.place[k])
    # nodes at one instant share its reading: nothing to integrate
    if t_end > t:
        i, done = integrate(
            samples,
            model,
            i,
            t,
            t_end,
            pos,
            vel,
            q,
            c,
            xi,
            legs.place[k],
            legs.trans[k],
            legs.rate[k],
            legs.now[k],
            legs.mid[k],
            done,
            legs.dvn,
            legs.dt,
            legs.since,
        )
        take_noise_out(samples, i, t_end, 3, legs.now[k])
    legs.at[k], legs.steps[k] = i, done


@kernel
def begin(
    samples: Samples, model: ModelArrays, legs: Legs, t: float, pos: FloatArray, xi: FloatArray
) -> None:
    """Write the first row of the legs, at the first node."""
    i = 0
    while i < samples.t.shape[0] - 2 and samples.t[i + 1] <= t:
        i += 1
    start_interval(legs.trans[0])
    earth_terms(pos, model.earth_on, legs.place[0])
    reading_at(samples, model, i, t, xi, legs.rate[0], legs.mid[0])
    legs.now[0, :] = legs.mid[0, :6]
    take_noise_out(samples, i, t, 3, legs.now[0])
    take_noise_out(samples, i, t, 6, legs.mid[0])
    legs.at[0], legs.steps[0] = i, 0


@kernel
def walk_path(
    samples: Samples,
    model: ModelArrays,
    node_t: FloatArray,
    nominal: FloatArray,
    params: FloatArray,
    legs: Legs,
) -> None:
    """Write the legs between nodes at ``node_t`` [k] s, each from the state ``nominal`` [k, 10],
    ``params`` [k, n - 9] of its first node."""
    pos, vel, q, c = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros((3, 3))
    xi = np.zeros(params.shape[1])
    load_state(nominal[0], params[0], pos, vel, q, c, xi)
    begin(samples, model, legs, node_t[0], pos, xi)
    for k in range(1, node_t.shape[0]):
        t, i, done = node_t[k - 1], legs.at[k - 1], legs.steps[k - 1]
        legs.rate[k, :] = legs.rate[k - 1]
        legs.now[k, :] = legs.now[k - 1]
        legs.mid[k, :] = legs.mid[k - 1]
        go(samples, model, legs, k, done, i, t, node_t[k], pos, vel, q, c, xi)
        subtract(pos, vel, q, nominal[k], legs.off[k])
        load_state(nominal[k], params[k], pos, vel, q, c, xi)
