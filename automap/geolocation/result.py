"""What comes of locating the signs of a drive, and what the user is told of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from automap.effects.lens import focal_length
from automap.geolocation.camera_doubt import beyond_stated, misfit
from automap.geolocation.facing import Faces
from automap.geolocation.landmark import Landmark, direction_residuals
from automap.geolocation.landmark_kernels import FOCAL_LOG
from automap.geolocation.trajectory_adjustment import AdjustedTrajectory
from automap.geolocation.views import CameraCorrection, MeasurementNoise, Views
from automap.records import BoolArray, Camera, FloatArray, IntArray, Sign

LEFT_OUT = {
    "no_pose": "lie outside the trajectory or in a long gap of it",
    "no_direction": "have no direction (no height, or outside the lens model)",
    "misfit": "fit no sign's other views",
    "no_place": "belong to no place in front of the camera",
    "unconfirmed": "show things that were not seen again when they should have been",
    "moving": "show things that move along with the traffic, such as a sign on a lorry",
    "fixed": "stay at one place of the picture in motion, such as a sticker or a lorry's sign",
    "back": "show the backs of signs",
    "too_far": "were seen once only and too far away to be placed",
}
"""Why detections were left out, by their note."""


@dataclass(frozen=True)
class Observations:
    """What became of every detection, in the order of the detections given.

    ``track`` [n] number of the pass in which its sign was tracked (-1 none), ``sign_id`` [n]
    ("" none), ``residual_px`` [n, 2] right and down (NaN without a sign), ``range_m`` [n]
    distance to the sign, ``used`` [n], ``note`` [n] why not ("no_pose", "no_direction",
    "misfit", "no_place", "too_far", "unconfirmed", "moving", "fixed", "back"; "" when used).
    """

    track: IntArray
    sign_id: npt.NDArray[np.object_]
    residual_px: FloatArray
    range_m: FloatArray
    used: npt.NDArray[np.bool_]
    note: npt.NDArray[np.object_]


@dataclass(frozen=True)
class GeolocationResult:
    """Signs in the order of first sight, what became of every detection, what was found out
    about each camera, and sentences for the user; ``adjusted`` trajectory, as signs seen again and
    control signs put it right (None: not at all), ``n_control`` control signs that were used,
    ``noise`` of the boxes as it was taken, ``faces`` what was found of all faces."""

    signs: list[Sign]
    observations: Observations
    corrections: dict[str, CameraCorrection]
    warnings: list[str]
    adjusted: AdjustedTrajectory | None
    n_control: int
    noise: MeasurementNoise
    faces: Faces


def nothing_observed(notes: npt.NDArray[np.object_], views: Views) -> Observations:
    """Nothing known yet of detections [n] but, by their views, which have no pose and no direction,
    and by their ``notes`` [n] which are of no sign whatever the camera is."""
    total = len(notes)
    observations = Observations(
        track=np.full(total, -1, np.int64),
        sign_id=np.full(total, "", np.object_),
        residual_px=np.full((total, 2), np.nan),
        range_m=np.full(total, np.nan),
        used=np.zeros(total, np.bool_),
        note=np.full(total, "no_place", np.object_),
    )
    observations.note[np.setdiff1d(np.arange(total), views.row)] = "no_direction"
    observations.note[views.without_pose] = "no_pose"
    observations.note[notes != ""] = notes[notes != ""]
    return observations


def record_sign(
    observations: Observations,
    views: Views,
    mark: Landmark,
    track: int,
    sign_id: str,
    focal: FloatArray,
) -> None:
    rows = views.row[mark.rows]
    observations.track[rows] = track
    observations.sign_id[rows] = sign_id
    residual = direction_residuals(views, mark)
    observations.residual_px[rows] = residual * focal[views.camera[mark.rows], None]
    observations.range_m[rows] = np.linalg.norm(views.centre[mark.rows] - mark.position, axis=1)
    observations.used[rows] = True
    observations.note[rows] = ""


def mostly_left_out(used: npt.NDArray[np.bool_], note: npt.NDArray[np.object_]) -> str:
    """The main reason why more detections, ``used`` [n] or left out for what ``note`` [n] says, are
    of no sign than of one; "" where that is not so."""
    notes, counts = np.unique(note[~used].astype(str), return_counts=True)
    known = [(int(n), LEFT_OUT.get(one, one)) for one, n in zip(notes, counts, strict=True)]
    if 2 * int(used.sum()) >= len(used) or not known:
        return ""
    n, text = max(known)
    return f"{'most' if used.any() else 'all'} of them are of no sign: {n} {text}"


def left_out_sentences(notes: npt.NDArray[np.object_]) -> list[str]:
    """How many detections were left out, by their ``notes`` [n], and why."""
    sentences = []
    for note, text in LEFT_OUT.items():
        n = int(np.count_nonzero(notes == note))
        if n:
            advice = ""
            if note == "no_pose" and n == len(notes):
                advice = " Check the clock of the frames: time and start_ns in [video], t_ns."
            sentences.append(f"{n} of {len(notes)} detections {text}; they were left out.{advice}")
    return sentences


def warnings_of(
    observations: Observations,
    asked: BoolArray,
    signs: Sequence[Sign],
    corrections: Mapping[str, CameraCorrection],
    cameras: Mapping[str, Camera],
    focal_sd: float,
) -> list[str]:
    """Sentences for the user; which detections [n] were ``asked`` of the camera, the ``cameras`` as
    stated, ``focal_sd`` how well, as a part,
    their focal lengths are known."""
    sentences = left_out_sentences(observations.note)
    sentences += misfit(observations.used[asked], observations.note[asked], signs)
    for name, correction in corrections.items():
        camera = cameras[name]
        if correction.time_minima:
            times = " or ".join(f"{v:+.2f}" for v in correction.time_minima)
            sentences.append(
                f"camera {name}: too few signs to tell by how much its frames are off; {times} s "
                "explain the boxes alike. The manifest's time_offset_s was kept."
            )
        if camera.focal_sd > 0.0:
            focal = focal_length(camera) * np.exp(correction.focal_log)
            sd = focal * np.sqrt(correction.covariance[FOCAL_LOG, FOCAL_LOG])
            sentences.append(
                f"camera {name}: the boxes make its focal length {focal:.0f} px, give or take "
                f"{sd:.0f}; signs were placed with that. camera_matrix in the manifest would be "
                "surer."
            )
        if beyond_stated(correction, camera, focal_sd):
            turn = ", ".join(f"{v:.2f}" for v in np.degrees(correction.turn))
            sentences.append(
                f"camera {name} seems turned by ({turn}) deg in roll, pitch, yaw, its frames "
                f"{correction.time_s:+.3f} s off, its focal length {correction.focal_log:+.1%} and "
                f"k1 of its lens {correction.radial:+.3f}, more than the manifest's sigmas allow; "
                "check mount_rpy_deg, time_offset_s, camera_matrix and distortion."
            )
    return sentences
