"""The terms on one measurement as kernels take them, and their sums at a state.

Sums stand in a room that is made once a run, for nothing is allocated on the way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

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
def sum_terms(
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
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def times(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    """``out`` [3] := C a."""
    for i in range(3):
        out[i] = c[i, 0] * a[0] + c[i, 1] * a[1] + c[i, 2] * a[2]


@kernel
def back(c: FloatArray, a: FloatArray, out: FloatArray) -> None:
    """``out`` [3] := C' a."""
    for i in range(3):
        out[i] = c[0, i] * a[0] + c[1, i] * a[1] + c[2, i] * a[2]
