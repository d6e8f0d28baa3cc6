"""The forward filter over all nodes."""

from __future__ import annotations

import math

import numpy as np

from automap.effects.term_sums import SIGNAL_COLUMN, new_room, set_signals
from automap.fusion.arrays import ForwardStore, Legs, ModelArrays, NodeArrays, Samples
from automap.fusion.kernels.integrate import begin, go, sum_noise
from automap.fusion.kernels.readings import acceleration
from automap.fusion.kernels.state import inject, load_state, subtract
from automap.fusion.kernels.transition import (
    N_NOISE,
    carry_mean,
    end_interval,
    expand_noise,
    propagate_covariance,
)
from automap.fusion.kernels.update import block_gains, inflate, pack, update_block
from automap.fusion.layout import N_NAV
from automap.fusion.measurements.observe import HAS, observe
from automap.fusion.measurements.state import AtNode
from automap.fusion.mechanisation import N_EARTH, quat_to_dcm
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def run_forward(
    samples: Samples,
    model: ModelArrays,
    nodes: NodeArrays,
    x0: FloatArray,
    xi0: FloatArray,
    p0: FloatArray,
    linearised_at: FloatArray,
    linearised_params: FloatArray,
    legs: Legs,
    store: ForwardStore,
) -> float:
    """Filter from the first node to the last; returns the robust log-likelihood.

    ``x0`` [10] and ``xi0`` [n - 9] the nominal start, ``p0`` [n, n] its covariance.
    ``linearised_at`` [k, 10], ``linearised_params`` [k, n - 9]: states to linearise about (an
    iteration of the smoother), and the ``legs`` between these; or empty: then about the filter's
    own running estimate, and ``legs`` is room for one. With an empty ``store`` only the likelihood
    is computed, from the innovations (F. C. Schweppe, IEEE Transactions on Information Theory 11,
    1965).
    """
    n = p0.shape[0]
    keep = store.nominal.shape[0] > 0
    relinearise = linearised_at.shape[0] > 0
    pos = x0[0:3].copy()
    vel = x0[3:6].copy()
    q = x0[6:10].copy()
    xi = xi0.copy()
    c = np.zeros((3, 3))
    quat_to_dcm(q, c)
    p = p0.copy()
    noise = np.zeros(N_NOISE)
    qn = np.zeros((N_NAV, N_NAV))
    work = np.zeros((N_NAV, n))
    decay = np.ones(n)
    q_state = np.zeros(n)
    place = np.zeros(N_EARTH)
    rate = np.zeros(3)
    now = np.zeros(6)
    rate_now, force_now = now[:3], now[3:]
    acc = np.zeros(3)
    mid = np.zeros(6 + samples.extra.shape[1])
    signals = np.zeros(SIGNAL_COLUMN + nodes.signals.shape[1])
    room = new_room()
    # the node's state is changed in place, here as in its parts
    at = AtNode(pos, vel, acc, c, rate_now, rate, mid, place, xi, signals, room)
    h = np.zeros((3, n))
    z = np.zeros(3)
    zz = np.zeros(3)
    var = np.zeros(3)
    dx = np.zeros(n)
    step = np.zeros(n)
    unit = np.zeros((3, n))
    gain = np.zeros((3, n))
    nu = np.zeros(3)
    s = np.zeros(3)
    score = 0.0
    total = 0
    if relinearise:
        # the prior, relative to the first state linearised about
        subtract(pos, vel, q, linearised_at[0], dx)
        for j in range(n - N_NAV):
            dx[N_NAV + j] = xi[j] - linearised_params[0, j]
        load_state(linearised_at[0], linearised_params[0], pos, vel, q, c, xi)
    else:
        begin(samples, model, legs, nodes.t[0], pos, xi)
    t = nodes.t[0]
    # nought as int64, as elsewhere: for a literal all that integrates would be compiled once more
    nought = int(np.int64(0))
    for k in range(nodes.t.shape[0]):
        row = k if relinearise else 0
        span = nodes.t[k] - t
        if k > 0 and not relinearise:
            go(samples, model, legs, nought, nought, legs.at[0], t, nodes.t[k], pos, vel, q, c, xi)
        t, i, phi = nodes.t[k], legs.at[row], legs.trans[row]
        rate[:], now[:] = legs.rate[row], legs.now[row]
        mid[:], place[:] = legs.mid[row], legs.place[row]
        if k > 0:
            end_interval(
                phi,
                span,
                model.tau,
                model.walk,
                decay,
                q_state,
                xi,
                model.kept,
                nodes.keep[k],
            )
            if relinearise:
                carry_mean(dx, phi, decay, xi, linearised_params[k], step)
                for a in range(N_NAV):
                    dx[a] += legs.off[k, a]
                load_state(linearised_at[k], linearised_params[k], pos, vel, q, c, xi)
            a, b = legs.steps[row - 1] if row > 0 else 0, legs.steps[row]
            noise[:] = 0.0
            sum_noise(samples, model, legs.dvn[a:b], legs.dt[a:b], legs.since[a:b], noise)
            expand_noise(noise, qn)
            propagate_covariance(p, phi, qn, decay, q_state, work)
        if not relinearise:
            dx[:] = 0.0
        acceleration(samples, i, t, place[2], c, force_now, acc)
        set_signals(signals, t, nodes.signals[k])
        flags = nodes.flags[k]
        for number in range(len(HAS)):
            if (flags & HAS[number]) == 0:
                continue
            rows, first = observe(number, nodes, k, at, model, h, z)
            if rows == 0:
                continue
            hs, us, gs = h[:rows], unit[:rows], gain[:rows]
            for a in range(rows):
                var[a] = nodes.var[k, first + a]
            nis = block_gains(p, hs, z, var, dx, us, gs, nu, s)
            factor = 1.0
            if not nis <= model.gate[rows - 1]:
                for a in range(rows):
                    left = z[a]
                    for j in range(n):
                        left -= h[a, j] * dx[j]
                    zz[a] = left
                factor = inflate(p, h, zz, var, rows, model.gate[rows - 1], model.gate[3])
                for a in range(rows):
                    var[a] *= factor
                block_gains(p, hs, z, var, dx, us, gs, nu, s)
            update_block(p, dx, us, gs, nu)
            for a in range(rows):
                score -= 0.5 * (nu[a] * nu[a] / s[a] + math.log(s[a]))
            if keep:
                for a in range(rows):
                    store.h[total, :] = h[a]
                    store.gain[total, :] = gain[a]
                    store.nu[total] = nu[a]
                    store.var[total] = s[a]
                    store.factor[total] = factor
                    store.nis[k, first + a] = nis
                    store.info[total, 0] = k
                    store.info[total, 1] = first + a
                    store.info[total, 2] = 1 if factor < model.gate[4] else 0
                    total += 1
        if not relinearise:
            inject(pos, vel, q, c, xi, dx)
        if keep:
            if relinearise:
                store.mean[k, :] = dx
            store.scalars[k] = total
            store.nominal[k, 0:3] = pos
            store.nominal[k, 3:6] = vel
            store.nominal[k, 6:10] = q
            store.params[k, :] = xi
            store.trans[k, :, :] = phi
            pack(p, store.cov[k])
    return score
