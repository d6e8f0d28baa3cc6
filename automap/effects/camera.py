"""Effects of the camera: what the manifest says of it, corrected by values that were found.

Values map effect to parameter to value, in the catalogue's names and units. They are errors of
what is stated: the true camera is the stated one with them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.effects.vehicle import Values, parameter, parameters
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.records import Camera, FloatArray


def true_camera(stated: Camera, values: Values) -> Camera:
    """The camera as it is.

    ``camera_boresight`` turns it further in its own axes, ``camera_time_offset`` is added to the
    stamps, ``camera_focal`` lengthens the focal length by that share, ``camera_distortion`` and
    ``camera_lever_arm`` are added to what is stated.
    """
    matrix = stated.matrix.copy()
    matrix[:2, :2] *= 1.0 + parameter(values, "camera_focal")
    bend = np.zeros(max(len(stated.distortion), 5))
    bend[: len(stated.distortion)] = stated.distortion
    bend[:2] += parameters(values, "camera_distortion")
    turn = rpy_to_matrix(stated.mount_rpy) @ rpy_to_matrix(parameters(values, "camera_boresight"))
    return replace(
        stated,
        matrix=matrix,
        distortion=bend,
        lever_arm_m=stated.lever_arm_m + parameters(values, "camera_lever_arm"),
        mount_rpy=matrix_to_rpy(turn),
        time_offset_s=stated.time_offset_s + parameter(values, "camera_time_offset"),
    )


def row_share(rows: FloatArray, height: int) -> FloatArray:
    """Place of pixel rows [n] in the image, from -0.5 at the top to 0.5; 0 is the stamp's."""
    return np.asarray(np.clip((rows + 0.5) / height - 0.5, -0.5, 0.5))


def row_delay_s(rows: FloatArray, height: int, values: Values) -> FloatArray:
    """When pixel rows [n] are read, in s after the middle one, ``rolling_shutter``."""
    return parameter(values, "rolling_shutter") * row_share(rows, height)
