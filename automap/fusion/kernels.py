"""The numba loops of the filter: forward pass over nodes, smoother, dense output.

Nodes are the instants at which something is measured (and some without measurement, so that
no stretch is too long). Between nodes only the nominal state and the nine navigation rows of
the transition matrix are carried; the covariance moves from node to node. The smoother is
the modified Bryson-Frazier form (Bierman 1973): it inverts no covariance, so constant
parameters without process noise do it no harm, and it needs one pass over the scalars that
the forward filter recorded.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from automap.fusion.layout import (
    CH_NHC,
    CH_POS,
    CH_VEL,
    CH_ZARU,
    CH_ZUPT,
    DELAY,
    HAS_POS_H,
    HAS_POS_V,
    HAS_VEL_H,
    HAS_VEL_V,
    LEVER,
    MAX_SCALARS,
    MOUNT,
    N_NAV,
    NHC,
    PHI_ID,
    STANDSTILL,
    V_ID,
    VEL_LATENCY,
    WANDER,
    WHEEL,
)
from automap.fusion.mechanisation import (
    correct_reading,
    gravity,
    quat_to_dcm,
    radii,
    rotate_left,
    strapdown_step,
)


@njit(cache=True)
def interpolate_reading(imu_t, readings, i, t, out):
    """Raw reading ``out`` [6] at time ``t`` between samples i and i + 1."""
    span = imu_t[i + 1] - imu_t[i]
    s = (t - imu_t[i]) / span
    for k in range(6):
        out[k] = readings[i, k] + s * (readings[i + 1, k] - readings[i, k])


@njit(cache=True)
def add_transition(phi, terms, c, r, dvn, dt):
    """Advance the transition rows ``phi`` [9, n] over one strapdown step.

    ``r`` [6] the corrected reading in the middle of the step, ``c`` [3, 3] the attitude.
    Position and velocity columns are closed forms and are filled in at the node.
    """
    fn, fe, fd = dvn[0], dvn[1], dvn[2]
    for j in range(6, 9):
        _advance_column(phi, j, fn, fe, fd, dt)
    for m in range(terms.shape[0]):
        j = N_NAV + m
        axis, b = terms[m, 1], terms[m, 2]
        u = (1.0 if b == 0 else r[b - 1]) * dt
        if terms[m, 0] == 0:
            _advance_column(phi, j, fn, fe, fd, dt)
            phi[6, j] -= c[0, axis] * u
            phi[7, j] -= c[1, axis] * u
            phi[8, j] -= c[2, axis] * u
        else:
            phi[0, j] += phi[3, j] * dt
            phi[1, j] += phi[4, j] * dt
            phi[2, j] += phi[5, j] * dt
            an, ae, ad = c[0, axis] * u, c[1, axis] * u, c[2, axis] * u
            phi[0, j] -= 0.5 * an * dt
            phi[1, j] -= 0.5 * ae * dt
            phi[2, j] -= 0.5 * ad * dt
            phi[3, j] -= an
            phi[4, j] -= ae
            phi[5, j] -= ad


@njit(cache=True)
def _advance_column(phi, j, fn, fe, fd, dt):
    """dv/dt = -f x phi, dp/dt = v for one column."""
    x, y, z = phi[6, j], phi[7, j], phi[8, j]
    dn = fd * y - fe * z
    de = fn * z - fd * x
    dd = fe * x - fn * y
    phi[0, j] += (phi[3, j] + 0.5 * dn) * dt
    phi[1, j] += (phi[4, j] + 0.5 * de) * dt
    phi[2, j] += (phi[5, j] + 0.5 * dd) * dt
    phi[3, j] += dn
    phi[4, j] += de
    phi[5, j] += dd


@njit(cache=True)
def add_noise(qn, dvn, dt, qa, qg):
    """Advance the process noise ``qn`` [9, 9] over one step.

    ``qa``, ``qg`` are the power spectral densities (m/s^2)^2/Hz and (rad/s)^2/Hz, isotropic.
    The matrix stays symmetric; only the blocks that can be non-zero are touched.
    """
    f = np.empty((3, 3))
    f[0, 0] = f[1, 1] = f[2, 2] = 0.0
    f[0, 1], f[0, 2] = dvn[2], -dvn[1]
    f[1, 0], f[1, 2] = -dvn[2], dvn[0]
    f[2, 0], f[2, 1] = dvn[1], -dvn[0]
    # columns first: Q A', then rows: A (Q A'), with A: v += f phi, p += v dt
    for i in range(9):
        for a in range(3):
            s = 0.0
            for b in range(3):
                s += f[a, b] * qn[i, 6 + b]
            qn[i, a] += (qn[i, 3 + a] + 0.5 * s) * dt
            qn[i, 3 + a] += s
    for j in range(9):
        for a in range(3):
            s = 0.0
            for b in range(3):
                s += f[a, b] * qn[6 + b, j]
            qn[a, j] += (qn[3 + a, j] + 0.5 * s) * dt
            qn[3 + a, j] += s
    for a in range(3):
        qn[3 + a, 3 + a] += qa * dt
        qn[6 + a, 6 + a] += qg * dt


@njit(cache=True)
def propagate_covariance(p, phi, qn, decay, q_state, work):
    """P := F P F' + Q with F = [phi; 0 diag(decay)] in place; ``work`` [9, n]."""
    n = p.shape[0]
    for i in range(N_NAV):
        for j in range(n):
            work[i, j] = 0.0
        for k in range(n):
            a = phi[i, k]
            if a != 0.0:
                for j in range(n):
                    work[i, j] += a * p[k, j]
    for i in range(N_NAV):
        for j in range(i, N_NAV):
            s = qn[i, j]
            for k in range(n):
                s += work[i, k] * phi[j, k]
            p[i, j] = s
            p[j, i] = s
        for j in range(N_NAV, n):
            v = work[i, j] * decay[j]
            p[i, j] = v
            p[j, i] = v
    for i in range(N_NAV, n):
        for j in range(N_NAV, n):
            p[i, j] *= decay[i] * decay[j]
        p[i, i] += q_state[i]


@njit(cache=True)
def _lever_rows(h, phi_row, cl, sign):
    """h[0:3, 6:9] := -sign [cl x]."""
    h[0, phi_row + 1] = sign * cl[2]
    h[0, phi_row + 2] = -sign * cl[1]
    h[1, phi_row] = -sign * cl[2]
    h[1, phi_row + 2] = sign * cl[0]
    h[2, phi_row] = sign * cl[1]
    h[2, phi_row + 1] = -sign * cl[0]


@njit(cache=True)
def position_block(h, z, fix, pos, vel, c, xi, off, wander_scale):
    """Residual ``z`` [3] in metres NED and rows ``h`` [3, n] of an antenna position.

    ``fix`` [3] latitude, longitude, height. Predicted: p + C l + wander, at the fix's time
    shifted by the remaining delay (p + v delay).
    """
    n = h.shape[1]
    lever = np.zeros(3)
    if off[LEVER] >= 0:
        for a in range(3):
            lever[a] = xi[off[LEVER] - N_NAV + a]
    cl = np.zeros(3)
    for a in range(3):
        cl[a] = c[a, 0] * lever[0] + c[a, 1] * lever[1] + c[a, 2] * lever[2]
    rm, rn = radii(pos[0])
    dlon = fix[1] - pos[1]
    if dlon > math.pi:
        dlon -= 2 * math.pi
    elif dlon < -math.pi:
        dlon += 2 * math.pi
    z[0] = (fix[0] - pos[0]) * (rm + pos[2]) - cl[0]
    z[1] = dlon * (rn + pos[2]) * math.cos(pos[0]) - cl[1]
    z[2] = -(fix[2] - pos[2]) - cl[2]
    for a in range(3):
        for j in range(n):
            h[a, j] = 0.0
        h[a, a] = 1.0
    _lever_rows(h, PHI_ID, cl, 1.0)
    if off[LEVER] >= 0:
        for a in range(3):
            for b in range(3):
                h[a, off[LEVER] + b] = c[a, b]
    if off[DELAY] >= 0:
        d = xi[off[DELAY] - N_NAV]
        for a in range(3):
            z[a] -= vel[a] * d
            h[a, off[DELAY]] = vel[a]
    if off[WANDER] >= 0:
        for a in range(3):
            z[a] -= wander_scale[a] * xi[off[WANDER] - N_NAV + a]
            h[a, off[WANDER] + a] = wander_scale[a]


@njit(cache=True)
def velocity_block(h, z, fix_vel, vel, c, rate, acc, xi, off):
    """Residual and rows of an antenna velocity NED; ``rate`` [3] body, ``acc`` [3] NED."""
    n = h.shape[1]
    lever = np.zeros(3)
    if off[LEVER] >= 0:
        for a in range(3):
            lever[a] = xi[off[LEVER] - N_NAV + a]
    b0 = rate[1] * lever[2] - rate[2] * lever[1]
    b1 = rate[2] * lever[0] - rate[0] * lever[2]
    b2 = rate[0] * lever[1] - rate[1] * lever[0]
    cv = np.zeros(3)
    for a in range(3):
        cv[a] = c[a, 0] * b0 + c[a, 1] * b1 + c[a, 2] * b2
    for a in range(3):
        z[a] = fix_vel[a] - vel[a] - cv[a]
        for j in range(n):
            h[a, j] = 0.0
        h[a, V_ID + a] = 1.0
    _lever_rows(h, PHI_ID, cv, 1.0)
    if off[LEVER] >= 0:
        for a in range(3):
            # C [omega x]
            h[a, off[LEVER]] = c[a, 1] * rate[2] - c[a, 2] * rate[1]
            h[a, off[LEVER] + 1] = c[a, 2] * rate[0] - c[a, 0] * rate[2]
            h[a, off[LEVER] + 2] = c[a, 0] * rate[1] - c[a, 1] * rate[0]
    if off[DELAY] >= 0:
        d = xi[off[DELAY] - N_NAV]
        for a in range(3):
            z[a] -= acc[a] * d
            h[a, off[DELAY]] = acc[a]
    if off[VEL_LATENCY] >= 0:
        d = xi[off[VEL_LATENCY] - N_NAV]
        for a in range(3):
            z[a] += acc[a] * d
            h[a, off[VEL_LATENCY]] = -acc[a]


@njit(cache=True)
def constraint_block(h, z, vel, c, rate, xi, off):
    """Rows [2, n] of the non-holonomic constraint: no lateral or vertical speed of the vehicle.

    At the point that does not slide: u = C' v + omega x r, turned into the vehicle by the
    mounting m (small): (I + [m x]) u, components y and z are zero.
    """
    n = h.shape[1]
    r = np.zeros(3)
    if off[WHEEL] >= 0:
        for a in range(3):
            r[a] = xi[off[WHEEL] - N_NAV + a]
    m = np.zeros(3)
    if off[MOUNT] >= 0:
        for a in range(3):
            m[a] = xi[off[MOUNT] - N_NAV + a]
    u = np.zeros(3)
    for a in range(3):
        u[a] = c[0, a] * vel[0] + c[1, a] * vel[1] + c[2, a] * vel[2]
    u[0] += rate[1] * r[2] - rate[2] * r[1]
    u[1] += rate[2] * r[0] - rate[0] * r[2]
    u[2] += rate[0] * r[1] - rate[1] * r[0]
    # rows 1 and 2 of I + [m x]
    w = np.zeros((2, 3))
    w[0, 0], w[0, 1], w[0, 2] = m[2], 1.0, -m[0]
    w[1, 0], w[1, 1], w[1, 2] = -m[1], m[0], 1.0
    cross = np.zeros((3, 3))
    cross[0, 1], cross[0, 2] = -rate[2], rate[1]
    cross[1, 0], cross[1, 2] = rate[2], -rate[0]
    cross[2, 0], cross[2, 1] = -rate[1], rate[0]
    for i in range(2):
        z[i] = -(w[i, 0] * u[0] + w[i, 1] * u[1] + w[i, 2] * u[2])
        for j in range(n):
            h[i, j] = 0.0
        g = np.zeros(3)
        for a in range(3):
            g[a] = w[i, 0] * c[a, 0] + w[i, 1] * c[a, 1] + w[i, 2] * c[a, 2]
            h[i, V_ID + a] = g[a]
        # d(C' v)/dphi = C' [v x]
        h[i, PHI_ID] = g[1] * vel[2] - g[2] * vel[1]
        h[i, PHI_ID + 1] = g[2] * vel[0] - g[0] * vel[2]
        h[i, PHI_ID + 2] = g[0] * vel[1] - g[1] * vel[0]
        if off[WHEEL] >= 0:
            for b in range(3):
                s = 0.0
                for a in range(3):
                    s += w[i, a] * cross[a, b]
                h[i, off[WHEEL] + b] = s
    if off[MOUNT] >= 0:
        o = off[MOUNT]
        h[0, o], h[0, o + 2] = -u[2], u[0]
        h[1, o], h[1, o + 1] = u[1], -u[0]


@njit(cache=True)
def inflate(p, h, z, var, rows, threshold, limit):
    """Factor on ``var`` that brings the block's NIS to ``threshold``, and the NIS before.

    The first answer to a surprising measurement is to trust it less; nothing is thrown away,
    so a wrong state cannot lock the truth out, and an outlier's pull falls with its size.
    """
    n = p.shape[0]
    hph = np.zeros((rows, rows))
    tmp = np.zeros(n)
    for i in range(rows):
        for j in range(n):
            tmp[j] = 0.0
        for k in range(n):
            a = h[i, k]
            if a != 0.0:
                for j in range(n):
                    tmp[j] += a * p[k, j]
        for i2 in range(rows):
            s = 0.0
            for j in range(n):
                s += tmp[j] * h[i2, j]
            hph[i, i2] = s
    first = -1.0
    factor = 1.0
    while True:
        nis = _quadratic(hph, z, var, rows, factor)
        if first < 0.0:
            first = nis
        if nis <= threshold or factor >= limit:
            return factor, first
        factor *= max(1.3, min(nis / threshold, 10.0))


@njit(cache=True)
def _quadratic(hph, z, var, rows, factor):
    """z' (hph + factor diag(var))^-1 z by Cholesky on the first ``rows``."""
    low = np.zeros((rows, rows))
    y = np.zeros(rows)
    total = 0.0
    for i in range(rows):
        for j in range(i + 1):
            s = hph[i, j]
            if i == j:
                s += factor * var[i]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                low[i, i] = math.sqrt(max(s, 1e-300))
            else:
                low[i, j] = s / low[j, j]
        s = z[i]
        for k in range(i):
            s -= low[i, k] * y[k]
        y[i] = s / low[i, i]
        total += y[i] * y[i]
    return total


@njit(cache=True)
def update_scalar(p, h, z, var, dx, k_out):
    """One scalar Kalman update of ``p`` [n, n] and ``dx`` [n]; returns innovation and its variance.

    ``z`` is the residual against the nominal state; ``dx`` the correction so far. The gain is
    left in ``k_out`` [n].
    """
    n = p.shape[0]
    for j in range(n):
        k_out[j] = 0.0
    for i in range(n):
        a = h[i]
        if a != 0.0:
            for j in range(n):
                k_out[j] += a * p[i, j]
    s = var
    nu = z
    for i in range(n):
        a = h[i]
        if a != 0.0:
            s += a * k_out[i]
            nu -= a * dx[i]
    inv = 1.0 / s
    for i in range(n):
        ki = k_out[i] * inv
        for j in range(i, n):
            v = p[i, j] - ki * k_out[j]
            p[i, j] = v
            p[j, i] = v
    for j in range(n):
        k_out[j] *= inv
        dx[j] += k_out[j] * nu
    return nu, s


@njit(cache=True)
def inject(pos, vel, q, c, xi, dx):
    """Move the nominal state by the error estimate ``dx`` [n]."""
    rm, rn = radii(pos[0])
    pos[1] += dx[1] / ((rn + pos[2]) * math.cos(pos[0]))
    pos[0] += dx[0] / (rm + pos[2])
    pos[2] -= dx[2]
    for a in range(3):
        vel[a] += dx[V_ID + a]
    rotate_left(q, dx[PHI_ID], dx[PHI_ID + 1], dx[PHI_ID + 2])
    r = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for a in range(4):
        q[a] *= r
    quat_to_dcm(q, c)
    for j in range(xi.shape[0]):
        xi[j] += dx[N_NAV + j]


@njit(cache=True)
def run_forward(
    imu_t,
    readings,
    extra,
    force,
    terms,
    off,
    node_t,
    node_flags,
    node_fix,
    node_var,
    node_wander,
    x0,
    xi0,
    p0,
    tau,
    walk,
    noise,
    gap,
    gate,
    earth_on,
    store,
    about,
    about_params,
    nominal,
    params,
    mean,
    trans,
    cov,
    sc_count,
    sc_h,
    sc_k,
    sc_nu,
    sc_s,
    sc_info,
    nis_table,
):
    """Filter from the first node to the last; returns the robust log-likelihood.

    Inputs: ``imu_t`` [n] s, ``readings`` [n, 6] raw rates and forces, ``extra`` [n, e] extra
    basis signals, ``force`` [n, 3] the forces freed of vibration without delay, ``terms`` [m, 3], ``off`` [N_BLOCKS], ``node_t`` [k] s within ``imu_t``,
    ``node_flags`` [k], ``node_fix`` [k, 6] lat, lon, height, velocity NED, ``node_var`` [k, 14]
    variances by channel, ``node_wander`` [k, 3] sigma of the wander in m, ``x0`` [10] and
    ``xi0`` [n - 9] the nominal start, ``p0`` [n, n], ``tau`` [n] correlation time of Gauss-Markov
    states (0: none), ``walk`` [n] random-walk PSD, ``noise`` (qa, qg), ``gap`` (longest normal
    step s, force sd m/s^2, rate sd rad/s inside a gap), ``gate`` (NIS per rows 1..3 and limit).
    ``about`` [k, 10], ``about_params`` [k, n - 9]: states to linearise about (an iteration of
    the smoother), or empty: then about the filter's own running estimate.
    Outputs (preallocated; with ``store`` only): ``nominal`` [k, 10], ``params`` [k, n - 9] the
    states linearised about and ``mean`` [k, n] the error estimate relative to them after the
    update (zero where it was moved into the state), ``trans`` [k, 9, n], ``cov`` [k, n, n],
    ``sc_*`` the scalars in order of
    processing with ``sc_count`` [k] the running total, ``nis_table`` [k, 14] block NIS before
    inflation (NaN where not measured).
    """
    n = p0.shape[0]
    pos = x0[0:3].copy()
    vel = x0[3:6].copy()
    q = x0[6:10].copy()
    xi = xi0.copy()
    c = np.zeros((3, 3))
    quat_to_dcm(q, c)
    p = p0.copy()
    phi = np.zeros((N_NAV, n))
    qn = np.zeros((N_NAV, N_NAV))
    work = np.zeros((N_NAV, n))
    decay = np.ones(n)
    q_state = np.zeros(n)
    dvn = np.zeros(3)
    raw = np.zeros(6)
    ra = np.zeros(6)
    rb = np.zeros(6)
    rm_ = np.zeros(6 + extra.shape[1])
    h = np.zeros((3, n))
    z = np.zeros(3)
    var = np.zeros(3)
    dx = np.zeros(n)
    k_gain = np.zeros(n)
    mean_rate = np.zeros(3)
    acc = np.zeros(3)
    step = np.zeros(n)
    score = 0.0
    total = 0
    n_imu = imu_t.shape[0]
    relinearise = about.shape[0] > 0
    if relinearise:
        # the prior, relative to the first state linearised about
        subtract(pos, vel, q, about[0], dx)
        for j in range(n - N_NAV):
            dx[N_NAV + j] = xi[j] - about_params[0, j]
        load_state(about[0], about_params[0], pos, vel, q, c, xi)
    i = 0
    while i < n_imu - 2 and imu_t[i + 1] <= node_t[0]:
        i += 1
    interpolate_reading(imu_t, readings, i, node_t[0], raw)
    correct_reading(raw, extra[i], terms, xi, ra)
    t = node_t[0]
    for a in range(3):
        mean_rate[a] = ra[a]
    for k in range(node_t.shape[0]):
        t_end = node_t[k]
        span = t_end - t
        if k > 0 and span > 0.0:
            for a in range(N_NAV):
                for j in range(n):
                    phi[a, j] = 0.0
                phi[a, a] = 1.0
                for j in range(N_NAV):
                    qn[a, j] = 0.0
            for a in range(3):
                mean_rate[a] = 0.0
            # readings change with the parameters: refresh the start of the interval
            interpolate_reading(imu_t, readings, i, t, raw)
            correct_reading(raw, extra[i], terms, xi, ra)
            while t < t_end:
                nxt = imu_t[i + 1]
                wide = nxt - imu_t[i] > gap[0]
                if nxt > t_end or (i == n_imu - 2):
                    nxt = t_end
                if wide and nxt - t > 0.02:
                    nxt = t + 0.02
                dt = nxt - t
                if nxt == imu_t[i + 1]:
                    for a in range(6):
                        raw[a] = readings[i + 1, a]
                    correct_reading(raw, extra[i + 1], terms, xi, rb)
                else:
                    interpolate_reading(imu_t, readings, i, nxt, raw)
                    correct_reading(raw, extra[i], terms, xi, rb)
                for a in range(6):
                    rm_[a] = 0.5 * (ra[a] + rb[a])
                for a in range(extra.shape[1]):
                    rm_[6 + a] = extra[i, a]
                if dt > 0.0:
                    strapdown_with_transition(
                        pos, vel, q, c, ra, rb, rm_, dt, earth_on, dvn, phi, terms
                    )
                    qa, qg = noise[0], noise[1]
                    if wide:
                        width = imu_t[i + 1] - imu_t[i]
                        qa += gap[1] * gap[1] * width
                        qg += gap[2] * gap[2] * width
                    add_noise(qn, dvn, dt, qa, qg)
                for a in range(3):
                    mean_rate[a] += rm_[a] * dt
                for a in range(6):
                    ra[a] = rb[a]
                t = nxt
                if i < n_imu - 2 and t >= imu_t[i + 1]:
                    i += 1
            for a in range(3):
                phi[a, V_ID + a] = span
                mean_rate[a] /= span
            for j in range(N_NAV, n):
                if tau[j] > 0.0:
                    d = math.exp(-span / tau[j])
                    decay[j] = d
                    q_state[j] = (1.0 - d * d) * walk[j]
                    xi[j - N_NAV] *= d
                else:
                    decay[j] = 1.0
                    q_state[j] = walk[j] * span
            if relinearise:
                carry_mean(dx, phi, decay, xi, about_params[k])
                subtract(pos, vel, q, about[k], step)
                for a in range(N_NAV):
                    dx[a] += step[a]
                load_state(about[k], about_params[k], pos, vel, q, c, xi)
            propagate_covariance(p, phi, qn, decay, q_state, work)
            if store:
                for a in range(N_NAV):
                    for j in range(n):
                        trans[k, a, j] = phi[a, j]
        elif k > 0 and store:
            for a in range(N_NAV):
                trans[k, a, a] = 1.0
        if not relinearise:
            for j in range(n):
                dx[j] = 0.0
        flags = node_flags[k]
        acceleration(imu_t, force, i, t_end, pos, c, acc)
        for block in range(5):
            rows = 0
            first = 0
            start = 0
            if block == 0:
                has_h = (flags & HAS_POS_H) != 0
                has_v = (flags & HAS_POS_V) != 0
                if not (has_h or has_v):
                    continue
                position_block(h, z, node_fix[k, 0:3], pos, vel, c, xi, off, node_wander[k])
                start = 0 if has_h else 2
                rows = (3 if has_v else 2) - start
                first = CH_POS
            elif block == 1:
                has_h = (flags & HAS_VEL_H) != 0
                has_v = (flags & HAS_VEL_V) != 0
                if not (has_h or has_v):
                    continue
                velocity_block(h, z, node_fix[k, 3:6], vel, c, mean_rate, acc, xi, off)
                start = 0 if has_h else 2
                rows = (3 if has_v else 2) - start
                first = CH_VEL
            elif block == 2:
                if (flags & NHC) == 0:
                    continue
                constraint_block(h, z, vel, c, mean_rate, xi, off)
                rows, first = 2, CH_NHC
            elif block == 3:
                if (flags & STANDSTILL) == 0:
                    continue
                for a in range(3):
                    for j in range(n):
                        h[a, j] = 0.0
                    h[a, V_ID + a] = 1.0
                    z[a] = -vel[a]
                rows, first = 3, CH_ZUPT
            else:
                if (flags & STANDSTILL) == 0:
                    continue
                standstill_rate_rows(h, z, mean_rate, pos[0], c, ra, extra[i], terms, earth_on)
                rows, first = 3, CH_ZARU
            # residuals were taken against the nominal state; blocks before moved dx
            for a in range(rows):
                var[a] = node_var[k, first + start + a]
                if start > 0:
                    z[a] = z[start + a]
                    for j in range(n):
                        h[a, j] = h[start + a, j]
            zz = np.zeros(3)
            for a in range(rows):
                s = z[a]
                for j in range(n):
                    if h[a, j] != 0.0:
                        s -= h[a, j] * dx[j]
                zz[a] = s
            factor, nis = inflate(p, h, zz, var, rows, gate[rows - 1], gate[3])
            for a in range(rows):
                nu, s = update_scalar(p, h[a], z[a], var[a] * factor, dx, k_gain)
                score -= 0.5 * (nu * nu / s + math.log(s))
                if store:
                    nis_table[k, first + start + a] = nis
                    for j in range(n):
                        sc_h[total, j] = h[a, j]
                        sc_k[total, j] = k_gain[j]
                    sc_nu[total] = nu
                    sc_s[total] = s
                    sc_info[total, 0] = k
                    sc_info[total, 1] = first + start + a
                    sc_info[total, 2] = 1 if factor < gate[4] else 0
                    total += 1
        if not relinearise:
            inject(pos, vel, q, c, xi, dx)
        if store:
            if relinearise:
                for j in range(n):
                    mean[k, j] = dx[j]
            sc_count[k] = total
            for a in range(3):
                nominal[k, a] = pos[a]
                nominal[k, 3 + a] = vel[a]
            for a in range(4):
                nominal[k, 6 + a] = q[a]
            for j in range(n - N_NAV):
                params[k, j] = xi[j]
            for a in range(n):
                for b in range(n):
                    cov[k, a, b] = p[a, b]
    return score


@njit(cache=True)
def acceleration(imu_t, force, i, t, pos, c, out):
    """Acceleration over ground NED [3] at ``t`` between samples i and i + 1, to first order."""
    s = (t - imu_t[i]) / (imu_t[i + 1] - imu_t[i])
    s = min(max(s, 0.0), 1.0)
    f0 = force[i, 0] + s * (force[i + 1, 0] - force[i, 0])
    f1 = force[i, 1] + s * (force[i + 1, 1] - force[i, 1])
    f2 = force[i, 2] + s * (force[i + 1, 2] - force[i, 2])
    for a in range(3):
        out[a] = c[a, 0] * f0 + c[a, 1] * f1 + c[a, 2] * f2
    out[2] += gravity(pos[0], pos[2])


@njit(cache=True)
def load_state(row, row_params, pos, vel, q, c, xi):
    """Set the nominal state from a stored row [10] and its parameters."""
    for a in range(3):
        pos[a] = row[a]
        vel[a] = row[3 + a]
    for a in range(4):
        q[a] = row[6 + a]
    quat_to_dcm(q, c)
    for j in range(xi.shape[0]):
        xi[j] = row_params[j]


@njit(cache=True)
def subtract(pos, vel, q, row, out):
    """Navigation error ``out`` [0:9] of a state against a stored row [10]: state minus row."""
    rm, rn = radii(row[0])
    out[0] = (pos[0] - row[0]) * (rm + row[2])
    dlon = pos[1] - row[1]
    if dlon > math.pi:
        dlon -= 2 * math.pi
    elif dlon < -math.pi:
        dlon += 2 * math.pi
    out[1] = dlon * (rn + row[2]) * math.cos(row[0])
    out[2] = row[2] - pos[2]
    for a in range(3):
        out[V_ID + a] = vel[a] - row[3 + a]
    # rotation vector of q row^-1, a left rotation
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    w1, x1, y1, z1 = row[6], -row[7], -row[8], -row[9]
    w = w0 * w1 - x0 * x1 - y0 * y1 - z0 * z1
    x = w0 * x1 + x0 * w1 + y0 * z1 - z0 * y1
    y = w0 * y1 - x0 * z1 + y0 * w1 + z0 * x1
    z = w0 * z1 + x0 * y1 - y0 * x1 + z0 * w1
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    s = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if s < 1e-9 else 2.0 * math.atan2(s, w) / s
    out[PHI_ID], out[PHI_ID + 1], out[PHI_ID + 2] = scale * x, scale * y, scale * z


@njit(cache=True)
def carry_mean(dx, phi, decay, xi, next_params):
    """Carry an error estimate [n] over an interval, towards the next state's parameters."""
    n = dx.shape[0]
    nav = np.zeros(N_NAV)
    for i in range(N_NAV):
        s = 0.0
        for j in range(n):
            s += phi[i, j] * dx[j]
        nav[i] = s
    for i in range(N_NAV):
        dx[i] = nav[i]
    for j in range(N_NAV, n):
        # xi has already decayed
        dx[j] = decay[j] * dx[j] + xi[j - N_NAV] - next_params[j - N_NAV]


@njit(cache=True)
def strapdown_with_transition(pos, vel, q, c, ra, rb, mid, dt, earth_on, dvn, phi, terms):
    """One strapdown step and the matching step of the transition rows."""
    c0 = c.copy()
    strapdown_step(pos, vel, q, c, ra, rb, dt, earth_on, dvn)
    for a in range(3):
        for b in range(3):
            c0[a, b] = 0.5 * (c0[a, b] + c[a, b])
    add_transition(phi, terms, c0, mid, dvn, dt)


@njit(cache=True)
def standstill_rate_rows(h, z, mean_rate, lat, c, reading, extra, terms, earth_on):
    """Rows [3, n] of the zero-rate update: the body turns with the Earth only."""
    n = h.shape[1]
    wn = 7.292115e-5 * math.cos(lat) if earth_on else 0.0
    wd = -7.292115e-5 * math.sin(lat) if earth_on else 0.0
    for a in range(3):
        for j in range(n):
            h[a, j] = 0.0
        z[a] = c[0, a] * wn + c[2, a] * wd - mean_rate[a]
    for m in range(terms.shape[0]):
        if terms[m, 0] == 0:
            b = terms[m, 2]
            value = 1.0 if b == 0 else (reading[b - 1] if b < 7 else extra[b - 7])
            h[terms[m, 1], N_NAV + m] = -value


@njit(cache=True)
def run_smoother(node_t, tau, trans, cov, sc_count, sc_h, sc_k, sc_nu, sc_s, dx, p_s):
    """Modified Bryson-Frazier pass: corrections ``dx`` [k, n] and covariances ``p_s`` [k, n, n].

    They refer to the forward filter's state after the update of each node.
    """
    n_nodes, n = dx.shape
    lam = np.zeros(n)
    big = np.zeros((n, n))
    u = np.zeros((n, n))
    lk = np.zeros(n)
    decay = np.ones(n)
    for k in range(n_nodes - 1, -1, -1):
        # smoothed state after this node's update: future information only
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += cov[k, i, j] * lam[j]
            dx[k, i] = -s
        for i in range(n):
            for j in range(n):
                u[i, j] = 0.0
            for m in range(n):
                a = cov[k, i, m]
                if a != 0.0:
                    for j in range(n):
                        u[i, j] += a * big[m, j]
        for i in range(n):
            for j in range(i, n):
                s = cov[k, i, j]
                for m in range(n):
                    s -= u[i, m] * cov[k, m, j]
                p_s[k, i, j] = s
                p_s[k, j, i] = s
        lo = sc_count[k - 1] if k > 0 else 0
        for r in range(sc_count[k] - 1, lo - 1, -1):
            inv = 1.0 / sc_s[r]
            kl = 0.0
            for j in range(n):
                kl += sc_k[r, j] * lam[j]
            klk = 0.0
            for i in range(n):
                s = 0.0
                for j in range(n):
                    s += big[i, j] * sc_k[r, j]
                lk[i] = s
            for i in range(n):
                klk += lk[i] * sc_k[r, i]
            gain = kl + sc_nu[r] * inv
            for i in range(n):
                lam[i] -= sc_h[r, i] * gain
            w = klk + inv
            for i in range(n):
                hi = sc_h[r, i]
                for j in range(i, n):
                    hj = sc_h[r, j]
                    v = big[i, j] - hi * lk[j] - lk[i] * hj + hi * hj * w
                    big[i, j] = v
                    big[j, i] = v
        if k > 0:
            span = node_t[k] - node_t[k - 1]
            for j in range(N_NAV, n):
                decay[j] = math.exp(-span / tau[j]) if tau[j] > 0.0 else 1.0
            for j in range(n):
                s = decay[j] * lam[j] if j >= N_NAV else 0.0
                for m in range(N_NAV):
                    s += trans[k, m, j] * lam[m]
                lk[j] = s
            for j in range(n):
                lam[j] = lk[j]
            for i in range(n):
                for j in range(n):
                    u[i, j] = big[i, j] * decay[j] if j >= N_NAV else 0.0
                for m in range(N_NAV):
                    a = big[i, m]
                    if a != 0.0:
                        for j in range(n):
                            u[i, j] += a * trans[k, m, j]
            for i in range(n):
                for j in range(i, n):
                    s = decay[i] * u[i, j] if i >= N_NAV else 0.0
                    for m in range(N_NAV):
                        s += trans[k, m, i] * u[m, j]
                    big[i, j] = s
                    big[j, i] = s


@njit(cache=True)
def apply_correction(nominal, params, dx):
    """Add smoothed corrections [k, n] to filtered nodes in place."""
    pos = np.zeros(3)
    vel = np.zeros(3)
    q = np.zeros(4)
    c = np.zeros((3, 3))
    for k in range(nominal.shape[0]):
        pos[:] = nominal[k, 0:3]
        vel[:] = nominal[k, 3:6]
        q[:] = nominal[k, 6:10]
        inject(pos, vel, q, c, params[k], dx[k])
        nominal[k, 0:3] = pos
        nominal[k, 3:6] = vel
        nominal[k, 6:10] = q


@njit(cache=True)
def run_dense(
    imu_t, readings, extra, terms, node_t, nominal, params, gap, earth_on, blend, out, rates
):
    """States ``out`` [n, 10] at every IMU epoch by re-integration between nodes.

    With ``blend`` the mismatch at the next node (process noise that the smoother assigned) is
    spread evenly over the interval, without it the integration simply runs on. Epochs before
    the first or after the last node keep NaN. ``rates`` [n, 6] the corrected readings.
    """
    n_imu = imu_t.shape[0]
    pos = np.zeros(3)
    vel = np.zeros(3)
    q = np.zeros(4)
    c = np.zeros((3, 3))
    dvn = np.zeros(3)
    raw = np.zeros(6)
    ra = np.zeros(6)
    rb = np.zeros(6)
    miss = np.zeros(9)
    i = 0
    while i < n_imu - 2 and imu_t[i + 1] <= node_t[0]:
        i += 1
    if imu_t[i] == node_t[0]:
        for a in range(10):
            out[i, a] = nominal[0, a]
        for a in range(6):
            raw[a] = readings[i, a]
        correct_reading(raw, extra[i], terms, params[0], ra)
        for a in range(6):
            rates[i, a] = ra[a]
    for k in range(node_t.shape[0] - 1):
        t0, t1 = node_t[k], node_t[k + 1]
        if t1 <= t0:
            continue
        for a in range(3):
            pos[a] = nominal[k, a]
            vel[a] = nominal[k, 3 + a]
        for a in range(4):
            q[a] = nominal[k, 6 + a]
        quat_to_dcm(q, c)
        interpolate_reading(imu_t, readings, i, t0, raw)
        correct_reading(raw, extra[i], terms, params[k], ra)
        t = t0
        i_first = i + 1
        while t < t1:
            nxt = imu_t[i + 1]
            wide = nxt - imu_t[i] > gap[0]
            if nxt > t1 or (i == n_imu - 2):
                nxt = t1
            if wide and nxt - t > 0.02:
                nxt = t + 0.02
            if nxt == imu_t[i + 1]:
                for a in range(6):
                    raw[a] = readings[i + 1, a]
                correct_reading(raw, extra[i + 1], terms, params[k], rb)
            else:
                interpolate_reading(imu_t, readings, i, nxt, raw)
                correct_reading(raw, extra[i], terms, params[k], rb)
            if nxt > t:
                strapdown_step(pos, vel, q, c, ra, rb, nxt - t, earth_on, dvn)
            for a in range(6):
                ra[a] = rb[a]
            t = nxt
            if t >= imu_t[i + 1]:
                for a in range(3):
                    out[i + 1, a] = pos[a]
                    out[i + 1, 3 + a] = vel[a]
                for a in range(4):
                    out[i + 1, 6 + a] = q[a]
                for a in range(6):
                    rates[i + 1, a] = ra[a]
                if i == n_imu - 2:
                    break
                i += 1
        if blend:
            subtract(pos, vel, q, nominal[k + 1], miss)
            for a in range(9):
                miss[a] = -miss[a]
            rm, rn = radii(pos[0])
            last = i + 1 if imu_t[i + 1] <= t1 else i
            for j in range(i_first, last + 1):
                s = (imu_t[j] - t0) / (t1 - t0)
                out[j, 0] += s * miss[0] / (rm + out[j, 2])
                out[j, 1] += s * miss[1] / ((rn + out[j, 2]) * math.cos(out[j, 0]))
                out[j, 2] -= s * miss[2]
                for a in range(3):
                    out[j, 3 + a] += s * miss[3 + a]
                rotate_left(out[j, 6:10], s * miss[6], s * miss[7], s * miss[8])
