"""Where a camera was at each of its frames, by the trajectory of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.effects.camera import camera_poses
from automap.frames import matrix_to_rotation_vector
from automap.interpolation import poses_at
from automap.records import BoolArray, Camera, FloatArray, IntArray, Trajectory
from automap.vision import limits


@dataclass(frozen=True)
class CameraPath:
    """Poses of a camera at its frames [n].

    ``centre`` [n, 3] m in a local north-east-down frame, ``C_cam_ref`` [n, 3, 3] that frame to
    camera axes (forward, right, down); NaN where ``known`` [n] is False.
    """

    centre: FloatArray
    C_cam_ref: FloatArray
    known: BoolArray

    def __len__(self) -> int:
        return len(self.known)

    def steps(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Metres [n] and radians [n] moved since the frame before, and whether they are known."""
        travelled, turned = np.zeros(len(self)), np.zeros(len(self))
        both = np.zeros(len(self), np.bool_)
        if len(self) < 2:
            return travelled, turned, both
        both[1:] = self.known[1:] & self.known[:-1]
        travelled[1:] = np.linalg.norm(np.diff(self.centre, axis=0), axis=1)
        rows = np.flatnonzero(both)
        turn = self.C_cam_ref[rows - 1] @ np.swapaxes(self.C_cam_ref[rows], 1, 2)
        if len(rows):
            turned[rows] = np.linalg.norm(matrix_to_rotation_vector(turn), axis=1)
        both &= np.nan_to_num(travelled, nan=np.inf) < limits.LONGEST_STEP_M
        return np.where(both, travelled, 0.0), np.where(both, turned, 0.0), both


def camera_path(trajectory: Trajectory, camera: Camera, t_ns: IntArray) -> CameraPath:
    """The camera's path at frame stamps [n] of the trajectory's clock."""
    offset = np.int64(round(camera.time_offset_s * 1e9))
    poses = poses_at(trajectory, np.asarray(t_ns, np.int64) + offset)
    rows = np.flatnonzero(poses.covered)
    if not len(rows):
        n = len(t_ns)
        return CameraPath(np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan), poses.covered)
    middle = rows[len(rows) // 2]
    height = float(np.nan_to_num(poses.height_m[middle]))
    origin = (float(poses.lat_rad[middle]), float(poses.lon_rad[middle]), height)
    centre, C_cam_ref = camera_poses(poses, camera, origin)
    known = np.asarray(
        np.isfinite(centre).all(axis=1) & np.isfinite(C_cam_ref).all(axis=(1, 2)), np.bool_
    )
    return CameraPath(centre, C_cam_ref, known)
