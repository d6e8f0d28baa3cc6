"""Whether a camera is as stated, by what became of its boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.special import bdtrc

from automap.gates import sigmas
from automap.geolocation import limits
from automap.geolocation.views import CameraCorrection
from automap.records import UNKNOWN_DISTORTION_SD, BoolArray, Camera, FloatArray, Sign


def as_unknown(camera: Camera) -> Camera:
    """The camera with its turn, time offset, focal length and lens as good as unknown."""
    return replace(
        camera,
        mount_sd=max(camera.mount_sd, limits.DOUBTED_TURN_RAD),
        time_offset_sd=max(camera.time_offset_sd, limits.DOUBTED_TIME_S),
        distortion_sd=max(camera.distortion_sd, UNKNOWN_DISTORTION_SD),
        focal_sd=max(camera.focal_sd, limits.DOUBTED_FOCAL),
    )


def beyond_stated(correction: CameraCorrection, camera: Camera, focal_sd: float) -> bool:
    """Whether turn, time offset, focal length or k1 are off by more than their sigmas allow."""
    sd = [camera.mount_sd] * 3 + [camera.time_offset_sd, max(focal_sd, camera.focal_sd)]
    sd += [camera.distortion_sd]
    off = np.append(correction.values[:5], correction.radial)
    most = sigmas(limits.BEYOND_MANIFEST_PROBABILITY)
    return bool((np.abs(off) > most * np.maximum(sd, 1e-9)).any())


def misfit(used: BoolArray, note: npt.NDArray[np.object_], signs: Sequence[Sign]) -> list[str]:
    """A sentence where boxes, ``used`` [n] or left out for what ``note`` [n] says, and path are so
    much at odds that the video or the camera must be another one than stated."""
    seen = [sign for sign in signs if sign.status != "single_view"]
    weak = sum(sign.status != "ok" for sign in seen)
    by_chance = float(bdtrc(weak - 1, len(seen), limits.USUAL_WEAK)) if weak else 1.0
    placed = ~np.isin(note, ("no_pose", "no_direction", "too_far", "back"))
    lost = placed & ~used
    share = float(lost.sum()) / max(int(placed.sum()), 1)
    if by_chance > limits.MISFIT_PROBABILITY and (
        share < limits.LOST_SHARE or int(placed.sum()) < limits.LEAST_LOST
    ):
        return []
    return [
        f"The boxes do not fit the path: {share:.0%} of them were left out, and {weak} of "
        f"{len(seen)} signs are placed uncertainly, more than chance does. Their places may be "
        "wrong by more than they say: check that the video is of this drive and its frames' "
        "stamps are right, that camera_matrix belongs to its width and height, that the picture "
        "is neither mirrored nor turned, and mount_rpy_deg. (Where most boxes are of signs on "
        "other vehicles it is these.)"
    ]


def doubtful(sign: Sign, range_m: float) -> Sign:
    """A sign of a camera that is not as stated, seen from ``range_m`` at the nearest: boxes whose
    scale, turn and time nobody knows say no more than that something stood near the road; if it is
    there at all."""
    widened: FloatArray = sign.cov_enu + range_m**2 * np.eye(3)
    return replace(
        sign,
        status="doubtful",
        cov_enu=widened,
        existence=sign.existence * limits.IMPLAUSIBLE_CONFIDENCE,
        confidence=sign.confidence * limits.IMPLAUSIBLE_CONFIDENCE,
    )
