"""The camera on the vehicle: where it is, when its rows are read, what its errors do.

Values map effect to parameter to value, in the catalogue's names and units. They are errors of
what is stated: the true camera is the stated one with them. What a camera sees of a point is
that point in camera axes (``in_camera``), its direction, distorted by the lens into a pixel
(``lens``); what errors of the camera do to it are the columns of ``error_columns``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from automap.earth import local_ned, tangent_rotation
from automap.effects.lens import lens_of, normalise, project
from automap.effects.measured import Values
from automap.effects.path_signals import PathSignals
from automap.effects.signals import Signals
from automap.effects.vehicle import parameter, parameters
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.interpolation import Poses
from automap.records import Camera, Detections, FloatArray

PoseAt = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Position [n, 3] m NED and attitude ``C_n_b`` [n, 3, 3] of the vehicle at seconds [n]."""

_SHUTTER_ROUNDS = 3
"""The row of a pixel tells its instant, and that the row: rounds of that."""


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


def as_stated(
    found: Detections, camera: Camera, values: Values, path: PathSignals | None = None
) -> Detections:
    """Boxes as ``camera``, the true one, takes them but for what changes from box to box: all rows
    at once, and without users' effects, which need the quantities along the ``path``."""
    from automap.effects.camera_user import drift

    box = np.asarray(found.box, np.float64)
    late = row_delay_s(0.5 * (box[:, 1] + box[:, 3]), camera.height, values)
    if path is not None:
        at = found.t_ns + np.int64(round(camera.time_offset_s * 1e9))
        turn, more = drift(values, path.at(at))
        late = late + more
        if turn.any():
            box = _turned_back(camera, box, rpy_to_matrix(turn))
    return replace(found, t_ns=found.t_ns + np.rint(late * 1e9).astype(np.int64), box=box)


def _turned_back(camera: Camera, box: FloatArray, C_cam_turned: FloatArray) -> FloatArray:
    """Boxes [n, 4] as a camera that is not turned has them, from the middles of their edges."""
    x, y = 0.5 * (box[:, 0] + box[:, 2]), 0.5 * (box[:, 1] + box[:, 3])
    out = []
    for k, edge in enumerate(((box[:, 0], y), (x, box[:, 1]), (box[:, 2], y), (x, box[:, 3]))):
        flat = normalise(camera, np.column_stack(edge))
        ray = np.column_stack([np.ones(len(flat)), flat])
        out.append(project(camera, np.einsum("nij,nj->ni", C_cam_turned, ray))[:, k % 2])
    return np.column_stack(out)


def camera_poses(
    poses: Poses, camera: Camera, origin: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Camera centres [n, 3] and ``C_cam_ref`` [n, 3, 3] in the tangent plane at ``origin``."""
    height = np.where(np.isfinite(poses.height_m), poses.height_m, origin[2])
    vehicle = local_ned(poses.lat_rad, poses.lon_rad, height, origin)
    C_ref_ned = tangent_rotation(poses.lat_rad, poses.lon_rad, origin)
    C_ref_body = C_ref_ned @ rpy_to_matrix(poses.rpy)
    centre = vehicle + C_ref_body @ camera.lever_arm_m
    C_body_cam = rpy_to_matrix(camera.mount_rpy)
    return centre, np.swapaxes(C_ref_body @ C_body_cam, 1, 2)


def in_camera(
    camera: Camera, position: FloatArray, C_n_b: FloatArray, point: FloatArray
) -> FloatArray:
    """A point [3] or points [n, 3] m NED in the axes [n, 3] (forward, right, down) of the camera
    of a vehicle at ``position`` [n, 3] with attitude ``C_n_b`` [n, 3, 3]."""
    body = np.einsum("nji,nj->ni", C_n_b, point - position) - camera.lever_arm_m
    return np.asarray(body @ rpy_to_matrix(camera.mount_rpy))


def exposed(
    camera: Camera,
    values: Values,
    pose_at: PoseAt,
    t_s: FloatArray,
    point: FloatArray,
    signals: Signals | None = None,
) -> tuple[FloatArray, FloatArray]:
    """A point in camera axes [n, 3] when the row that shows it is read, and that time [n] s.

    ``t_s`` [n] s when the middle row is read; ``camera`` is the true one, which users' effects
    turn further with the ``signals`` of the drive.
    """
    from automap.effects.camera_user import drift

    late = np.zeros(len(t_s))
    for _ in range(_SHUTTER_ROUNDS if "rolling_shutter" in values else 1):
        q = in_camera(camera, *pose_at(t_s + late), point)
        if signals is not None:
            turn, _ = drift(values, signals.at(t_s + late))
            q = np.einsum("nji,nj->ni", rpy_to_matrix(turn), q)
        row = np.nan_to_num(project(camera, q)[:, 1], nan=-1e6)
        read, late = t_s + late, row_delay_s(row, camera.height, values)
    return q, read


def error_columns(
    camera: Camera,
    values: Values,
    q: FloatArray,
    height: FloatArray,
    share: FloatArray,
    rate: FloatArray,
    velocity: FloatArray,
) -> FloatArray:
    """What errors of the camera do to what it sees: columns [n, 3, 11].

    Rows: direction right and down (normalised, the distortion of the lens removed as the camera
    has it) and the logarithm of the apparent height. Columns: the parameters of the catalogue's
    effects of a camera, in its order, at ``values``, which ``camera`` was made with. ``q`` [n, 3] m
    things in camera axes, ``height`` [n] normalised, ``share`` [n] of their rows, ``rate`` [n, 3]
    rad/s and ``velocity`` [n, 3] m/s of the camera in its axes.
    """
    from automap.effects.camera_kernels import all_columns

    C_cam_body = np.ascontiguousarray(rpy_to_matrix(camera.mount_rpy).T)
    own = all_columns(q, height, share, rate, velocity, C_cam_body, lens_of(camera))
    return by_parameters(values, own)


def by_parameters(values: Values, columns: FloatArray) -> FloatArray:
    """Columns [n, 3, 11] by the catalogue's parameters at ``values``, from the kernels' by a turn
    about the camera's axes and the logarithm of the focal length."""
    from automap.effects.camera_kernels import FOCAL

    roll, pitch, _ = parameters(values, "camera_boresight")
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    out = columns.copy()
    out[:, :, :3] = columns[:, :, :3] @ np.array([[1, 0, -sp], [0, cr, sr * cp], [0, -sr, cr * cp]])
    out[:, :, FOCAL] /= 1.0 + parameter(values, "camera_focal")
    return out


def direction_by_point(q: FloatArray) -> FloatArray:
    """Derivative [n, 3, 3] of right / forward, down / forward and the logarithm of the apparent
    size by a point [n, 3] in camera axes."""
    out = np.zeros((len(q), 3, 3))
    out[:, 0, 0], out[:, 0, 1] = -q[:, 1] / q[:, 0] ** 2, 1.0 / q[:, 0]
    out[:, 1, 0], out[:, 1, 2] = -q[:, 2] / q[:, 0] ** 2, 1.0 / q[:, 0]
    out[:, 2, 0] = -1.0 / q[:, 0]
    return out


def direction_by_turn(q: FloatArray) -> FloatArray:
    """Derivative [n, 3, 3] of the same by a small turn of the camera about its axes."""
    # what a camera sees turns the other way: q x axis
    return direction_by_point(q) @ np.stack([np.cross(q, axis) for axis in np.eye(3)], axis=2)
