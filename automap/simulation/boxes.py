"""Boxes of a scene's signs as a detector would find them, without drawing a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap import earth
from automap.effects.camera import row_delay_s, true_camera
from automap.effects.vehicle import Values
from automap.frames import rpy_to_matrix
from automap.geolocation.camera_model import project
from automap.records import Camera, FloatArray, IntArray
from automap.simulation.scenario import CameraSetup
from automap.simulation.scene import Scene, SceneSign
from automap.simulation.trajectory import DriveMotion

NEAR_M, FAR_M = 5.0, 60.0
FOUND = 0.92
LEAST_PX = 6.0
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
) -> SignBoxes:
    """Boxes in frames taken at ``t_s`` [m] s of the drive, by a camera with the given errors.

    A frame is stamped when its middle row is read; ``camera_time_offset`` belongs to the stamps
    and is no business of the picture.
    """
    camera = true_camera(stated_camera(setup), errors)
    noise = setup.box_sd_px or 0.0
    frames, boxes, names = [], [], []
    here = drive.at(t_s)
    place = earth.local_ned(here.lat_rad, here.lon_rad, here.height_m, scene.ref)
    for sign in scene.signs:
        near = np.flatnonzero(np.linalg.norm(place - sign.centre, axis=1) < FAR_M + 5.0)
        if len(near) == 0:
            continue
        late = np.zeros(len(near))
        for _ in range(3 if "rolling_shutter" in errors else 1):
            at = np.clip(t_s[near] + late, 0.0, drive.duration_s)
            ray, towards = _rays(drive, camera, at, sign, scene.ref)
            pixel = np.nan_to_num(project(camera, ray), nan=-1e6)
            late = row_delay_s(pixel[:, 1], camera.height, errors)
        depth = np.maximum(ray[:, 0], 0.1)
        half = 0.5 * camera.matrix[0, 0] * sign.size_m / depth
        box = np.column_stack([pixel - half[:, None], pixel + half[:, None]])
        box += rng.standard_normal(box.shape) * noise
        good = (ray[:, 0] > NEAR_M) & (ray[:, 0] < FAR_M) & (towards > FACING)
        good &= np.hypot(ray[:, 1], ray[:, 2]) < WIDEST * depth
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


def _rays(
    drive: DriveMotion,
    camera: Camera,
    t_s: FloatArray,
    sign: SceneSign,
    ref: tuple[float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """The sign in camera axes [n, 3], and the cosine [n] between its normal and the camera."""
    motion = drive.at(t_s)
    place = earth.local_ned(motion.lat_rad, motion.lon_rad, motion.height_m, ref)
    centre = place + motion.C_n_b @ camera.lever_arm_m
    there = sign.centre - centre
    body = np.einsum("nji,nj->ni", motion.C_n_b, there)
    normal = np.array([np.cos(sign.facing_rad), np.sin(sign.facing_rad), 0.0])
    towards = -(there @ normal) / np.maximum(np.linalg.norm(there, axis=1), 0.1)
    return np.asarray(body @ rpy_to_matrix(camera.mount_rpy)), np.asarray(towards)


def detections_csv(boxes: SignBoxes) -> str:
    """The boxes as a drive folder's detections."""
    lines = ["frame,class,x_min,y_min,x_max,y_max,score"]
    for frame, name, box in zip(boxes.frame, boxes.name, boxes.box, strict=True):
        edges = ",".join(f"{v:.2f}" for v in box)
        lines.append(f"{frame},{name},{edges},0.90")
    return "\n".join(lines) + "\n"
