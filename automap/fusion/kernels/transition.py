"""From node to node: transition rows, process noise, covariance, error estimate."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.layout import N_NAV, V_ID
from automap.jit import kernel
from automap.records import FloatArray, IntArray

# process noise over an interval, in compact form: see ``add_noise``
N_NOISE = 29


@kernel
def start_interval(phi: FloatArray) -> None:
    """Identity transition rows [9, n]."""
    phi[:, :] = 0.0
    for a in range(N_NAV):
        phi[a, a] = 1.0


@kernel
def reach(phi: FloatArray) -> int:
    """Columns of the transition rows ``phi`` [9, n] up to the last that is not zero."""
    for j in range(phi.shape[1] - 1, N_NAV - 1, -1):
        for a in range(N_NAV):
            if phi[a, j] != 0.0:
                return j + 1
    return N_NAV


@kernel
def add_transition(
    phi: FloatArray, terms: IntArray, c: FloatArray, r: FloatArray, dvn: FloatArray, dt: float
) -> None:
    """Advance the transition rows ``phi`` [9, n] over one strapdown step.

    ``r`` [6 + e] the corrected reading in the middle of the step and the extra signals, ``c``
    [3, 3] the attitude. dv/dt = -f x phi, dp/dt = v (Groves, section 14.2, without the terms of
    Earth and transport rate). The columns of position and velocity are closed forms and are filled
    in at the node.
    """
    fn, fe, fd = dvn[0], dvn[1], dvn[2]
    for j in range(6, 9):
        _advance_column(phi, j, fn, fe, fd, dt)
    for m in range(terms.shape[0]):
        j = N_NAV + terms[m, 3]
        axis, b = terms[m, 1], terms[m, 2]
        u = (1.0 if b == 0 else r[b - 1]) * dt
        cn, ce, cd = c[0, axis] * u, c[1, axis] * u, c[2, axis] * u
        if m > 0 and terms[m - 1, 3] == terms[m, 3]:
            # the column of a parameter advances once, and takes what its other axes add
            if terms[m, 0] == 0:
                dn, de, dd = fe * cd - fd * ce, fd * cn - fn * cd, fn * ce - fe * cn
                phi[6, j] -= cn
                phi[7, j] -= ce
                phi[8, j] -= cd
            else:
                dn, de, dd = -2.0 * cn, -2.0 * ce, -2.0 * cd
            phi[0, j] += 0.25 * dn * dt
            phi[1, j] += 0.25 * de * dt
            phi[2, j] += 0.25 * dd * dt
            phi[3, j] += 0.5 * dn
            phi[4, j] += 0.5 * de
            phi[5, j] += 0.5 * dd
        elif terms[m, 0] == 0:
            # the attitude error grows over the step: half of it turns the force on average
            phi[6, j] -= 0.5 * cn
            phi[7, j] -= 0.5 * ce
            phi[8, j] -= 0.5 * cd
            _advance_column(phi, j, fn, fe, fd, dt)
            phi[6, j] -= 0.5 * cn
            phi[7, j] -= 0.5 * ce
            phi[8, j] -= 0.5 * cd
        else:
            phi[0, j] += (phi[3, j] - 0.5 * cn) * dt
            phi[1, j] += (phi[4, j] - 0.5 * ce) * dt
            phi[2, j] += (phi[5, j] - 0.5 * cd) * dt
            phi[3, j] -= cn
            phi[4, j] -= ce
            phi[5, j] -= cd


@kernel
def _advance_column(phi: FloatArray, j: int, fn: float, fe: float, fd: float, dt: float) -> None:
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


@kernel
def add_noise(s: FloatArray, dvn: FloatArray, dt: float, qa: float, qg: float) -> None:
    """Advance the process noise over one step.

    ``qa``, ``qg`` PSD of force (m/s^2)^2/Hz and rate (rad/s)^2/Hz, equal on all axes. With
    isotropic rate noise the blocks are few numbers: phi-phi = s[0] I, v-phi = -[a x] with
    a = s[1:4], p-phi = -[b x] with b = s[4:7], v-v symmetric s[7:13] (nn, ee, dd, ne, nd, ed),
    p-v full s[13:22], p-p symmetric s[22:28].
    """
    d0, d1, d2 = dvn[0], dvn[1], dvn[2]
    q = s[0]
    a0, a1, a2 = s[1], s[2], s[3]
    # p-p with the old p-v and v-v
    s[22] += dt * (2 * s[13] + dt * s[7])
    s[23] += dt * (2 * s[17] + dt * s[8])
    s[24] += dt * (2 * s[21] + dt * s[9])
    s[25] += dt * (s[14] + s[16] + dt * s[10])
    s[26] += dt * (s[15] + s[19] + dt * s[11])
    s[27] += dt * (s[18] + s[20] + dt * s[12])
    # p-phi
    half = 0.5 * dt * q
    b0, b1, b2 = s[4] + dt * a0 + half * d0, s[5] + dt * a1 + half * d1, s[6] + dt * a2 + half * d2
    s[4], s[5], s[6] = b0, b1, b2
    # p-v: + dt v-v, and -(d b' - (b.d) I) - dt / 2 (a d' - (a.d) I) by the attitude error
    k = 0.5 * dt
    bd = b0 * d0 + b1 * d1 + b2 * d2 + k * (a0 * d0 + a1 * d1 + a2 * d2)
    s[13] += dt * s[7] - d0 * b0 - k * a0 * d0 + bd
    s[14] += dt * s[10] - d0 * b1 - k * a0 * d1
    s[15] += dt * s[11] - d0 * b2 - k * a0 * d2
    s[16] += dt * s[10] - d1 * b0 - k * a1 * d0
    s[17] += dt * s[8] - d1 * b1 - k * a1 * d1 + bd
    s[18] += dt * s[12] - d1 * b2 - k * a1 * d2
    s[19] += dt * s[11] - d2 * b0 - k * a2 * d0
    s[20] += dt * s[12] - d2 * b1 - k * a2 * d1
    s[21] += dt * s[9] - d2 * b2 - k * a2 * d2 + bd
    # v-v: -(a d' + d a' - 2 (a.d) I) - q (d d' - |d|^2 I)
    ad = 2.0 * (a0 * d0 + a1 * d1 + a2 * d2)
    dd = q * (d0 * d0 + d1 * d1 + d2 * d2)
    s[7] += ad + dd - 2 * a0 * d0 - q * d0 * d0 + qa * dt
    s[8] += ad + dd - 2 * a1 * d1 - q * d1 * d1 + qa * dt
    s[9] += ad + dd - 2 * a2 * d2 - q * d2 * d2 + qa * dt
    s[10] -= a0 * d1 + a1 * d0 + q * d0 * d1
    s[11] -= a0 * d2 + a2 * d0 + q * d0 * d2
    s[12] -= a1 * d2 + a2 * d1 + q * d1 * d2
    # v-phi, phi-phi
    s[1] += d0 * q
    s[2] += d1 * q
    s[3] += d2 * q
    s[0] += qg * dt


@kernel
def expand_noise(s: FloatArray, out: FloatArray) -> None:
    """The full symmetric matrix [9, 9] of the compact noise."""
    out[:, :] = 0.0
    for i in range(3):
        out[i, i] = s[22 + i]
        out[3 + i, 3 + i] = s[7 + i]
        out[6 + i, 6 + i] = s[0]
        for j in range(3):
            out[i, 3 + j] = s[13 + 3 * i + j]
    out[0, 1], out[0, 2], out[1, 2] = s[25], s[26], s[27]
    out[3, 4], out[3, 5], out[4, 5] = s[10], s[11], s[12]
    for row, first in ((3, 1), (0, 4)):
        x, y, z = s[first], s[first + 1], s[first + 2]
        out[row, 7], out[row, 8] = z, -y
        out[row + 1, 6], out[row + 1, 8] = -z, x
        out[row + 2, 6], out[row + 2, 7] = y, -x
    for i in range(9):
        for j in range(i):
            out[i, j] = out[j, i]


@kernel
def outlasting(
    span: float, tau: FloatArray, kept: IntArray, keep: FloatArray, out: FloatArray
) -> None:
    """What of each parameter outlasts ``span`` s, ``out`` [n]: correlated ones decay with ``tau``
    [n] s, and normalised ones by a share of ``keep`` [6] more (``kept`` [n], -1 none)."""
    for j in range(N_NAV, out.shape[0]):
        out[j] = 1.0
        if tau[j] > 0.0:
            out[j] = math.exp(-span / tau[j])
            if kept[j] >= 0:
                out[j] *= keep[kept[j]]


@kernel
def end_interval(
    phi: FloatArray,
    span: float,
    tau: FloatArray,
    walk: FloatArray,
    decay: FloatArray,
    q_state: FloatArray,
    xi: FloatArray,
    kept: IntArray,
    keep: FloatArray,
) -> None:
    """Close an interval of ``span`` s: velocity columns, decay and noise of the parameters.

    ``keep``, ``kept``: see ``outlasting``. Gauss-Markov states are exact (Brown and Hwang,
    Introduction to Random Signals, section 5.3).
    """
    n = phi.shape[1]
    for a in range(3):
        phi[a, V_ID + a] = span
    outlasting(span, tau, kept, keep, decay)
    for j in range(N_NAV, n):
        if tau[j] > 0.0:
            d = decay[j]
            q_state[j] = (1.0 - d * d) * walk[j]
            xi[j - N_NAV] *= d
        else:
            q_state[j] = walk[j] * span


@kernel
def propagate_covariance(
    p: FloatArray,
    phi: FloatArray,
    qn: FloatArray,
    decay: FloatArray,
    q_state: FloatArray,
    work: FloatArray,
) -> None:
    """P := F P F' + Q with F = [phi; 0 diag(decay)] in place; ``work`` [9, n]."""
    n = p.shape[0]
    r = reach(phi)
    shown = np.empty((N_NAV, r))
    for i in range(N_NAV):
        for j in range(r):
            shown[i, j] = phi[i, j]
    np.dot(shown, p[:r], work)
    for i in range(N_NAV):
        for j in range(i + 1):
            s = qn[i, j]
            for k in range(r):
                s += work[i, k] * shown[j, k]
            p[i, j] = s
            p[j, i] = s
        for j in range(N_NAV, n):
            v = work[i, j] * decay[j]
            p[i, j] = v
            p[j, i] = v
    for i in range(N_NAV, n):
        if decay[i] != 1.0:
            for j in range(N_NAV, n):
                p[i, j] *= decay[i]
            for j in range(N_NAV, n):
                p[j, i] *= decay[i]
        p[i, i] += q_state[i]


@kernel
def carry_mean(
    dx: FloatArray,
    phi: FloatArray,
    decay: FloatArray,
    xi: FloatArray,
    next_params: FloatArray,
    work: FloatArray,
) -> None:
    """Carry an error estimate [n] over an interval, towards the next state's parameters."""
    n = dx.shape[0]
    for i in range(N_NAV):
        s = 0.0
        for j in range(n):
            s += phi[i, j] * dx[j]
        work[i] = s
    for i in range(N_NAV):
        dx[i] = work[i]
    for j in range(N_NAV, n):
        # xi has already decayed
        dx[j] = decay[j] * dx[j] + xi[j - N_NAV] - next_params[j - N_NAV]
