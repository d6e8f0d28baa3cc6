"""The camera's yaw against the direction of travel.

Signs tell how a camera is turned against the trajectory, whose heading may be off: that error
looks like a turn of the camera. But a sign's boxes tell it by the way the camera goes, so what
they say is free of the heading when it is taken against the course of the trajectory's own
velocity. On straight roads a car goes where it points, but for the slip that the road's camber
and side wind need. Signs are placed with the turn against the trajectory; this yaw is what the
camera has on the vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.geolocation import limits
from automap.geolocation.boresight import (
    CameraPriors,
    evidence_of,
    solve_camera,
    usable_landmarks,
)
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.pass_errors import pass_sd
from automap.geolocation.views import CameraCorrection, Views
from automap.records import Camera

_VELOCITY_RIGHT = 10
"""Place of the velocity error to the right in ``N_COMMON``."""


def yaw_by_course(
    views: Views,
    landmarks: Sequence[Landmark],
    camera_index: int,
    camera: Camera,
    correction: CameraCorrection,
    prior: SizePrior,
    priors: CameraPriors,
) -> tuple[float, float]:
    """Yaw (rad) beyond the given mounting against the course, and its sd.

    ``views`` and ``landmarks`` were made with ``correction``. Signs passed in bends or slowly
    have no share; without any the yaw is zero with the sd that the camera's mounting has.
    """
    usable, evidence, variance = [], [], []
    for mark in usable_landmarks(views, landmarks, camera_index):
        heading = _off_course(views, mark, camera)
        if heading is None:
            continue
        sd = pass_sd(views, mark.rows, attitude=False)
        # an error of the velocity to the side turns the course, which is held to
        sd[_VELOCITY_RIGHT] = 0.0
        information, pull = evidence_of(views, mark, prior, sd)
        turned = np.zeros(len(pull))
        turned[:3] = views.C_cam_body[mark.anchor] @ np.array([0.0, 0.0, heading])
        usable.append(mark)
        evidence.append((information, pull + information @ turned))
        attitude = np.mean(views.attitude_sd[mark.rows] ** 2, axis=0)
        slip = np.mean(views.slip_sd[mark.rows] ** 2)
        variance.append(np.array([attitude[0], attitude[1], slip]))
    values, covariance = solve_camera(
        views, usable, evidence, variance, correction.values, camera, priors
    )
    return float(values[2]), float(np.sqrt(covariance[2, 2]))


def _off_course(views: Views, mark: Landmark, camera: Camera) -> float | None:
    """Heading minus course (rad) while a sign was passed, None where that says nothing."""
    to_body = np.swapaxes(views.C_cam_body[mark.rows], 1, 2)
    velocity = np.einsum("nij,nj->ni", to_body, views.velocity[mark.rows])
    rate = np.einsum("nij,nj->ni", to_body, views.rate[mark.rows])
    velocity = velocity - np.cross(rate, camera.lever_arm_m)
    straight = (velocity[:, 0] > limits.COURSE_SPEED) & (
        np.abs(rate[:, 2]) < limits.COURSE_TURN_RATE
    )
    if straight.mean() < limits.STRAIGHT_SHARE:
        return None
    return -float(np.mean(np.arctan2(velocity[straight, 1], velocity[straight, 0])))
