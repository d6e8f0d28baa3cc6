"""Loops of the camera model: lens, direction of a point, and what each error does to it.

A lens is an array [21]: OpenCV's twelve coefficients k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, then
the matrix of its tilted sensor row by row. Coordinates are normalised: right / forward and
down / forward, focal length one.
"""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray

TURN, TIME, SHUTTER, FOCAL, LENS, LEVER_ARM = 0, 3, 4, 5, 6, 8
"""Places of the first parameter of each effect among the columns."""
N_COLUMNS = 11
"""Turn (roll, pitch, yaw in camera axes), time, shutter, focal length, k1, k2, lever arm."""

_ROUNDS, _LONGEST_STEP, _SETTLED = 30, 0.5, 1e-12
"""Newton's steps at most, the longest, which keeps it from jumping over a fold, and the one that
is rounding."""
_FOLDED = 1e-3
"""Share of the undistorted area below which the lens model counts as folding over."""


@kernel
def bend(lens, y, z, out):  # type: ignore[no-untyped-def]
    """Distort (y, z): ``out`` [2, 5] has the point in its first column, then its derivatives by
    y, z, k1 and k2 (OpenCV's model: documentation of its module calib3d)."""
    r2 = y * y + z * z
    r4 = r2 * r2
    r6 = r4 * r2
    top = 1.0 + lens[0] * r2 + lens[1] * r4 + lens[4] * r6
    below = 1.0 / (1.0 + lens[5] * r2 + lens[6] * r4 + lens[7] * r6)
    radial = top * below
    # derivative of the radial factor by r^2
    slope = (lens[0] + 2.0 * lens[1] * r2 + 3.0 * lens[4] * r4) * below
    slope -= radial * below * (lens[5] + 2.0 * lens[6] * r2 + 3.0 * lens[7] * r4)
    p1, p2 = lens[2], lens[3]
    side, down = lens[8] + 2.0 * lens[9] * r2, lens[10] + 2.0 * lens[11] * r2
    both = 2.0 * y * z
    out[0, 0] = y * radial + p1 * both + p2 * (r2 + 2.0 * y * y) + lens[8] * r2 + lens[9] * r4
    out[1, 0] = z * radial + p1 * (r2 + 2.0 * z * z) + p2 * both + lens[10] * r2 + lens[11] * r4
    out[0, 1] = radial + 2.0 * y * y * slope + 2.0 * p1 * z + 6.0 * p2 * y + 2.0 * y * side
    out[0, 2] = both * slope + 2.0 * p1 * y + 2.0 * p2 * z + 2.0 * z * side
    out[1, 1] = both * slope + 2.0 * p1 * y + 2.0 * p2 * z + 2.0 * y * down
    out[1, 2] = radial + 2.0 * z * z * slope + 6.0 * p1 * z + 2.0 * p2 * y + 2.0 * z * down
    out[0, 3], out[1, 3] = y * r2 * below, z * r2 * below
    out[0, 4], out[1, 4] = y * r4 * below, z * r4 * below
    a, b = out[0, 0], out[1, 0]
    inverse = 1.0 / (lens[18] * a + lens[19] * b + lens[20])
    out[0, 0] = (lens[12] * a + lens[13] * b + lens[14]) * inverse
    out[1, 0] = (lens[15] * a + lens[16] * b + lens[17]) * inverse
    for k in range(1, 5):
        a, b = out[0, k], out[1, k]
        along = lens[18] * a + lens[19] * b
        out[0, k] = (lens[12] * a + lens[13] * b - out[0, 0] * along) * inverse
        out[1, k] = (lens[15] * a + lens[16] * b - out[1, 0] * along) * inverse


@kernel
def distort(lens: FloatArray, points: FloatArray) -> FloatArray:
    """Distorted coordinates [n, 2] of undistorted ones [n, 2]."""
    out = np.empty((len(points), 2))
    bent = np.zeros((2, 5))
    for i in range(len(points)):
        bend(lens, points[i, 0], points[i, 1], bent)
        out[i, 0], out[i, 1] = bent[0, 0], bent[1, 0]
    return out


@kernel
def undistort(lens: FloatArray, points: FloatArray, agreement: float) -> FloatArray:
    """Undistorted coordinates [n, 2] by Newton's method from the distorted ones [n, 2].

    OpenCV's own inverse is a fixed-point iteration that does not converge at the edge of a wide
    lens. NaN where no point is met to ``agreement``, or where the model folds over there.
    """
    out = points.copy()
    bent = np.zeros((2, 5))
    for i in range(len(points)):
        determinant = 1.0
        for _ in range(_ROUNDS):
            bend(lens, out[i, 0], out[i, 1], bent)
            miss_y, miss_z = points[i, 0] - bent[0, 0], points[i, 1] - bent[1, 0]
            determinant = bent[0, 1] * bent[1, 2] - bent[0, 2] * bent[1, 1]
            if determinant == 0.0 or not np.isfinite(determinant):
                break
            step_y = (bent[1, 2] * miss_y - bent[0, 2] * miss_z) / determinant
            step_z = (bent[0, 1] * miss_z - bent[1, 1] * miss_y) / determinant
            step_y = min(max(step_y, -_LONGEST_STEP), _LONGEST_STEP)
            step_z = min(max(step_z, -_LONGEST_STEP), _LONGEST_STEP)
            out[i, 0] += step_y
            out[i, 1] += step_z
            if max(abs(step_y), abs(step_z)) < _SETTLED:
                break
        bend(lens, out[i, 0], out[i, 1], bent)
        error = np.hypot(points[i, 0] - bent[0, 0], points[i, 1] - bent[1, 0])
        if not (error < agreement and determinant > _FOLDED):
            out[i, 0] = out[i, 1] = np.nan
    return out


@kernel
def by_point(h, q, d, out, m):  # type: ignore[no-untyped-def]
    """Column ``m`` of ``out`` [3, ...]: what a move ``d`` [3] of the point q [3] in camera axes
    does to its direction h [2] and to the logarithm of its size in the picture."""
    inverse = 1.0 / q[0]
    out[0, m] = (d[1] - h[0] * d[0]) * inverse
    out[1, m] = (d[2] - h[1] * d[0]) * inverse
    out[2, m] = -d[0] * inverse


@kernel
def effect_columns(h, q, height, share, rate, velocity, C_cam_body, lens, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` [3, 11]: derivative of direction h [2] and log height of a thing at q [3] in
    camera axes, as the stated lens undistorts them, by the errors of the camera.

    ``height`` of the thing in normalised coordinates, ``share`` of the image height at which its
    row is read, ``rate`` (rad/s) and ``velocity`` (m/s) [3] of the camera in its axes,
    ``C_cam_body`` [3, 3].
    """
    d = np.zeros(3)
    for k in range(3):
        # a camera turned about an axis sees everything turned the other way: q x axis
        d[:] = 0.0
        d[(k + 1) % 3] = q[(k + 2) % 3]
        d[(k + 2) % 3] = -q[(k + 1) % 3]
        by_point(h, q, d, out, TURN + k)
    for k in range(3):
        # a camera further along an axis of the vehicle sees everything nearer by as much
        for i in range(3):
            d[i] = -C_cam_body[i, k]
        by_point(h, q, d, out, LEVER_ARM + k)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        d[k] = -(rate[i] * q[j] - rate[j] * q[i]) - velocity[k]
    by_point(h, q, d, out, TIME)
    for i in range(3):
        out[i, SHUTTER] = out[i, TIME] * share
    _lens_columns(h, height, lens, out)


@kernel
def _lens_columns(h, height, lens, out):  # type: ignore[no-untyped-def]
    """The columns of focal length, k1 and k2: what they move in the distorted picture, taken back
    to undistorted coordinates; of the height, the difference between its ends."""
    bent = np.zeros((2, 5))
    for part in range(3):
        z = h[1] if part == 0 else h[1] + (part - 1.5) * height
        bend(lens, h[0], z, bent)
        determinant = bent[0, 1] * bent[1, 2] - bent[0, 2] * bent[1, 1]
        for k in range(3):
            a, b = (bent[0, 0], bent[1, 0]) if k == 0 else (bent[0, 2 + k], bent[1, 2 + k])
            down = (bent[0, 1] * b - bent[1, 1] * a) / determinant
            if part == 0:
                out[0, FOCAL + k] = (bent[1, 2] * a - bent[0, 2] * b) / determinant
                out[1, FOCAL + k] = down
            elif part == 1:
                out[2, FOCAL + k] = -down / height
            else:
                out[2, FOCAL + k] += down / height


@kernel
def all_columns(
    q: FloatArray,
    height: FloatArray,
    share: FloatArray,
    rate: FloatArray,
    velocity: FloatArray,
    C_cam_body: FloatArray,
    lens: FloatArray,
) -> FloatArray:
    """``effect_columns`` [n, 3, 11] of things at q [n, 3] that one camera sees."""
    out = np.empty((len(q), 3, N_COLUMNS))
    h = np.zeros(2)
    for i in range(len(q)):
        h[0], h[1] = q[i, 1] / q[i, 0], q[i, 2] / q[i, 0]
        effect_columns(h, q[i], height[i], share[i], rate[i], velocity[i], C_cam_body, lens, out[i])
    return out
