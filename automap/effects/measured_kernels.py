"""What fixes and the vehicle's motion should read in a state, and how that depends on the state.

One prediction with its rows for the position and velocity of the antenna and for the velocity of
the point that does not slide. Parameters act by the terms of their effects (``effects.terms``),
which arrive as a table; no effect is known by name. Rows are those of the error state: navigation
errors, then parameters.
"""

from __future__ import annotations

import numpy as np

from automap.effects.limits import COURSE_SPEED
from automap.effects.navigation import N_NAV, P_ID, PHI_ID, V_ID
from automap.effects.term_columns import (
    attitude_columns,
    course_columns,
    lengthen,
    plain_columns,
    point_columns,
    turn_columns,
)
from automap.effects.term_sums import (
    ADDED,
    ARM,
    AXES,
    LATE,
    LONGER,
    MATRIX,
    SIGNAL_COLUMN,
    SIGNAL_FORWARD,
    SIGNAL_LATERAL,
    SLIDE,
    SLOPE,
    WORK,
    MeasuredTerms,
    back,
    cross,
    new_room,
    set_signals,
    sum_terms,
    times,
)
from automap.jit import kernel
from automap.records import FloatArray, IntArray


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
    sum_terms(codes, weights, now, xi, room)
    back(matrix, room[ARM], arm)
    times(c, arm, cl)
    cross(rate, arm, swing)
    times(c, swing, moving)
    h[:, :] = 0.0
    for a in range(3):
        moving[a] += vel[a]
        out[a] = cl[a] + moving[a] * room[LATE, 0] + room[ADDED, a]
        h[a, P_ID + a] = 1.0
    attitude_columns(h, cl)
    point_columns(h, codes, weights, now, room, c)
    plain_columns(h, codes, weights, now, moving, out)


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
    sum_terms(codes, weights, now, xi, room)
    back(matrix, room[ARM], arm)
    cross(rate, arm, swing)
    times(c, swing, cv)
    cross(rate, swing, inward)
    times(c, inward, late)
    h[:, :] = 0.0
    for a in range(3):
        whole[a] = vel[a] + cv[a]
        late[a] += acc[a]
        h[a, V_ID + a] = 1.0
        # C [omega x]
        g[a, 0] = c[a, 1] * rate[2] - c[a, 2] * rate[1]
        g[a, 1] = c[a, 2] * rate[0] - c[a, 0] * rate[2]
        g[a, 2] = c[a, 0] * rate[1] - c[a, 1] * rate[0]
    attitude_columns(h, cv)
    point_columns(h, codes, weights, now, room, g)
    lengthen(h, room[LONGER])
    _across(whole, late, aside)
    for a in range(3):
        changed = late[a] * room[LATE, 0] + aside[a] * room[LATE, 1]
        out[a] = room[LONGER, a] * whole[a] + changed + room[ADDED, a]
    plain_columns(h, codes, weights, now, late, whole)
    course_columns(h, codes, weights, now, aside)


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
    sum_terms(codes, weights, now, xi, room)
    back(c, acc, u)
    times(w, u, along)
    now[SIGNAL_FORWARD], now[SIGNAL_LATERAL] = along[0], along[1]
    for m in range(codes.shape[0]):
        if codes[m, 3] == SIGNAL_FORWARD or codes[m, 3] == SIGNAL_LATERAL:
            # once more, now that the mounting says what the vehicle's accelerations are
            sum_terms(codes, weights, now, xi, room)
            break
    back(w, room[ARM], arm)
    cross(rate, arm, swing)
    back(c, vel, u)
    cross(rate, u, slope)
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
    point_columns(h, codes, weights, now, room, g)
    turn_columns(h, codes, weights, now, room[AXES : AXES + 3], y)
    lengthen(h, room[LONGER])
    cross(room[SLIDE], y, slipped)
    for a in range(1, 3):
        # a vehicle that slips is still seen by its wheels along its own nose
        y[a] += slipped[a]
    y[0] += gained * room[LATE, 0]
    for a in range(3):
        out[a] = room[LONGER, a] * y[a] + room[ADDED, a]
    slope[0], slope[1], slope[2] = room[LONGER, 0] * gained, 0.0, 0.0
    plain_columns(h, codes, weights, now, slope, y)


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
def course_changes(vel: FloatArray, acc: FloatArray, out: FloatArray) -> None:
    """``out`` [k, 3]: what of accelerations ``acc`` [k, 3] turns velocities ``vel`` [k, 3], m/s^2
    NED, as the rows of a late course have it."""
    for k in range(vel.shape[0]):
        _across(vel[k], acc[k], out[k])


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
