"""A drive over hills and round bends with two cameras, where no two numbers are alike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.effects.lens import project
from automap.frames import rpy_to_matrix
from automap.geolocation.landmark import SizePrior
from automap.geolocation.views import CameraCorrection, MeasurementNoise, Views, build_views
from automap.records import Camera, Detections, FloatArray, IntArray, Looked, Trajectory
from tests.unit.geolocation_scene import ORIGIN

CLASSES = (
    "regulatory--stop--g1",
    "regulatory--yield--g1",
    "warning--children--g2",
    "sign-of-none",
)
SIZES = (0.75, 0.8, 0.62, 1.1)
NOISE = MeasurementNoise(0.9, 0.02, 0.0008, 1.7, 0.0, (1.1, 0.9, 1.3))
PRIOR = SizePrior(0.7, 0.35, {CLASSES[2]: SizePrior(0.6, 0.2)})


@dataclass(frozen=True)
class Drive:
    """All of it; ``owner`` of each camera's boxes the sign they show."""

    path: Trajectory
    place: FloatArray
    detections: list[Detections]
    owner: list[IntArray]
    cameras: dict[str, Camera]

    def views(self, noise: MeasurementNoise = NOISE, plain: bool = False) -> Views:
        """Of all boxes, with or without what was found out about the cameras."""
        return build_views(
            self.path, self.detections, self.cameras, noise, None if plain else CORRECTIONS
        )

    def rows(self, views: Views, sign: int, camera: int = 0) -> IntArray:
        """Those of the views that show a sign."""
        first = len(self.detections[0]) * camera
        own = np.flatnonzero(self.owner[camera] == sign) + first
        return np.flatnonzero(np.isin(views.row, own) & (views.camera == camera))


def cameras() -> dict[str, Camera]:
    """One that looks ahead through a bent lens, one to the left."""
    front = Camera(
        1280, 720, np.array([[960.0, 0.0, 632.0], [0.0, 985.0, 352.0], [0.0, 0.0, 1.0]]),
        np.array([-0.11, 0.04, 0.0008, -0.0006, 0.01]), np.array([1.4, 0.25, -0.7]),
        np.radians([0.6, -1.3, 2.2]), float(np.radians(0.3)), 0.011, 0.006, 0.04,
    )  # fmt: skip
    left = replace(
        front,
        matrix=np.array([[820.0, 0.0, 655.0], [0.0, 800.0, 371.0], [0.0, 0.0, 1.0]]),
        distortion=np.array([0.05, -0.02, 0.0, 0.001, 0.0]),
        lever_arm_m=np.array([0.9, -0.6, -0.8]),
        mount_rpy=np.radians([-0.8, 2.0, -31.0]),
        time_offset_s=-0.017,
        lever_arm_sd=0.07,
    )
    return {"front": front, "left": left}


CORRECTIONS = {
    "front": CameraCorrection(
        np.array([0.002, -0.0015, 0.003]), 0.004, np.diag(np.arange(1.0, 11.0) * 1e-6) + 2e-7,
        0.006, 0.0011, 0.004,
    )
}  # fmt: skip


@cache
def rich_path(seconds: float = 26.0) -> Trajectory:
    """Fifty rows a second; speed, course, slope, lean and all sigmas change."""
    t = np.arange(0.0, seconds, 0.02)
    speed = 10.0 + 2.5 * np.sin(0.35 * t)
    yaw = 0.7 + 0.5 * np.sin(0.21 * t) + 0.02 * t
    climb = 0.05 * np.sin(0.4 * t + 1.0)
    velocity = speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), -climb])
    place = np.cumsum(velocity, axis=0) * 0.02
    lat, lon, height = from_local_ned(place - place[len(t) // 2], ORIGIN)
    slow = np.column_stack([1.0 + 0.3 * np.sin(w * t) for w in (0.11, 0.17, 0.07)])
    return Trajectory(
        t_ns=(1e12 + t * 1e9).astype(np.int64),
        gps_s=1.4e9 + t,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        rpy=np.column_stack([0.03 * np.sin(0.9 * t), climb + 0.01 * np.cos(2.0 * t), yaw + 0.01]),
        sd_pos_ned=slow * [0.5, 0.4, 0.9],
        sd_vel_ned=slow[:, ::-1] * [0.03, 0.02, 0.05],
        sd_rpy=slow * [0.0012, 0.0009, 0.003],
    )


@cache
def rich_drive(seed: int = 5) -> Drive:
    """Its signs stand at all distances; a hundred boxes of each camera or so."""
    rng = np.random.default_rng(seed)
    path, seen_by = rich_path(), cameras()
    rows = np.sort(rng.choice(np.arange(150, len(path) - 20), 16, replace=False))
    here = local_ned(path.lat_rad[rows], path.lon_rad[rows], path.height_m[rows], ORIGIN)
    yaw = path.rpy[rows, 2]
    side = rng.uniform(3.0, 7.0, 16) * np.where(rng.random(16) < 0.5, -1.0, 1.0)
    place = here + np.column_stack(
        [-np.sin(yaw) * side, np.cos(yaw) * side, rng.uniform(-3.5, -1.2, 16)]
    )
    found = [_boxes(rng, path, place, name, camera) for name, camera in seen_by.items()]
    return Drive(path, place, [f for f, _ in found], [o for _, o in found], seen_by)


def _boxes(
    rng: np.random.Generator, path: Trajectory, place: FloatArray, name: str, camera: Camera
) -> tuple[Detections, IntArray]:
    frames = np.arange(0, len(path) - 1, 17)
    body = local_ned(path.lat_rad[frames], path.lon_rad[frames], path.height_m[frames], ORIGIN)
    rows, owner = [], []
    for frame, (row, at) in enumerate(zip(frames, body, strict=True)):
        C_n_b = rpy_to_matrix(path.rpy[row])
        C_cam_n = (C_n_b @ rpy_to_matrix(camera.mount_rpy)).T
        q = (place - at - C_n_b @ camera.lever_arm_m) @ C_cam_n.T
        for k in np.flatnonzero((q[:, 0] > 4.0) & (q[:, 0] < 48.0)):
            size = SIZES[k % 4]
            edges = [q[k] + [0.0, 0.0, 0.5 * size * s] for s in (-1.0, 1.0)]
            top, bottom = project(camera, np.array(edges))
            high = (bottom[1] - top[1]) * np.exp(rng.normal(0.0, 0.03)) + rng.normal(1.5, 0.5)
            wide = high * (0.97 - 0.02 * (k % 3)) * np.exp(rng.normal(0.0, 0.03))
            x, y = 0.5 * (top + bottom) + 1.3 * rng.standard_t(3.0, 2)
            if not (wide < x < camera.width - wide and high < y < camera.height - high):
                continue
            box = [x - wide / 2, y - high / 2, x + wide / 2, y + high / 2]
            stamp = path.t_ns[row] - round(camera.time_offset_s * 1e9)
            misread = CLASSES[(k + 1) % 4] if rng.random() < 0.1 else CLASSES[k % 4]
            rows.append((3 * frame, stamp, misread, box, k))
            owner.append(k)
    # one before the path begins, one without a height, one without a place
    for stamp, box in (
        (int(path.t_ns[0]) - 10**9, [300.0, 200.0, 330.0, 232.0]),
        (int(path.t_ns[400]), [300.0, 200.0, 330.0, 200.0]),
        (int(path.t_ns[500]), [np.nan, 200.0, 330.0, 231.0]),
    ):
        rows.append((rows[-1][0], stamp, CLASSES[3], box, -1))
        owner.append(-1)
    n = len(rows)
    known = np.where(rng.random(n) < 0.8, rng.uniform(0.1, 0.7, n), np.nan)
    track = np.array([r[4] if r[4] % 3 else -1 for r in rows], np.int64)
    probability = rng.uniform(0.5, 0.95, n)
    looked = np.arange(0, 3 * len(frames), 3)
    region = np.tile([20.0, 11.0, camera.width - 31.0, camera.height - 17.0], (len(looked), 1))
    return (
        Detections(
            frame=np.array([r[0] for r in rows], np.int64),
            t_ns=np.array([r[1] for r in rows], np.int64),
            class_name=np.array([r[2] for r in rows], np.object_),
            box=np.array([r[3] for r in rows]),
            score=rng.uniform(0.4, 0.98, n),
            track=track,
            camera=name,
            class_probability=np.where(track >= 0, probability, np.nan),
            group_probability=np.where(track >= 0, 0.3 + 0.7 * probability, np.nan),
            contrast=known,
            contrast_note=np.where(np.isfinite(known), "", "too small").astype(np.object_),
            looked=Looked(looked, region),
        ),
        np.array(owner, np.int64),
    )
