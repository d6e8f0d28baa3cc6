"""Pixels to directions and back, for a pinhole camera with OpenCV distortion.

Directions are in camera axes forward, right, down and scaled to forward = 1: the pair
(right / forward, down / forward) of a pixel is what OpenCV calls normalised coordinates.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from automap.records import Camera, FloatArray

_AGREEMENT_PX = 0.01
_MAX_ITERATIONS = 30
_STEP = 1e-6


def normalise(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Normalised coordinates [n, 2] (right, down) of pixels [n, 2].

    NaN where the distortion model has no inverse, which happens outside the part of the
    image that it was fitted to.
    """
    points = np.ascontiguousarray(pixels, np.float64).reshape(-1, 2)
    if len(points) == 0:
        return points.copy()
    if not np.any(camera.distortion):
        return _pinhole_inverse(camera, points)
    return _newton_inverse(camera, points)


def _newton_inverse(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Invert the distortion by Newton's method from the undistorted start.

    OpenCV's own inverse is a fixed-point iteration that does not converge at the edge of a
    wide lens. A root where the model folds over (Jacobian not positive) is no solution.
    """
    rays = _pinhole_inverse(camera, pixels)
    scale = camera.matrix[0, 0] * camera.matrix[1, 1]
    determinant = np.ones(len(rays))
    for _ in range(_MAX_ITERATIONS):
        missing = pixels - _distorted(camera, rays)
        columns = []
        for axis in range(2):
            step = np.zeros(2)
            step[axis] = _STEP
            difference = _distorted(camera, rays + step) - _distorted(camera, rays - step)
            columns.append(difference / (2.0 * _STEP))
        (a, c), (b, d) = columns[0].T, columns[1].T
        determinant = a * d - b * c
        with np.errstate(all="ignore"):
            change = np.column_stack(
                [d * missing[:, 0] - b * missing[:, 1], a * missing[:, 1] - c * missing[:, 0]]
            )
            change /= determinant[:, None]
        change = np.clip(np.nan_to_num(change), -0.5, 0.5)
        rays = rays + change
        if np.abs(change).max() < 1e-12:
            break
    error = np.linalg.norm(_distorted(camera, rays) - pixels, axis=1)
    rays[~((error < _AGREEMENT_PX) & (determinant > 1e-3 * scale))] = np.nan
    return rays


def _distorted(camera: Camera, normalised: FloatArray) -> FloatArray:
    """Pixels [n, 2] of normalised coordinates [n, 2]."""
    import cv2

    points = np.column_stack([normalised, np.ones(len(normalised))])
    zero = np.zeros(3)
    pixels, _ = cv2.projectPoints(points[:, None], zero, zero, camera.matrix, camera.distortion)
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def _pinhole_inverse(camera: Camera, points: FloatArray) -> FloatArray:
    k = camera.matrix
    down = (points[:, 1] - k[1, 2]) / k[1, 1]
    right = (points[:, 0] - k[0, 2] - k[0, 1] * down) / k[0, 0]
    return np.column_stack([right, down])


def project(camera: Camera, directions: FloatArray) -> FloatArray:
    """Pixels [n, 2] of directions [n, 3] (forward, right, down); NaN behind the camera."""
    directions = np.ascontiguousarray(directions, np.float64).reshape(-1, 3)
    if len(directions) == 0:
        return np.zeros((0, 2))
    forward = np.where(directions[:, 0] > 0.0, directions[:, 0], np.nan)
    normalised = directions[:, 1:] / forward[:, None]
    if np.any(camera.distortion):
        return _distorted(camera, normalised)
    k = camera.matrix
    return np.column_stack(
        [
            k[0, 0] * normalised[:, 0] + k[0, 1] * normalised[:, 1] + k[0, 2],
            k[1, 1] * normalised[:, 1] + k[1, 2],
        ]
    )


def focal_length(camera: Camera) -> float:
    """Mean focal length in pixels."""
    return float(0.5 * (camera.matrix[0, 0] + camera.matrix[1, 1]))


def touches_edge(camera: Camera, box: FloatArray, margin: float = 1.5) -> npt.NDArray[np.bool_]:
    """Whether boxes [n, 4] reach the edge of the image, so that a part of the sign is cut off."""
    last_x, last_y = camera.width - 1, camera.height - 1
    return np.asarray(
        (box[:, 0] <= margin)
        | (box[:, 1] <= margin)
        | (box[:, 2] >= last_x - margin)
        | (box[:, 3] >= last_y - margin)
    )
