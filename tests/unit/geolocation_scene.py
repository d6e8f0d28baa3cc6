"""A small exact world for the geolocation tests: a path, signs beside it, their boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import from_local_ned
from automap.effects.lens import project
from automap.frames import rpy_to_matrix
from automap.records import Camera, Detections, FloatArray, Trajectory

ORIGIN = (np.radians(-35.3), np.radians(149.1), 580.0)


def camera(**changes: object) -> Camera:
    values: dict[str, object] = {
        "width": 1280,
        "height": 720,
        "matrix": np.array([[1000.0, 0.0, 640.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]]),
        "distortion": np.zeros(5),
        "lever_arm_m": np.array([1.4, 0.1, -0.6]),
        "mount_rpy": np.radians([0.5, -1.0, 2.0]),
        "mount_sd": np.radians(0.2),
        "time_offset_s": 0.0,
        "time_offset_sd": 0.005,
    }
    return Camera(**(values | changes))  # type: ignore[arg-type]


def drive_path(
    duration_s: float = 40.0, speed: float = 12.0, turn_rate: float = 0.05, sd_m: float = 0.5
) -> Trajectory:
    """A level arc at constant speed, 100 rows a second, heading north-east at first."""
    s = np.arange(0.0, duration_s, 0.01)
    yaw = 0.7 + turn_rate * s
    if turn_rate:
        north = speed / turn_rate * (np.sin(yaw) - np.sin(0.7))
        east = -speed / turn_rate * (np.cos(yaw) - np.cos(0.7))
    else:
        north, east = speed * s * np.cos(0.7), speed * s * np.sin(0.7)
    lat, lon, height = from_local_ned(np.column_stack([north, east, np.zeros_like(s)]), ORIGIN)
    ones = np.ones((len(s), 3))
    return Trajectory(
        t_ns=(1e12 + s * 1e9).astype(np.int64),
        gps_s=1.4e9 + s,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=np.column_stack([speed * np.cos(yaw), speed * np.sin(yaw), np.zeros_like(s)]),
        rpy=np.column_stack([np.zeros_like(s), np.zeros_like(s), yaw]),
        sd_pos_ned=ones * sd_m,
        sd_vel_ned=ones * 0.02,
        sd_rpy=ones * 0.001,
    )


@dataclass(frozen=True)
class Scene:
    """Signs in the tangent plane at ORIGIN [n, 3] NED, their heights and classes."""

    position: FloatArray
    size_m: FloatArray
    class_name: tuple[str, ...]


def roadside(trajectory: Trajectory, every_s: float = 4.0, lateral_m: float = 4.0) -> Scene:
    """A sign every few seconds of driving, left and right in turn, 2.2 m above the IMU."""
    from automap.earth import local_ned

    rows = np.arange(600, len(trajectory), int(every_s * 100))
    here = local_ned(
        trajectory.lat_rad[rows], trajectory.lon_rad[rows], trajectory.height_m[rows], ORIGIN
    )
    yaw = trajectory.rpy[rows, 2]
    side = np.where(np.arange(len(rows)) % 2 == 0, 1.0, -1.0) * lateral_m
    offset = np.column_stack([-np.sin(yaw) * side, np.cos(yaw) * side, np.full(len(rows), -2.2)])
    return Scene(here + offset, np.full(len(rows), 0.75), tuple(f"sign-{k % 3}" for k in rows))


def boxes(
    trajectory: Trajectory,
    scene: Scene,
    view: Camera,
    rng: np.random.Generator,
    noise_px: float = 1.0,
    interval_s: float = 0.2,
    range_m: tuple[float, float] = (5.0, 45.0),
) -> tuple[Detections, np.ndarray]:
    """What a perfect detector with noisy boxes sees, and the sign that each box shows.

    The frame stamps are earlier than the exposure by ``view.time_offset_s``.
    """
    from automap.earth import local_ned

    rows = np.arange(0, len(trajectory), int(interval_s * 100))
    body = local_ned(
        trajectory.lat_rad[rows], trajectory.lon_rad[rows], trajectory.height_m[rows], ORIGIN
    )
    found, owner = [], []
    for frame, (row, place) in enumerate(zip(rows, body, strict=True)):
        C_n_b = rpy_to_matrix(trajectory.rpy[row])
        centre = place + C_n_b @ view.lever_arm_m
        C_cam_n = (C_n_b @ rpy_to_matrix(view.mount_rpy)).T
        for k, sign in enumerate(scene.position):
            q = C_cam_n @ (sign - centre)
            if not range_m[0] < q[0] < range_m[1]:
                continue
            half = 0.5 * scene.size_m[k]
            up = np.array([0.0, 0.0, -half])
            corners = project(view, np.array([q + up, q - up]))
            middle = project(view, q[None])[0]
            height = corners[1, 1] - corners[0, 1]
            x, y = middle + rng.normal(0.0, noise_px, 2)
            if not (height < x < view.width - height and height < y < view.height - height):
                continue
            height *= 1.0 + rng.normal(0.0, 0.02)
            box = [x - height / 2, y - height / 2, x + height / 2, y + height / 2]
            stamp = trajectory.t_ns[row] - round(view.time_offset_s * 1e9)
            found.append((frame, stamp, scene.class_name[k], box))
            owner.append(k)
    return (
        Detections(
            frame=np.array([f[0] for f in found], np.int64),
            t_ns=np.array([f[1] for f in found], np.int64),
            class_name=np.array([f[2] for f in found], np.object_),
            box=np.array([f[3] for f in found], np.float64).reshape(-1, 4),
            score=np.full(len(found), 0.9),
            track=np.full(len(found), -1, np.int64),
        ),
        np.array(owner, np.int64),
    )
