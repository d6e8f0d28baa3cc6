"""The camera's mounting and time offset, from all signs together.

A camera that is turned a little, or whose stamps are late, makes the rays of every sign miss
one another in the same way. The signs' own unknowns are eliminated one by one (Schur
complement: Triggs et al., Bundle Adjustment, 2000), which leaves ten equations a camera:
turn, time offset, focal length, lever arm, the margin of its boxes and the radial distortion of
its lens. The lever arm is considered, not corrected: along the road it is one with the place of all
signs. Boxes drawn a pixel or two too tall make signs grow too slowly on approach, which looks like
a greater distance, and on one side of the road like a turned camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from automap.effects.lens import focal_length
from automap.geolocation import limits
from automap.geolocation.landmark import Landmark, SizePrior
from automap.geolocation.landmark_kernels import MARGIN, N_COMMON, RADIAL
from automap.geolocation.pass_errors import equations, pass_sd
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import CameraCorrection, Views
from automap.records import Camera, FloatArray

N_CAMERA = 10
"""Of the errors common to views, those that a camera shares with all signs."""

_LEVER_ARM = slice(5, 8)


def prior_covariance(camera: Camera, rules: GeolocationRules) -> FloatArray:
    """Covariance [10, 10] of turn (rad), time offset (s), log focal length, lever arm (m), box
    margin (rad) and radial distortion k1 before any sign was seen."""
    sd = [camera.mount_sd] * 3 + [camera.time_offset_sd, max(rules.focal_sd, camera.focal_sd)]
    sd += [camera.lever_arm_sd] * 3
    sd += [rules.camera_margin_sd_px / focal_length(camera), camera.distortion_sd]
    return np.diag(np.maximum(np.array(sd), 1e-9) ** 2)


def camera_covariances(
    views: Views,
    cameras: Mapping[str, Camera],
    corrections: Mapping[str, CameraCorrection],
    rules: GeolocationRules,
) -> list[FloatArray]:
    """Covariances [10, 10] of the views' cameras: as signs left them, else before any sign."""
    before = {name: prior_covariance(cameras[name], rules) for name in views.camera_names}
    return [
        corrections[name].covariance if name in corrections else own for name, own in before.items()
    ]


def refine_correction(
    views: Views,
    landmarks: Sequence[Landmark],
    camera_index: int,
    camera: Camera,
    current: CameraCorrection | None,
    rules: GeolocationRules,
) -> CameraCorrection:
    """One Gauss-Newton step for a camera's turn, time offset, focal length and lens.

    ``views`` and ``landmarks`` were made with ``current``. Every sign's evidence is limited by
    errors of its own frames and boxes, that of all signs of a minute by the attitude error of
    the trajectory: they look like a turn or an offset but are others elsewhere.
    """
    before = np.zeros(N_CAMERA) if current is None else current.values
    usable = usable_landmarks(views, landmarks, camera_index)
    evidence = [
        evidence_of(
            *(views, mark, rules.size),
            pass_sd(views, mark.rows, attitude=False),
        )
        for mark in usable
    ]
    attitude = [np.mean(views.attitude_sd[mark.rows] ** 2, axis=0) for mark in usable]
    after, covariance = solve_camera(views, usable, evidence, attitude, before, camera, rules)
    return CameraCorrection(
        turn=after[:3],
        time_s=float(after[3]),
        focal_log=float(after[4]),
        margin=float(after[MARGIN]),
        radial=float(after[RADIAL]),
        covariance=covariance,
    )


def usable_landmarks(
    views: Views, landmarks: Sequence[Landmark], camera_index: int
) -> list[Landmark]:
    """The landmarks with views enough of one camera to say something about it."""
    return [
        landmark
        for landmark in landmarks
        if len(landmark.rows) >= limits.CAMERA_VIEWS
        and landmark.ok
        and (views.camera[landmark.rows] == camera_index).all()
    ]


def solve_camera(
    views: Views,
    landmarks: Sequence[Landmark],
    evidence: Sequence[tuple[FloatArray, FloatArray]],
    attitude_variance: Sequence[FloatArray],
    before: FloatArray,
    camera: Camera,
    rules: GeolocationRules,
) -> tuple[FloatArray, FloatArray]:
    """Values [10] of a camera and their covariance [10, 10] from the ``evidence`` of landmarks.

    ``before`` [10] the values that views and landmarks were made with; ``attitude_variance`` [3]
    of every landmark, of the trajectory's error that it shares with others of its time.
    """
    n = N_CAMERA
    windows: dict[int, tuple[FloatArray, FloatArray, list[FloatArray]]] = {}
    for landmark, (own, step), variance in zip(landmarks, evidence, attitude_variance, strict=True):
        first = landmark.rows[0]
        number = int((views.t_ns[first] - views.t_ns[0]) * 1e-9 // limits.ATTITUDE_WINDOW_S)
        known, pull, attitude = windows.get(number, (np.zeros((n, n)), np.zeros(n), []))
        windows[number] = (known + own, pull + step, [*attitude, variance])
    before_any = prior_covariance(camera, rules)
    # what bends tell of the lever arm is each pass's own: it has no share in the solution
    held = before_any.copy()
    held[_LEVER_ARM, _LEVER_ARM] = 1e-12 * np.eye(3)
    information = np.linalg.inv(held)
    right = -information @ before
    for known, pull, attitude in windows.values():
        shared = np.zeros(n)
        shared[:3] = np.mean(attitude, axis=0)
        limited = np.linalg.inv(np.eye(n) + known * shared)
        information += limited @ known
        right += limited @ pull
    covariance = np.asarray(np.linalg.inv(0.5 * (information + information.T)), np.float64)
    after = before + covariance @ right
    # the lever arm keeps its prior: its error is that of the manifest
    covariance[_LEVER_ARM] = before_any[_LEVER_ARM]
    covariance[:, _LEVER_ARM] = before_any[:, _LEVER_ARM]
    return np.asarray(after), covariance


def evidence_of(
    views: Views, landmark: Landmark, prior: SizePrior, pass_errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Information [10, 10] and right-hand side [10] of one sign, its own unknowns eliminated (Schur
    complement: Triggs et al., Bundle Adjustment, 2000).

    Its own unknowns are its place and size and the errors of its pass, of sigmas
    ``pass_errors`` [13], but for the attitude, which it shares with its neighbours in time.
    """
    N, A, shared, _, _, chi2, _ = equations(
        views, landmark, landmark.parameters, np.zeros(N_COMMON), prior
    )
    solved = np.linalg.solve(N, np.column_stack([A, shared[N_COMMON:, -1]]))
    information = shared[:N_COMMON, :N_COMMON] - A.T @ solved[:, :N_COMMON]
    right = shared[:N_COMMON, -1] - A.T @ solved[:, -1]
    # boxes of one sign err together: their agreement is no measure of their error
    scale = max(1.0, chi2 / landmark.dof)
    limited = np.linalg.inv(np.eye(N_COMMON) + information / scale * pass_errors**2)
    n = N_CAMERA
    return (limited @ information)[:n, :n] / scale, (limited @ right)[:n] / scale
