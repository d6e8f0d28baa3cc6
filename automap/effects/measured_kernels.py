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

from automap.effects.limits import COURSE_SPEED
from automap.effects.navigation import N_NAV, P_ID, PHI_ID, V_ID
from automap.jit import kernel
from automap.records import FloatArray, IntArray

AXIS, POINT, TIME, TURN, SLIP, SCALE, COURSE = 0, 1, 2, 4, 5, 6, 7
SIGNAL_ONE, SIGNAL_ELAPSED, SIGNAL_FORWARD, SIGNAL_LATERAL, SIGNAL_COLUMN = 0, 1, 2, 3, 4

# rows of the room [ROOM, 3] in which a measurement's terms are added up: arm m, turn and slip rad
# in vehicle axes, what is added in the measurement's, factors on its components, s that it is
# late, the turn of which the matrix is; that matrix, sensor to vehicle; axes, a row an angle, in
# vehicle axes about which roll, pitch and yaw turn it further; and room for vectors on the way
ARM, ANGLES, ADDED, SLIDE, LONGER, LATE, MOUNTED = range(7)
MATRIX, AXES, SLOPE, WORK = 7, 10, 13, 16
ROOM = WORK + 8


class Terms(NamedTuple):
    """Terms on one measurement as a kernel takes them: ``codes`` [m, 4] parameter, kind, axis and
    signal (from ``SIGNAL_COLUMN`` on: a column of the node's signals), ``weights`` [m]."""

    codes: IntArray
    weights: FloatArray


class MeasuredTerms(NamedTuple):
    """The terms on all measurements of a model."""

    position: Terms
    velocity: Terms
    vehicle: Terms


@kernel
def new_room() -> FloatArray:
    """Room [ROOM, 3] for the sums of a measurement's terms, made once a run."""
    room = np.zeros((ROOM, 3))
    for a in range(3):
        room[MATRIX + a, a] = room[AXES + a, a] = 1.0
    return room


@kernel
def set_signals(now: FloatArray, t: float, columns: FloatArray) -> None:
    """Signals ``now`` [4 + e] at ``t``, the vehicle's accelerations still zero."""
    now[SIGNAL_ONE], now[SIGNAL_ELAPSED] = 1.0, t
    now[SIGNAL_FORWARD], now[SIGNAL_LATERAL] = 0.0, 0.0
    for i in range(columns.shape[0]):
        now[SIGNAL_COLUMN + i] = columns[i]


@kernel
def antenna_position(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    xi: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    room: FloatArray,
) -> None:
    """Where a fix should lie against the IMU, ``out`` [3] m NED, and rows ``h`` [3, n].

    C W' l + (v + C (omega x W' l)) d + b: the arm l is the vehicle's, C [3, 3] the sensor's
    attitude, W the mounting between the two, d how much later the fix holds the motion, ``vel``
    [3] m/s NED, ``rate`` [3] rad/s in the sensor's axes, b what is added. Groves, Principles of
    GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., section 14.3.
    """
    work, matrix = room[WORK:], room[MATRIX : MATRIX + 3]
    arm, cl, swing, moving = work[0], work[1], work[2], work[3]
    _sum_terms(codes, weights, now, xi, room)
    _back(matrix, room[ARM], arm)
    _times(c, arm, cl)
    _cross(rate, arm, swing)
    _times(c, swing, moving)
    h[:, :] = 0.0
    for a in range(3):
        moving[a] += vel[a]
        out[a] = cl[a] + moving[a] * room[LATE, 0] + room[ADDED, a]
        h[a, P_ID + a] = 1.0
    _attitude_columns(h, cl)
    _point_columns(h, codes, weights, now, room, c)
    _plain_columns(h, codes, weights, now, moving, out)


@kernel
def antenna_velocity(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    room: FloatArray,
) -> None:
    """The velocity that a fix should have, ``out`` [3] m/s NED, and rows ``h`` [3, n].

    S (v + C (omega x W' l)) + (a + C (omega x (omega x W' l))) d + b, with ``acc`` [3] m/s^2 NED
    over ground and S the factors on the components; what changes the course alone also acts with
    the delay of that. That a turn begins or ends within d is left out. Groves, section 14.3.
    """
    work, matrix, g = room[WORK:], room[MATRIX : MATRIX + 3], room[SLOPE : SLOPE + 3]
    arm, swing, cv = work[0], work[1], work[2]
    inward, late, whole, aside = work[3], work[4], work[5], work[6]
    _sum_terms(codes, weights, now, xi, room)
    _back(matrix, room[ARM], arm)
    _cross(rate, arm, swing)
    _times(c, swing, cv)
    _cross(rate, swing, inward)
    _times(c, inward, late)
    h[:, :] = 0.0
    for a in range(3):
        whole[a] = vel[a] + cv[a]
        late[a] += acc[a]
        h[a, V_ID + a] = 1.0
        # C [omega x]
        g[a, 0] = c[a, 1] * rate[2] - c[a, 2] * rate[1]
        g[a, 1] = c[a, 2] * rate[0] - c[a, 0] * rate[2]
        g[a, 2] = c[a, 0] * rate[1] - c[a, 1] * rate[0]
    _attitude_columns(h, cv)
    _point_columns(h, codes, weights, now, room, g)
    _lengthen(h, room[LONGER])
    _across(whole, late, aside)
    for a in range(3):
        changed = late[a] * room[LATE, 0] + aside[a] * room[LATE, 1]
        out[a] = room[LONGER, a] * whole[a] + changed + room[ADDED, a]
    _plain_columns(h, codes, weights, now, late, whole)
    _course_columns(h, codes, weights, now, aside)


@kernel
def vehicle_velocity(
    h: FloatArray,
    out: FloatArray,
    vel: FloatArray,
    c: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    xi: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    room: FloatArray,
) -> None:
    """The velocity of the point that does not slide, ``out`` [3] m/s in vehicle axes, and rows
    ``h`` [3, n].

    S (I + [s x]) y + b with y = W (C' v + omega x W' r): r the arm to the point, W the mounting, s
    the slip, S the factors; forward S y' d more, d how much later it is told, y' = W C' a -
    W (omega x C' v), which leaves out that a turn begins or ends within d. Of ``now`` the
    accelerations along the vehicle's axes are set here.
    Dissanayake et al., IEEE Transactions on Robotics and Automation 17 (2001), 731-747.
    """
    work, w, g = room[WORK:], room[MATRIX : MATRIX + 3], room[SLOPE : SLOPE + 3]
    u, y, along, arm, swing, slipped = work[0], work[1], work[2], work[3], work[4], work[5]
    slope = work[6]
    _sum_terms(codes, weights, now, xi, room)
    _back(c, acc, u)
    _times(w, u, along)
    now[SIGNAL_FORWARD], now[SIGNAL_LATERAL] = along[0], along[1]
    for m in range(codes.shape[0]):
        if codes[m, 3] == SIGNAL_FORWARD or codes[m, 3] == SIGNAL_LATERAL:
            # once more, now that the mounting says what the vehicle's accelerations are
            _sum_terms(codes, weights, now, xi, room)
            break
    _back(w, room[ARM], arm)
    _cross(rate, arm, swing)
    _back(c, vel, u)
    _cross(rate, u, slope)
    gained = along[0] - w[0, 0] * slope[0] - w[0, 1] * slope[1] - w[0, 2] * slope[2]
    for a in range(3):
        u[a] += swing[a]
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
    _point_columns(h, codes, weights, now, room, g)
    _turn_columns(h, codes, weights, now, room[AXES : AXES + 3], y)
    _lengthen(h, room[LONGER])
    _cross(room[SLIDE], y, slipped)
    for a in range(1, 3):
        # a vehicle that slips is still seen by its wheels along its own nose
        y[a] += slipped[a]
    y[0] += gained * room[LATE, 0]
    for a in range(3):
        out[a] = room[LONGER, a] * y[a] + room[ADDED, a]
    slope[0], slope[1], slope[2] = room[LONGER, 0] * gained, 0.0, 0.0
    _plain_columns(h, codes, weights, now, slope, y)


@kernel
def rows_along(
    vel: FloatArray,
    dcm: FloatArray,
    rate: FloatArray,
    acc: FloatArray,
    t: FloatArray,
    columns: FloatArray,
    xi: FloatArray,
    terms: MeasuredTerms,
    out: FloatArray,
) -> None:
    """Parameter columns ``out`` [k, 3, 3, p] of position, velocity and vehicle velocity along a
    motion: ``vel``, ``rate`` (sensor axes), ``acc`` (NED) [k, 3], ``dcm`` [k, 3, 3] body to NED,
    ``t`` [k] s, ``columns`` [k, e] signals."""
    h, z, room = np.zeros((3, N_NAV + xi.shape[0])), np.zeros(3), new_room()
    now = np.zeros(SIGNAL_COLUMN + columns.shape[1])
    on_p, on_v, on_car = terms.position, terms.velocity, terms.vehicle
    for k in range(t.shape[0]):
        set_signals(now, t[k], columns[k])
        v, c, w, a = vel[k], dcm[k], rate[k], acc[k]
        antenna_position(h, z, v, c, w, xi, on_p.codes, on_p.weights, now, room)
        out[k, 0] = h[:, N_NAV:]
        antenna_velocity(h, z, v, c, w, a, xi, on_v.codes, on_v.weights, now, room)
        out[k, 1] = h[:, N_NAV:]
        vehicle_velocity(h, z, v, c, w, a, xi, on_car.codes, on_car.weights, now, room)
        out[k, 2] = h[:, N_NAV:]


@kernel
def _sum_terms(
    codes: IntArray, weights: FloatArray, now: FloatArray, xi: FloatArray, room: FloatArray
) -> None:
    """Add up the terms on one measurement at parameters ``xi`` [p] and signals ``now`` [4 + e]."""
    for a in range(3):
        room[ARM, a] = room[ANGLES, a] = room[ADDED, a] = room[SLIDE, a] = room[LATE, a] = 0.0
        room[LONGER, a] = 1.0
    for m in range(codes.shape[0]):
        kind, a = codes[m, 1], codes[m, 2]
        v = weights[m] * now[codes[m, 3]] * xi[codes[m, 0]]
        if kind == AXIS:
            room[ADDED, a] += v
        elif kind == POINT:
            room[ARM, a] += v
        elif kind == TIME:
            room[LATE, 0] += v
        elif kind == TURN:
            room[ANGLES, a] += v
        elif kind == SLIP:
            room[SLIDE, a] += v
        elif kind == COURSE:
            room[LATE, 1] += v
        else:
            room[LONGER, a] += v
    turn, known = room[ANGLES], room[MOUNTED]
    if turn[0] != known[0] or turn[1] != known[1] or turn[2] != known[2]:
        _mount(turn, room[MATRIX : MATRIX + 3], room[AXES : AXES + 3])
        for a in range(3):
            known[a] = turn[a]


@kernel
def _mount(angles: FloatArray, matrix: FloatArray, axes: FloatArray) -> None:
    """Matrix and axes [3, 3] of roll, pitch, yaw [3] rad, as ``frames.rpy_to_matrix``."""
    cr, sr = math.cos(angles[0]), math.sin(angles[0])
    cp, sp = math.cos(angles[1]), math.sin(angles[1])
    cy, sy = math.cos(angles[2]), math.sin(angles[2])
    matrix[0, 0] = cy * cp
    matrix[0, 1] = cy * sp * sr - sy * cr
    matrix[0, 2] = cy * sp * cr + sy * sr
    matrix[1, 0] = sy * cp
    matrix[1, 1] = sy * sp * sr + cy * cr
    matrix[1, 2] = sy * sp * cr - cy * sr
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = -sp, cp * sr, cp * cr
    axes[0, 0], axes[0, 1], axes[0, 2] = cy * cp, sy * cp, -sp
    axes[1, 0], axes[1, 1], axes[1, 2] = -sy, cy, 0.0
    axes[2, 0], axes[2, 1], axes[2, 2] = 0.0, 0.0, 1.0


@kernel
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _times(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    """``out`` [3] := C a."""
    for i in range(3):
        out[i] = c[i, 0] * a[0] + c[i, 1] * a[1] + c[i, 2] * a[2]


@kernel
def _back(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    """``out`` [3] := C' a."""
    for i in range(3):
        out[i] = c[0, i] * a[0] + c[1, i] * a[1] + c[2, i] * a[2]


@kernel
def _lengthen(h: FloatArray, longer: FloatArray) -> None:
    for a in range(3):
        if longer[a] != 1.0:
            for j in range(h.shape[1]):
                h[a, j] *= longer[a]


@kernel
def _across(whole: FloatArray, late: FloatArray, out: FloatArray) -> None:
    """``out`` [3]: the part of the change ``late`` [3] that turns the horizontal velocity."""
    squared = whole[0] * whole[0] + whole[1] * whole[1]
    share = 0.0
    if squared > 0.0:
        share = (whole[0] * late[0] + whole[1] * late[1]) / squared
    # at a crawl a course is anything, and no delay tells how it turns
    seen = min(squared / COURSE_SPEED**2, 1.0)
    out[0] = (late[0] - share * whole[0]) * seen
    out[1] = (late[1] - share * whole[1]) * seen
    out[2] = 0.0


@kernel
def _course_columns(
    h: FloatArray, codes: IntArray, weights: FloatArray, now: FloatArray, aside: FloatArray
) -> None:
    for m in range(codes.shape[0]):
        if codes[m, 1] == COURSE:
            w = weights[m] * now[codes[m, 3]]
            for i in range(2):
                h[i, N_NAV + codes[m, 0]] += w * aside[i]


@kernel
def _attitude_columns(h: FloatArray, u: FloatArray) -> None:
    """h[0:3, phi] := -[u x], for a vector u = C b of the body."""
    h[0, PHI_ID + 1], h[0, PHI_ID + 2] = u[2], -u[1]
    h[1, PHI_ID], h[1, PHI_ID + 2] = -u[2], u[0]
    h[2, PHI_ID], h[2, PHI_ID + 1] = u[1], -u[0]


@kernel
def _point_columns(
    h: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    room: FloatArray,
    g: FloatArray,
) -> None:
    """Columns of what moves the measured point, and of the mounting that turns its arm, where
    ``g`` [3, 3] is the derivative by the arm along the sensor's axes."""
    seen, moved = room[WORK + 6], room[WORK + 7]
    swings = room[ARM, 0] != 0.0 or room[ARM, 1] != 0.0 or room[ARM, 2] != 0.0
    for m in range(codes.shape[0]):
        kind, a, j = codes[m, 1], codes[m, 2], N_NAV + codes[m, 0]
        if kind == POINT:
            for i in range(3):
                moved[i] = room[MATRIX + a, i]
        elif kind == TURN and swings:
            # the arm is on the vehicle, not on the sensor: d(W' l) = W' (l x axis)
            _cross(room[ARM], room[AXES + a], seen)
            _back(room[MATRIX : MATRIX + 3], seen, moved)
        else:
            continue
        w = weights[m] * now[codes[m, 3]]
        for i in range(3):
            h[i, j] += w * (g[i, 0] * moved[0] + g[i, 1] * moved[1] + g[i, 2] * moved[2])


@kernel
def _turn_columns(
    h: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    axes: FloatArray,
    y: FloatArray,
) -> None:
    """Columns of the vehicle's velocity ``y`` [3] by the mounting, which turns about ``axes``
    [3, 3], a row an angle, and by slip, which turns about the vehicle's own."""
    for m in range(codes.shape[0]):
        kind = codes[m, 1]
        if kind != TURN and kind != SLIP:
            continue
        a, j = codes[m, 2], N_NAV + codes[m, 0]
        w = weights[m] * now[codes[m, 3]]
        if kind == SLIP:
            b, d = (a + 1) % 3, (a + 2) % 3
            if b > 0:
                h[b, j] -= w * y[d]
            if d > 0:
                h[d, j] += w * y[b]
        else:
            h[0, j] += w * (axes[a, 1] * y[2] - axes[a, 2] * y[1])
            h[1, j] += w * (axes[a, 2] * y[0] - axes[a, 0] * y[2])
            h[2, j] += w * (axes[a, 0] * y[1] - axes[a, 1] * y[0])


@kernel
def _plain_columns(
    h: FloatArray,
    codes: IntArray,
    weights: FloatArray,
    now: FloatArray,
    slope: FloatArray,
    whole: FloatArray,
) -> None:
    """Columns of what is added, of delays (``slope`` [3] per second) and of factors on the
    components of ``whole`` [3]."""
    for m in range(codes.shape[0]):
        kind, a, j = codes[m, 1], codes[m, 2], N_NAV + codes[m, 0]
        w = weights[m] * now[codes[m, 3]]
        if kind == AXIS:
            h[a, j] += w
        elif kind == TIME:
            for i in range(3):
                h[i, j] += w * slope[i]
        elif kind == SCALE:
            h[a, j] += w * whole[a]
