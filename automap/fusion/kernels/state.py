"""Nominal states and small errors: load, subtract, inject."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.layout import N_NAV, PHI_ID, V_ID
from automap.fusion.mechanisation import quat_to_dcm, radii, rotate_left
from automap.jit import kernel
from automap.records import FloatArray


@kernel
def load_state(
    row: FloatArray,
    row_params: FloatArray,
    pos: FloatArray,
    vel: FloatArray,
    q: FloatArray,
    c: FloatArray,
    xi: FloatArray,
) -> None:
    """Set the nominal state from a stored row [10] and its parameters."""
    for a in range(3):
        pos[a] = row[a]
        vel[a] = row[3 + a]
    for a in range(4):
        q[a] = row[6 + a]
    quat_to_dcm(q, c)
    for j in range(xi.shape[0]):
        xi[j] = row_params[j]


@kernel
def subtract(
    pos: FloatArray, vel: FloatArray, q: FloatArray, row: FloatArray, out: FloatArray
) -> None:
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


@kernel
def inject(
    pos: FloatArray,
    vel: FloatArray,
    q: FloatArray,
    c: FloatArray,
    xi: FloatArray,
    dx: FloatArray,
) -> None:
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


@kernel
def apply_correction(nominal: FloatArray, params: FloatArray, dx: FloatArray) -> None:
    """Add errors [k, n] to states [k, 10] and parameters [k, n - 9] in place."""
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
