"""What fixes and the vehicle's motion should read in a state, and how that depends on the state.

One prediction with its rows for the position and velocity of the antenna and for the velocity of
the point that does not slide. Parameters act by the terms of their effects (``effects.terms``),
which arrive as a table; no effect is known by name. Rows are those of the error state: navigation
errors, then parameters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from automap.effects.navigation import N_NAV, P_ID, PHI_ID, V_ID
from automap.jit import kernel
from automap.records import FloatArray, IntArray

ON_POSITION, ON_VELOCITY, ON_VEHICLE = 0, 1, 2
AXIS, POINT, TIME, TURN, SLIP, SCALE = 0, 1, 2, 4, 5, 6
SIGNAL_ONE, SIGNAL_ELAPSED, SIGNAL_FORWARD, SIGNAL_LATERAL, SIGNAL_COLUMN = 0, 1, 2, 3, 4


class TermTable(NamedTuple):
    """Terms as a kernel takes them: ``codes`` [m, 5] parameter, what it acts on, kind, axis and
    signal (from ``SIGNAL_COLUMN`` on: a column of the node's signals); ``weights`` [m]."""

    codes: IntArray
    weights: FloatArray


class Acting(NamedTuple):
    """What all terms on one measurement add up to: ``arm`` [3] m and ``turn`` [3] rad in vehicle
    axes, ``late`` [1] s, ``added`` [3] in the measurement's axes, ``slip`` [3] rad, ``longer`` [3]
    factors on the components."""

    arm: FloatArray
    turn: FloatArray
    late: FloatArray
    added: FloatArray
    slip: FloatArray
    longer: FloatArray


@kernel
def sum_terms(on: int, table: TermTable, now: FloatArray, xi: FloatArray) -> Acting:
    """The terms on one measurement at parameters ``xi`` [p] and signals ``now`` [4 + e]."""
    arm, turn, late = np.zeros(3), np.zeros(3), np.zeros(1)
    added, slip, longer = np.zeros(3), np.zeros(3), np.ones(3)
    for m in range(table.codes.shape[0]):
        if table.codes[m, 1] != on:
            continue
        kind, a = table.codes[m, 2], table.codes[m, 3]
        v = table.weights[m] * now[table.codes[m, 4]] * xi[table.codes[m, 0]]
        if kind == AXIS:
            added[a] += v
        elif kind == POINT:
            arm[a] += v
        elif kind == TIME:
            late[0] += v
        elif kind == TURN:
            turn[a] += v
        elif kind == SLIP:
            slip[a] += v
        else:
            longer[a] += v
    return Acting(arm, turn, late, added, slip, longer)


@kernel
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _times(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = c[i, 0] * a[0] + c[i, 1] * a[1] + c[i, 2] * a[2]


class Mounting(NamedTuple):
    """ZYX angles as ``matrix`` [3, 3] sensor to vehicle, and the axes [3, 3] in vehicle axes, a row
    an angle, about which roll, pitch and yaw turn it further."""

    matrix: FloatArray
    axes: FloatArray


@kernel
def mounting_of(angles: FloatArray) -> Mounting:
    """The mounting of roll, pitch, yaw [3] rad (as ``frames.rpy_to_matrix``)."""
    cr, sr = math.cos(angles[0]), math.sin(angles[0])
    cp, sp = math.cos(angles[1]), math.sin(angles[1])
    cy, sy = math.cos(angles[2]), math.sin(angles[2])
    matrix, axes = np.zeros((3, 3)), np.zeros((3, 3))
    matrix[0, 0] = cy * cp
    matrix[0, 1] = cy * sp * sr - sy * cr
    matrix[0, 2] = cy * sp * cr + sy * sr
    matrix[1, 0] = sy * cp
    matrix[1, 1] = sy * sp * sr + cy * cr
    matrix[1, 2] = sy * sp * cr - cy * sr
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = -sp, cp * sr, cp * cr
    axes[0, 0], axes[0, 1], axes[0, 2] = cy * cp, sy * cp, -sp
    axes[1, 0], axes[1, 1] = -sy, cy
    axes[2, 2] = 1.0
    return Mounting(matrix, axes)


@kernel
def _back(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    """``out`` [3] := C' a."""
    for i in range(3):
        out[i] = c[0, i] * a[0] + c[1, i] * a[1] + c[2, i] * a[2]


@kernel
def _attitude_columns(h: FloatArray, u: FloatArray) -> None:
    """h[0:3, phi] := -[u x], for a vector u = C b of the body."""
    h[0, PHI_ID + 1], h[0, PHI_ID + 2] = u[2], -u[1]
    h[1, PHI_ID], h[1, PHI_ID + 2] = -u[2], u[0]
    h[2, PHI_ID], h[2, PHI_ID + 1] = u[1], -u[0]


@kernel
def _point_columns(
    h: FloatArray,
    table: TermTable,
    on: int,
    now: FloatArray,
    acting: Acting,
    mount: Mounting,
    g: FloatArray,
) -> None:
    """Columns of what moves the measured point, and of the mounting that turns its arm, where
    ``g`` [3, 3] is the derivative by the arm along the sensor's axes."""
    seen, moved = np.zeros(3), np.zeros(3)
    for m in range(table.codes.shape[0]):
        kind = table.codes[m, 2]
        if table.codes[m, 1] != on or (kind != POINT and kind != TURN):
            continue
        a, j = table.codes[m, 3], N_NAV + table.codes[m, 0]
        if kind == POINT:
            seen[:] = 0.0
            seen[a] = 1.0
        else:
            # the arm is on the vehicle, not on the sensor: d(W' l) = W' (l x axis)
            _cross(acting.arm, mount.axes[a], seen)
        _back(mount.matrix, seen, moved)
        w = table.weights[m] * now[table.codes[m, 4]]
        for i in range(3):
            h[i, j] += w * (g[i, 0] * moved[0] + g[i, 1] * moved[1] + g[i, 2] * moved[2])


@kernel
def antenna_position(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    xi: FloatArray,
    table: TermTable,
    now: FloatArray,
) -> None:
    """Where a fix should lie against the IMU, ``out`` [3] m NED, and rows ``h`` [3, n].

    C W' l + (v + C (omega x W' l)) d + b: the arm l is the vehicle's, C [3, 3] the sensor's
    attitude, W the mounting between the two, d how much later the fix holds the motion, ``vel``
    [3] m/s NED, ``rate`` [3] rad/s in the sensor's axes, b what is added. Groves, Principles of
    GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., section 14.3.
    """
    on = ON_POSITION
    acting = sum_terms(on, table, now, xi)
    mount = mounting_of(acting.turn)
    arm, cl, swing, moving = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    _back(mount.matrix, acting.arm, arm)
    _times(c, arm, cl)
    _cross(rate, arm, swing)
    _times(c, swing, moving)
    h[:, :] = 0.0
    for a in range(3):
        moving[a] += vel[a]
        out[a] = cl[a] + moving[a] * acting.late[0] + acting.added[a]
        h[a, P_ID + a] = 1.0
    _attitude_columns(h, cl)
    _point_columns(h, table, on, now, acting, mount, c)
    _plain_columns(h, table, on, now, moving, out)


@kernel
def antenna_velocity(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    table: TermTable,
    now: FloatArray,
) -> None:
    """The velocity that a fix should have, ``out`` [3] m/s NED, and rows ``h`` [3, n].

    S (v + C (omega x W' l)) + (a + C (omega x (omega x W' l))) d + b, with ``acc`` [3] m/s^2 NED
    over ground and S the factors on the components; that a turn begins or ends within d is left
    out. Groves, section 14.3.
    """
    on = ON_VELOCITY
    acting = sum_terms(on, table, now, xi)
    mount = mounting_of(acting.turn)
    arm, swing, cv = np.zeros(3), np.zeros(3), np.zeros(3)
    inward, slope = np.zeros(3), np.zeros(3)
    _back(mount.matrix, acting.arm, arm)
    _cross(rate, arm, swing)
    _times(c, swing, cv)
    _cross(rate, swing, inward)
    _times(c, inward, slope)
    h[:, :] = 0.0
    g = np.zeros((3, 3))
    whole = np.zeros(3)
    for a in range(3):
        whole[a] = vel[a] + cv[a]
        slope[a] += acc[a]
        h[a, V_ID + a] = 1.0
        # C [omega x]
        g[a, 0] = c[a, 1] * rate[2] - c[a, 2] * rate[1]
        g[a, 1] = c[a, 2] * rate[0] - c[a, 0] * rate[2]
        g[a, 2] = c[a, 0] * rate[1] - c[a, 1] * rate[0]
    _attitude_columns(h, cv)
    _point_columns(h, table, on, now, acting, mount, g)
    _lengthen(h, acting.longer)
    for a in range(3):
        out[a] = acting.longer[a] * whole[a] + slope[a] * acting.late[0] + acting.added[a]
    _plain_columns(h, table, on, now, slope, whole)


@kernel
def vehicle_velocity(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    table: TermTable,
    now: FloatArray,
) -> None:
    """The velocity of the point that does not slide, ``out`` [3] m/s in vehicle axes, and rows
    ``h`` [3, n].

    S (I + [s x]) y + b with y = W (C' v + omega x W' r): r the arm to the point, W the mounting, s
    the slip, S the factors. Of ``now`` the accelerations along the
    vehicle's axes are set here. Dissanayake et al., IEEE Transactions on Robotics and Automation
    17 (2001), 731-747.
    """
    on = ON_VEHICLE
    mount = mounting_of(sum_terms(on, table, now, xi).turn)
    w = mount.matrix
    u, y, cross, along = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    _back(c, acc, u)
    _times(w, u, along)
    now[SIGNAL_FORWARD], now[SIGNAL_LATERAL] = along[0], along[1]
    acting = sum_terms(on, table, now, xi)
    arm, swing = np.zeros(3), np.zeros(3)
    _back(w, acting.arm, arm)
    _cross(rate, arm, swing)
    _back(c, vel, u)
    for a in range(3):
        u[a] += swing[a]
    g = np.zeros((3, 3))
    h[:, :] = 0.0
    for i in range(3):
        y[i] = w[i, 0] * u[0] + w[i, 1] * u[1] + w[i, 2] * u[2]
        # W [omega x]
        g[i, 0] = w[i, 1] * rate[2] - w[i, 2] * rate[1]
        g[i, 1] = w[i, 2] * rate[0] - w[i, 0] * rate[2]
        g[i, 2] = w[i, 0] * rate[1] - w[i, 1] * rate[0]
        b0 = w[i, 0] * c[0, 0] + w[i, 1] * c[0, 1] + w[i, 2] * c[0, 2]
        b1 = w[i, 0] * c[1, 0] + w[i, 1] * c[1, 1] + w[i, 2] * c[1, 2]
        b2 = w[i, 0] * c[2, 0] + w[i, 1] * c[2, 1] + w[i, 2] * c[2, 2]
        h[i, V_ID], h[i, V_ID + 1], h[i, V_ID + 2] = b0, b1, b2
        # d(C' v)/dphi = C' [v x]
        h[i, PHI_ID] = b1 * vel[2] - b2 * vel[1]
        h[i, PHI_ID + 1] = b2 * vel[0] - b0 * vel[2]
        h[i, PHI_ID + 2] = b0 * vel[1] - b1 * vel[0]
    _point_columns(h, table, on, now, acting, mount, g)
    _turn_columns(h, table, on, now, TURN, mount.axes, y)
    _turn_columns(h, table, on, now, SLIP, np.eye(3), y)
    _lengthen(h, acting.longer)
    _cross(acting.slip, y, cross)
    for a in range(3):
        # a vehicle that slips is still seen by its wheels along its own nose
        y[a] += cross[a] if a > 0 else 0.0
        out[a] = acting.longer[a] * y[a] + acting.added[a]
    _plain_columns(h, table, on, now, along, y)


@kernel
def _lengthen(h: FloatArray, longer: FloatArray) -> None:
    for a in range(3):
        if longer[a] != 1.0:
            for j in range(h.shape[1]):
                h[a, j] *= longer[a]


@kernel
def _turn_columns(
    h: FloatArray,
    table: TermTable,
    on: int,
    now: FloatArray,
    kind: int,
    axes: FloatArray,
    u: FloatArray,
) -> None:
    """Columns of turns of a vector ``u`` [3] about ``axes`` [3, 3], a row each."""
    turned = np.zeros(3)
    for m in range(table.codes.shape[0]):
        if table.codes[m, 1] != on or table.codes[m, 2] != kind:
            continue
        j = N_NAV + table.codes[m, 0]
        w = table.weights[m] * now[table.codes[m, 4]]
        _cross(axes[table.codes[m, 3]], u, turned)
        for i in range(1 if kind == SLIP else 0, 3):
            h[i, j] += w * turned[i]


@kernel
def _plain_columns(
    h: FloatArray,
    table: TermTable,
    on: int,
    now: FloatArray,
    slope: FloatArray,
    whole: FloatArray,
) -> None:
    """Columns of what is added, of delays (``slope`` [3] per second) and of factors on the
    components of ``whole`` [3]."""
    for m in range(table.codes.shape[0]):
        if table.codes[m, 1] != on:
            continue
        kind, a, j = table.codes[m, 2], table.codes[m, 3], N_NAV + table.codes[m, 0]
        w = table.weights[m] * now[table.codes[m, 4]]
        if kind == AXIS:
            h[a, j] += w
        elif kind == TIME:
            for i in range(3):
                h[i, j] += w * slope[i]
        elif kind == SCALE:
            h[a, j] += w * whole[a]


@kernel
def rows_along(
    vel: FloatArray,
    dcm: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    t: FloatArray,
    columns: FloatArray,
    xi: FloatArray,
    table: TermTable,
    out: FloatArray,
) -> None:
    """Parameter columns ``out`` [k, 3, 3, p] of position, velocity and vehicle velocity along a
    motion: ``vel``, ``rate`` (sensor axes), ``acc`` (NED) [k, 3], ``dcm`` [k, 3, 3] body to NED,
    ``t`` [k] s, ``columns`` [k, e] signals."""
    p = xi.shape[0]
    h = np.zeros((3, N_NAV + p))
    z = np.zeros(3)
    now = np.zeros(SIGNAL_COLUMN + columns.shape[1])
    for k in range(t.shape[0]):
        set_signals(now, t[k], columns[k])
        c = dcm[k]
        antenna_position(h, z, vel[k], c, rate[k], xi, table, now)
        out[k, ON_POSITION] = h[:, N_NAV:]
        antenna_velocity(h, z, vel[k], c, rate[k], acc[k], xi, table, now)
        out[k, ON_VELOCITY] = h[:, N_NAV:]
        vehicle_velocity(h, z, vel[k], c, rate[k], acc[k], xi, table, now)
        out[k, ON_VEHICLE] = h[:, N_NAV:]


@kernel
def set_signals(now: FloatArray, t: float, columns: FloatArray) -> None:
    """Signals ``now`` [4 + e] at ``t``, the vehicle's accelerations still zero."""
    now[SIGNAL_ONE], now[SIGNAL_ELAPSED] = 1.0, t
    now[SIGNAL_FORWARD], now[SIGNAL_LATERAL] = 0.0, 0.0
    for i in range(columns.shape[0]):
        now[SIGNAL_COLUMN + i] = columns[i]
