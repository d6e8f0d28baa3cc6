"""The camera's mounting and time offset, from all signs together.

A camera that is turned a little, or whose stamps are late, makes the rays of every sign miss
one another in the same way. The signs' own unknowns are eliminated one by one (Schur
complement: Triggs et al., Bundle Adjustment, 2000), which leaves four equations a camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from automap.geolocation.landmark import Landmark, SizePrior, relative_views, view_drift, view_sd
from automap.geolocation.landmark_kernels import normal_equations
from automap.geolocation.views import CameraCorrection, Views
from automap.records import Camera, FloatArray, IntArray

_PASS_TURN_RAD = 0.005
_PASS_TIME_S = 0.02
"""What one pass of one sign may suggest in error: uneven stamps, a bent box, a swaying mount."""

MIN_VIEWS = 4
"""Signs with fewer views say nothing about the camera that their own unknowns do not absorb."""


def prior_covariance(camera: Camera) -> FloatArray:
    """Covariance [4, 4] of turn (rad) and time offset (s) before any sign was seen."""
    sd = np.array([camera.mount_sd] * 3 + [camera.time_offset_sd])
    return np.diag(np.maximum(sd, 1e-9) ** 2)


def pass_covariance(views: Views, rows: IntArray) -> FloatArray:
    """Covariance [4, 4] of turn and time offset that hold for one pass of one sign only."""
    turn = views.attitude_sd[rows].mean(axis=0) ** 2 + _PASS_TURN_RAD**2
    return np.diag([*turn, _PASS_TIME_S**2])


def refine_correction(
    views: Views,
    landmarks: Sequence[Landmark],
    camera_index: int,
    camera: Camera,
    current: CameraCorrection | None,
    prior: SizePrior,
) -> CameraCorrection:
    """One Gauss-Newton step for a camera's turn and time offset.

    ``views`` and ``landmarks`` were made with ``current``. Every sign's evidence is limited by
    the attitude error of the trajectory at the time it was seen, and by errors of its own
    frames and boxes: they look like a turn or an offset but are others for every sign.
    """
    before = np.zeros(4) if current is None else np.array([*current.turn, current.time_s])
    information = np.linalg.inv(prior_covariance(camera))
    right = -information @ before
    for landmark in landmarks:
        rows = landmark.rows
        if len(rows) < MIN_VIEWS or not landmark.ok:
            continue
        if (views.camera[rows] != camera_index).any():
            continue
        own, step = _evidence(views, landmark, prior)
        limited = np.linalg.inv(np.eye(4) + own @ pass_covariance(views, rows))
        information += limited @ own
        right += limited @ step
    covariance = np.asarray(np.linalg.inv(0.5 * (information + information.T)), np.float64)
    after = before + covariance @ right
    return CameraCorrection(turn=after[:3], time_s=float(after[3]), covariance=covariance)


def _evidence(views: Views, landmark: Landmark, prior: SizePrior) -> tuple[FloatArray, FloatArray]:
    """Information [4, 4] and right-hand side [4] of one sign, its own unknowns eliminated."""
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
        *(views.rate[rows], views.velocity[rows]),
        float(np.log(prior.size_m)),
        prior.log_sd,
        True,
    )
    solved = np.linalg.solve(N, np.column_stack([A, shared[4:, 4]]))
    information = shared[:4, :4] - A.T @ solved[:, :4]
    right = shared[:4, 4] - A.T @ solved[:, 4]
    scale = max(1.0, chi2 / landmark.dof)
    return information / scale, right / scale
