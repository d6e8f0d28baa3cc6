"""Boxes of a scene's signs as a detector would find them, without drawing a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from automap import earth
from automap.effects.camera import exposed, true_camera
from automap.effects.lens import project
from automap.effects.measured import Values
from automap.effects.signals import Signals
from automap.frames import rpy_to_matrix
from automap.records import Camera, FloatArray, IntArray
from automap.signs.outlines import outline_points
from automap.signs.vocabulary import load_vocabulary
from automap.simulation.scenario import CameraSetup
from automap.simulation.scene import Scene, SceneSign
from automap.simulation.trajectory import DriveMotion

NEAR_M, FAR_M = 5.0, 60.0
"""Distances ahead, m, at which signs are found: nearer ones have left the picture."""
FOUND, LEAST_PX = 0.92, 6.0
"""Share of the signs in sight that is found in a picture, and their boxes' least size, px."""
FACING = 0.3
"""A plate is read up to 72 deg off its normal."""
WIDEST = 0.8
"""Rays further from the axis than this are not in the picture, wherever a lens model puts them."""


@dataclass(frozen=True)
class SignBoxes:
    """``frame`` [n], ``name`` of the class and ``box`` [n, 4] in pixels, in the order of frames."""

    frame: IntArray
    name: tuple[str, ...]
    box: FloatArray


def stated_camera(setup: CameraSetup) -> Camera:
    """The camera of the setup; the middle of the picture is its principal point."""
    f, cx, cy = setup.focal_px, (setup.width - 1) / 2.0, (setup.height - 1) / 2.0
    return Camera(
        width=setup.width,
        height=setup.height,
        matrix=np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]]),
        distortion=np.zeros(5),
        lever_arm_m=np.asarray(setup.lever_arm_m, np.float64),
        mount_rpy=np.deg2rad(setup.mount_rpy_deg),
        mount_sd=0.0,
        time_offset_s=0.0,
        time_offset_sd=0.0,
    )


def sign_boxes(
    drive: DriveMotion,
    setup: CameraSetup,
    errors: Values,
    t_s: FloatArray,
    scene: Scene,
    rng: np.random.Generator,
    signals: Signals | None = None,
) -> SignBoxes:
    """Boxes in frames taken at ``t_s`` [m] s of the drive, by a camera with the given errors;
    ``signals`` of the drive where users' effects are among them.

    A frame is stamped when its middle row is read; ``camera_time_offset`` belongs to the stamps
    and is no business of the picture.
    """
    camera = true_camera(stated_camera(setup), errors)
    noise = setup.box_sd_px or 0.0
    frames, boxes, names = [], [], []

    def pose_at(seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
        motion = drive.at(np.clip(seconds, 0.0, drive.duration_s))
        place = earth.local_ned(motion.lat_rad, motion.lon_rad, motion.height_m, scene.ref)
        return place, motion.C_n_b

    frames_at = cKDTree(pose_at(t_s)[0])
    for sign in scene.signs:
        near = np.sort(np.array(frames_at.query_ball_point(sign.centre, FAR_M + 5.0), np.int64))
        if len(near) == 0:
            continue
        ray, read = exposed(camera, errors, pose_at, t_s[near], sign.centre, signals)
        place, C_n_b = pose_at(read)
        C_cam_n = rpy_to_matrix(camera.mount_rpy).T @ np.swapaxes(C_n_b, 1, 2)
        box = face_box(camera, ray, np.einsum("nij,kj->nki", C_cam_n, face_outline(sign)))
        box += rng.standard_normal(box.shape) * noise
        towards = _towards(sign, place + C_n_b @ camera.lever_arm_m)
        good = (ray[:, 0] > NEAR_M) & (ray[:, 0] < FAR_M) & (towards > FACING)
        good &= np.hypot(ray[:, 1], ray[:, 2]) < WIDEST * ray[:, 0]
        good &= (box[:, :2] > 1.0).all(axis=1) & (box[:, 2] < camera.width - 2)
        good &= (box[:, 3] < camera.height - 2) & (box[:, 2] - box[:, 0] > LEAST_PX)
        good &= (box[:, 3] - box[:, 1] > LEAST_PX) & (rng.random(len(near)) < FOUND)
        frames.append(near[good])
        boxes.append(box[good])
        names += [sign.name] * int(good.sum())
    frame = np.concatenate([np.zeros(0, np.int64), *frames])
    order = np.argsort(frame, kind="stable")
    every = np.concatenate([np.zeros((0, 4)), *boxes])
    return SignBoxes(frame[order], tuple(names[i] for i in order), every[order])


def face_box(camera: Camera, ray: FloatArray, corners: FloatArray) -> FloatArray:
    """Boxes [n, 4] about a face at ``ray`` [n, 3] m, of ``corners`` [n, k, 3] m about its centre,
    both in camera axes."""
    points = ray[:, None] + corners
    points[..., 0] = np.maximum(points[..., 0], 0.1)
    pixels = project(camera, points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


def face_outline(sign: SceneSign) -> FloatArray:
    """Corners [k, 3] NED of a sign's face about its centre, m."""
    shape = outline_points(load_vocabulary().classes[sign.name].outline) - 0.5
    right = np.array([np.sin(sign.facing_rad), -np.cos(sign.facing_rad), 0.0])
    return np.asarray(sign.size_m * (shape[:, :1] * right + shape[:, 1:] * [0.0, 0.0, 1.0]))


def _towards(sign: SceneSign, place: FloatArray) -> FloatArray:
    """Cosine [n] between a sign's normal and the way to it from places [n, 3]."""
    there = sign.centre - place
    normal = np.array([np.cos(sign.facing_rad), np.sin(sign.facing_rad), 0.0])
    return np.asarray(-(there @ normal) / np.maximum(np.linalg.norm(there, axis=1), 0.1))


def detections_csv(boxes: SignBoxes) -> str:
    """The boxes as a drive folder's detections."""
    lines = ["frame,class,x_min,y_min,x_max,y_max,score"]
    for frame, name, box in zip(boxes.frame, boxes.name, boxes.box, strict=True):
        edges = ",".join(f"{v:.2f}" for v in box)
        lines.append(f"{frame},{name},{edges},0.90")
    return "\n".join(lines) + "\n"
