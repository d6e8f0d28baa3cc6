"""What a node observes: residuals and rows of the measurement matrix."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.kernels.arrays import Samples
from automap.fusion.layout import (
    DATUM,
    DELAY,
    LATENCY,
    LEVER,
    MOUNT,
    N_NAV,
    ODOMETER_SCALE,
    PHI_ID,
    SIDESLIP,
    SKEW,
    V_ID,
    VEHICLE_PITCH,
    VEL_LAG,
    VEL_LATENCY,
    VEL_WANDER,
    WANDER,
    WHEEL,
)
from automap.fusion.mechanisation import radii
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def _lever_rows(h: FloatArray, phi_row: int, cl: FloatArray, sign: float) -> None:
    """h[0:3, 6:9] := -sign [cl x]."""
    h[0, phi_row + 1] = sign * cl[2]
    h[0, phi_row + 2] = -sign * cl[1]
    h[1, phi_row] = -sign * cl[2]
    h[1, phi_row + 2] = sign * cl[0]
    h[2, phi_row] = sign * cl[1]
    h[2, phi_row + 1] = -sign * cl[0]


@kernel
def _lever_in_sensor_axes(
    lever: FloatArray, turn: FloatArray, xi: FloatArray, off: IntArray
) -> None:
    """The antenna's ``lever`` [3], stated along the vehicle's axes, along the sensor's: l - m x l,
    with the mounting m (small). ``turn`` [3, 3] := I - [m x]."""
    stated = np.zeros(3)
    m = np.zeros(3)
    for a in range(3):
        stated[a] = xi[off[LEVER] - N_NAV + a]
        if off[MOUNT] >= 0:
            m[a] = xi[off[MOUNT] - N_NAV + a]
    turn[0, 0] = turn[1, 1] = turn[2, 2] = 1.0
    turn[0, 1], turn[0, 2] = m[2], -m[1]
    turn[1, 0], turn[1, 2] = -m[2], m[0]
    turn[2, 0], turn[2, 1] = m[1], -m[0]
    for a in range(3):
        lever[a] = turn[a, 0] * stated[0] + turn[a, 1] * stated[1] + turn[a, 2] * stated[2]


@kernel
def _lever_columns(
    h: FloatArray, g: FloatArray, turn: FloatArray, xi: FloatArray, off: IntArray
) -> None:
    """Columns of the lever arm, and of the mounting that turns it, where ``g`` [3, 3] is the
    derivative by the lever arm along the sensor's axes."""
    o = off[LEVER]
    for a in range(3):
        for b in range(3):
            h[a, o + b] = g[a, 0] * turn[0, b] + g[a, 1] * turn[1, b] + g[a, 2] * turn[2, b]
    if off[MOUNT] < 0:
        return
    l0, l1, l2 = xi[o - N_NAV], xi[o - N_NAV + 1], xi[o - N_NAV + 2]
    q = off[MOUNT]
    for a in range(3):
        # d(-m x l)/dm = [l x]
        h[a, q] = g[a, 1] * l2 - g[a, 2] * l1
        h[a, q + 1] = -g[a, 0] * l2 + g[a, 2] * l0
        h[a, q + 2] = g[a, 0] * l1 - g[a, 1] * l0


@kernel
def _shift_in_time(
    h: FloatArray, z: FloatArray, slope: FloatArray, xi: FloatArray, offset: int, factor: float
) -> None:
    """A parameter that moves the observed instant: slope [3] per second times ``factor``."""
    if offset < 0:
        return
    d = factor * xi[offset - N_NAV]
    for a in range(3):
        z[a] -= slope[a] * d
        h[a, offset] = slope[a] * factor


@kernel
def position_block(
    h: FloatArray,
    z: FloatArray,
    fix: FloatArray,
    pos: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    xi: FloatArray,
    off: IntArray,
    wander_scale: FloatArray,
    t: float,
) -> None:
    """Residual ``z`` [3] in metres NED and rows ``h`` [3, n] of an antenna position.

    ``fix`` [3] latitude, longitude, height. Predicted: p + C (I - [m x]) l + wander, at the fix's
    time shifted by the remaining delay (p + v delay); the lever arm l is the vehicle's, C the
    sensor's attitude, m the mounting between the two.
    """
    n = h.shape[1]
    lever = np.zeros(3)
    turn = np.zeros((3, 3))
    if off[LEVER] >= 0:
        _lever_in_sensor_axes(lever, turn, xi, off)
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
        _lever_columns(h, c, turn, xi, off)
    _shift_in_time(h, z, vel, xi, off[DELAY], 1.0)
    _shift_in_time(h, z, vel, xi, off[SKEW], t)
    _shift_in_time(h, z, vel, xi, off[LATENCY], -1.0)
    if off[DATUM] >= 0:
        for a in range(3):
            z[a] -= xi[off[DATUM] - N_NAV + a]
            h[a, off[DATUM] + a] = 1.0
    if off[WANDER] >= 0:
        for a in range(3):
            z[a] -= wander_scale[a] * xi[off[WANDER] - N_NAV + a]
            h[a, off[WANDER] + a] = wander_scale[a]


@kernel
def velocity_block(
    h: FloatArray,
    z: FloatArray,
    fix_vel: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    off: IntArray,
    t: float,
) -> None:
    """Residual and rows of an antenna velocity NED, its wander added; ``rate`` [3] body, ``acc``
    [3] NED."""
    n = h.shape[1]
    lever = np.zeros(3)
    turn = np.zeros((3, 3))
    if off[LEVER] >= 0:
        _lever_in_sensor_axes(lever, turn, xi, off)
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
        # C [omega x]
        g = np.zeros((3, 3))
        for a in range(3):
            g[a, 0] = c[a, 1] * rate[2] - c[a, 2] * rate[1]
            g[a, 1] = c[a, 2] * rate[0] - c[a, 0] * rate[2]
            g[a, 2] = c[a, 0] * rate[1] - c[a, 1] * rate[0]
        _lever_columns(h, g, turn, xi, off)
    _shift_in_time(h, z, acc, xi, off[DELAY], 1.0)
    _shift_in_time(h, z, acc, xi, off[SKEW], t)
    _shift_in_time(h, z, acc, xi, off[LATENCY], -1.0)
    _shift_in_time(h, z, acc, xi, off[VEL_LATENCY], -1.0)
    # a first-order low-pass delays by its time constant, to first order
    _shift_in_time(h, z, acc, xi, off[VEL_LAG], -1.0)
    if off[VEL_WANDER] >= 0:
        for a in range(3):
            z[a] -= xi[off[VEL_WANDER] - N_NAV + a]
            h[a, off[VEL_WANDER] + a] = 1.0


@kernel
def _wheel_velocity(
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    xi: FloatArray,
    off: IntArray,
    m: FloatArray,
    u: FloatArray,
) -> None:
    """Velocity ``u`` [3] in sensor axes of the point that does not slide, C' v + omega x r, and
    the mounting ``m`` [3] as it stands."""
    r = np.zeros(3)
    for a in range(3):
        if off[WHEEL] >= 0:
            r[a] = xi[off[WHEEL] - N_NAV + a]
        m[a] = xi[off[MOUNT] - N_NAV + a] if off[MOUNT] >= 0 else 0.0
        u[a] = c[0, a] * vel[0] + c[1, a] * vel[1] + c[2, a] * vel[2]
    u[0] += rate[1] * r[2] - rate[2] * r[1]
    u[1] += rate[2] * r[0] - rate[0] * r[2]
    u[2] += rate[0] * r[1] - rate[1] * r[0]


@kernel
def constraint_block(
    h: FloatArray,
    z: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    off: IntArray,
) -> None:
    """Rows [2, n] of the non-holonomic constraint: no lateral or vertical speed of the vehicle.

    At the point that does not slide: u = C' v + omega x r, turned into the vehicle by the
    mounting m (small): (I + [m x]) u, components y and z are zero.
    """
    n = h.shape[1]
    m = np.zeros(3)
    u = np.zeros(3)
    _wheel_velocity(vel, c, rate, xi, off, m, u)
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
    if off[SIDESLIP] >= 0:
        # the car drifts outwards by an angle that grows with the lateral acceleration
        lateral = c[0, 1] * acc[0] + c[1, 1] * acc[1] + c[2, 1] * acc[2]
        z[0] -= xi[off[SIDESLIP] - N_NAV] * lateral * u[0]
        h[0, off[SIDESLIP]] = lateral * u[0]
    if off[VEHICLE_PITCH] >= 0:
        # on its springs the nose rises with the acceleration, and points above where it goes
        forward = c[0, 0] * acc[0] + c[1, 0] * acc[1] + c[2, 0] * acc[2]
        z[1] += xi[off[VEHICLE_PITCH] - N_NAV] * forward * u[0]
        h[1, off[VEHICLE_PITCH]] = -forward * u[0]
    if off[MOUNT] >= 0:
        o = off[MOUNT]
        h[0, o], h[0, o + 2] = -u[2], u[0]
        h[1, o], h[1, o + 1] = u[1], -u[0]


@kernel
def odometer_row(
    h: FloatArray,
    z: FloatArray,
    speed: float,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    xi: FloatArray,
    off: IntArray,
) -> None:
    """Row [1, n] of a wheel speed in m/s: (1 + scale) times the forward speed of the vehicle.

    The forward speed is that of the point that does not slide, as in ``constraint_block``.
    """
    m = np.zeros(3)
    u = np.zeros(3)
    _wheel_velocity(vel, c, rate, xi, off, m, u)
    scale = 1.0 + (xi[off[ODOMETER_SCALE] - N_NAV] if off[ODOMETER_SCALE] >= 0 else 0.0)
    forward = u[0] - m[2] * u[1] + m[1] * u[2]
    z[0] = speed - scale * forward
    h[0, :] = 0.0
    g = np.zeros(3)
    for a in range(3):
        g[a] = scale * (c[a, 0] - m[2] * c[a, 1] + m[1] * c[a, 2])
        h[0, V_ID + a] = g[a]
    h[0, PHI_ID] = g[1] * vel[2] - g[2] * vel[1]
    h[0, PHI_ID + 1] = g[2] * vel[0] - g[0] * vel[2]
    h[0, PHI_ID + 2] = g[0] * vel[1] - g[1] * vel[0]
    if off[WHEEL] >= 0:
        o = off[WHEEL]
        h[0, o] = scale * (-m[2] * rate[2] - m[1] * rate[1])
        h[0, o + 1] = scale * (-rate[2] + m[1] * rate[0])
        h[0, o + 2] = scale * (rate[1] + m[2] * rate[0])
    if off[MOUNT] >= 0:
        h[0, off[MOUNT] + 1] = scale * u[2]
        h[0, off[MOUNT] + 2] = -scale * u[1]
    if off[ODOMETER_SCALE] >= 0:
        h[0, off[ODOMETER_SCALE]] = forward


@kernel
def zero_velocity_rows(h: FloatArray, z: FloatArray, vel: FloatArray) -> None:
    """Rows [3, n] of the zero-velocity update."""
    for a in range(3):
        for j in range(h.shape[1]):
            h[a, j] = 0.0
        h[a, V_ID + a] = 1.0
        z[a] = -vel[a]


@kernel
def standstill_rate_rows(
    h: FloatArray,
    z: FloatArray,
    rate: FloatArray,
    e: FloatArray,
    c: FloatArray,
    mid: FloatArray,
    terms: IntArray,
) -> None:
    """Rows [3, n] of the zero-rate update: the body turns with the Earth only.

    ``rate`` [3] mean over the interval, ``mid`` [6 + e] a corrected reading and the extra
    signals, ``e`` [9] the terms of the place.
    """
    for a in range(3):
        for j in range(h.shape[1]):
            h[a, j] = 0.0
        z[a] = c[0, a] * e[6] + c[2, a] * e[7] - rate[a]
    for m in range(terms.shape[0]):
        if terms[m, 0] == 0:
            b = terms[m, 2]
            h[terms[m, 1], N_NAV + m] = -(1.0 if b == 0 else mid[b - 1])


@kernel
def calm_rate(samples: Samples, i: int, t: float, rate: FloatArray) -> None:
    """Take the noise of a single reading out of the rate [3] at ``t`` between samples i, i + 1."""
    s = (t - samples.t[i]) / (samples.t[i + 1] - samples.t[i])
    s = min(max(s, 0.0), 1.0)
    d = samples.calm
    for a in range(3):
        rate[a] += d[i, a] + s * (d[i + 1, a] - d[i, a])


@kernel
def acceleration(
    samples: Samples, i: int, t: float, gravity: float, c: FloatArray, out: FloatArray
) -> None:
    """Acceleration over ground NED [3] at ``t`` between samples i and i + 1, to first order."""
    s = (t - samples.t[i]) / (samples.t[i + 1] - samples.t[i])
    s = min(max(s, 0.0), 1.0)
    f = samples.force
    f0 = f[i, 0] + s * (f[i + 1, 0] - f[i, 0])
    f1 = f[i, 1] + s * (f[i + 1, 1] - f[i, 1])
    f2 = f[i, 2] + s * (f[i + 1, 2] - f[i, 2])
    for a in range(3):
        out[a] = c[a, 0] * f0 + c[a, 1] * f1 + c[a, 2] * f2
    out[2] += gravity
