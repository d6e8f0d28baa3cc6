"""What the rows of a measurement hold: for the attitude, and for each kind of term.

Every function adds to rows ``h`` [3, n] of the error state: navigation errors, then parameters.
"""

from __future__ import annotations

from automap.effects.navigation import N_NAV, PHI_ID
from automap.effects.term_sums import (
    ARM,
    AXES,
    AXIS,
    COURSE,
    MATRIX,
    POINT,
    SCALE,
    SLIP,
    TIME,
    TURN,
    WORK,
    back,
    cross,
)
from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def attitude_columns(h: FloatArray, u: FloatArray) -> None:
    """h[0:3, phi] := -[u x], for a vector u = C b of the body."""
    h[0, PHI_ID + 1], h[0, PHI_ID + 2] = u[2], -u[1]
    h[1, PHI_ID], h[1, PHI_ID + 2] = -u[2], u[0]
    h[2, PHI_ID], h[2, PHI_ID + 1] = u[1], -u[0]


@kernel
def point_columns(
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
            cross(room[ARM], room[AXES + a], seen)
            back(room[MATRIX : MATRIX + 3], seen, moved)
        else:
            continue
        w = weights[m] * now[codes[m, 3]]
        for i in range(3):
            h[i, j] += w * (g[i, 0] * moved[0] + g[i, 1] * moved[1] + g[i, 2] * moved[2])


@kernel
def turn_columns(
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
def plain_columns(
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


@kernel
def course_columns(
    h: FloatArray, codes: IntArray, weights: FloatArray, now: FloatArray, aside: FloatArray
) -> None:
    for m in range(codes.shape[0]):
        if codes[m, 1] == COURSE:
            w = weights[m] * now[codes[m, 3]]
            for i in range(2):
                h[i, N_NAV + codes[m, 0]] += w * aside[i]


@kernel
def lengthen(h: FloatArray, longer: FloatArray) -> None:
    for a in range(3):
        if longer[a] != 1.0:
            for j in range(h.shape[1]):
                h[a, j] *= longer[a]
