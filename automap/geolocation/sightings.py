"""One sign seen in one pass: place, total covariance, facing, size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from automap.geolocation import limits
from automap.geolocation.boresight import N_CAMERA
from automap.geolocation.landmark import Landmark, SizePrior, position_jacobian
from automap.geolocation.landmark_kernels import MARGIN
from automap.geolocation.view_errors import crowd
from automap.geolocation.views import Views
from automap.records import FloatArray


@dataclass(frozen=True)
class Sighting:
    """A landmark with what the map needs of it; vectors in the local frame (NED).

    ``own_cov`` [3, 3] from its boxes alone; ``camera_effect`` [3, 10] derivative of the position by
    what is common to the camera, with ``camera_cov`` [10, 10]; ``pass_cov`` [3, 3] effect of what
    is common to this pass (attitude and velocity of the trajectory, margin of the boxes);
    ``path_sd`` [3] the trajectory's position error at the nearest view, m; ``time_s`` the
    middle of the pass; ``facing`` [2] unit vector (north, east) from the sign towards the
    cameras; ``class_score`` sum of its boxes' scores by class. ``size_effect`` [3] what of
    ``own_cov`` and ``pass_cov`` comes of the size that the sign was taken for and of what boxes
    leave around it: how far a sigma of both moves the place, m. Every pass and every drive takes
    the sign for that size, and a detector leaves about as much around it each time.
    """

    landmark: Landmark
    camera: int
    position: FloatArray
    own_cov: FloatArray
    camera_effect: FloatArray
    camera_cov: FloatArray
    pass_cov: FloatArray
    path_sd: FloatArray
    time_s: float
    facing: FloatArray
    class_score: dict[str, float]
    size_effect: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def covariance(self) -> FloatArray:
        """Total covariance [3, 3] of the position."""
        camera = self.camera_effect @ self.camera_cov @ self.camera_effect.T
        return np.asarray(self.own_cov + self.pass_cov + camera + np.diag(self.path_sd**2))

    @property
    def class_name(self) -> str:
        """The class with the highest sum of scores."""
        return class_of([self])


def class_of(sightings: Sequence[Sighting]) -> str:
    """The class with the highest sum of scores; the alphabet decides between equals."""
    scores: Counter[str] = sum((Counter(s.class_score) for s in sightings), Counter())
    return max(sorted(scores), key=scores.__getitem__)


def common_effects(sightings: Sequence[Sighting]) -> FloatArray:
    """How far a sigma of each of what sightings [n] have in common moves their places: [n, 3, e] m,
    of the size of the sign, and of what is wrong of each camera."""
    cameras = 1 + max(s.camera for s in sightings)
    effects = np.zeros((len(sightings), 3, 1 + N_CAMERA * cameras))
    for own, s in zip(effects, sightings, strict=True):
        variances, axes = np.linalg.eigh(s.camera_cov)
        own[:, 0], first = s.size_effect, 1 + N_CAMERA * s.camera
        root = axes * np.sqrt(np.maximum(variances, 0.0))
        own[:, first : first + N_CAMERA] = s.camera_effect @ root
    return effects


def _by_size(views: Views, landmark: Landmark, size: SizePrior) -> FloatArray:
    """How far a landmark's place [3] moves by a sigma of its size prior and of the part of its
    boxes' margin that every pass has: both move it along the line of sight, and count as one."""
    prior = size.of(views.class_name[landmark.rows].tolist())
    stated = landmark.covariance / max(1.0, landmark.chi2 / landmark.dof)
    J = position_jacobian(views, landmark)
    share = prior.weight(landmark) / prior.log_sd
    by_size = J @ (stated + landmark.pass_covariance)[:, 3] * share
    margin = float(views.margin_sd[landmark.rows].mean()) * np.sqrt(limits.MARGIN_ALIKE)
    by_margin = J @ landmark.common[:, MARGIN] * margin
    both = by_size + np.copysign(1.0, by_size @ by_margin) * by_margin
    total = np.hypot(np.linalg.norm(by_size), np.linalg.norm(by_margin))
    return np.asarray(both * (total / max(float(np.linalg.norm(both)), 1e-12)))


def make_sighting(
    views: Views,
    landmark: Landmark,
    camera_covariances: Sequence[FloatArray],
    size: SizePrior | None = None,
) -> Sighting:
    """Turn a landmark into a sighting; ``camera_covariances`` [10, 10] one per camera, ``size``
    that it was taken for (None: as if boxes alone told it)."""
    rows = landmark.rows
    J = position_jacobian(views, landmark)
    effect = J @ landmark.common[:, :N_CAMERA]
    anchor = landmark.anchor
    camera = int(views.camera[anchor])
    camera_cov = camera_covariances[camera].copy()
    # the error of the lever arm is among those of the pass
    camera_cov[5:8] = camera_cov[:, 5:8] = 0.0
    towards = views.centre[rows, :2] - landmark.position[:2]
    distance = np.linalg.norm(towards, axis=1)
    mean = (towards / np.maximum(distance, 1e-6)[:, None]).mean(axis=0)
    scores: dict[str, float] = {}
    # those from one place together count as much as one of them
    weights = np.maximum(views.score[rows], limits.LEAST_SCORE) / crowd(views, rows)
    for name, weight in zip(views.class_name[rows], weights, strict=True):
        scores[str(name)] = scores.get(str(name), 0.0) + float(weight)
    return Sighting(
        landmark=landmark,
        camera=camera,
        position=landmark.position,
        own_cov=J @ landmark.covariance @ J.T,
        camera_effect=effect,
        camera_cov=camera_cov,
        pass_cov=J @ landmark.pass_covariance @ J.T,
        path_sd=views.pose_sd[anchor],
        time_s=float(views.t_ns[rows].mean() * 1e-9),
        facing=mean / max(float(np.linalg.norm(mean)), 1e-6),
        class_score=scores,
        size_effect=np.zeros(3) if size is None else _by_size(views, landmark, size),
    )
