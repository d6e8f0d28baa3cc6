"""How a camera moved between two frames: by its path, or by what the pictures show.

Without a trajectory the rotation comes from the flow of the background: whatever the
distances, a camera that goes straight ahead moves every point along the line through the
point it heads for, so that the part of the flow across that line is rotation alone. The
distance is then a guess, but for a standstill.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from automap.effects.camera import direction_by_turn
from automap.effects.lens import focal_length, normalise
from automap.gates import sd_by_median
from automap.records import Camera, FloatArray, Image
from automap.robust import cauchy_weight
from automap.vision import limits
from automap.vision.camera_path import CameraPath

_WIDTH = 320
"""Of the reduced picture, px."""
_WINDOW = (11, 11)
_LEVELS = 3
"""Of the pyramid: flow of half the window times 2^3."""


@dataclass(frozen=True)
class Motion:
    """From an earlier frame to a later one.

    ``C_new_old`` [3, 3] earlier to later camera axes (forward, right, down); ``moved`` [3] m
    travelled, in the earlier axes; ``turn_sd`` rad and ``moved_sd`` [3] m one sigma.
    ``scale_log_sd`` is that of a factor on all distances, which stays much the same from frame
    to frame: where the speed is a guess, so is every depth.
    """

    C_new_old: FloatArray
    moved: FloatArray
    turn_sd: float
    moved_sd: FloatArray
    scale_log_sd: float = 0.0

    @property
    def size(self) -> float:
        """How much changes, in metres; a degree of turn counts as one metre."""
        angle = np.arccos(np.clip(0.5 * (np.trace(self.C_new_old) - 1.0), -1.0, 1.0))
        return float(np.hypot(np.linalg.norm(self.moved), np.degrees(angle)))


def motion_on_path(path: CameraPath, old: int, new: int, seconds: float) -> Motion | None:
    """Between two rows of the path; None where either is unknown."""
    if not (path.known[old] and path.known[new]):
        return None
    C_new_old = path.C_cam_ref[new] @ path.C_cam_ref[old].T
    moved = path.C_cam_ref[old] @ (path.centre[new] - path.centre[old])
    distance = float(np.linalg.norm(moved))
    # attitude is good from frame to frame; mounting and time offset tilt the way ahead
    moved_sd = np.full(3, limits.PATH_STEP_SD_M + limits.PATH_STEP_SHARE * distance)
    turn_sd = limits.PATH_TURN_SD + limits.PATH_TURN_RATE_SD * min(seconds, limits.PATH_TURN_S)
    return Motion(C_new_old, moved, turn_sd, moved_sd)


def guessed_motion(seconds: float) -> Motion:
    """Nothing is known: town speed straight ahead, and any turn that a car can make."""
    ahead = limits.TOWN_SPEED * seconds
    sd = np.array(limits.SPEED_SHARES) * ahead + limits.MOVE_SD_M
    turn_sd = limits.TURN_RATE_SD * seconds
    return Motion(np.eye(3), np.array([ahead, 0.0, 0.0]), turn_sd, sd, limits.SPEED_LOG_SD)


class ImageMotion:
    """Motion from picture to picture by sparse optical flow; ``ahead`` [2] is where the way ahead
    lies, normalised coordinates (right, down)."""

    def __init__(self, camera: Camera, ahead: FloatArray | None = None) -> None:
        self._camera = camera
        self._ahead = np.zeros(2) if ahead is None else ahead
        self._before: Image | None = None

    def forget(self) -> None:
        """The motion since the last picture is known otherwise; start with the next one."""
        self._before = None

    def step(self, image: Image, seconds: float, wanted: bool = True) -> Motion:
        """Motion since the picture before; when it is not ``wanted`` only a guess."""
        small = _reduced(image)
        scale = small.shape[1] / image.shape[1]
        before, self._before = self._before, small
        guess = guessed_motion(seconds)
        if before is None or not wanted or before.shape != small.shape:
            return guess
        old, new = _flow(before, self._before)
        if len(old) < limits.FEWEST_POINTS:
            return guess
        if float(np.median(np.linalg.norm(new - old, axis=1))) < limits.STILL_PX:
            still_sd = np.full(3, limits.STILL_MOVE_SD_M)
            return Motion(
                np.eye(3), np.zeros(3), limits.STILL_TURN_SD, still_sd, limits.SPEED_LOG_SD
            )
        before_ray, now_ray = (normalise(self._camera, points / scale) for points in (old, new))
        focal = focal_length(self._camera) * scale
        turn, sd = _turn_from_flow(before_ray, now_ray, focal, self._ahead)
        if turn is None:
            return guess
        from automap.frames import rotation_vector_to_matrix

        C_new_old = rotation_vector_to_matrix(turn).T
        return replace(guess, C_new_old=C_new_old, turn_sd=sd)


def _reduced(image: Image) -> Image:
    """A grey picture about 320 px wide, halved again and again."""
    while image.shape[1] >= 1.5 * _WIDTH:
        half = (image.shape[1] // 2, image.shape[0] // 2)
        # at exactly half the size this is the mean of four pixels
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_LINEAR), np.uint8)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def _flow(before: Image, now: Image) -> tuple[FloatArray, FloatArray]:
    """Points [k, 2] of the picture before and where they are now."""
    height = before.shape[0]
    # the bonnet moves along, and so do its reflections
    mask = np.zeros(before.shape, np.uint8)
    mask[: int(limits.FLOW_HEIGHT * height)] = 255
    points: Any = cv2.goodFeaturesToTrack(before, limits.FLOW_POINTS, 0.01, 8, mask=mask)
    if points is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    follow: Any = cv2.calcOpticalFlowPyrLK
    moved, found, _ = follow(before, now, points, None, winSize=_WINDOW, maxLevel=_LEVELS)
    back, found_back, _ = follow(now, before, moved, None, winSize=_WINDOW, maxLevel=_LEVELS)
    there = (found[:, 0] > 0) & (found_back[:, 0] > 0)
    there &= np.linalg.norm(back - points, axis=2)[:, 0] < limits.FLOW_WORST_PX
    old, new = points[there, 0], moved[there, 0]
    return np.asarray(old, np.float64), np.asarray(new, np.float64)


def _turn_from_flow(
    old: FloatArray, new: FloatArray, focal: float, ahead: FloatArray
) -> tuple[FloatArray | None, float]:
    """Turn of the camera (rotation vector [3], rad, in its axes) and its one sigma.

    ``old``, ``new`` [k, 2] normalised coordinates (right, down). What a turn moves across the
    radius from the way ``ahead`` [2] is fitted by reweighted least squares.
    """
    a, b = 0.5 * (old + new).T
    right, down = a - ahead[0], b - ahead[1]
    radius = np.hypot(right, down)
    # nothing is known of what lies outside the lens model
    use = (radius > limits.LEAST_RADIUS) & np.isfinite(new).all(axis=1)
    if use.sum() < limits.FEWEST_POINTS:
        return None, 0.0
    a, b, radius = a[use], b[use], radius[use]
    across = np.column_stack([-down[use], right[use]]) / radius[:, None]
    flow = (new - old)[use]
    per_axis = direction_by_turn(np.column_stack([np.ones(len(a)), a, b]))[:, :2]
    A = np.einsum("kc,kcj->kj", across, per_axis)
    y = np.einsum("kc,kc->k", across, flow)
    noise = limits.FLOW_NOISE_PX / focal
    weight = np.ones(len(y))
    turn = np.zeros(3)
    for _ in range(8):
        N = A.T @ (A * weight[:, None]) + np.diag(np.full(3, 1e-6))
        turn = np.linalg.solve(N, A.T @ (weight * y))
        residual = y - A @ turn
        sigma = max(noise, sd_by_median(residual))
        weight = cauchy_weight((residual / sigma) ** 2, limits.FLOW_HALF_WEIGHT)
    if sigma > limits.WORST_FLOW:
        return None, 0.0
    sd = float(np.sqrt(np.diag(np.linalg.inv(N)).max()) * sigma)
    return turn, limits.LEAST_TURN_SD + 2.0 * sd
