"""Pixels to directions and back, for a pinhole camera with OpenCV's distortion.

Directions are in camera axes forward, right, down and scaled to forward = 1: the pair
(right / forward, down / forward) of a pixel is what OpenCV calls normalised coordinates.
"""

from __future__ import annotations

import numpy as np

from automap.records import BoolArray, Camera, FloatArray

_AGREEMENT_PX = 0.01
"""A pixel's direction leads back to it so nearly, or the lens has no inverse there."""
EDGE_PX = 1.5
"""A box so near to the edge of the picture is of a sign cut off: boxes err by a pixel, and the last
one ends half of one further out."""
_CUT_SD_FACTOR = 6.0


def project(camera: Camera, directions: FloatArray) -> FloatArray:
    """Pixels [n, 2] of directions [n, 3] (forward, right, down); NaN behind the camera.

    Hartley and Zisserman, Multiple View Geometry, 2nd ed., sections 6.1 and 7.4.
    """
    directions = np.asarray(directions, np.float64).reshape(-1, 3)
    forward = np.where(directions[:, 0] > 0.0, directions[:, 0], np.nan)
    flat = directions[:, 1:] / forward[:, None]
    if np.any(camera.distortion):
        from automap.effects.camera_kernels import distort

        flat = distort(lens_of(camera), flat)
    k = camera.matrix
    return np.column_stack(
        [
            k[0, 0] * flat[:, 0] + k[0, 1] * flat[:, 1] + k[0, 2],
            k[1, 1] * flat[:, 1] + k[1, 2],
        ]
    )


def normalise(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Normalised coordinates [n, 2] (right, down) of pixels [n, 2].

    NaN where the distortion model has no inverse, which happens outside the part of the
    image that it was fitted to.
    """
    points = np.asarray(pixels, np.float64).reshape(-1, 2)
    k = camera.matrix
    down = (points[:, 1] - k[1, 2]) / k[1, 1]
    right = (points[:, 0] - k[0, 2] - k[0, 1] * down) / k[0, 0]
    flat = np.column_stack([right, down])
    if not np.any(camera.distortion):
        return flat
    from automap.effects.camera_kernels import undistort

    return np.asarray(undistort(lens_of(camera), flat, _AGREEMENT_PX / focal_length(camera)))


def lens_of(camera: Camera) -> FloatArray:
    """The camera's distortion as an array [21] for ``camera_kernels``.

    The last nine are the matrix of the tilted sensor (Louhichi et al., Measurement Science and
    Technology 18, 2007), the unit matrix without a tilt.
    """
    given = np.zeros(14)
    given[: len(camera.distortion)] = camera.distortion
    (cx, cy), (sx, sy) = np.cos(given[12:]), np.sin(given[12:])
    turn = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]]
    )
    onto = np.array(
        [[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]]
    )
    return np.concatenate([given[:12], (onto @ turn).ravel()])


def focal_length(camera: Camera) -> float:
    """Mean focal length in pixels."""
    return float(0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]))


def cut_off(box: FloatArray, size: FloatArray) -> BoolArray:
    """Whether boxes [n, 4] reach the edge of pictures of width and height ``size`` [n, 2] or [2],
    so that a part of the sign is cut off."""
    last = size - 1.0 - EDGE_PX
    return np.asarray(((box[:, :2] <= EDGE_PX) | (box[:, 2:] >= last)).any(axis=1))


def touches_edge(camera: Camera, box: FloatArray) -> BoolArray:
    """Whether boxes [n, 4] of a camera are ``cut_off``."""
    return cut_off(box, np.array([camera.width, camera.height], np.float64))


def box_variances(
    camera: Camera,
    box: FloatArray,
    height: FloatArray,
    pixel_sd: float,
    fraction: float,
    attitude_sd: float = 0.0,
) -> FloatArray:
    """Variances [n, 3] of direction right and down and of the log height of boxes [n, 4] of
    normalised ``height`` [n].

    ``pixel_sd`` px of a box's centre, ``fraction`` of its height that centre and height err by,
    ``attitude_sd`` rad of the camera. A box that the edge of the image cuts shows neither the
    sign's centre nor its size.
    """
    pixel = pixel_sd / focal_length(camera)
    cut = np.where(touches_edge(camera, box), _CUT_SD_FACTOR**2, 1.0)
    direction = pixel**2 + (fraction * height) ** 2 + attitude_sd**2
    size = 2.0 * (pixel / height) ** 2 + fraction**2
    return np.column_stack([direction, direction, size]) * cut[:, None]
