"""The forward filter over all nodes."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.kernels.arrays import ForwardStore, ModelArrays, NodeArrays, Samples
from automap.fusion.kernels.integrate import integrate, reading_at
from automap.fusion.kernels.observations import (
    acceleration,
    calm_rate,
    constraint_block,
    odometer_row,
    position_block,
    standstill_rate_rows,
    velocity_block,
    zero_velocity_rows,
)
from automap.fusion.kernels.state import inject, load_state, subtract
from automap.fusion.kernels.transition import (
    N_NOISE,
    carry_mean,
    end_interval,
    expand_noise,
    propagate_covariance,
    start_interval,
)
from automap.fusion.kernels.update import inflate, pack, update_scalar
from automap.fusion.layout import (
    CH_NHC,
    CH_ODOMETER,
    CH_POS,
    CH_VEL,
    CH_ZARU,
    CH_ZUPT,
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    N_NAV,
    NHC,
    ODOMETER,
    STANDSTILL,
    WANDER,
)
from automap.fusion.mechanisation import N_EARTH, earth_terms, quat_to_dcm
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def observe(
    block: int,
    nodes: NodeArrays,
    model: ModelArrays,
    k: int,
    pos: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    xi: FloatArray,
    place: FloatArray,
    rate: FloatArray,
    rate_now: FloatArray,
    acc: FloatArray,
    mid: FloatArray,
    h: FloatArray,
    z: FloatArray,
) -> tuple[int, int]:
    """Rows and residuals of one block of a node: number of rows, first channel.

    ``rate`` [3] is the mean over the interval, for standstill; ``rate_now`` that at the
    node, without the noise of its reading.

    Blocks: 0 position, 1 velocity, 2 vehicle constraint, 3 odometer, 4 zero velocity, 5 zero
    rate.
    """
    flags = nodes.flags[k]
    off = model.offsets
    if block < 2:
        horizontal = (flags & (HAS_POS_H if block == 0 else HAS_VEL_H)) != 0
        vertical = (flags & (HAS_POS_V if block == 0 else HAS_VEL_V)) != 0
        if not (horizontal or vertical):
            return 0, 0
        if block == 0:
            position_block(
                h, z, nodes.fix[k, 0:3], pos, vel, c, xi, off, nodes.wander[k], nodes.t[k]
            )
        else:
            velocity_block(h, z, nodes.fix[k, 3:6], vel, c, rate_now, acc, xi, off, nodes.t[k])
        first = CH_POS if block == 0 else CH_VEL
        if horizontal:
            return (3 if vertical else 2), first
        z[0] = z[2]
        h[0, :] = h[2, :]
        return 1, first + 2
    if block == 2:
        if (flags & NHC) == 0:
            return 0, 0
        constraint_block(h, z, vel, c, rate_now, acc, xi, off)
        return 2, CH_NHC
    if block == 3:
        if (flags & ODOMETER) == 0:
            return 0, 0
        odometer_row(h, z, nodes.fix[k, 6], vel, c, rate_now, xi, off)
        return 1, CH_ODOMETER
    if (flags & STANDSTILL) == 0:
        return 0, 0
    if block == 4:
        zero_velocity_rows(h, z, vel)
        return 3, CH_ZUPT
    standstill_rate_rows(h, z, rate, place, c, mid, model.terms)
    return 3, CH_ZARU


@kernel
def run_forward(
    samples: Samples,
    model: ModelArrays,
    nodes: NodeArrays,
    x0: FloatArray,
    xi0: FloatArray,
    p0: FloatArray,
    about: FloatArray,
    about_params: FloatArray,
    store: ForwardStore,
) -> float:
    """Filter from the first node to the last; returns the robust log-likelihood.

    ``x0`` [10] and ``xi0`` [n - 9] the nominal start, ``p0`` [n, n] its covariance. ``about``
    [k, 10], ``about_params`` [k, n - 9]: states to linearise about (an iteration of the
    smoother), or empty: then about the filter's own running estimate. With an empty ``store``
    only the likelihood is computed.
    """
    n = p0.shape[0]
    keep = store.nominal.shape[0] > 0
    relinearise = about.shape[0] > 0
    pos = x0[0:3].copy()
    vel = x0[3:6].copy()
    q = x0[6:10].copy()
    xi = xi0.copy()
    c = np.zeros((3, 3))
    quat_to_dcm(q, c)
    p = p0.copy()
    phi = np.zeros((N_NAV, n))
    noise = np.zeros(N_NOISE)
    qn = np.zeros((N_NAV, N_NAV))
    work = np.zeros((N_NAV, n))
    decay = np.ones(n)
    q_state = np.zeros(n)
    place = np.zeros(N_EARTH)
    rate = np.zeros(3)
    rate_now = np.zeros(3)
    acc = np.zeros(3)
    mid = np.zeros(6 + samples.extra.shape[1])
    h = np.zeros((3, n))
    z = np.zeros(3)
    zz = np.zeros(3)
    var = np.zeros(3)
    dx = np.zeros(n)
    step = np.zeros(n)
    gain = np.zeros(n)
    p_before = np.zeros((n, n))
    dx_before = np.zeros(n)
    score = 0.0
    total = 0
    if relinearise:
        # the prior, relative to the first state linearised about
        subtract(pos, vel, q, about[0], dx)
        for j in range(n - N_NAV):
            dx[N_NAV + j] = xi[j] - about_params[0, j]
        load_state(about[0], about_params[0], pos, vel, q, c, xi)
    i = 0
    while i < samples.t.shape[0] - 2 and samples.t[i + 1] <= nodes.t[0]:
        i += 1
    t = nodes.t[0]
    earth_terms(pos, model.earth_on, place)
    for k in range(nodes.t.shape[0]):
        # nodes at one instant share its reading: nothing to integrate
        span = nodes.t[k] - t
        start_interval(phi, noise)
        if k == 0:
            reading_at(samples, model, i, t, xi, rate, mid)
            rate_now[:] = rate
            calm_rate(samples, i, t, rate_now)
        else:
            earth_terms(pos, model.earth_on, place)
            if span > 0.0:
                i = integrate(
                    samples,
                    model,
                    i,
                    t,
                    nodes.t[k],
                    pos,
                    vel,
                    q,
                    c,
                    xi,
                    place,
                    phi,
                    noise,
                    rate,
                    rate_now,
                    mid,
                )
                calm_rate(samples, i, nodes.t[k], rate_now)
            t = nodes.t[k]
            end_interval(
                phi,
                span,
                model.tau,
                model.walk,
                decay,
                q_state,
                xi,
                model.offsets[WANDER],
                nodes.keep[k],
            )
            if relinearise:
                carry_mean(dx, phi, decay, xi, about_params[k], step)
                subtract(pos, vel, q, about[k], step)
                for a in range(N_NAV):
                    dx[a] += step[a]
                load_state(about[k], about_params[k], pos, vel, q, c, xi)
            expand_noise(noise, qn)
            propagate_covariance(p, phi, qn, decay, q_state, work)
        if not relinearise:
            dx[:] = 0.0
        acceleration(samples, i, t, place[2], c, acc)
        for block in range(6):
            rows, first = observe(
                block, nodes, model, k, pos, vel, c, xi, place, rate, rate_now, acc, mid, h, z
            )
            if rows == 0:
                continue
            # first as it is; the scalars' innovations add up to the block's NIS
            p_before[:, :] = p
            dx_before[:] = dx
            factor = 1.0
            nis = 0.0
            for attempt in range(2):
                gained = 0.0
                at = total
                for a in range(rows):
                    nu, s = update_scalar(p, h[a], z[a], nodes.var[k, first + a] * factor, dx, gain)
                    gained -= 0.5 * (nu * nu / s + math.log(s))
                    if attempt == 0:
                        nis += nu * nu / s
                    if keep:
                        store.h[at, :] = h[a]
                        store.gain[at, :] = gain
                        store.nu[at] = nu
                        store.var[at] = s
                        at += 1
                if attempt == 1 or nis <= model.gate[rows - 1]:
                    break
                p[:, :] = p_before
                dx[:] = dx_before
                for a in range(rows):
                    var[a] = nodes.var[k, first + a]
                    s = z[a]
                    for j in range(n):
                        s -= h[a, j] * dx[j]
                    zz[a] = s
                factor = inflate(p, h, zz, var, rows, model.gate[rows - 1], model.gate[3])
            score += gained
            if keep:
                for a in range(rows):
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
