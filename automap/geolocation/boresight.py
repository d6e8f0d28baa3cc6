"""The camera's mounting and time offset, from all signs together.

A camera that is turned a little, or whose stamps are late, makes the rays of every sign miss
one another in the same way. The signs' own unknowns are eliminated one by one (Schur
complement: Triggs et al., Bundle Adjustment, 2000), which leaves eight equations a camera:
turn, time offset, focal length and lever arm. The lever arm is considered, not corrected:
along the road it is one with the place of all signs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automap.geolocation.landmark import Landmark, SizePrior, relative_views, view_drift, view_sd
from automap.geolocation.landmark_kernels import N_COMMON, normal_equations
from automap.geolocation.views import CameraCorrection, Views
from automap.records import Camera, FloatArray, IntArray

_PASS_TURN_RAD = 0.0075
_PASS_TIME_S = 0.02
"""What one pass of one sign may suggest in error: uneven stamps, a bent box, a swaying mount."""

_EVIDENCE_TIME_S = 0.05
"""The same for the evidence on the offset, where a wrong size or path looks like late frames."""

ATTITUDE_WINDOW_S = 60.0
"""Signs seen within such a time share the trajectory's attitude error."""

MIN_VIEWS = 4
"""Signs with fewer views say nothing about the camera that their own unknowns do not absorb."""


@dataclass(frozen=True)
class CameraPriors:
    """One-sigma priors that the manifest does not state: relative ``focal_sd`` and
    ``lever_arm_sd_m`` of the camera's place on the vehicle."""

    focal_sd: float = 0.005
    lever_arm_sd_m: float = 0.1


def prior_covariance(camera: Camera, priors: CameraPriors) -> FloatArray:
    """Covariance [8, 8] of turn (rad), time offset (s), log focal length and lever arm (m)
    before any sign was seen."""
    sd = [camera.mount_sd] * 3 + [camera.time_offset_sd, priors.focal_sd]
    sd += [priors.lever_arm_sd_m] * 3
    return np.diag(np.maximum(np.array(sd), 1e-9) ** 2)


def pass_covariance(views: Views, rows: IntArray) -> FloatArray:
    """Covariance [8, 8] of turn and time offset that hold for one pass of one sign only."""
    return _own_error(_PASS_TIME_S) + _attitude_error(views, rows)


def _own_error(time_s: float) -> FloatArray:
    return np.diag([_PASS_TURN_RAD**2] * 3 + [time_s**2] + [0.0] * 4)


def _attitude_error(views: Views, rows: IntArray) -> FloatArray:
    return np.diag([*(views.attitude_sd[rows].mean(axis=0) ** 2), 0.0, 0.0, 0.0, 0.0, 0.0])


def refine_correction(
    views: Views,
    landmarks: Sequence[Landmark],
    camera_index: int,
    camera: Camera,
    current: CameraCorrection | None,
    prior: SizePrior,
    priors: CameraPriors,
) -> CameraCorrection:
    """One Gauss-Newton step for a camera's turn, time offset and focal length.

    ``views`` and ``landmarks`` were made with ``current``. Every sign's evidence is limited by
    errors of its own frames and boxes, that of all signs of a minute by the attitude error of
    the trajectory: they look like a turn or an offset but are others elsewhere.
    """
    n = N_COMMON
    before = np.zeros(n) if current is None else current.values
    windows: dict[int, tuple[FloatArray, FloatArray, list[FloatArray]]] = {}
    usable = [
        landmark
        for landmark in landmarks
        if len(landmark.rows) >= MIN_VIEWS
        and landmark.ok
        and (views.camera[landmark.rows] == camera_index).all()
    ]
    for landmark in usable:
        rows = landmark.rows
        own, step = _evidence(views, landmark, prior)
        limited = np.linalg.inv(np.eye(n) + own @ _own_error(_EVIDENCE_TIME_S))
        number = int((views.t_ns[rows[0]] - views.t_ns[0]) * 1e-9 // ATTITUDE_WINDOW_S)
        known, pull, attitude = windows.get(number, (np.zeros((n, n)), np.zeros(n), []))
        attitude.append(_attitude_error(views, rows))
        windows[number] = (known + limited @ own, pull + limited @ step, attitude)
    before_any = prior_covariance(camera, priors)
    information = np.linalg.inv(before_any)
    right = -information @ before
    for known, pull, attitude in windows.values():
        limited = np.linalg.inv(np.eye(n) + known @ np.mean(attitude, axis=0))
        information += limited @ known
        right += limited @ pull
    covariance = np.asarray(np.linalg.inv(0.5 * (information + information.T)), np.float64)
    after = before + covariance @ right
    # the lever arm keeps its prior: its error is that of the manifest
    kept = slice(n - 3, n)
    covariance[kept] = before_any[kept]
    covariance[:, kept] = before_any[:, kept]
    return CameraCorrection(
        turn=after[:3], time_s=float(after[3]), focal_log=float(after[4]), covariance=covariance
    )


def _evidence(views: Views, landmark: Landmark, prior: SizePrior) -> tuple[FloatArray, FloatArray]:
    """Information [8, 8] and right-hand side [8] of one sign, its own unknowns eliminated."""
    rows = landmark.rows
    M, b = relative_views(views, rows, landmark.anchor)
    N, A, shared, _, _, chi2 = normal_equations(
        landmark.parameters,
        *(
            M,
            b,
            views.measured[rows],
            view_sd(views, rows),
            view_drift(views, rows, landmark.anchor),
        ),
        *(views.rate[rows], views.velocity[rows], views.C_cam_body[rows]),
        float(np.log(prior.size_m)),
        prior.log_sd,
        True,
    )
    n = N_COMMON
    solved = np.linalg.solve(N, np.column_stack([A, shared[n:, n]]))
    information = shared[:n, :n] - A.T @ solved[:, :n]
    right = shared[:n, n] - A.T @ solved[:, n]
    # boxes of one sign err together: their agreement is no measure of their error
    scale = max(1.0, chi2 / landmark.dof)
    return information / scale, right / scale
